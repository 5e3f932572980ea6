"""Bodies and parts that go into a bed: their shapes and files, how they are driven, and how they are told."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from conftest import cube_packing
from loading import check_that_it_goes_on

from exporters import mjcf
from grainsdem.dynamics import own_part, penetration
from grainsdem.dynamics.engine import Contacts
from grainsdem.dynamics.experiments import registry
from grainsdem.dynamics.experiments.parts.gauge import exerted
from grainsdem.dynamics.experiments.parts.joined.driving import table_driver
from grainsdem.dynamics.experiments.parts.joined.fragment import read_fragment
from grainsdem.dynamics.experiments.parts.meshes import read_hulls
from grainsdem.dynamics.experiments.parts.pushed.bodies import make_body, read_body
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.model import Domain

BOX = Domain.box((9.0, 6.0, 12.0))
SLAB = Domain.slab((9.0, 6.0), 2.0)


@pytest.mark.unit
def test_bodies_have_the_volumes_of_their_shapes_and_fit_a_third_of_the_box():
    assert make_body("plate", BOX).volume == pytest.approx(8.0)
    assert make_body("plate", BOX, width=1.0, thickness=0.5).volume == pytest.approx(0.5)
    assert make_body("sphere", BOX).volume == pytest.approx(np.pi * 8 / 6)
    assert make_body("cone", BOX, apex_angle=np.pi / 2).volume == pytest.approx(np.pi / 3)
    wheel = make_body("wheel", BOX)
    assert wheel.volume == pytest.approx(np.pi * 1.125**2 * 2.0)
    np.testing.assert_allclose(wheel.half, [1.125, 1.0, 1.125])
    assert make_body("cone", SLAB, width=2.0, apex_angle=np.pi / 2).volume == pytest.approx(2.0)
    assert make_body("wheel", SLAB, width=2.0).volume == pytest.approx(2 * np.pi)


@pytest.mark.unit
def test_each_piece_of_a_mesh_is_a_convex_body_in_the_middle_of_the_whole(tmp_path, caplog):
    one = trimesh.creation.box((1.0, 2.0, 3.0))
    two = trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((2.0, 0.0, 0.0))
    (one + two).export(tmp_path / "two.stl")
    body = read_body(str(tmp_path / "two.stl"), BOX, scale=0.5)
    assert [len(shape.numbers) for shape in body.shapes] == [8, 8]
    assert body.volume == pytest.approx((6.0 + 1.0) / 8)
    np.testing.assert_allclose(body.half, [0.75, 0.5, 0.75])
    corners = np.vstack([shape.numbers for shape in body.shapes])
    np.testing.assert_allclose(corners.min(axis=0), -corners.max(axis=0), atol=1e-7)
    assert not caplog.records


@pytest.mark.unit
def test_a_mesh_with_a_hollow_is_taken_as_its_hull_with_a_warning(tmp_path, caplog):
    notch = trimesh.creation.box((2.0, 2.0, 2.0)).apply_translation((1.0, 1.0, 0.0))
    corner = trimesh.boolean.difference([trimesh.creation.box((2.0, 2.0, 1.0)), notch])
    corner.export(tmp_path / "corner.obj")
    with caplog.at_level(logging.WARNING):
        (hull,) = read_hulls(tmp_path / "corner.obj")
    assert len(hull) == 10
    assert "corner.obj: not convex; it collides as the convex hull" in caplog.text


@pytest.mark.unit
def test_the_force_on_a_part_is_that_of_grains_and_container_but_not_of_its_own_pieces():
    forces = np.array([[0.0, 0.0, -2.0], [1.0, 0.0, 0.0], [0.0, 5.0, 0.0]])
    contacts = Contacts(
        np.array([[-2, 7], [-3, -2], [-3, -2]]), np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 0.0]]),
        np.zeros((3, 3)), forces, np.zeros(3), np.zeros(3),
    )  # fmt: skip
    force, moment = exerted(contacts, [1])
    np.testing.assert_allclose(force, [1.0, 5.0, 2.0])
    np.testing.assert_allclose(moment, [0.0, 2.0 - 2.0, 0.0])
    np.testing.assert_allclose(exerted(contacts, [1], about=(0.0, 0.0, 2.0))[1], [10.0, -2.0, 0.0])
    np.testing.assert_allclose(exerted(contacts, [1, 2])[0], [0.0, 0.0, 2.0])


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"width": 4.0}, "width of the plate is 4 m; it must be below 4 m, the box's"),
        ({"body": "wheel", "thickness": 5.0}, "thickness of the wheel is 5 m"),
        ({"body": "plate", "mode": "roll"}, "mode 'roll' takes a wheel, or a mesh; got body 'plate'"),
        ({"mode": "drop", "depth": 1.0}, "depth is an option of mode 'press'; got mode 'drop'"),
        ({"mass": 1.0}, "mass is an option of mode 'drop' and 'roll'; got mode 'press'"),
        ({"depth": 9.0}, "depth must be below 4 m"),
        ({"body": "wheel", "mode": "roll", "slip": 0.1, "forward_speed": 1.0}, "slip and forward_speed"),
        ({"body": "wheel", "mode": "roll", "travel": 3.0}, "travel must be at most 0 m, what the box leaves"),
        ({"speed": 200.0}, "speed is 200 m/s; .* m/s, 20 √.g d., can be simulated"),
        ({"mode": "drop", "height": 1e4}, "the fall's speed is 442.* can be simulated"),
        (
            {"body": "wheel", "mode": "roll", "width": 0.5, "travel": 0.01, "angular_speed": 1e3},
            "travel must be at most",
        ),
        ({"body": "ball"}, "body: input should be 'plate', 'cone', 'sphere' or 'wheel'; got 'ball'"),
        ({"mode": "roll", "body": "wheel", "slip": 1.5}, "slip"),
        ({"mesh": "nowhere.stl"}, r"nowhere\.stl: no such file"),
        ({"mesh": "body.step"}, r"a body's mesh is \.stl or \.obj; got '.step'"),
        ({"apex_angle": 4.0}, "apex_angle"),
    ],
)
def test_what_a_body_cannot_be_or_do_is_refused_in_one_line(cube, options, words):
    with pytest.raises((InputError, MissingFileError, FileFormatError), match=words) as caught:
        penetration(cube, **options)
    assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_a_file_that_is_no_mesh_and_a_mesh_in_a_plane_are_refused(tmp_path):
    (tmp_path / "empty.obj").write_text("# nothing\n")
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FileFormatError, match=r"empty\.obj: "):
        read_hulls(tmp_path / "empty.obj")
    with pytest.raises(FileFormatError, match=r"flat\.obj: a piece of 3 corners"):
        read_hulls(tmp_path / "flat.obj")
    with pytest.raises(InputError, match="a planar bed takes a plate, cone, sphere or wheel"):
        read_body("any.stl", SLAB)


PART = """<mujoco>
  <compiler angle="degree"/>
  <default><geom density="2000"/></default>
  <worldbody>
    <geom name="post" type="box" size="0.1 0.1 0.1" pos="0.5 0.5 3.5"/>
    <body name="arm" pos="0 0 2">
      <joint name="slide" type="slide" axis="1 0 0" stiffness="3" springref="0.1" damping="0.5" range="-1 1"/>
      <geom type="box" size="0.1 0.2 0.3"/>
      <body name="hand" pos="0.5 0 0">
        <joint name="turn" axis="0 1 0" range="-90 45" stiffness="2" armature="0.25"/>
        <geom type="sphere" size="0.1" mass="7" contype="0" conaffinity="0"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.5" size="0.05"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def part(tmp_path):
    path = tmp_path / "part.xml"
    path.write_text(PART)
    return str(path)


