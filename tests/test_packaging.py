from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
import zipfile
from itertools import chain
from pathlib import Path

import pytest

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
