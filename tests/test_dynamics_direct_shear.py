from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from chance import margin
from conftest import cube_packing
from loading import check_that_it_goes_on, grow, grow_planar

from grainsdem.dynamics import direct_shear
from grainsdem.errors import InputError
from grainsdem.model import Domain

pytestmark = pytest.mark.client


def two_blocks():
    """A cube that fills the lower half of a box, and one on it that is narrower, and stays on it while it slides."""
    pair = cube_packing([[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]], density=2000.0, domain=Domain.box((2.0, 2.0, 4.0)))
    corners = pair.grains.vertices.copy()
    corners[8:, :2] *= 0.8
    return replace(pair, grains=replace(pair.grains, vertices=corners))


@pytest.mark.parametrize("friction", [0.3, 0.6])
def test_a_block_that_is_pushed_over_another_one_slides_at_its_friction(friction):
    outcome = direct_shear(two_blocks(), normal_stress=1e4, displacement=0.16, inertial_number=1e-2, friction=friction)
    assert outcome.report.steady_friction == pytest.approx(friction, rel=0.02)
    assert outcome.report.dilation == pytest.approx(0, abs=0.005)
    assert outcome.report.normal_stress == pytest.approx(1e4, rel=0.01)


def test_prisms_are_sheared_in_their_plane():
    start = grow_planar(16)
    outcome = direct_shear(start, displacement=0.02, inertial_number=0.05, rng=1)
    np.testing.assert_allclose(outcome.packing.positions[:, 2], start.positions[0, 2], atol=1e-9)
    # Of 12 beds: 1.006 ± 0.010.
    assert outcome.report.normal_stress == pytest.approx(1e4, rel=0.006 + margin(0.010, measured=12))
    assert 0 < outcome.report.initial_solid_fraction < 1


@pytest.mark.slow
def test_a_box_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(
        direct_shear, grow(16), tmp_path, samples=24, displacement=0.02, inertial_number=0.05, spheres=True, rng=1
    )


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"normal_stress": 0.0}, "normal_stress"),
        ({"displacement": 0.6}, "displacement"),
        ({"friction": -0.5}, "friction"),
    ],
)
def test_options_out_of_range_are_refused_by_name(options, words):
    with pytest.raises(InputError, match=words):
        direct_shear(two_blocks(), **options)