@pytest.mark.unit
def test_a_part_is_the_same_in_grain_units_as_mujoco_makes_it_in_si(part, cube):
    import mujoco

    from grainsdem.dynamics.scene import equip

    fragment, units = read_fragment(part), mjcf.units(cube, 3.0)
    apparatus = equip(cube, mjcf.MjcfOptions(gravity=3.0))
    elements, _ = fragment.elements(units, (1.0, 0.0, 0.0), {}, None)
    apparatus.add_elements(elements)
    ours, theirs = mujoco.MjModel.from_xml_string(apparatus.text()), mujoco.MjModel.from_xml_path(part)
    for name in ("arm", "hand"):
        a, b = ours.body(name), theirs.body(name)
        assert a.mass * units.mass == pytest.approx(b.mass, rel=1e-9)
        np.testing.assert_allclose(a.inertia * units.inertia, b.inertia, rtol=1e-9)
    np.testing.assert_allclose(ours.body("hand").pos * units.length, [0.5, 0.0, 0.0], rtol=1e-9)
    np.testing.assert_allclose(ours.body("arm").pos * units.length, [1.0, 0.0, 2.0], rtol=1e-9)
    slide, turn = ours.joint("slide"), ours.joint("turn")
    assert np.ravel(slide.stiffness)[0] * units.force / units.length == pytest.approx(3.0, rel=1e-9)
    assert np.ravel(slide.damping)[0] * units.force / units.velocity == pytest.approx(0.5, rel=1e-9)
    assert np.ravel(turn.stiffness)[0] * units.energy == pytest.approx(2.0, rel=1e-9)
    assert turn.armature[0] * units.inertia == pytest.approx(0.25, rel=1e-9)
    np.testing.assert_allclose(slide.range * units.length, [-1.0, 1.0], rtol=1e-9)
    np.testing.assert_allclose(turn.range, np.radians([-90.0, 45.0]), rtol=1e-9)
    assert ours.geom("post").size[0] * units.length == pytest.approx(0.1, rel=1e-9)
    # What cannot be touched weighs, and is not there otherwise.
    assert [ours.geom_bodyid.tolist().count(ours.body(name).id) for name in ("arm", "hand")] == [1, 1]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        ('type="box" size="0.1 0.2 0.3"', 'type="bocks"', r"part.xml:8: MuJoCo refuses the part: XML Error.*bocks"),
        ('type="box" size="0.1 0.2 0.3"', 'type="mesh" mesh="no"', r"part.xml:8: .*mesh 'no' not found"),
        ("</mujoco>", "", r"part.xml.*: MuJoCo refuses the part: XML parse error"),
        ("mujoco", "body", "part.xml: MuJoCo refuses the part: .*Unrecognized XML model type"),
        ("</mujoco>", '<actuator><motor joint="turn"/></actuator></mujoco>', "actuators are not taken over"),
        ('name="arm"', 'name="floor"', "the body 'floor' has the name of a part of the scene"),
        ('name="arm"', 'name="g000000"', "the body 'g000000' has the name of a part of the scene"),
        ('name="post"', 'name="wall_x0"', "the geom 'wall_x0' has the name of a part of the scene"),
        ('pos="0 0 2"', 'pos="2 2 2"', r"arm and g000000 overlap by .* d, .* m; move the part \(x, y, z\)"),
    ],
)
def test_a_part_that_cannot_be_joined_is_refused_in_one_line_and_nothing_is_written(
    cube, part, tmp_path, before, after, words
):
    (tmp_path / "part.xml").write_text(PART.replace(before, after))
    with pytest.raises((InputError, FileFormatError), match=words) as caught:
        own_part(cube, model=part, duration=1.0, history_path=tmp_path / "history.h5")
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["part.xml"]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("", "the first line must be 'time' and the names of joints"),
        ("time,slide,slide\n0,0,0\n1,1,1\n", "each once"),
        ("time,slide\n0,0\n", "two or more"),
        ("time,slide\n0.5,0\n1,0\n", "time must begin at 0"),
        ("time,slide\n0,0\n1,a\n", r"motion.csv:3: could not convert string to float: 'a'"),
        ("time,slide\n0,0\n1,nan\n", r"motion.csv:3: 2 finite numbers are needed"),
        ("time,slide:pace\n0,0\n1,1\n", "'slide:pace' must end in :position, :speed or :force"),
        ("time,lift\n0,0\n1,1\n", "there is no joint 'lift' that slides or turns; there are slide, turn"),
        ("time,slide\n0,1\n1,1\n", "slide begins at 1 m, but the part is at 0 m"),
        ("time,slide\n0,0\n0.01,1\n", r"slide goes at 100 m/s; .* can be simulated"),
    ],
)
def test_a_table_that_cannot_drive_is_refused_in_one_line(cube, part, tmp_path, table, words):
    path = tmp_path / "motion.csv"
    path.write_text(table)
    with pytest.raises((InputError, FileFormatError), match=words) as caught:
        own_part(cube, model=part, motion=str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"model": None}, "model: missing"),
        ({"model": "none.xml"}, "none.xml: no such file"),
        ({}, "duration: missing"),
        ({"drive": lambda _time, _state: {"lift": 0.0}, "duration": 1.0}, "there is no joint 'lift'"),
        ({"drive": lambda _time, _state: 3.0, "duration": 1.0}, "must return a mapping of joints to numbers; got 3.0"),
        ({"drive": lambda _time, _state: {"slide": np.nan}, "duration": 1.0}, "must return finite numbers"),
        ({"drive": lambda _time, _state: {}, "motion": "a.csv"}, "give one of them"),
    ],
)
def test_what_drives_no_part_is_refused_in_one_line(cube, part, options, words):
    with pytest.raises((InputError, MissingFileError), match=words):
        own_part(cube, **{"model": part, **options})


