"""SDFormat: opened, weighed and stepped by Drake and by PyBullet, read by Gazebo's parser, each in its own process."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from importlib.util import find_spec

import numpy as np
import pytest
import trimesh
from beds import SIZES, check_golden, small_bed, two_grains, written
from conftest import cube_packing
from worlds import RULES, read_world

from exporters.units import units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import random_quaternions, to_matrices, world_vertices
from grainsdem.model import Domain

pytestmark = pytest.mark.client

DRAKE = """
import json, sys
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
path, step, n_steps = sys.argv[1], float(sys.argv[2]), int(sys.argv[3])
builder = DiagramBuilder()
plant, _ = AddMultibodyPlantSceneGraph(builder, step)
models = Parser(plant).AddModels(path)
plant.Finalize()
diagram = builder.Build()
context = diagram.CreateDefaultContext()
mine = plant.GetMyContextFromRoot(context)
query = plant.get_geometry_query_input_port().Eval(mine)
told = {"names": [plant.GetModelInstanceName(m) for m in models], "grains": []}
told["depths"] = [pair.depth for pair in query.ComputePointPairPenetration()]
bodies = [plant.get_body(plant.GetBodyIndices(m)[0]) for m in models[1:]]
def places():
    return [list(plant.EvalBodyPoseInWorld(mine, body).translation()) for body in bodies]
for body in bodies:
    inertia = body.default_spatial_inertia()
    turn = plant.EvalBodyPoseInWorld(mine, body).rotation().matrix()
    about = inertia.Shift(inertia.get_com()).CalcRotationalInertia().CopyToFullMatrix3()
    told["grains"].append([inertia.get_mass(), list(inertia.get_com()), turn.tolist(), about.tolist()])
told["before"] = places()
Simulator(diagram, context).AdvanceTo(step * n_steps)
told["after"] = places()
print(json.dumps(told))
"""

BULLET = """
import json, sys
import pybullet
path, step, n_steps, gravity = sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
pybullet.connect(pybullet.DIRECT)
ids = pybullet.loadSDF(path)
pybullet.setGravity(0, 0, -gravity)
pybullet.setTimeStep(step)
def places():
    return [pybullet.getBasePositionAndOrientation(i)[0] for i in ids[1:]]
told = {"names": [pybullet.getBodyInfo(i)[1].decode() for i in ids]}
told["masses"] = [pybullet.getDynamicsInfo(i, -1)[0] for i in ids]
told["before"] = places()
pybullet.performCollisionDetection()
told["depths"] = [-point[8] for point in pybullet.getContactPoints()]
for _ in range(n_steps):
    pybullet.stepSimulation()
