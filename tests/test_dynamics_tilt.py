from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing
from loading import check_that_it_goes_on, grow

from grainsdem.dynamics import tilt
from grainsdem.errors import InputError
from grainsdem.model import Domain

pytestmark = pytest.mark.client


@pytest.mark.parametrize("friction", [0.4])
def test_a_block_fails_where_its_friction_is_overcome(friction):
    block = cube_packing([[2.0, 5.0, 1.0]], domain=Domain.box((20.0, 10.0, 6.0)))
    report = tilt(block, friction=friction, rate=0.004).report
    assert report.has_failed
    assert report.failure_angle == pytest.approx(np.arctan(friction), abs=np.radians(1.0))


def test_a_bed_that_stands_is_given_up_at_the_largest_angle():
    block = cube_packing([[2.0, 5.0, 1.0]], domain=Domain.box((20.0, 10.0, 6.0)))
    outcome = tilt(block, friction=0.9, max_angle=0.3, rate=0.05)
    assert not outcome.report.has_failed
    assert outcome.report.largest_angle == pytest.approx(0.3, abs=0.02)
    assert outcome.report.to_dict()["failure_angle"] is None
    down = outcome.snapshot.gravity
    np.testing.assert_allclose(np.linalg.norm(down), 9.81, rtol=1e-9)
    np.testing.assert_allclose(np.arctan2(down[0], -down[2]), outcome.report.largest_angle, atol=0.02)


@pytest.mark.slow
def test_a_tilted_bed_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(tilt, grow(12), tmp_path, samples=50, rng=1, rate=0.05, max_angle=0.4)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"rate": 0.0}, "rate"), ({"max_angle": 2.0}, "max_angle"), ({"gravity": -9.81}, "gravity")],
)
def test_options_out_of_range_are_refused_by_name(cube, options, words):
    with pytest.raises(InputError, match=words):
        tilt(cube, **options)