@pytest.mark.unit
def test_a_table_is_interpolated_and_each_column_may_say_what_it_is(tmp_path):
    path = tmp_path / "motion.csv"
    path.write_text("time, slide, turn:force\n0, 0, 1\n\n2, 4, 2\n")
    driver = table_driver(str(path), "speed")
    assert driver.controls == {"slide": "speed", "turn": "force"}
    assert driver.end == 2.0
    assert driver.ask(0.5, None) == {"slide": 1.0, "turn": 1.25}


@pytest.fixture(scope="module")
def aside():
    """One cube of edge 2 in the corner of a wide box, at rest."""
    return cube_packing([[1.05, 1.05, 1.0]], domain=Domain.box((12.0, 12.0, 8.0)))


@pytest.mark.client
@pytest.mark.parametrize("body", ["plate", "sphere"])
def test_a_body_that_lies_on_the_floor_presses_with_its_weight(aside, body):
    report = penetration(aside, body=body, mode="drop", mass=50.0, height=0.5, width=3.0).report
    assert report.at_rest
    assert report.final_force == pytest.approx(50.0 * 9.81, rel=0.01)
    assert report.floor_distance == pytest.approx(0.0, abs=0.02)
    assert abs(report.force_along_x) + abs(report.force_along_y) < 1e-3 * report.final_force
    assert not report.is_valid
    assert "the floor was" in report.reason


