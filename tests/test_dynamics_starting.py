from __future__ import annotations

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from conftest import cube_packing
from loading import borne, first_at_rest, grow_few

from exporters.mjcf import units
from grainsdem.dynamics import settle
from grainsdem.dynamics.starting import as_spheres, begin, sphere_radii
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.measures import diameters
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink, shuffle
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate
from grainsdem.validation import validate

FLOOR_FORCE = 0.05
"""How far from the weight the force on floor and walls may be told at rest (`test_dynamics.FLOOR_FORCE`)."""


@pytest.fixture(scope="module")
def flat():
    """A planar bed of 40 prisms."""
    slab = Domain.slab((8e-3, 6e-3), 1e-3)
    seeds = relax(poisson(slab, 60, rng=3), slab, iterations=2)
    return shrink(carve(tessellate(seeds, slab)), porosity=0.3)


@pytest.fixture(scope="module")
def few():
    """Twenty-eight grains."""
    return grow_few()


@pytest.fixture(scope="module")
def rained(few, shake):
    return first_at_rest(lambda seed: settle(few, start="rain", rng=seed, max_time=60.0))


@pytest.mark.unit
def test_spheres_have_the_grains_volumes_and_reach_as_far_everywhere(fresh):
    round_ = as_spheres(fresh)
    np.testing.assert_allclose(volumes(round_.grains), volumes(fresh.grains), rtol=1e-12)
    np.testing.assert_allclose(2 * sphere_radii(round_), diameters(fresh.grains), rtol=1e-12)
    distances = np.linalg.norm(round_.grains.vertices, axis=1).reshape(len(fresh), -1)
    np.testing.assert_allclose(
        distances, np.broadcast_to(1.01 * sphere_radii(fresh)[:, None], distances.shape), rtol=5e-3
    )


@pytest.mark.unit
def test_discs_have_the_prisms_areas_and_thickness(flat):
    round_ = as_spheres(flat)
    np.testing.assert_allclose(volumes(round_.grains), volumes(flat.grains), rtol=1e-12)
    assert np.ptp(round_.grains.vertices[:, 2]) == pytest.approx(np.ptp(flat.grains.vertices[:, 2]))
    np.testing.assert_allclose(np.pi * sphere_radii(flat) ** 2 * 1e-3, volumes(flat.grains), rtol=1e-9)


@pytest.mark.unit
def test_grains_that_are_alike_leave_a_third_of_their_places_empty_and_others_none(few):
    cubes = cube_packing(np.full((90, 3), 5.0), half=0.5, domain=Domain.box((6.0, 6.0, 9.0)))
    poured = begin(cubes, start="pour", rng=3)
    layers, counts = np.unique(np.round(poured.positions[:, 2], 6), return_counts=True)
    assert validate(poured).ok
    assert len(layers) > len(np.unique(np.round(shuffle(cubes, rng=3).positions[:, 2], 6)))
    assert counts.max() < 9 + 3  # of nine places in a layer two thirds are taken, in the mean
    assert json.loads(poured.provenance[-1])["vacancies"] == 0.5
    assert json.loads(begin(few, start="pour", rng=3).provenance[-1])["vacancies"] == 0.0


@pytest.mark.unit
def test_a_share_of_places_left_empty_cannot_be_below_zero(few):
    with pytest.raises(InputError, match="vacancies must be zero or more and finite; got -1"):
        shuffle(few, vacancies=-1.0)


@pytest.mark.unit
def test_planar_grains_are_shuffled_in_their_plane(flat):
    loose = shuffle(flat, rng=2)
    assert loose.domain.is_planar
    assert validate(loose).ok
    np.testing.assert_allclose(to_matrices(loose.quaternions)[:, 2, 2], 1.0)
    assert np.ptp(to_matrices(loose.quaternions)[:, 0, 0]) > 1.5
    assert loose.positions[:, 1].max() > flat.positions[:, 1].max()


@pytest.mark.statistical
def test_shares_of_densities_are_drawn_by_number(fresh):
    many = begin(fresh, density={2650.0: 3, 5200.0: 1}, rng=4).densities
    share = np.mean(many == 5200.0)
    assert set(many) == {2650.0, 5200.0}
    assert share == pytest.approx(0.25, abs=5 * np.sqrt(0.25 * 0.75 / len(fresh)))


