"""Friction of each wall and of each grain: blocks slide at the angles that it gives, and beds and files keep it."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from conftest import cube_packing
from loading import check_that_it_goes_on, grow, grow_planar

from exporters.mjcf import MjcfOptions, text, units
from exporters.rest import frictions, rest_of
from grainsdem.dynamics import ensemble, settle, tap, triaxial, with_densities, with_frictions
from grainsdem.dynamics.experiments.start import plate_friction
from grainsdem.dynamics.mechanics import sliding_fraction, snapshot
from grainsdem.dynamics.scene import build, equip, scene_of
from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import diameters
from grainsdem.model import Domain
from grainsdem.packing import shuffle
from grainsdem.storage import load, save

DEGREE = np.radians(1.0)
BOX = Domain.box((40.0, 40.0, 8.0))
SMOOTH, ROUGH = 0.3, 0.6


def slabs(*places, friction=None):
    """Return flat blocks, 2 wide and 0.6 high, their middles at these places; two on each other do not topple."""
    bed = cube_packing(places, domain=BOX)
    flat = replace(bed, grains=replace(bed.grains, vertices=bed.grains.vertices * [1.0, 1.0, 0.3]))
    return flat if friction is None else replace(flat, frictions=friction)


def turned(scene, angle, *, onto=2):
    """Rest a scene, turn gravity by an angle [rad] from a wall towards +x, and return how far each block goes [d]."""
    level, slope = np.zeros(3), np.zeros(3)
    level[onto], slope[0], slope[onto] = -1.0, np.sin(angle), -np.cos(angle)
    scene.engine.set_gravity(level)
    scene.engine.step(200)
    scene.engine.set_gravity(slope)
    before = scene.poses()[0]
    scene.engine.step(400)
    return np.linalg.norm(scene.poses()[0] - before, axis=1)


def slides(bed, options, limit, *, onto=2):
    """Return which blocks stay a degree below a coefficient's angle and slide a degree above it, relative to the floor.

    In 4 t a block a degree above goes 0.14 d and more, and creeps by 1e-4 d below.
    """
    below, above = (turned(build(bed, options), np.arctan(limit) + turn, onto=onto) for turn in (-DEGREE, DEGREE))
    return (below < 0.02) & (above > 0.05)


@pytest.mark.client
def test_a_block_slides_on_each_wall_of_a_box_at_the_angle_of_that_walls_friction():
    # It touches the floor and a wall, and is pressed against one of them; it would slide on neither at the grains' 0.9.
    block = slabs([20.0, 1.0, 0.3])
    options = MjcfOptions(friction=0.9, wall_friction={"floor": ROUGH, "wall_y0": 0.2})
    assert slides(block, options, ROUGH, onto=2).all()
    assert slides(block, options, 0.2, onto=1).all()


@pytest.mark.client
@pytest.mark.parametrize("mixing", ["max", "min"])
def test_two_materials_slide_on_one_floor_each_at_its_own_angle(mixing):
    two = slabs([10.0, 10.0, 0.3], [10.0, 30.0, 0.3], friction=[SMOOTH, ROUGH])
    options = MjcfOptions(mixing=mixing)
    assert slides(two, options, SMOOTH).tolist() == [True, False]
    # The smooth one slides a degree below the rough one's angle, too.
    assert slides(two, options, ROUGH).tolist() == [False, True]


@pytest.mark.client
@pytest.mark.parametrize(("mixing", "limit"), [("max", ROUGH), ("min", SMOOTH)])
@pytest.mark.parametrize("order", [[SMOOTH, ROUGH], [ROUGH, SMOOTH]])
def test_a_block_slides_on_one_of_another_material_at_the_angle_of_the_mixing_rule(mixing, limit, order):
    stack = slabs([10.0, 20.0, 0.3], [10.0, 20.0, 0.9], friction=order)
    # The floor's friction goes before that of all grains, and holds the lower block.
    assert slides(stack, MjcfOptions(mixing=mixing, wall_friction=2.0), limit).tolist() == [False, True]


@pytest.mark.client
@pytest.mark.parametrize(("mixing", "expected"), [("max", ROUGH), ("min", SMOOTH)])
def test_contacts_tell_the_friction_that_rules_them(mixing, expected):
    stack = slabs([10.0, 20.0, 0.3], [10.0, 20.0, 0.9], friction=[SMOOTH, ROUGH])
    scene = build(stack, MjcfOptions(mixing=mixing, wall_friction={"wall_x0": 0.0}))
    scene.engine.step(100)
    told = scene.engine.contacts()
    among = (told.pairs >= 0).all(axis=1)
    assert among.any()
    assert told.frictions[among] == pytest.approx(expected)
    assert told.frictions[~among] == pytest.approx(SMOOTH)  # a wall that is not named is as rough as what touches it
    assert sliding_fraction(snapshot(scene)) == 0.0


@pytest.mark.client
@pytest.mark.parametrize("mixing", ["max", "min"])
def test_grains_get_one_friction_while_they_are_compressed_and_their_own_again(mixing):
    two = slabs([10.0, 10.0, 0.3], [10.0, 30.0, 0.3], friction=[SMOOTH, ROUGH])
    limit = np.arctan(0.1)
    for turn, slid in ((-DEGREE, False), (DEGREE, True)):
        scene = build(two, MjcfOptions(mixing=mixing))
        scene.engine.set_friction(0.1)
        assert (turned(scene, limit + turn) > 0.05).tolist() == [slid, slid]
    scene.engine.set_friction(None)
    assert (turned(scene, np.arctan(SMOOTH) + DEGREE) > 0.05).tolist() == [True, False]


@pytest.mark.client
@pytest.mark.parametrize("mixing", ["max", "min"])
def test_a_wall_that_is_made_smooth_goes_before_the_smoothest_grain(mixing):
    scene = build(slabs([10.0, 10.0, 0.3], friction=[SMOOTH]), MjcfOptions(mixing=mixing))
    scene.engine.make_smooth(["floor"])
    assert turned(scene, DEGREE) > 0.1
    scene.engine.make_smooth([])
    assert turned(scene, DEGREE) < 0.02


@pytest.mark.client
@pytest.mark.parametrize("mixing", ["max", "min"])
@pytest.mark.parametrize(("friction", "limits"), [(None, [SMOOTH, ROUGH]), (0.45, [0.45, 0.45])])
def test_a_part_is_as_rough_as_what_touches_it_or_has_its_own_friction(mixing, friction, limits):
    bed = slabs([10.0, 10.0, 0.3], [10.0, 30.0, 0.3], friction=[SMOOTH, ROUGH])
    options = MjcfOptions(mixing=mixing, walls="none")
    d = units(bed).length
    for k, limit in enumerate(limits):
        way = []
        for turn in (-DEGREE, DEGREE):
            apparatus = equip(bed, options)
            apparatus.add_shape(
                None, "plate", "box", np.array([40.0, 40.0, 1.0]) / d, position=np.array([20.0, 20.0, -1.0]) / d,
                friction=friction,
            )  # fmt: skip
            scene = scene_of(bed, apparatus.text(), 9.81)
            way.append(turned(scene, np.arctan(limit) + turn)[k])
        assert way[0] < 0.02
        assert way[1] > 0.05


@pytest.mark.unit
def test_plates_are_to_grains_as_these_are_to_each_other():
    bed = slabs([10.0, 10.0, 0.3], friction=[SMOOTH])
    assert plate_friction(bed, None) is None
    assert plate_friction(bed, 0.4) == 0.4
    assert plate_friction(replace(bed, frictions=None), None) == 0.5


@pytest.mark.unit
def test_grains_and_walls_with_frictions_of_their_own_resist_rolling_too():
    bed = slabs([10.0, 10.0, 0.3], [10.0, 30.0, 0.3], friction=[0.0, ROUGH])
    model = mujoco.MjModel.from_xml_string(text(bed, MjcfOptions(rolling_friction=0.1, wall_friction={"floor": 0.0})))
    assert model.geom_condim.tolist() == [6] * model.ngeom
    np.testing.assert_allclose(model.geom_friction[:, 1:], 0.05)
    plain = mujoco.MjModel.from_xml_string(text(bed, MjcfOptions(wall_friction={"floor": 0.0})))
    assert [int(plain.geom(name).condim[0]) for name in ("floor", "g000000", "g000001")] == [1, 1, 3]


@pytest.mark.client
def test_grains_without_friction_slide_where_the_smoother_rules_and_not_where_the_rougher_does():
    stack = slabs([10.0, 20.0, 0.3], [10.0, 20.0, 0.9], friction=[0.5, 0.0])
    for mixing, slid in (("max", False), ("min", True)):
        way = turned(build(stack, MjcfOptions(mixing=mixing, wall_friction=0.5)), 5 * DEGREE)
        assert (way[1] > 0.05) == slid


@pytest.mark.unit
def test_a_wall_that_a_container_does_not_have_is_refused_with_those_that_it_has():
    bed = cube_packing([[2.0, 2.0, 1.001]], domain=Domain.cube(4.0))
    walls = "its walls are floor, wall_x0, wall_x1, wall_y0, wall_y1"
    with pytest.raises(InputError, match=f"the container has no lid to have a wall_friction: {walls}"):
        settle(bed, wall_friction={"lid": 0.1, "floor": 0.2})
    with pytest.raises(InputError, match=r"its walls are wall_y0, wall_x0, wall_x1$"):
        text(grow_planar(4), MjcfOptions(wall_friction={"floor": 0.1}))
    with pytest.raises(InputError, match="it has no walls"):
        text(bed, MjcfOptions(wall_friction={"floor": 0.1}, walls="none"))
    planes = np.array([[np.sqrt(0.5), np.sqrt(0.5), 0.0, 4.0]])
    cut = replace(bed, domain=Domain(np.zeros(3), np.full(3, 4.0), planes=planes))
    assert 'friction="0.1"' in text(cut, MjcfOptions(wall_friction={"wall_p0": 0.1}))


@pytest.mark.unit
@pytest.mark.parametrize("given", [{"floor": -0.1}, {"floor": np.nan}, {}, "floor", "floor=", {1: 0.2}])
def test_a_table_of_walls_that_says_nothing_is_refused(given):
    with pytest.raises(InputError, match="wall_friction must be zero or more and finite, or such numbers by name"):
        MjcfOptions(wall_friction=given)


@pytest.mark.unit
def test_frictions_go_with_their_grains_and_through_files(tmp_path):
    bed = with_frictions(grow(27), lambda sizes: sizes / sizes.max())
    mixed = shuffle(bed, rng=3)
    np.testing.assert_allclose(mixed.frictions, diameters(mixed.grains) / diameters(bed.grains).max(), rtol=1e-12)
    save(mixed, tmp_path / "bed.h5")
    kept = load(tmp_path / "bed.h5")
    assert kept.frictions.tobytes() == mixed.frictions.tobytes()
    save(grow(8), tmp_path / "plain.h5")
    assert load(tmp_path / "plain.h5").frictions is None


@pytest.mark.unit
def test_frictions_are_drawn_by_shares_as_densities_are():
    bed = grow(64)
    drawn = with_frictions(bed, {0.3: 3, 0.6: 1}, rng=1).frictions
    assert set(drawn) == {0.3, 0.6}
    assert 0.3 * len(bed) < np.count_nonzero(drawn == 0.3) < len(bed)
    same = with_densities(bed, {0.3: 3, 0.6: 1}, rng=1).densities
    np.testing.assert_array_equal(drawn, same)
    assert with_frictions(bed, 0.4).frictions.tolist() == [0.4] * len(bed)
    assert with_frictions(with_frictions(bed, 0.4), None).frictions is None


@pytest.mark.unit
@pytest.mark.parametrize(
    ("given", "words"),
    [
        (-0.1, "frictions must be zero or more and finite; those of grains 0, 1, 2"),
        ({0.3: -1.0}, "shares of frictions must be zero or more"),
        ({}, "shares of frictions"),
        (lambda sizes: sizes * np.nan, "frictions must be zero or more"),
    ],
)
def test_frictions_that_cannot_be_are_refused(given, words):
    with pytest.raises(InputError, match=words):
        with_frictions(grow(8), given)
    with pytest.raises(ShapeError, match="frictions must be finite and zero or more; not so: 1"):
        replace(cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0]]), frictions=[0.1, -0.1])
    with pytest.raises(ShapeError, match=r"frictions must have shape \(2\)"):
        replace(cube_packing([[2.0, 2.0, 2.0], [5.0, 2.0, 2.0]]), frictions=[0.1])


@pytest.mark.client
@pytest.mark.parametrize("mixing", ["max", "min"])
def test_a_settled_bed_is_written_with_the_frictions_of_its_grains_and_walls(mixing, tmp_path):
    walls = {"floor": 0.7, "wall_x1": 0.0}
    bed = cube_packing([[2.0, 2.0, 1.001], [5.0, 2.0, 1.001]], domain=Domain.box((8.0, 4.0, 4.0)))
    own = with_frictions(bed, lambda sizes: np.linspace(0.2, 0.4, sizes.size))
    end = settle(own, wall_friction=walls, mixing=mixing).packing
    save(end, tmp_path / "end.h5")
    kept = load(tmp_path / "end.h5")
    rest = rest_of(kept)
    assert (rest.friction, rest.wall_friction, rest.mixing) == (None, walls, mixing)
    assert text(kept) == text(end)
    model = mujoco.MjModel.from_xml_string(text(kept))
    assert [model.geom(name).friction[0] for name in ("g000000", "g000001", "floor")] == [0.2, 0.4, 0.7]
    assert model.geom("wall_x1").condim[0] == 1
    assert model.geom("floor").priority[0] > model.geom("g000000").priority[0] >= model.geom("wall_x0").priority[0]


@pytest.mark.client
def test_a_number_is_for_one_run_and_leaves_the_grains_their_own():
    bed = with_frictions(cube_packing([[2.0, 2.0, 1.001]], domain=Domain.cube(4.0)), 0.2)
    own, other = settle(bed).packing, settle(bed, friction=0.7).packing
    assert (rest_of(own).friction, rest_of(other).friction) == (None, 0.7)
    assert own.frictions.tolist() == other.frictions.tolist() == [0.2]
    assert [frictions(packing, None).grains for packing in (own, other)] == [0.2, 0.7]
    # What comes next is another run, with the grains' own again.
    again = tap(other, taps=1).packing
    assert rest_of(again).friction is None
    assert rest_of(tap(other, taps=1, friction=0.4).packing).friction == 0.4


@pytest.mark.slow
@pytest.mark.client
def test_a_test_of_two_materials_that_bounce_goes_on_and_runs_in_ensembles(tmp_path):
    grains = with_frictions(grow(12), {0.2: 1, 0.8: 1}, rng=1)
    options = {"strain": 0.01, "inertial_number": 0.1, "compaction_friction": 0.1, "mixing": "min", "restitution": 0.5}
    alone = check_that_it_goes_on(triaxial, grains, tmp_path, samples=20, rng=4, **options)
    runs = ensemble(triaxial, grains, seeds=[4, 7], through="batch", **options)
    assert runs.outcomes[0].packing.positions.tobytes() == alone.packing.positions.tobytes()
    one, other = (outcome.packing.frictions for outcome in runs.outcomes)
    assert one.tolist() != other.tolist()  # each seed has its order of grains
    assert sorted(one) == sorted(other) == sorted(grains.frictions)