@pytest.mark.client
def test_a_body_that_lies_on_a_grain_presses_with_its_weight_and_lost_what_it_had_on_the_way():
    bed = cube_packing([[6.0, 6.0, 1.0]], domain=Domain.box((12.0, 12.0, 8.0)))
    outcome = penetration(bed, body="plate", mode="drop", mass=20.0, height=1.0, width=3.0, friction=0.3)
    report, history = outcome.report, outcome.history
    assert report.at_rest
    assert report.final_force == pytest.approx(20.0 * 9.81, rel=0.01)
    assert report.final_depth == pytest.approx(0.0, abs=0.02)
    # It fell by 1 m onto what did not give way: all that it had is gone.
    assert report.work == pytest.approx(20.0 * 9.81 * 1.0, rel=0.05)
    touching = history["force_z"] > 0
    assert not touching[history["stage"] == 0.0].any()


@pytest.mark.client
def test_a_part_on_a_spring_swings_as_in_si(aside, tmp_path):
    """x = a (1 − cos ωt) from rest, ω² = k/m: 3 N/m and 0.048 kg, a = 0.1 m."""
    path = tmp_path / "swing.xml"
    path.write_text(
        '<mujoco><worldbody><body name="bob" pos="6 6 6">'
        '<joint name="x" type="slide" axis="1 0 0" stiffness="3" springref="0.1"/>'
        '<geom type="box" size="0.1 0.2 0.3" density="1"/></body></worldbody></mujoco>'
    )
    outcome = own_part(aside, model=str(path), duration=1.0, rest=0.0, time_step=0.002)
    omega = np.sqrt(3.0 / 0.048)
    expected = 0.1 * (1 - np.cos(omega * outcome.history["time"]))
    # The bed's own time goes by meanwhile: nobody holds what is not driven.
    np.testing.assert_allclose(outcome.history["x"], expected, atol=0.004)