told["after"] = places()
print("TOLD" + json.dumps(told))
"""


def with_wheels_of(module):
    """Mark a test that asks a module for which some machines have no wheels: there it is one of the other programs."""
    return pytest.mark.programs if find_spec(module) is None else pytest.mark.client


WITH_DRAKE, WITH_BULLET = with_wheels_of("pydrake"), with_wheels_of("pybullet")


def ask(module, script, *arguments):
    """Return what a script in a process of its own tells."""
    if find_spec(module) is None:
        pytest.skip(f"{module} is not installed: pip install {module.replace('pydrake', 'drake')}")
    command = [sys.executable, "-c", script, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr[-2000:]
    return json.loads(result.stdout.split("TOLD")[-1]), result.stderr


@WITH_DRAKE
@pytest.mark.parametrize("diameter", SIZES)
@pytest.mark.opens("sdf", "Drake", "counted", "weighed", "stepped")
def test_drake_holds_every_grain_with_its_mass_and_inertia_and_steps_it_in_si(tmp_path, diameter):
    bed = replace(small_bed(diameter), links=None)
    bed = replace(bed, quaternions=random_quaternions(len(bed), np.random.default_rng(9)))
    # Turned in place they would overlap: lifted apart.
    middle = bed.positions.mean(axis=0)
    bed = replace(bed, positions=middle + 2 * (bed.positions - middle) + [0, 0, 3 * diameter])
    written(bed, tmp_path / "bed.sdf", walls="floor")
    step = 0.01 * np.sqrt(diameter / 9.81)
    told, warnings = ask("pydrake", DRAKE, tmp_path / "bed.sdf", step, 100)
    assert told["names"] == ["container", *(f"g{i:06d}" for i in range(len(bed)))]
    assert told["depths"] == []
    assert "ignored" not in warnings
    exact, matrices = integrate(bed.grains), to_matrices(bed.quaternions)
    for i, (mass, centre, turn, inertia) in enumerate(told["grains"]):
        assert mass == pytest.approx(exact.volumes[i] * 2650, rel=1e-11)
        assert np.abs(centre).max() < 1e-9 * diameter
        assert np.abs(turn - matrices[i]).max() < 1e-9
        assert np.abs(inertia - exact.inertias[i] * 2650).max() < 1e-9 * np.abs(inertia).max()
    assert np.abs(np.array(told["before"]) - bed.positions).max() < 1e-9 * diameter
    # One unit of time of free fall, in Drake's first-order steps.
    fallen = (np.array(told["before"]) - told["after"])[:, 2]
    assert fallen == pytest.approx(np.full(len(bed), diameter / 2), rel=0.02)


@WITH_DRAKE
def test_drake_finds_no_overlap_in_a_fresh_bed_and_lays_it_down_in_its_box(tmp_path):
    bed = small_bed(1e-3)
    written(bed, tmp_path / "bed.sdf")
    told, _ = ask("pydrake", DRAKE, tmp_path / "bed.sdf", 1e-4, 400)
    assert told["depths"] == []
    after = np.array(told["after"])
    assert (after[:, 2] < bed.positions[:, 2]).all()
    # Four units of time later all rest on the floor or on each other, none has sunk into the walls.
    assert after[:, 2].min() > 0.2e-3
    assert (after[:, :2] > bed.domain.lower[:2]).all()
    assert (after[:, :2] < bed.domain.upper[:2]).all()


@WITH_DRAKE
def test_drake_tells_overlap_where_there_is_some(tmp_path):
    written(cube_packing([[5, 5, 3], [5.2, 5.3, 4.9]], domain=Domain.cube(10.0)), tmp_path / "bed.sdf")
    told, _ = ask("pydrake", DRAKE, tmp_path / "bed.sdf", 1e-3, 0)
    assert told["depths"] == pytest.approx([0.1], rel=1e-3)


@WITH_BULLET
@pytest.mark.parametrize("diameter", SIZES)
@pytest.mark.opens("sdf", "PyBullet", "counted", "weighed", "stepped")
def test_pybullet_counts_weighs_and_steps_a_bed_of_any_size_in_grain_units(tmp_path, diameter):
    bed = small_bed(diameter)
    written(bed, tmp_path / "bed.sdf", units="grain")
    told, _ = ask("pybullet", BULLET, tmp_path / "bed.sdf", 0.01, 100, 1.0)
    scales = units(bed)
    assert told["names"] == ["container", *(f"g{i:06d}" for i in range(len(bed)))]
    masses = integrate(bed.grains).volumes * 2650 / scales.mass
    assert told["masses"] == pytest.approx([0.0, *masses], rel=1e-9)
    assert max(told["depths"], default=0) < 1e-6
    before, after = np.array(told["before"]), np.array(told["after"])
    assert np.abs(before * scales.length - bed.positions).max() < 1e-6 * diameter
    assert (after[:, 2] < before[:, 2]).all()
    assert after[:, 2].min() > 0.2
    assert (after[:, :2] * scales.length > bed.domain.lower[:2]).all()
    assert (after[:, :2] * scales.length < bed.domain.upper[:2]).all()


@WITH_DRAKE
def test_the_golden_world_is_weighed_by_drake(tmp_path):
    made = check_golden(two_grains(), "sdf", "two.sdf")
    for name, content in made.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(content)
    told, _ = ask("pydrake", DRAKE, tmp_path / "two.sdf", 1e-4, 10)
    masses, _, turns, inertias = zip(*told["grains"], strict=True)
    assert masses == pytest.approx([2500 * 48e-9, 2500 * 32e-9])
    assert np.diag(inertias[0]) == pytest.approx(np.array([52, 40, 20]) * 1e-6 / 12 * masses[0])
    assert np.abs(np.array(turns[1]) - [[0, -1, 0], [1, 0, 0], [0, 0, 1]]).max() < 1e-9


FAULTS = {
    "two of one name": ('<model name="g000001">', '<model name="g000000">'),
    "a reserved name": ('<model name="g000001">', '<model name="__model__">'),
    "a model without a link": ("<link ", "<!-- <link "),
    "a mass below zero": ("<mass>", "<mass>-"),
    "a moment larger than the others' sum": ("<ixx>", "<ixx>1"),
    "a pose of five numbers": ("<pose>0 0 0 ", "<pose>0 0 "),
}
"""Ways to spoil a world, each refused by our reader and by Gazebo's parser."""

