from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest
from auditing import installed, judged
from packaging.requirements import Requirement

pytestmark = pytest.mark.packaging

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    """The wheel, built from the sources and unpacked away from them."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        str(ROOT),
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--disable-pip-version-check",
        "-q",
        "-w",
        str(folder),
    ]
    subprocess.run(pip, check=True)
    (wheel,) = folder.glob("grainsdem-*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


def python(code, site, **options):
    """Run code with the unpacked wheel first on the path and the sources out of sight."""
    environment = {**os.environ, "PYTHONPATH": str(site)}
    command = [sys.executable, "-P", "-c", code]
    return subprocess.run(command, env=environment, cwd=site, capture_output=True, text=True, check=True, **options)


def test_one_wheel_holds_both_packages_the_example_and_the_types(unpacked):
    for name in ("grainsdem/cli/__init__.py", "exporters/mjcf/__init__.py", "grainsdem/angular_sand.toml"):
        assert (unpacked / name).is_file()
    assert (unpacked / "grainsdem" / "py.typed").is_file()
    assert not (unpacked / "tests").exists()


def test_the_wheel_alone_imports_both_packages(unpacked):
    result = python("import grainsdem, exporters; print(grainsdem.__file__, exporters.__file__)", unpacked)
    assert result.stdout.count(str(unpacked)) == 2


def test_the_wheel_alone_has_the_command_line(unpacked):
    result = python(
        "import sys; sys.argv = ['grainsdem', '--version']; from grainsdem.cli import main; main()", unpacked
    )
    assert result.stdout.startswith("grainsdem 0.")


def test_importing_grainsdem_loads_nothing_heavy(unpacked):
    heavy = "{'mujoco', 'pxr', 'trimesh', 'matplotlib', 'pyvista', 'manifold3d', 'numba', 'scipy'}"
    result = python(f"import sys, grainsdem; print(sorted({heavy} & set(sys.modules)))", unpacked)
    assert result.stdout.strip() == "[]"


def test_every_public_name_can_be_had(unpacked):
    code = "import grainsdem; [getattr(grainsdem, name) for name in grainsdem.__all__]; print(len(grainsdem.__all__))"
    assert int(python(code, unpacked).stdout) > 40


def bill_of(site):
    """Return the path of the bill of materials in an unpacked wheel."""
    (path,) = site.glob("grainsdem-*.dist-info/sboms/*.cdx.json")
    return path


def test_the_wheel_has_a_bill_of_what_it_needs_in_the_versions_that_are_allowed(unpacked):
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    bill = json.loads(bill_of(unpacked).read_text(encoding="utf-8"))
    ours = bill["metadata"]["component"]
    assert (bill["bomFormat"], bill["specVersion"]) == ("CycloneDX", "1.7")
    assert ours["name"] == "grainsdem"
    assert ours["licenses"][0]["license"]["id"] == told["license"]
    extras = [line for name in ("viz", "tables", "video", "images") for line in told["optional-dependencies"][name]]
    scopes = dict.fromkeys(extras, "optional") | dict.fromkeys(told["dependencies"], "required")
    found = {
        one["name"]: (set(one["versionRange"].removeprefix("vers:pypi/").split("|")), one["scope"])
        for one in bill["components"]
    }
    for need, scope in ((Requirement(line), scope) for line, scope in scopes.items()):
        assert found[need.name] == ({str(part) for part in need.specifier}, scope)
    assert set(bill["dependencies"][0]["dependsOn"]) == {one["bom-ref"] for one in bill["components"]}
    # What the bill calls complete: nothing of others is in the wheel.
    assert {path.name for path in unpacked.iterdir()} - {bill_of(unpacked).parents[1].name} == {
        "grainsdem",
        "exporters",
    }


SCHEMA = """
import sys
from pathlib import Path
from cyclonedx.schema import SchemaVersion
from cyclonedx.validation.json import JsonStrictValidator
fault = JsonStrictValidator(SchemaVersion.V1_7).validate_str(Path(sys.argv[1]).read_text(encoding="utf-8"))
sys.exit(fault and str(fault))
"""


@pytest.mark.client
def test_the_bill_is_what_the_schema_of_its_format_allows(environment, unpacked):
    python = environment("cyclonedx", "cyclonedx-python-lib[json-validation]>=11")
    subprocess.run([python, "-c", SCHEMA, bill_of(unpacked)], check=True, capture_output=True, text=True)


FLAW = {"id": "PYSEC-2026-1", "fix_versions": ["2.1"]}


@pytest.mark.unit
@pytest.mark.parametrize(
    ("code", "answer", "words", "ok", "line"),
    [
        (0, [{"name": "a", "version": "2", "vulns": []}], "", True, "1 packages audited, 0 known vulnerabilities"),
        (1, [{"name": "a", "version": "2", "vulns": [FLAW]}], "", False, "a 2: PYSEC-2026-1, mended in 2.1"),
        (0, [{"name": "a", "skip_reason": "not found"}], "", True, "nothing was audited"),
        (0, [{"name": "a", "skip_reason": ""}, {"name": "b", "version": "1", "vulns": []}], "", True, "not audited: a"),
        (1, None, "Traceback\nrequests.exceptions.ConnectionError: no name", True, "nothing was audited"),
        (2, None, "usage: pip-audit\nunknown option", False, "pip-audit gave no answer: unknown option"),
    ],
    ids=["clean", "known", "unknown", "partly", "unreachable", "broken"],
)
def test_what_is_known_against_a_dependency_fails_and_what_cannot_be_asked_is_said(code, answer, words, ok, line):
    text = "" if answer is None else json.dumps({"dependencies": answer, "fixes": []})
    found, lines = judged(code, text, words)
    assert found == ok
    assert lines[0].startswith(line)


def test_what_is_audited_holds_all_that_is_needed_at_first_and_second_hand():
    assert {"numpy", "numba", "llvmlite", "pillow", "pyarrow"} <= set(installed("grainsdem[all]"))


OLDEST = """
import sys
from grainsdem.cli import app