@pytest.mark.client
def test_joints_do_what_a_function_says_in_si(aside, part):
    seen = []

    def drive(time, state):
        seen.append(state.speeds["slide"])
        return {"slide:position": 0.2 * np.sin(2.0 * time), "turn:speed": 0.3}

    outcome = own_part(aside, model=part, drive=drive, duration=1.0, rest=1.0, z=1.0, x=5.0, y=5.0)
    history = outcome.history
    start = history["time"][np.flatnonzero(history["stage"] == 0.0)[-1]]
    since = np.clip(history["time"] - start, 0.0, 1.0)
    np.testing.assert_allclose(history["slide"], 0.2 * np.sin(2.0 * since), atol=2e-3)
    np.testing.assert_allclose(history["turn"], 0.3 * since, atol=5e-3)
    assert seen[-1] == pytest.approx(0.4 * np.cos(2.0), abs=0.02)
    last = outcome.packing.provenance[-1]
    assert '"model": "part.xml"' in last
    assert "drive" in last


@pytest.mark.client
def test_a_wedge_in_a_plane_meets_nothing_before_it_touches():
    bed = cube_packing([[4.5, 1.0, 1.0]], domain=Domain.slab((9.0, 8.0), 2.0))
    outcome = penetration(bed, body="cone", mode="drop", width=1.0, height=1.0, mass=20.0)
    history = outcome.history
    assert np.all(history["force_y"][history["depth"] < -0.02] == 0)
    assert np.all(history["force_z"] == 0)
    assert outcome.report.final_force == pytest.approx(20.0 * 9.81, rel=0.01)


@pytest.mark.client
@pytest.mark.parametrize("planar", [False, True])
def test_a_wheel_that_slips_on_a_plain_floor_pulls_with_its_friction(aside, planar):
    bed = cube_packing([[10.95, 1.0, 1.0]], domain=Domain.slab((12.0, 8.0), 2.0)) if planar else aside
    options = {"friction": 0.4, "load": 300.0, "width": 2.0, "travel": 1.0, "angular_speed": 2.0}
    outcome = penetration(bed, body="wheel", mode="roll", slip=0.5, **options)
    goes = outcome.history["travel"] > 0.15
    forward, upward, torque = (
        outcome.history[k][goes] for k in ("force_x", "force_y" if planar else "force_z", "torque")
    )
    # It hops a little: its load is what it presses with in the mean only.
    np.testing.assert_allclose(forward, 0.4 * upward, rtol=0.02)
    np.testing.assert_allclose(torque, 1.0 * forward, rtol=0.02)
    assert upward.mean() == pytest.approx(300.0, rel=0.1)
    assert outcome.report.sinkage == pytest.approx(0.0, abs=0.03)
    braked = penetration(bed, body="wheel", mode="roll", forward_speed=3.0, **options).report
    assert braked.slip == pytest.approx(-0.5, abs=1e-9)
    assert braked.drawbar_pull == pytest.approx(-0.4 * 300.0, rel=0.1)


@pytest.mark.client
def test_penetration_goes_on_after_a_kill_to_the_same_bits(tmp_path):
    bed = cube_packing([[6.0, 6.0, 1.0]], domain=Domain.box((12.0, 12.0, 8.0)))
    check_that_it_goes_on(penetration, bed, tmp_path, samples=20, mode="drop", body="sphere", height=1.0)


