from __future__ import annotations

import numpy as np
import pytest
from chance import margin
from loading import check_that_it_goes_on, grow, grow_planar

from grainsdem.dynamics import ring_shear
from grainsdem.errors import InputError

pytestmark = pytest.mark.client

STRESS = 5e3


@pytest.fixture(scope="module")
def sheared(shake):
    """A ring of spheres, which roll and are quick."""
    return ring_shear(
        grow(70), normal_stress=STRESS, strain=0.2, inertial_number=0.1, friction=0.5, spheres=True, rng=1
    )


@pytest.fixture(scope="module")
def several(shake):
    """Rings of twice as many spheres that go round for longer."""
    options = {"normal_stress": STRESS, "strain": 1.0, "inertial_number": 0.1, "friction": 0.5, "spheres": True}
    return [ring_shear(grow(150), rng=seed, **options) for seed in range(1, 5)]


@pytest.mark.slow
@pytest.mark.statistical
def test_lid_and_contacts_tell_the_same_friction(several):
    told = []
    for ring in several:
        chosen = ring.history["stage"] == 1
        means = {name: series[chosen].mean() for name, series in ring.history.items()}
        told.append(
            [
                means["shear_stress"] / means["normal_stress"],
                means["shear_stress_contacts"] / means["normal_stress_contacts"],
            ]
        )
    lid, contacts = np.mean(told, axis=0)
    # Of 11 rings the two differed by −0.006 ± 0.0045, and the lids bore 0.25 ± 0.07.
    assert contacts == pytest.approx(lid, abs=0.006 + margin(0.0045, measured=11, runs=4))
    assert lid == pytest.approx(0.25, abs=margin(0.07, measured=11, runs=4))


@pytest.mark.slow
@pytest.mark.statistical
def test_the_lids_are_pressed_down_as_hard_as_was_asked_for(several):
    # Of 11 rings: 0.998 ± 0.0033 of what was asked for.
    told = np.mean([ring.report.normal_stress for ring in several])
    assert told == pytest.approx(STRESS, rel=0.002 + margin(0.0033, measured=11, runs=4))


@pytest.mark.slow
@pytest.mark.statistical
def test_grains_go_round_faster_the_nearer_they_are_to_the_lid(several):
    slopes = []
    for ring in several:
        height, velocity = ring.profile["height"], ring.profile["velocity"]
        slopes.append(np.nanmean(velocity[height > 2 / 3]) - np.nanmean(velocity[height < 1 / 3]))
    # Of 11 rings: 0.6 ± 0.1 of the lid's speed.
    assert np.mean(slopes) == pytest.approx(0.6, abs=margin(0.1, measured=11, runs=4))


def test_the_glued_grains_stay_on_their_plates(sheared):
    glued = sheared.snapshot.is_glued
    n = int(glued.sum()) // 2
    heights = sheared.packing.positions[:, 2]
    assert glued[: 2 * n].all()
    assert np.ptp(heights[:n]) == pytest.approx(0, abs=1e-9)
    assert np.ptp(heights[n : 2 * n]) == pytest.approx(0, abs=1e-9)
    loose = heights[2 * n :]
    assert (loose > heights[0]).all()
    assert (loose < heights[n]).all()
    np.testing.assert_allclose(sheared.snapshot.velocities[:n], 0, atol=1e-12)


@pytest.mark.slow
def test_a_ring_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    options = {"strain": 0.05, "inertial_number": 0.1, "spheres": True, "rng": 1}
    whole = check_that_it_goes_on(ring_shear, grow(70), tmp_path, samples=40, **options)
    assert len(whole.profile["velocity"])


def test_a_ring_takes_its_radii_in_metres():
    outcome = ring_shear(
        grow(60),
        strain=0.01,
        inertial_number=0.1,
        inner_radius=1.5e-3,
        outer_radius=4e-3,
        spheres=True,
        rng=1,
    )
    radii = np.hypot(*outcome.packing.positions[:, :2].T)
    assert radii.min() > 1.5e-3
    assert radii.max() < 4e-3


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"normal_stress": 0.0}, "normal_stress"),
        ({"strain": -1.0}, "strain"),
        ({"inner_radius": 3e-3, "outer_radius": 2e-3}, "radii"),
        ({"inner_radius": 2e-3, "outer_radius": 2.5e-3}, "narrower than the largest grain"),
        ({"inner_radius": 20e-3, "outer_radius": 30e-3}, "needs four times as many"),
    ],
)
def test_options_out_of_range_are_refused_by_name(options, words):
    with pytest.raises(InputError, match=words):
        ring_shear(grow(20), rng=1, **options)


def test_a_planar_bed_is_sent_to_the_box():
    with pytest.raises(InputError, match="direct shear box"):
        ring_shear(grow_planar(9), rng=1)