commands = [
    "generate bed.h5 --count 24 --keep all --porosity 0.4 -q",
    "validate bed.h5 -q",
    "measure bed.h5 --table grains.parquet -q",
    "export bed.h5 out --to mjcf --to usd --to stl --to obj --to vtk --to contacts",
    "info out/bed.xml", "info out/bed.usdc", "info out/bed.stl", "info out/bed.obj",
    "settle bed.h5 settled.h5 --max-time 1 -q",
    "voxels bed.h5 bed.tif --per-diameter 6 -q",
    "planform bed.h5 seen.png --per-diameter 8 -q",
    "render bed.h5 bed.png -q",
]
for command in commands:
    try:
        app(command.split(), standalone_mode=False)
    except SystemExit as end:
        if end.code:
            sys.exit(f"{command}: {end.code}")
"""


def oldest():
    """Return what asks pip for the oldest version allowed of all that a user's installation has."""
    told = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = (told["optional-dependencies"][name] for name in ("viz", "tables", "images"))
    lowest = [re.match(r"([\w.-]+)>=([\d.]+)", line).groups() for line in chain(told["dependencies"], *extras)]
    return [f"{name}=={version}.*" for name, version in lowest]


@pytest.mark.slow
@pytest.mark.programs
def test_the_oldest_versions_that_are_allowed_do_what_users_do_first(environment, tmp_path):
    python = environment("oldest", *oldest())
    settings = {**os.environ, "PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    done = subprocess.run(
        [python, "-c", OLDEST], cwd=tmp_path, env=settings, capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert {path.name for path in tmp_path.iterdir()} >= {
        "bed.h5",
        "settled.h5",
        "grains.parquet",
        "bed.tif",
        "bed.png",
    }
