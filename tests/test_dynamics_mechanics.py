from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing

from exporters.mjcf import MjcfOptions
from grainsdem.dynamics import mechanics
from grainsdem.dynamics.scene import build
from grainsdem.errors import InputError
from grainsdem.model import Domain

GRAVITY = 9.81
WEIGHT = 8 * 1000.0 * GRAVITY
"""Of a cube of edge 2 m and density 1000 kg/m³ [N]."""


@pytest.fixture(scope="module")
def stack(shake):
    """The instant of three cubes on each other that are at rest, but for a hum of their corners.

    Of 21 shakes it held the floor's force within 1e-3 ± 6e-4 of a weight for each axis, torques within 5e-3, the stress
    within 6e-4 ± 3e-4 of itself: each tolerance below is seven spreads or more beyond these.
    """
    cubes = cube_packing(
        [[3.0, 3.0, 1.0], [3.0, 3.0, 3.0], [3.0, 3.0, 5.0]], domain=Domain.box((6.0, 6.0, 8.0)), density=1000.0
    )
    scene = build(cubes, MjcfOptions(gravity=GRAVITY))
    scene.engine.step(600)
    return mechanics.snapshot(scene)


@pytest.mark.client
def test_the_floor_feels_the_weight_of_the_stack(stack):
    force = mechanics.force_on(stack, "floor")
    np.testing.assert_allclose(force, [0, 0, -3 * WEIGHT], atol=1e-2 * WEIGHT)
    assert mechanics.force_on(stack, "wall_x0") == pytest.approx([0, 0, 0])
    assert mechanics.torque_on(stack, "floor") == pytest.approx(0, abs=5e-2 * WEIGHT)
    with pytest.raises(InputError, match="part must be one of floor"):
        mechanics.force_on(stack, "lid")


@pytest.mark.client
def test_planes_carry_the_weight_above_them(stack):
    for (lower, upper), above in (((1.5, 2.5), 2), ((3.5, 4.5), 1)):
        found = mechanics.traction(stack, axis=2, lower=lower, upper=upper, area=4.0)
        np.testing.assert_allclose(found, [0, 0, above * WEIGHT / 4.0], atol=3e-3 * WEIGHT)
    # Friction holds a few thousandths of the weight, three metres from the axis.
    assert mechanics.torque_through(stack, lower=1.5, upper=2.5) == pytest.approx(0, abs=5e-2 * WEIGHT)


@pytest.mark.client
def test_love_and_webers_stress_of_a_stack_is_half_its_edges_times_its_forces(stack):
    # Each cube has half an edge to the contact below and above: (3 + 2) + (2 + 1) + 1 weights times one metre.
    found = mechanics.stress(stack, volume=24.0)
    assert found[2, 2] == pytest.approx(9 * WEIGHT / 24.0, rel=5e-3)
    assert np.abs(found - np.diag(np.diag(found))).max() < 5e-3 * found[2, 2]
    lowest = mechanics.stress(stack, volume=8.0, rows=np.array([True, False, False]))
    assert lowest[2, 2] == pytest.approx(5 * WEIGHT / 8.0, rel=5e-3)
    with pytest.raises(InputError, match="volume must be positive"):
        mechanics.stress(stack, volume=0.0)


@pytest.mark.client
def test_the_network_of_a_stack(stack):
    graph = mechanics.contact_graph(stack)
    assert graph.pairs.tolist() == [[0, 1], [1, 2]]
    assert mechanics.coordination(stack) == pytest.approx(4 / 3)
    np.testing.assert_allclose(mechanics.fabric(stack), np.diag([0, 0, 1]), atol=1e-6)
    np.testing.assert_allclose(mechanics.fabric(stack, of="strong"), np.diag([0, 0, 1]), atol=1e-6)
    np.testing.assert_allclose(mechanics.normalized_forces(stack), [2 / 3, 4 / 3], rtol=3e-3)
    assert mechanics.sliding_fraction(stack) == 0.0
    assert mechanics.force_chains(stack) == []


