from __future__ import annotations

import os
import subprocess
import sys
import zipfile
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
