"""Files by the program that they are for, and the lines that open them there."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from beds import some
from typer.testing import CliRunner

import exporters
from exporters import usd
from exporters.formats import FORMATS, find
from exporters.programs import PROGRAMS
from exporters.usd import UsdOptions
from grainsdem.cli import app
from grainsdem.dynamics import settle
from grainsdem.errors import InputError
from grainsdem.storage import save


@pytest.fixture(scope="module")
def few(fresh):
    return some(fresh, 12)


@pytest.mark.unit
@pytest.mark.parametrize("name", [name for name in PROGRAMS if name != "openfoam"])
def test_every_program_gets_its_format_and_lines_that_name_the_file(few, tmp_path, name):
    wanted = PROGRAMS[name]
    assert wanted.suffix in FORMATS[wanted.format].suffixes
    files = exporters.write(few, tmp_path / "bed", program=name)
    assert files[0] == tmp_path / f"bed{wanted.suffix}"
    lines = exporters.opening(few, files[0], name)
    assert 1 <= len(lines) <= 3
    assert any(files[0].stem in line for line in lines)
    assert "{" not in "".join(lines)
    find(wanted.format).module.Options(**wanted.options)


@pytest.mark.unit
def test_options_of_ones_own_go_before_those_of_the_program(few, tmp_path):
    [path] = exporters.write(few, tmp_path / "bed.usda", program="newton", units="mm")
    assert "metersPerUnit = 0.001" in path.read_text()
    [path] = exporters.write(few, tmp_path / "bed.xml", program="MJWARP")
    text = path.read_text()
    assert 'solver="Newton"' in text
    assert "autoreset" not in text


@pytest.mark.unit
def test_the_lines_have_step_and_gravity_in_units_of_the_file(few, tmp_path):
    exporters.write(few, tmp_path / "bed", program="pybullet")
    lines = exporters.opening(few, tmp_path / "bed.sdf", "pybullet")
    assert "setGravity(0, 0, -1)" in lines[1]
    assert "setTimeStep(0.01)" in lines[1]
    lines = exporters.opening(few, tmp_path / "bed.sdf", "pybullet", {"units": "si", "gravity": 1.62})
    assert "setGravity(0, 0, -1.62)" in lines[1]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("path", "options", "message"),
    [
        ("bed", {"program": "lbm"}, "lbm reads voxels: grainsdem voxels BED out.nrrd"),
        ("bed", {"program": "blendr"}, r"no program has the name 'blendr'; known are mujoco, .*, 3dec"),
        ("bed.stl", {"program": "newton"}, r"bed.stl: for newton a bed is written as usd, with the suffix .usdc, .*or"),
        ("bed", {"program": "newton", "format": "stl"}, "a program picks the format; got the program newton and"),
        ("bed", {"program": "newton", "formats": ["stl"]}, "a program picks the format; got the program newton and"),
        ("bed", {"program": "newton", "binary": True}, "has no option binary; it has friction"),
    ],
)
def test_what_does_not_go_with_a_program_is_refused(few, tmp_path, path, options, message):
    with pytest.raises(InputError, match=message):
        exporters.write(few, tmp_path / path, **options)
    assert not list(tmp_path.iterdir())


@pytest.mark.unit
def test_the_command_writes_and_tells_how_to_open(few, tmp_path):
    save(few, tmp_path / "bed.h5")
    run = CliRunner().invoke(app, ["export", str(tmp_path / "bed.h5"), str(tmp_path / "out"), "--for", "drake"])
    assert run.exit_code == 0, run.output
    assert f'Parser(plant).AddModels("{tmp_path / "out.sdf"}")' in run.output
    told = [*("export", str(tmp_path / "bed.h5"), str(tmp_path / "two")), "--for", "mjwarp", "--json"]
    run = CliRunner().invoke(app, told)
    assert json.loads(run.output)["open"] == exporters.opening(few, tmp_path / "two.xml", "mjwarp")
    run = CliRunner().invoke(app, [*told[:-1], "--to", "stl", "--force"])
    assert run.exit_code == 2
    assert "--for takes one output and no --to" in run.output


@pytest.mark.client
def test_the_lines_for_mujoco_run(few, tmp_path):
    import mujoco

    exporters.write(few, tmp_path / "bed", program="mujoco")
    names = {"mujoco": mujoco}
    exec("\n".join(exporters.opening(few, tmp_path / "bed.xml", "mujoco")), names)  # noqa: S102  (as a user would)
    assert names["data"].time == names["model"].opt.timestep


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.parametrize(
    ("name", "begin"),
    [
        (
            "drake",
            "from pydrake.all import *\nbuilder = DiagramBuilder()\n",
        ),
        ("pybullet", "import pybullet\n"),
    ],
)
def test_the_lines_for_drake_and_pybullet_run(few, tmp_path, name, begin):
    pytest.importorskip("pydrake" if name == "drake" else "pybullet")
    exporters.write(few, tmp_path / "bed", program=name)
    lines = begin + "\n".join(exporters.opening(few, tmp_path / "bed.sdf", name))
    command = [sys.executable, "-W", "ignore", "-c", lines]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stderr


@pytest.fixture(scope="module")
def rested(fresh):
    return settle(some(fresh, 60), friction=0.3, rng=1).packing


@pytest.mark.slow
@pytest.mark.programs
@pytest.mark.client
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("mjwarp", marks=pytest.mark.opens("mjcf", "MuJoCo Warp", "counted", "stepped", "at rest")),
        pytest.param("newton", marks=pytest.mark.opens("usd", "Newton", "at rest")),
    ],
)
def test_two_hundred_steps_by_those_lines_leave_a_bed_at_rest(rested, tmp_path, newton, name):
    files = exporters.write(rested, tmp_path / "bed", program=name)
    lines = exporters.opening(rested, files[0], name)
    script = Path(__file__).with_name("program_lines.py")
    command = [newton, str(script), name, json.dumps(lines), "200", str(tmp_path / "found.json")]
    run = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    found = json.loads((tmp_path / "found.json").read_text())
    # In grain units either way: of MuJoCo the median diameter is one; of USD the unit is as long, by its factor.
    d = 1.0 if name == "mjwarp" else usd.factors(rested, UsdOptions(units="grain"))["length"] / _diameter(rested)
    assert len(found["moved"]) == len(rested)
    assert np.mean(found["moved"]) < 2e-3 * d
    assert np.max(found["moved"]) < 0.05 * d
    if name == "mjwarp":
        assert 0 < found["contacts"] < 20 * len(rested)


def _diameter(packing):
    return exporters.mjcf.units(packing).length
