from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from grainsdem.errors import InputError
from grainsdem.model import Domain
from grainsdem.points import clark_evans, halton, poisson

pytestmark = pytest.mark.unit

SLAB = Domain.slab((2.0, 1.0), 0.2)


def van_der_corput(index, base):
    """Return the digits of an index mirrored about the point, digit by digit."""
    value, weight = 0.0, 1.0
    while index:
        weight /= base
        index, digit = divmod(index, base)
        value += digit * weight
    return value


@pytest.mark.parametrize("bases", [(2, 3, 5), (5, 7, 11), (3, 4, 5), (13, 2, 101)])
@pytest.mark.parametrize("start", [0, 1, 1000])
def test_each_axis_is_the_sequence_of_its_base(bases, start):
    expected = [[van_der_corput(k, base) for base in bases] for k in range(start, start + 60)]
    np.testing.assert_allclose(halton(Domain.cube(), 60, bases=bases, start=start), expected, atol=1e-15)


def test_without_an_rng_it_is_deterministic_and_begins_alike_at_every_count():
    np.testing.assert_array_equal(halton(Domain.cube(), 100), halton(Domain.cube(), 500)[:100])


def test_a_planar_domain_takes_two_bases_or_three():
    two, three = (halton(SLAB, 50, bases=bases) for bases in ((5, 7), (5, 7, 2)))
    np.testing.assert_array_equal(two, three)
    assert (two[:, 2] == 0.1).all()
    assert halton(SLAB, 50, bases=(5, 7), rng=1).shape == (50, 3)


@pytest.mark.parametrize(
    ("domain", "bases", "words"),
    [
        (Domain.cube(), (2, 3), r"three whole numbers above 1, .*; got \(2, 3\)"),
        (SLAB, (2,), r"two or three whole numbers above 1, .*; got \(2,\)"),
        (SLAB, (2, 2), "without a common factor"),
        (SLAB, (0, 3), "above 1"),
        (Domain.cube(), (), "three whole numbers"),
        (Domain.cube(), (2**40, 3**30, 5**20), None),
    ],
)
def test_bases_that_are_not_coprime_are_refused_however_large(domain, bases, words):
    if words is None:
        assert len(halton(domain, 5, bases=bases)) == 5
        return
    with pytest.raises(InputError, match=words):
        halton(domain, 5, bases=bases)


@pytest.mark.statistical
@pytest.mark.parametrize("bases", [(2, 3, 5), (5, 7, 11)])
def test_the_discrepancy_is_below_that_of_random_seeds(bases):
    cube = Domain.cube()
    random = [qmc.discrepancy(poisson(cube, 400, rng=k), method="L2-star") for k in range(10)]
    assert qmc.discrepancy(halton(cube, 400, bases=bases), method="L2-star") < min(random)
    assert clark_evans(halton(cube, 400, bases=bases), cube) > 1.1