def by_hand(pairs, forces, *, positions, frictions=0.5):
    """An instant of small cubes, with contacts half way between them."""
    places = np.asarray(positions, float)
    n, pairs, forces = len(places), np.asarray(pairs, np.int64), np.asarray(forces, float)
    arms = places[pairs[:, 1]] - places[pairs[:, 0]]
    return mechanics.Snapshot(
        cube_packing(places, half=0.1),
        0.0,
        (0.0, 0.0, 0.0),
        np.zeros((n, 3)),
        np.zeros((n, 3)),
        pairs,
        places[pairs[:, 0]] + 0.5 * arms,
        arms / np.linalg.norm(arms, axis=1, keepdims=True),
        forces,
        np.zeros(len(pairs)),
        np.full(len(pairs), frictions),
    )


@pytest.mark.unit
def test_a_column_under_load_among_idle_grains_is_a_force_chain():
    column = [[0.0, 0.0, k] for k in range(5)]
    idle = [[5.0 + k, 0.0, 0.0] for k in range(6)]
    pairs = [[k, k + 1] for k in range(4)] + [[5 + k, 6 + k] for k in range(5)]
    forces = [[0, 0, 10.0]] * 4 + [[0.1, 0, 0]] * 5
    (chain,) = mechanics.force_chains(by_hand(pairs, forces, positions=column + idle))
    assert chain.tolist() == [0, 1, 2, 3, 4]


@pytest.mark.unit
def test_forces_are_told_by_pair_with_their_parts_and_the_chain_that_they_are_in(tmp_path):
    places = [[0.0, 0.0, k] for k in range(5)] + [[5.0 + k, 0.0, 0.0] for k in range(6)]
    pairs = [[k, k + 1] for k in range(4)] + [[5 + k, 6 + k] for k in range(5)]
    now = by_hand(pairs, [[3.0, 4.0, 10.0]] * 4 + [[0.1, 0, 0]] * 5, positions=places)
    graph, columns = mechanics.contact_forces(now)
    np.testing.assert_array_equal(graph.pairs, pairs)
    np.testing.assert_allclose(columns["normal_force"], [10.0] * 4 + [0.1] * 5)
    np.testing.assert_allclose(columns["tangential_force"], [5.0] * 4 + [0.0] * 5, atol=1e-15)
    np.testing.assert_array_equal(columns["chain"], [0] * 4 + [-1] * 5)
    rows = mechanics.write_forces(now, tmp_path / "forces.csv").read_text().splitlines()
    assert rows[0].endswith("kind,force_x,force_y,force_z,normal_force,tangential_force,chain")
    assert rows[1].endswith(",3.0,4.0,10.0,10.0,5.0,0")


@pytest.mark.client
def test_the_weight_of_a_stack_is_in_the_file_of_its_forces(stack, tmp_path):
    graph, columns = mechanics.contact_forces(stack)
    on_floor = graph.pairs[:, 0] < 0
    weight = stack.masses().sum() * 9.81
    # The floor pushes up on the lowest cube with the weight of all.
    assert columns["force"][on_floor].sum(axis=0)[2] == pytest.approx(weight, rel=3e-3)
    assert columns["normal_force"][on_floor].sum() == pytest.approx(weight, rel=3e-3)
    assert (columns["tangential_force"] < 1e-2 * weight).all()