@pytest.mark.unit
def test_a_density_may_be_a_law_of_the_diameter(fresh):
    made = begin(fresh, density=lambda d: 1000.0 * d / d.min())
    np.testing.assert_allclose(made.densities, 1000.0 * diameters(fresh.grains) / diameters(fresh.grains).min())


@pytest.mark.slow
@pytest.mark.client
def test_rain_comes_to_rest_as_a_bed(rained):
    assert borne(rained.report) == pytest.approx(1.0, abs=FLOOR_FORCE)
    assert validate(rained.packing, overlap=1e-3).ok


@pytest.mark.client
def test_energy_never_rises_while_it_rains(few):
    # A step so fine that none halves it, which would lift the bed; what soft contacts give back are some 1e-5.
    energy = settle(few, start="rain", rng=1, time_step=0.005, max_time=1.0).history["total_energy"]
    assert (np.diff(energy) < 1e-3).all()
    assert energy[-1] < 0.5 * energy[0]


@pytest.mark.client
def test_rain_keeps_its_speed_until_it_is_let_go(few):
    falling = settle(few, start="rain", rng=1, max_time=1e-9, friction=0.0).history["total_energy"]
    # Its weight is carried: potential energy goes at the speed of the fall, and no kinetic energy comes in its place.
    assert falling[0] - falling[3] == pytest.approx(0.6, rel=0.02)


@pytest.mark.client
@pytest.mark.parametrize(
    ("start", "drop_height", "fall"),
    [("rain", 2e-3, 2e-3), pytest.param("rain", 12e-3, 12e-3, marks=pytest.mark.slow), ("pour", None, None)],
)
def test_grains_fall_as_far_as_is_told(few, start, drop_height, fall):
    first = begin(few, start=start, drop_height=drop_height, rng=1)
    settled = settle(few, start=start, drop_height=drop_height, rng=1, max_time=12.0)
    if fall is None:
        # What is poured falls from where its lattice stands.
        fall = first.positions[:, 2].mean() - settled.packing.positions[:, 2].mean()
        assert settled.report.drop_height == pytest.approx(fall, rel=1e-9)
    # A grain of a millimetre is looked at every fifth of the time in which it comes down by one, and may meet a pit.
    assert settled.report.drop_height == pytest.approx(fall, abs=1e-3)
    assert json.loads(settled.packing.provenance[-1])["drop_height"] == settled.report.drop_height


@pytest.mark.slow
@pytest.mark.client
def test_rain_that_follows_the_bed_goes_on_after_an_interrupt_to_the_same_bits(few, tmp_path):
    def run(name, **options):
        return settle(few, start="rain", drop_height=2e-3, rng=1, max_time=3.0, history_path=tmp_path / name, **options)

    def interrupt(now):
        if now.time > 8.0 * second:
            raise KeyboardInterrupt

    whole = run("whole.h5")
    second = units(few, 9.81).time
    with pytest.raises(KeyboardInterrupt):
        run("parts.h5", progress=interrupt)
    parts = run("parts.h5", resume=True)
    assert parts.packing.positions.tobytes() == whole.packing.positions.tobytes()
    assert parts.report.to_dict() == whole.report.to_dict()


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"start": "pour", "drop_height": 1e-3}, "drop_height needs start = 'rain'"),
        ({"drop_height": 1e-3}, "got start = 'place'"),
        ({"start": "rain", "drop_height": -1.0}, "drop_height must be positive and finite; got -1"),
        ({"start": "rain", "drop_height": float("nan")}, "drop_height must be positive"),
    ],
)
def test_a_drop_height_that_cannot_be_is_refused(few, options, words):
    with pytest.raises(InputError, match=words):
        settle(few, **options)


@pytest.mark.client
def test_spheres_come_to_rest_on_the_floor_and_beside_each_other(few):
    result = first_at_rest(lambda seed: settle(few, start="pour", spheres=True, rng=seed, max_time=60.0))
    assert borne(result.report) == pytest.approx(1.0, abs=FLOOR_FORCE)
    # Each rests on the floor or on others: none hangs lower than its radius.
    radii = np.cbrt(0.75 / np.pi * volumes(result.packing.grains))
    assert (result.packing.positions[:, 2] > (1 - 2e-3) * radii).all()


