from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import LogHyperbolic, LogNormal, Normal
from grainsdem.model import Grading

SAND = Grading([0.25e-3, 0.5e-3, 1e-3, 2e-3], [0.0, 0.2, 0.9, 1.0])


@pytest.mark.property
@given(
    # Sizes up to 10 : 1, of each class a twentieth of the mass at least: 6000 grains are enough for any of them.
    st.lists(st.floats(0.2, 1.0), min_size=2, max_size=5),
    st.floats(1.25, 1.6),
    st.integers(0, 2**31),
    st.sampled_from([2, 3]),
)
def test_drawn_grains_have_the_curve_at_every_opening(shares, ratio, seed, power):
    openings = 1e-4 * ratio ** np.arange(len(shares) + 1)
    passing = np.append(0.0, np.cumsum(shares) / np.sum(shares))
    passing[-1] = 1.0
    grading = Grading(openings, passing)
    ratios = np.random.default_rng(seed).uniform(0.85, 1.1, 6000)
    sizes = grading.draw(6000, power=power, ratios=ratios)
    assert (np.diff(sizes) >= 0).all()
    assert (sizes > openings[0]).all()
    assert (sizes < openings[-1]).all()
    assert grading.deviation(sizes, (sizes / ratios) ** power) < 1e-4
    # By hand, from the definition.
    masses = (sizes / ratios) ** power
    for opening, share in zip(openings, passing, strict=True):
        assert masses[sizes < opening].sum() / masses.sum() == pytest.approx(share, abs=1e-4)


@pytest.mark.unit
def test_a_gap_holds_no_grain_and_its_percentile_is_in_its_middle():
    gapped = Grading([1e-4, 2e-4, 8e-4, 16e-4], [0.0, 0.5, 0.5, 1.0])
    sizes = gapped.draw(5000)
    assert not ((sizes > 2e-4) & (sizes < 8e-4)).any()
    assert gapped.percentile(50) == pytest.approx(4e-4)
    assert gapped.percentile([0, 25, 75, 100]) == pytest.approx([1e-4, np.sqrt(2) * 1e-4, np.sqrt(128) * 1e-4, 16e-4])


@pytest.mark.unit
def test_between_openings_the_curve_is_a_line_over_the_logarithm():
    middle = np.sqrt(0.5e-3 * 1e-3)
    assert SAND.passing_at([0.0, 1e-5, 0.25e-3, middle, 1.0]) == pytest.approx([0, 0, 0, 0.55, 1])
    assert SAND.passing_at(SAND.percentile([10, 37, 95])) == pytest.approx([0.1, 0.37, 0.95])


@pytest.mark.unit
def test_too_few_grains_are_refused_with_a_number_that_is_enough():
    wide = Grading(np.geomspace(1e-3, 1e-2, 21), np.linspace(0, 1, 21))
    with pytest.raises(InputError, match=r"3000 grains are too few .*; (\d+) grains can have it") as refused:
        wide.draw(3000)
    enough = int(str(refused.value).rsplit("; ", 1)[1].split()[0])
    assert wide.deviation(wide.draw(enough), wide.draw(enough) ** 3) < 1e-4
    nearest = wide.draw(3000, tolerance=None)
    assert len(nearest) == 3000
    assert wide.deviation(nearest, nearest**3) < 0.05
    assert len(wide.draw(1, tolerance=None)) == 1
    with pytest.raises(InputError, match="1 or more; got 0"):
        wide.draw(0)


@pytest.mark.unit
@pytest.mark.parametrize(
    "law",
    [
        LogNormal(np.log(1e-3), 0.4),
        Normal(1e-3, 2e-4),
        LogHyperbolic(6.0, 2.0, 0.3, np.log(1e-3)),
        stats.lognorm(s=0.4, scale=1e-3),
    ],
)
def test_the_curve_of_a_distribution_by_mass_is_its_own_between_its_cut_tails(law):
    curve = Grading.of(law, tail=1e-3)
    q = np.array([0.05, 0.16, 0.5, 0.84, 0.95])
    # Lines between 33 openings: 0.1 % of the mass off at most for a normal one, 0.3 % for long tails.
    assert curve.passing_at(law.ppf(q)) == pytest.approx((q - 1e-3) / 0.998, abs=4e-3)
    sizes = curve.draw(20_000, tolerance=5e-3)
    assert curve.deviation(sizes, sizes**3) < 5e-3


@pytest.mark.unit
def test_quantiles_are_where_the_share_below_is_theirs():
    law = LogHyperbolic(6.0, -2.0, 0.3, np.log(1e-3))
    q = np.linspace(0.001, 0.999, 25)
    assert law.cdf(law.ppf(q)) == pytest.approx(q, abs=1e-12)
    assert np.isnan(law.ppf([-0.1, 1.1])).all()


@pytest.mark.unit
@pytest.mark.parametrize(
    ("openings", "passing", "error", "words"),
    [
        ([1e-3], [0.0], ShapeError, "two openings or more; got 1"),
        ([1e-3, 2e-3], [0.0], ShapeError, r"passing must have shape \(2\)"),
        ([1e-3, 1e-3], [0, 1], InputError, "rise, all unlike"),
        ([-1e-3, 1e-3], [0, 1], InputError, "above zero and rise"),
        ([1e-3, 2e-3, 3e-3], [0, 0.5, 0.4], InputError, "must not fall .* at number 3"),
        ([1e-3, 2e-3], [0.1, 1], InputError, "from 0 at the finest opening to 1 at the widest; got 0.1 and 1"),
    ],
)
def test_what_is_no_curve_is_refused(openings, passing, error, words):
    with pytest.raises(error, match=words):
        Grading(openings, passing)


@pytest.mark.unit
def test_options_out_of_range_are_refused():
    with pytest.raises(InputError, match="'equal-volume' or 'sieve'; got 'box'"):
        Grading([1, 2], [0, 1], "box")
    with pytest.raises(InputError, match="from 0 to 100; got 101"):
        SAND.percentile(101)
    with pytest.raises(InputError, match=r"between 0 and 0\.5; got 0\.5"):
        Grading.of(Normal(1, 0.1), tail=0.5)
    with pytest.raises(InputError, match=r"no 0\.5 % quantile"):
        Grading.of(Normal(1e-3, 1e-2))


def test_a_curve_on_the_way_to_another_has_percentiles_between():
    one = Grading([1e-3, 2e-3, 4e-3], [0.0, 0.3, 1.0])
    other = Grading([0.5e-3, 1e-3], [0.0, 1.0])
    for share in (0.0, 0.25, 1.0):
        found = one.toward(other, share)
        for percent in (10, 30, 50, 90):
            wanted = one.percentile(percent) ** (1 - share) * other.percentile(percent) ** share
            assert found.percentile(percent) == pytest.approx(wanted, rel=1e-6)
    with pytest.raises(InputError, match="from 0 to 1; got 2"):
        one.toward(other, 2)
    with pytest.raises(InputError, match="unlike diameters"):
        one.toward(Grading([1e-3, 2e-3], [0.0, 1.0], "sieve"), 0.5)