@pytest.mark.client
@pytest.mark.parametrize("driven", ["table", pytest.param("function", marks=pytest.mark.slow)])
def test_a_part_goes_on_after_a_kill_to_the_same_bits(aside, part, tmp_path, driven):
    def drive(time, state):
        return {"slide": 0.2 * time, "turn:force": -3.0 * state.speeds["turn"]}

    (tmp_path / "motion.csv").write_text("time,slide,turn:force\n0,0,0\n1,0.5,0.2\n")
    driving = {"motion": str(tmp_path / "motion.csv")} if driven == "table" else {"drive": drive, "duration": 1.0}
    check_that_it_goes_on(own_part, aside, tmp_path, samples=18, model=part, rest=2.0, x=4.0, y=4.0, **driving)
    options = {"model": part, "rest": 2.0, "x": 4.0, "y": 4.0, "history_path": tmp_path / "other.h5", **driving}
    with pytest.raises(KeyboardInterrupt):
        own_part(aside, progress=_interrupt_after(18), **options)
    if driven == "table":
        (tmp_path / "motion.csv").write_text("time,slide,turn:force\n0,0,0\n1,0.4,0.2\n")
        with pytest.raises(InputError, match="begun otherwise and cannot go on: driver"):
            own_part(aside, resume=True, **options)


def _interrupt_after(samples):
    heard = []

    def tell(_fraction, _words):
        heard.append(None)
        if len(heard) == samples:
            raise KeyboardInterrupt

    return tell


BUCKET = """<mujoco><worldbody><body name="bucket" pos="3 3 0.4">
  <joint name="lift" type="slide" axis="0 0 1"/>
  <geom type="box" size="1.6 1.6 0.1"/>
  <geom type="box" size="0.1 1.6 1" pos="-1.5 0 1"/> <geom type="box" size="0.1 1.6 1" pos="1.5 0 1"/>
  <geom type="box" size="1.6 0.1 1" pos="0 -1.5 1"/> <geom type="box" size="1.6 0.1 1" pos="0 1.5 1"/>
</body></worldbody></mujoco>"""


