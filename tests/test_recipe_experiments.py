from __future__ import annotations

import json
import pickle

import pytest
import trimesh

from grainsdem.errors import InputError
from grainsdem.recipe import make, read, run
from grainsdem.recipe.experiments import experiment_tables
from grainsdem.storage import load, load_history

BED = {"domain": {"side": 3e-3}, "seeds": {"count": 27}, "grains": {"porosity": 0.4}}


@pytest.mark.client
def test_a_recipes_experiments_are_run_and_written(tmp_path):
    tables = {
        **BED,
        "triaxial": {"strain": 0.01, "inertial_number": 0.1, "spheres": True},
        "collapse": {"max_time": 0.5, "seeds": 2, "wall_friction": {"floor": 0.6}},
        "output": {"formats": [], "figures": True, "forces": ["vtp", "png"]},
    }
    result = run(make(**tables), tmp_path)
    told = json.loads((tmp_path / "summary.json").read_text())
    assert told["triaxial"]["is_compressed"] in (True, False)
    assert told["triaxial"]["inertial_number"] == 0.1
    assert told["collapse"]["seeds"] == [0, 1]
    assert set(load_history(tmp_path / "collapse" / "1.h5")) >= {"time", "run_out"}
    assert load(tmp_path / "triaxial.h5").provenance[-1].count("triaxial")
    names = {path.name for path in result.files}
    assert {"triaxial_forces.vtp", "triaxial_forces.png"} <= names
    assert {"triaxial.h5", "triaxial_history.h5", "triaxial.png", "0.h5", "1.h5"} <= names
    assert all(path.exists() for path in result.files)


@pytest.mark.client
def test_a_recipes_parts_lie_beside_it(tmp_path):
    (tmp_path / "files").mkdir()
    (tmp_path / "files" / "rod.xml").write_text(
        '<mujoco><worldbody><body name="rod" pos="0.5e-3 0.5e-3 0"><joint name="down" type="slide" axis="0 0 1"/>'
        '<geom type="sphere" size="0.2e-3"/></body></worldbody></mujoco>'
    )
    (tmp_path / "files" / "down.csv").write_text("time,down\n0,0\n0.01,-1e-4\n")
    trimesh.creation.icosahedron().export(tmp_path / "files" / "stone.stl")
    recipe = tmp_path / "bed.toml"
    recipe.write_text("""
        [domain]
        side = 2e-3
        [seeds]
        count = 8
        [grains]
        porosity = 0.4
        keep = "all"
        [penetration]
        mesh = "files/stone.stl"
        scale = 0.4e-3
        mode = "drop"
        max_time = 1.0
        start = "place"
        [own_part]
        model = "files/rod.xml"
        motion = "files/down.csv"
        z = 2.5e-3
        rest = 0.0
        start = "place"
        [output]
        formats = []
        figures = false
    """)
    wanted = read(recipe)
    assert wanted.experiments()["own_part"].options()["motion"] == str(tmp_path / "files" / "down.csv")
    run(wanted, tmp_path / "made")
    told = json.loads((tmp_path / "made" / "summary.json").read_text())
    assert told["penetration"]["work"] > 0
    assert load_history(tmp_path / "made" / "own_part_history.h5")["down"][-1] == pytest.approx(-1e-4, rel=0.05)
    last = load(tmp_path / "made" / "penetration.h5").provenance[-1]
    assert '"mesh": "stone.stl"' in last
    assert str(tmp_path) not in last


@pytest.mark.unit
def test_a_recipe_without_experiments_tells_nothing_of_them():
    told = make(**BED).model_dump(mode="json")
    assert not set(experiment_tables()) & set(told)
    assert make(**{**BED, "tilt": {}}).model_dump()["tilt"]["rate"] == 0.01


@pytest.mark.unit
@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({"triaxial": {"strain": 1.5}}, "triaxial.strain"),
        ({"triaxial": {"stress": 1.0}}, "unknown key; allowed are"),
        ({"shear": {"kind": "box"}}, r"shear: no such table; a ring is \[ring_shear\], a box"),
        ({"direct_shear": {"inner_radius": 1e-3}}, "direct_shear.inner_radius: unknown key; allowed are start, seeds"),
        ({"ring_shear": {"start": "place"}}, "ring_shear: ring_shear always sets grains apart"),
        ({"tap": {"taps": 1.5}}, "tap.taps: input should be a valid integer; got 1.5"),
        ({"tilt": {"friction": True}}, "tilt.friction: input should be a valid number; got True"),
        ({"tilt": {"max_angle": 3.0}}, "tilt.max_angle"),
        ({"tilt": {"wall_friction": {"floor": -1.0}}}, "tilt.wall_friction: must be zero or more and finite, or such"),
        ({"collapse": {"seeds": 3, "start": "place"}}, "several seeds"),
        ({"collapse": {"release": []}}, "collapse.release"),
    ],
)
def test_what_an_experiment_cannot_be_is_refused_by_its_key(table, words):
    with pytest.raises(InputError, match=words):
        make(**BED, **table)


@pytest.mark.unit
def test_a_recipe_with_experiments_is_the_same_through_pickle():
    wanted = make(**BED, tilt={"rate": 0.02}, ring_shear={"strain": 0.5, "seeds": 3})
    again = pickle.loads(pickle.dumps(wanted))  # noqa: S301  (our own)
    assert again == wanted
    assert again.model_dump() == wanted.model_dump()
    assert again.experiments()["tilt"].experiment is wanted.experiments()["tilt"].experiment
    assert again.model_fields_set == wanted.model_fields_set