@pytest.mark.unit
def test_spheres_do_not_begin_straight_above_each_other(fresh):
    round_ = begin(fresh, start="pour", spheres=True, rng=1)
    across, heights = round_.positions[:, :2], round_.positions[:, 2]
    for row in across:
        beside = np.linalg.norm(across - row, axis=1)
        # A column of the lattice: as many grains as there are layers, each a little aside from all others.
        assert np.sort(beside)[1] > 1e-3 * diameters(fresh.grains).mean()
    assert np.ptp(heights) > 2 * diameters(fresh.grains).mean()
    assert validate(round_).ok


@pytest.mark.client
def test_a_sphere_rolls_down_as_rolling_does():
    # Without slip a sphere has 5/7 of a frictionless block's acceleration: mean kinetic energy 1/2 (1 + 2/5) v².
    ball = as_spheres(cube_packing([[5.0, 5.0, 1.3]], domain=Domain.box((40.0, 10.0, 10.0))))
    lying = replace(ball, positions=[[5.0, 5.0, float(sphere_radii(ball)[0])]])
    slope = np.radians(10.0)
    moved = settle(lying, spheres=True, direction=(np.sin(slope), 0.0, -np.cos(slope)), max_time=3.0, friction=0.8)
    seconds = moved.history["time"][-1]
    way = moved.packing.positions[0, 0] - 5.0
    assert way == pytest.approx(0.5 * 5 / 7 * 9.81 * np.sin(slope) * seconds**2, rel=0.02)


@pytest.mark.client
@pytest.mark.parametrize(("start", "spheres"), [("place", False), ("rain", False), ("pour", True)])
def test_planar_beds_settle_in_their_plane(flat, start, spheres):
    result = first_at_rest(lambda seed: settle(flat, start=start, spheres=spheres, rng=seed, max_time=60.0))
    assert borne(result.report) == pytest.approx(1.0, abs=FLOOR_FORCE)
    assert np.ptp(result.packing.positions[:, 2]) < 1e-9
    np.testing.assert_allclose(to_matrices(result.packing.quaternions)[:, 2, 2], 1.0, atol=1e-9)
    assert result.packing.positions[:, 1].min() > 0


@pytest.mark.client
def test_grains_fall_where_gravity_points(few):
    # Before any of them touches another one or a wall.
    start = begin(few, start="pour", rng=1)
    fallen = settle(start, direction=(0.3, -0.4, -1.2), max_time=0.5)
    seconds, step = fallen.history["time"][-1], fallen.report.time_step
    way = 0.5 * 9.81 * seconds * (seconds + step) * np.array([0.3, -0.4, -1.2]) / 1.3
    moved = fallen.packing.positions - start.positions
    np.testing.assert_allclose(np.median(moved, axis=0), way, rtol=1e-4)


@pytest.mark.unit
def test_what_a_start_cannot_be_is_refused(fresh, flat):
    with pytest.raises(InputError, match="overlap"):
        settle(fresh, spheres=True)
    with pytest.raises(InputError, match="'place', 'pour'"):
        settle(fresh, start="throw")
    with pytest.raises(InputError, match="z below zero"):
        settle(fresh, direction=(0.0, 0.0, 1.0))
    with pytest.raises(InputError, match="y below zero"):
        settle(flat, direction=(0.0, -1.0, -1.0))
    with pytest.raises(InputError, match="those of grains 0, 1"):
        settle(fresh, density=-1.0)
    with pytest.raises(InputError, match="shares of densities"):
        settle(fresh, density={2650.0: 0.0})


@pytest.mark.client
def test_mujoco_has_spheres_of_the_grains_masses(fresh):
    from exporters.mjcf import MjcfOptions
    from grainsdem.dynamics.scene import equip

    round_ = as_spheres(fresh)
    text = equip(round_, MjcfOptions(gravity=9.81), are_spheres=True).text()
    model = mujoco.MjModel.from_xml_string(text)
    assert model.nmesh == 0
    masses = volumes(fresh.grains) * fresh.densities
    np.testing.assert_allclose(
        model.body_mass[-len(fresh) :] / masses * masses.mean(), model.body_mass[-len(fresh) :].mean(), rtol=1e-8
    )
    radii = model.geom_size[-len(fresh) :, 0]
    np.testing.assert_allclose(
        model.body_inertia[-len(fresh) :, 0], 0.4 * model.body_mass[-len(fresh) :] * radii**2, rtol=1e-8
    )