@pytest.mark.client
@pytest.mark.parametrize("spheres", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_what_a_bucket_lifts_is_the_weight_of_what_is_in_it(tmp_path, spheres):
    inside = [[2.3, 2.4, 1.2], [3.6, 2.5, 1.3], [2.4, 3.6, 1.4], [3.6, 3.5, 1.25], [3.0, 3.0, 2.6]]
    bed = cube_packing([*inside, [8.0, 3.0, 0.5]], half=0.4 if spheres else 0.5, domain=Domain.box((10.0, 6.0, 8.0)))
    (tmp_path / "bucket.xml").write_text(BUCKET)
    (tmp_path / "lift.csv").write_text("time,lift\n0,0\n1,2\n")
    outcome = own_part(
        bed, model=str(tmp_path / "bucket.xml"), motion=str(tmp_path / "lift.csv"), rest=8.0, part_friction=0.5,
        spheres=spheres, rolling_friction=0.1 if spheres else 0.0,
    )  # fmt: skip
    report, history = outcome.report, outcome.history
    assert history["lift"][-1] == pytest.approx(2.0, abs=1e-3)
    assert report.carried_grains == 5
    mass = 5 * (0.8**3 if spheres else 1.0)
    assert report.carried_mass == pytest.approx(mass, rel=1e-9)
    assert report.borne_mass == pytest.approx(mass, rel=0.03)
    assert abs(report.final_force_x) + abs(report.final_force_y) < 0.03 * mass * 9.81
    np.testing.assert_allclose(history["lift_force"], history["force_z"], rtol=1e-6, atol=1e-6)
    assert np.flatnonzero(outcome.packing.positions[:, 2] > 2.0).tolist() == [0, 1, 2, 3, 4]


@pytest.mark.client
def test_a_part_that_nothing_drives_lies_on_a_bed_in_a_plane_with_its_weight(tmp_path):
    bed = cube_packing([[4.5, 1.0, 1.0]], domain=Domain.slab((9.0, 8.0), 2.0))
    path = tmp_path / "slab.xml"
    path.write_text(
        '<mujoco><worldbody><body name="slab" pos="4.5 2.6 1"><joint name="fall" type="slide" axis="0 1 0"/>'
        '<geom type="box" size="0.8 0.5 1" density="2"/></body></worldbody></mujoco>'
    )
    outcome = own_part(bed, model=str(path), duration=1.0)
    report = outcome.report
    assert report.final_force_y == pytest.approx(2 * 3.2 * 2 * 9.81 / 2, rel=0.01)
    assert report.borne_mass == pytest.approx(-2 * 3.2 * 2 / 2, rel=0.01)  # the bed bears it
    assert report.carried_grains == 0
    assert report.at_rest


@pytest.mark.unit
def test_of_a_periodic_bed_the_nearest_that_there_is_is_named(cube):
    lower, upper = cube.domain.lower, cube.domain.upper
    periodic = replace(cube, domain=Domain(lower, upper, periodic=(True, False, False)))
    with pytest.raises(InputError, match=r"no periodic walls; .* take ring_shear"):
        penetration(periodic)


def corners_in_the_world(model):
    """Return the corners of a model's only mesh, sorted."""
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    meshes = {g: model.mesh(model.geom_dataid[g]) for g in range(model.ngeom) if model.geom_dataid[g] >= 0}
    ((geom, mesh),) = ((g, mesh) for g, mesh in meshes.items() if not mesh.name.startswith("g0"))
    corners = model.mesh_vert[mesh.vertadr[0] : mesh.vertadr[0] + mesh.vertnum[0]]
    found = data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T
    return found[np.lexsort(found.round(5).T)]


@pytest.mark.unit
def test_a_mesh_beside_a_part_stands_where_mujoco_puts_it_and_a_hollow_one_is_warned_of(cube, tmp_path, caplog):
    import mujoco

    from grainsdem.dynamics.scene import equip

    block = trimesh.creation.box((0.4, 0.2, 0.1)).apply_translation((0.3, 0.1, 0.0))
    notch = trimesh.creation.box((0.2, 0.1, 0.2)).apply_translation((0.45, 0.15, 0.0))
    trimesh.boolean.difference([block, notch]).export(tmp_path / "stone.stl")
    path = tmp_path / "part.xml"
    path.write_text(
        '<mujoco><asset><mesh name="stone" file="stone.stl"/></asset><worldbody><body name="arm" pos="1 0 3" '
        'euler="20 30 40"><joint name="turn" axis="0 1 0"/>'
        '<geom type="mesh" mesh="stone" pos="0.1 0 0" euler="0 0 10"/>'
        "</body></worldbody></mujoco>"
    )
    with caplog.at_level(logging.WARNING):
        fragment = read_fragment(str(path))
    assert "mesh 'stone' is not convex; it collides as its convex hull" in caplog.text
    units, apparatus = mjcf.units(cube), equip(cube, mjcf.MjcfOptions())
    elements, meshes = fragment.elements(units, (0.0, 0.0, 0.0), {}, 0.3)
    for name, corners in meshes.items():
        apparatus.add_mesh(name, corners)
    apparatus.add_elements(elements)
    ours, theirs = mujoco.MjModel.from_xml_string(apparatus.text()), mujoco.MjModel.from_xml_path(str(path))
    assert ours.body("arm").mass * units.mass == pytest.approx(theirs.body("arm").mass, rel=1e-6)
    np.testing.assert_allclose(
        corners_in_the_world(ours) * units.length, corners_in_the_world(theirs), atol=1e-5 * units.length
    )


@pytest.mark.unit
def test_what_slides_and_what_turns_are_drawn_apart():
    names = (
        "force_x",
        "force_y",
        "force_z",
        "lift",
        "lift_speed",
        "lift_force",
        "pitch",
        "pitch_speed",
        "pitch_torque",
    )
    series = {name: np.arange(3.0) for name in ("time", "stage", *names)}
    panels = registry.of(own_part).panels(series, {})
    assert [(panel.y_label, sorted(panel.curves)) for panel in panels] == [
        ("force on the part  [N]", ["x", "y", "z"]),
        ("joints  [m]", ["lift"]),
        ("joints  [rad]", ["pitch"]),
    ]
    still = {name: row for name, row in series.items() if not name.startswith(("lift", "pitch"))}
    assert len(registry.of(own_part).panels(still, {})) == 1