OUR_FAULTS = {
    "an element that there is not": ("<mass>", "<weight>1</weight><mass>"),
    "no geometry": ("<geometry><mesh><uri>two-meshes/g000000.obj</uri><drake:declare_convex/></mesh></geometry>", ""),
    "one twice": ("<mass>", "<mass>1</mass><mass>"),
    "a mesh that is nowhere": ("g000001.obj", "g000009.obj"),
    "a number that is none": ("<mass>", "<mass>nan "),
    "a moment left out": ("<iyz>0</iyz>", ""),
    "an attribute that there is not": ("<model ", '<model colour="red" '),
}
"""Ways that only our reader refuses; Gazebo's warns, or puts what it likes in their place."""


def spoilt(folder, old, new):
    """Write the golden pair's world with a fault and return its path."""
    path = folder / "two.sdf"
    written(two_grains(), path)
    text = path.read_text()
    assert old in text
    text = text.replace("<!-- 2 grains", "<!-- two grains").replace(old, new)
    path.write_text(text.replace("</link>", "</link> -->") if new.endswith("<!-- <link ") else text)
    return path


@pytest.mark.parametrize("unit", ["si", "grain"])
@pytest.mark.parametrize("diameter", SIZES)
def test_worlds_keep_the_rules_of_the_format(tmp_path, diameter, unit):
    bed = replace(small_bed(diameter), classes=np.arange(15) % 3)
    written(bed, tmp_path / "bed.sdf", units=unit)
    models = read_world(tmp_path / "bed.sdf")
    assert list(models) == ["container", *(f"g{i:06d}" for i in range(15))]
    scale = units(bed).mass if unit == "grain" else 1.0
    masses = [float(models[f"g{i:06d}"].findtext("link/inertial/mass")) * scale for i in range(15)]
    assert masses == pytest.approx(integrate(bed.grains).volumes * 2650)
    for choice, count in (("floor", 16), ("none", 15)):
        written(bed, tmp_path / "bed.sdf", units=unit, walls=choice)
        assert len(read_world(tmp_path / "bed.sdf")) == count


@pytest.mark.parametrize("fault", [*FAULTS, *OUR_FAULTS])
def test_the_reader_sees_every_fault(tmp_path, fault):
    path = spoilt(tmp_path, *(FAULTS | OUR_FAULTS)[fault])
    with pytest.raises((AssertionError, ValueError)):
        read_world(path)


