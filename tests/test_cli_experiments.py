from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import cube_packing
from loading import grow
from typer.testing import CliRunner

from grainsdem.cli import app
from grainsdem.model import Domain
from grainsdem.storage import load, load_history, save

pytestmark = pytest.mark.client


@pytest.fixture(scope="module")
def bed(tmp_path_factory):
    return str(save(grow(27), tmp_path_factory.mktemp("bed") / "bed.h5"))


def run(*words, code=0):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result


@pytest.mark.slow
def test_a_collapse_writes_packing_history_and_figure(bed, tmp_path):
    result = run(
        "collapse", bed, tmp_path / "heap.h5", "--max-time", 1, "--history", tmp_path / "history.h5",
        "--figure", tmp_path / "heap.png", "--forces", tmp_path / "forces.csv", "--json",
    )  # fmt: skip
    assert (tmp_path / "forces.csv").read_text().startswith("i,j,gap,")
    told = json.loads(result.stdout)
    assert told["relative_run_out"] == pytest.approx(told["final_run_out"] / told["initial_run_out"] - 1)
    assert len(load(tmp_path / "heap.h5")) == 27
    assert load_history(tmp_path / "history.h5")["run_out"][-1] == pytest.approx(told["final_run_out"])
    assert (tmp_path / "heap.png").stat().st_size > 1000


@pytest.mark.slow
def test_of_a_single_heap_is_said_that_it_is_one(bed, tmp_path):
    result = run("collapse", bed, tmp_path / "heap.h5", "--max-time", 0.4)
    assert "repose angle fit error" in result.stdout
    assert "A single run is one heap" in result.stdout
    assert "bins of a diameter long" in result.stderr


def test_a_box_of_spheres_is_sheared_and_told_as_a_table(bed, tmp_path):
    result = run(
        "direct-shear", bed, tmp_path / "sheared.h5", "--displacement", 0.005, "--spheres", "--inertial-number", 0.1
    )
    assert "steady friction" in result.stdout
    assert "normal stress, Pa" in result.stdout


@pytest.mark.slow
def test_walls_have_friction_of_their_own_by_the_command_and_in_ensembles(bed, tmp_path):
    walls = {"floor": 0.6, "wall_x0": 0.0}
    words = "floor=0.6,wall_x0=0"
    run(
        "collapse", bed, tmp_path / "heap.h5", "--max-time", 0.2, "--wall-friction", words, "--restitution", 0.5,
        "--quiet",
    )  # fmt: skip
    made = json.loads(load(tmp_path / "heap.h5").provenance[-1])
    assert made["wall_friction"] == made["resting"]["wall_friction"] == walls
    assert made["resting"]["restitution"] == 0.5
    run("ensemble", "collapse", bed, "max_time=0.2", f"wall_friction={words}", "--seeds", 1, "--quiet")


@pytest.fixture(scope="module")
def one(tmp_path_factory):
    """A cube of a millimetre that lies on the floor."""
    cube = cube_packing([[2e-3, 2e-3, 0.5e-3]], half=0.5e-3, domain=Domain.cube(4e-3), density=2000.0)
    return str(save(cube, tmp_path_factory.mktemp("one") / "one.h5"))


@pytest.mark.slow
def test_a_body_is_dropped_and_told_with_its_force(one, tmp_path):
    result = run(
        "penetration", one, tmp_path / "hit.h5", "--start", "place", "--mode", "drop", "--body", "sphere",
        "--mass", 1e-5, "--figure", tmp_path / "hit.png", "--history", tmp_path / "history.h5", "--json",
    )  # fmt: skip
    told = json.loads(result.stdout)
    assert told["final_force"] == pytest.approx(9.81e-5, rel=0.01)
    assert told["stiffness"] is None
    assert load_history(tmp_path / "history.h5")["depth"][-1] == pytest.approx(told["final_depth"])
    assert (tmp_path / "hit.png").stat().st_size > 1000


FINGER = """<mujoco><worldbody><body name="finger" pos="0 0 2e-3"><joint name="press" type="slide" axis="0 0 1"/>
<geom type="sphere" size="0.5e-3"/></body></worldbody></mujoco>"""


def test_a_part_of_ones_own_is_driven_by_a_table_and_told(one, tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    (tmp_path / "down.csv").write_text("time,press:force\n0,0\n0.01,-1e-4\n0.04,-1e-4\n")
    result = run(
        "own-part", one, tmp_path / "touched.h5", "--start", "place", "--model", tmp_path / "finger.xml", "--motion",
        tmp_path / "down.csv", "--x", 2e-3, "--y", 2e-3, "--rest", 0, "--history", tmp_path / "history.h5",
    )  # fmt: skip
    assert "carried mass, kg" in result.stdout
    history = load_history(tmp_path / "history.h5")
    weight = 1000.0 * np.pi / 6 * 1e-9 * 9.81
    # The last sample but one ends before the table does.
    assert history["force_z"][-2] == pytest.approx(1e-4 + weight, rel=0.02)
    np.testing.assert_allclose(history["press_force"], history["force_z"], rtol=1e-6, atol=1e-9)
    assert '"model": "finger.xml"' in load(tmp_path / "touched.h5").provenance[-1]


@pytest.mark.slow
def test_an_ensemble_of_tilted_beds_is_told_with_its_interval(bed):
    result = run("ensemble", "tilt", bed, "rate=0.05", "max_angle=0.05", "spheres=true", "--seeds", 2, "--json")
    told = json.loads(result.stdout)
    assert told["seeds"] == [0, 1]
    assert told["largest_angle"]["mean"] == pytest.approx(0.05, abs=0.02)
    assert told["failure_angle"]["mean"] is None


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("triaxial", "--strain", 2), "strain: input should be less than 0.9; got 2.0"),
        (("triaxial", "--confining-pressure", 0), "confining_pressure"),
        (("shear",), "no such command 'shear'"),
        (("ring-shear", "--start", "place"), "no such option: --start"),
        (("collapse", "--release", "roof"), "release must name some of"),
        (("tilt", "--max-angle", 4), "max_angle"),
        (
            ("tilt", "--wall-friction", "roof=0.1"),
            "the container has no roof to have a wall_friction: its walls are floor",
        ),
        (
            ("tilt", "--wall-friction", "rough"),
            "wall_friction: must be zero or more and finite, or such numbers by name",
        ),
        (("tilt", "--restitution", 0.9), "restitution: input should be less than or equal to 0.7; got 0.9"),
        (("penetration", "--mode", "drop", "--depth", 1e-3), "depth is an option of mode 'press'"),
        (("own-part",), "model: missing; give the path of a file for MuJoCo with the part"),
        (("own-part", "--model", "nowhere.xml"), "nowhere.xml: no such file"),
        (("tilt", "--max-hours", 1e-9), "this takes too long: 27 grains: about"),
        (("tilt", "--figure", "curve.pdf"), "written as .png"),
        (("tilt", "--forces", "forces.txt"), "contacts are written as .csv, .parquet, .graphml or .vtp; got '.txt'"),
    ],
)
def test_bad_input_is_refused_in_one_line_and_nothing_is_written(bed, tmp_path, words, told):
    result = run(words[0], bed, tmp_path / "out.h5", *words[1:], code=2)
    assert told in result.stderr
    assert list(tmp_path.iterdir()) == []
