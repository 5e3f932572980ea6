"""A rotating drum: balance of torques, angle over speed, mixing, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from loading import check_that_it_goes_on, grow, grow_planar

from exporters.mjcf import units
from grainsdem.dynamics import drum
from grainsdem.dynamics.experiments.drums.mixing import lacey_index
from grainsdem.dynamics.experiments.drums.shell import GUIDE, Shell
from grainsdem.dynamics.experiments.drums.surface import surface_angle
from grainsdem.errors import InputError


@pytest.mark.unit
def test_halves_are_unmixed_and_a_random_mixture_is_mixed():
    rng = np.random.default_rng(1)
    points = rng.uniform(0.0, 20.0, (4000, 2))
    points[0] = 0.0  # where the cells begin
    is_right = points[:, 0] >= 10.0
    assert lacey_index(points, is_right, width=2.0) == pytest.approx(0.0, abs=1e-12)
    shuffled = [lacey_index(points, rng.permutation(is_right), width=2.0) for _ in range(20)]
    assert np.mean(shuffled) == pytest.approx(1.0, abs=5 * np.std(shuffled, ddof=1) / np.sqrt(20))
    assert np.isnan(lacey_index(points, np.zeros(4000, dtype=bool), width=2.0))


@pytest.mark.unit
@pytest.mark.parametrize("degrees", [10.0, 25.0, 40.0])
def test_the_slope_of_a_flat_surface_is_found_from_a_guess_that_is_off(degrees):
    rng = np.random.default_rng(2)
    along, above = rng.uniform(-9.0, 9.0, 6000), rng.uniform(-6.0, 0.0, 6000)
    inside = np.hypot(along, above - 2.0) < 9.0
    turned = np.exp(1j * np.radians(degrees)) * (along + 1j * above)[inside]
    found = surface_angle(turned.real, turned.imag, np.radians(degrees - 4.0))
    assert np.degrees(found) == pytest.approx(degrees, abs=1.0)


@pytest.fixture(scope="module")
def turned(shake):
    """Prisms in a drum that has turned for a while."""
    del shake
    return drum(grow_planar(30), rng=1, turns=0.3)


@pytest.mark.slow
@pytest.mark.client
def test_the_torque_is_the_weight_times_the_lever_of_the_centre_of_mass(turned):
    report = turned.report
    # Of seven such drums the ratio was 0.996 ± 0.011.
    assert report.torque == pytest.approx(report.lift_torque, rel=0.1)
    assert report.torque > 0


@pytest.mark.slow
@pytest.mark.client
def test_grains_go_up_on_the_side_that_rises_and_stay_inside(turned):
    report, positions = turned.report, turned.packing.positions
    assert np.hypot(positions[:, 0], positions[:, 1]).max() < report.radius
    np.testing.assert_allclose(turned.packing.domain.upper[:2], report.radius)
    assert report.turns == pytest.approx(0.3, abs=0.01)
    # Of seven such drums 45° ± 5°.
    assert np.radians(10.0) < report.mass_angle < np.radians(80.0)
    assert report.froude_number == pytest.approx(0.01)
    # ω² R / g of what is reported in SI.
    assert (2 * np.pi / report.period) ** 2 * report.radius / 9.81 == pytest.approx(0.01)


@pytest.mark.client
def test_size_follows_from_the_fill_and_is_what_was_given():
    bed = grow_planar(16)
    wide = drum(bed, rng=1, radius=6e-3, turns=0.01).report
    assert wide.radius == pytest.approx(6e-3)
    half, full = (Shell(bed, fill=fill, radius=None, length=None, rng=1).packing.domain.lower[1] for fill in (0.2, 0.4))
    assert half / full == pytest.approx(np.sqrt(2.0))


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.statistical
def test_the_angle_rises_with_the_speed():
    # Of five drums each: 44.1° ± 1.6° at a Froude number of 0.05, 51.8° ± 3.4° at 0.6; means of three and of five
    # differ by 4.4 of their spreads.
    bed = grow_planar(30)
    radius = Shell(bed, fill=0.35, radius=None, length=None, rng=1).packing.domain.upper[0] / GUIDE

    def mean_angle(froude, n):
        period = 2 * np.pi * np.sqrt(radius / 9.81 / froude)
        return np.mean([drum(bed, rng=seed, turns=0.8, period=period).report.mass_angle for seed in range(n)])

    slow, fast = mean_angle(0.05, 3), mean_angle(0.6, 5)
    assert fast > slow


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.statistical
def test_lifters_lift_and_halves_mix():
    outcome = drum(grow_planar(40), rng=1, turns=1.0, lifters=6)
    report, history = outcome.report, outcome.history
    assert report.torque == pytest.approx(report.lift_torque, rel=0.1)
    mixing = history["mixing"][history["stage"] == 1.0]
    assert mixing[-50:].mean() > mixing[:5].mean()


@pytest.mark.slow
@pytest.mark.client
def test_a_drum_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(drum, grow_planar(12), tmp_path, samples=100, rng=1, turns=0.3)


@pytest.mark.client
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"period": 1e-3}, "period must be"),
        ({"fill": 0.7}, "fill"),
        ({"turns": 0.0}, "turns"),
        ({"radius": 1e-4}, "narrower than the largest grain"),
        ({"length": 1e-5}, "shorter than the largest grain"),
        ({"lifters": 2, "lifter_height": 1.0}, "lower than half the drum's radius"),
        ({"lifters": 33}, "lifters"),
    ],
)
def test_a_drum_that_makes_no_sense_is_refused(options, words):
    with pytest.raises(InputError, match=words):
        drum(grow(12), rng=1, **options)


@pytest.mark.slow
@pytest.mark.client
def test_units_of_a_history_are_si(turned):
    scales = units(turned.packing)
    last = turned.history["lift_torque"][-1]
    side = turned.packing.positions[:, 0]
    masses = turned.snapshot.masses()
    assert last == pytest.approx(9.81 * masses @ side, rel=1e-6)
    assert scales.length > 0