def asked(program, *arguments):
    """Return what Gazebo's parser of SDFormat says: its exit status, output and complaints."""
    command = [program("ign", "libsdformat-dev ignition-tools"), "sdf", *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    complaints = [line for line in run.stderr.splitlines() if line and "backtrace generation" not in line]
    return run.returncode, run.stdout, complaints


@pytest.mark.parametrize("unit", ["si", "grain"])
@pytest.mark.parametrize("diameter", SIZES)
@pytest.mark.opens("sdf", "Gazebo's parser", "counted", "weighed")
def test_gazebo_s_parser_finds_a_world_valid_and_reads_every_grain(program, tmp_path, diameter, unit):
    bed = small_bed(diameter)
    written(bed, tmp_path / "bed.sdf", units=unit)
    assert asked(program, "--check", tmp_path / "bed.sdf") == (0, "Valid.\n", [])
    status, text, complaints = asked(program, "--print", tmp_path / "bed.sdf")
    assert (status, complaints) == (0, [])
    models = {model.get("name"): model for model in ET.fromstring(text).iter("model")}  # noqa: S314  (our own file)
    scale = units(bed).mass if unit == "grain" else 1.0
    masses = [float(models[f"g{i:06d}"].findtext("link/inertial/mass")) * scale for i in range(15)]
    assert masses == pytest.approx(integrate(bed.grains).volumes * 2650, rel=1e-5)  # it prints six digits
    assert len(models) == 16


@pytest.mark.parametrize("fault", FAULTS)
def test_gazebo_s_parser_refuses_what_our_reader_refuses(program, tmp_path, fault):
    status, said, complaints = asked(program, "--check", spoilt(tmp_path, *FAULTS[fault]))
    assert (status, said) != (0, "Valid.\n") or complaints


def test_our_rules_are_those_of_the_specification(program):
    status, text, _ = asked(program, "--describe", "1.9")
    assert status == 0
    seen = set()

    def compare(element, tag):
        rule = RULES[tag]
        assert element.get("type") == rule.value, tag
        assert set(rule.attributes) <= {child.get("name") for child in element.findall("attribute")}, tag
        known = {child.get("name"): child for child in element.findall("element")}
        for name, often in rule.children.items():
            assert known[name].get("required") == often, f"{name} in {tag}"
            compare(known[name], name)
        seen.add(tag)

    compare(ET.fromstring(text), "sdf")  # noqa: S314  (the program's own words)
    assert seen == set(RULES)


def world_of(path):
    return ET.fromstring(path.read_text()).find("world")  # noqa: S314  (our own file)


@pytest.mark.parametrize(("unit", "length"), [("si", 1.0), ("mm", 1e-3), (0.01, 0.01), ("grain", None)])
def test_units_are_those_that_were_asked_for_in_the_world_and_in_its_meshes(tmp_path, unit, length):
    bed = small_bed(1e-3)
    length = length or units(bed).length
    written(bed, tmp_path / "bed.sdf", units=unit)
    world = world_of(tmp_path / "bed.sdf")
    pose = world.find("model[@name='g000003']/pose").text.split()
    assert np.allclose(np.array(pose[:3], float) * length, bed.positions[3], rtol=1e-9)
    mesh = trimesh.load(tmp_path / "bed-meshes" / "g000003.obj", process=False)
    assert mesh.is_watertight
    assert mesh.volume * length**3 == pytest.approx(integrate(bed.grains).volumes[3], rel=1e-7)


def test_poses_turn_vertices_to_where_they_are_even_where_x_points_up(tmp_path):
    up = np.array([[np.sqrt(0.5), 0, -np.sqrt(0.5), 0], [0.5, 0.5, 0.5, 0.5]])
    bed = replace(two_grains(), quaternions=up)
    written(bed, tmp_path / "bed.sdf")
    world = world_of(tmp_path / "bed.sdf")
    ours, offsets = world_vertices(bed), bed.grains.vertex_offsets
    for i in range(2):
        x, y, z, roll, pitch, yaw = map(float, world.find(f"model[@name='g{i:06d}']/pose").text.split())
        turn = trimesh.transformations.euler_matrix(roll, pitch, yaw, "sxyz")[:3, :3]
        seen = bed.grains.vertices_of(i) @ turn.T + [x, y, z]
        assert np.abs(seen - ours[offsets[i] : offsets[i + 1]]).max() < 1e-12


@pytest.mark.parametrize(
    ("options", "match"), [({"units": "inch"}, "units"), ({"units": 0.0}, "units"), ({"depth": -1.0}, "depth")]
)
def test_options_out_of_range_are_refused(tmp_path, options, match):
    with pytest.raises(InputError, match=match):
        written(two_grains(), tmp_path / "bed.sdf", **options)
    assert list(tmp_path.iterdir()) == []