@pytest.mark.unit
def test_contacts_at_the_cone_of_friction_slide():
    pairs, places = [[0, 1], [1, 2]], [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    now = by_hand(pairs, [[2.0, 1.0, 0.0], [2.0, 0.9, 0.0]], positions=places)
    assert mechanics.sliding_fraction(now) == 0.5
    assert np.isnan(mechanics.sliding_fraction(by_hand(np.empty((0, 2)), np.empty((0, 3)), positions=places)))


@pytest.mark.unit
def test_forces_that_balance_leave_nothing_and_one_that_does_not_is_told():
    places = [[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]]
    now = by_hand([[0, 1], [1, 2]], [[2.0, 0, 0], [2.0, 0, 0]], positions=places)
    # The two ends feel 2 each, the middle nothing; the mean force of a contact is 2.
    assert mechanics.unbalanced_force(now) == pytest.approx((2 + 0 + 2) / 3 / 2)


@pytest.mark.unit
def test_energies_are_those_of_rigid_bodies():
    cube = cube_packing([[0.0, 0.0, 3.0]], density=2.0)
    spin, speed = np.array([[0.5, 0.4, -0.7]]), np.array([[0.3, -0.2, 0.1]])
    empty = np.empty((0, 3))
    now = mechanics.Snapshot(
        cube, 0.0, (0, 0, -10.0), speed, spin, np.empty((0, 2), np.int64), empty, empty, empty, np.empty(0), np.empty(0)
    )
    found = mechanics.energies(now)
    assert found.translation == pytest.approx(0.5 * 16 * 0.14)
    assert found.rotation == pytest.approx(0.5 * (16 * 4 / 6) * 0.90)
    assert found.potential == pytest.approx(16 * 10 * 3)
    assert found.total == pytest.approx(sum(found))


@pytest.mark.unit
@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0])
def test_rotations_between_two_instants_are_the_shortest_turns(angle):
    cube = cube_packing([[0.0, 0.0, 0.0]])
    axis = np.array([1.0, 2.0, -2.0]) / 3
    turned = np.append(np.cos(angle / 2), np.sin(angle / 2) * axis)
    moved = replace(cube, positions=[[0.1, 0.2, 0.3]], quaternions=[-turned])  # the same rotation
    np.testing.assert_allclose(mechanics.rotations(cube, moved), [angle * axis], atol=1e-12)
    np.testing.assert_allclose(mechanics.displacements(cube, moved), [[0.1, 0.2, 0.3]])
    with pytest.raises(InputError, match="same grains"):
        mechanics.displacements(cube, cube_packing([[0, 0, 0], [3, 0, 0]]))


@pytest.mark.unit
def test_porosity_of_layers_is_the_void_of_each():
    packing = cube_packing([[2.0, 2.0, 1.0], [2.0, 2.0, 4.0]], domain=Domain.box((4.0, 4.0, 6.0)))
    middles, values = mechanics.porosity_profile(packing, layers=6)
    np.testing.assert_allclose(middles, np.arange(6) + 0.5)
    np.testing.assert_allclose(values, [0.75, 0.75, 1.0, 0.75, 0.75, 1.0], atol=1e-9)


@pytest.mark.unit
def test_velocity_of_layers_is_weighted_by_mass_and_nan_where_there_are_no_grains():
    now = by_hand([[0, 1]], [[1.0, 0, 0]], positions=[[0, 0, 0.5], [1, 0, 0.5], [0, 0, 2.5]])
    heavy = replace(now.packing, densities=[1.0, 3.0, 1.0])
    now = replace(now, packing=heavy, velocities=[[4.0, 0, 0], [0, 0, 0], [2.0, 0, 0]])
    _, values = mechanics.velocity_profile(now, along=(1.0, 0.0, 0.0), edges=[0.0, 1.0, 2.0, 3.0])
    np.testing.assert_allclose(values, [1.0, np.nan, 2.0])


@pytest.mark.unit
def test_the_mobilised_angle_of_friction_is_that_of_mohrs_circle():
    assert np.degrees(mechanics.friction_angle([3.0, 1.0])) == pytest.approx(30.0)
    assert mechanics.friction_angle([2.0, 2.0, 2.0]) == 0.0
    with pytest.raises(InputError, match="must be positive"):
        mechanics.inertial_number(1.0, diameter=0.0, density=1.0, pressure=1.0)
