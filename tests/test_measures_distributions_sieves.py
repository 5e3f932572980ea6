from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import (
    FAMILIES,
    LogHyperbolic,
    LogNormal,
    Normal,
    fit_sieves,
    fit_sizes,
    sieve_statistics,
    size_statistics,
)

TRUTH = LogHyperbolic(alpha=5.0, beta=3.2, delta=1 / np.sqrt(5.0**2 - 3.2**2), mu=np.log(0.5e-3))


def sieved(d, step):
    """Return the bounds of sieves at steps of ln d, with pan and overflow, and the counts between them."""
    inner = np.exp(np.arange(np.log(d).min() - step, np.log(d).max() + 2 * step, step))
    bounds = np.concatenate([[0.0], inner, [np.inf]])
    return bounds, np.histogram(d, bounds)[0]


@pytest.mark.statistical
def test_a_quarter_phi_of_sieves_recovers_the_shape_of_20_000_grains_within_five_percent():
    bounds, counts = sieved(TRUTH.draw(20_000, rng=1), 0.25 * np.log(2))
    fit = fit_sieves(bounds, counts)
    chi, xi = TRUTH.shape
    assert fit.parameters["chi"] == pytest.approx(chi, rel=0.05)
    assert fit.parameters["xi"] == pytest.approx(xi, rel=0.05)
    for name in ("alpha", "beta", "delta", "mu"):
        low, high = fit.intervals[name]
        assert abs(fit.parameters[name] - getattr(TRUTH, name)) < 5 / 1.96 * 0.5 * (high - low)
    assert fit.n == 20_000
    assert fit.ks < 1.63 / np.sqrt(20_000)  # of a known distribution's distances one in a hundred is larger


@pytest.mark.slow
@pytest.mark.statistical
def test_intervals_hold_the_truth_as_often_as_they_say():
    repeats, confidence = 40, 0.9
    held = {"chi": 0.0, "xi": 0.0, "mu": 0.0, "delta": 0.0}
    truth = {**dict(zip(("chi", "xi"), TRUTH.shape, strict=True)), "mu": TRUTH.mu, "delta": TRUTH.delta}
    for seed in range(repeats):
        fit = fit_sieves(*sieved(TRUTH.draw(2000, rng=seed), 0.3), confidence=confidence)
        for name in held:
            held[name] += fit.intervals[name][0] <= truth[name] <= fit.intervals[name][1]
    for name, count in held.items():
        assert abs(count / repeats - confidence) < 5 * np.sqrt(confidence * (1 - confidence) / repeats), name


@pytest.mark.unit
@pytest.mark.parametrize("family", FAMILIES)
def test_many_narrow_sieves_tell_what_the_sizes_themselves_tell(family):
    d = TRUTH.draw(2000, rng=4) if family == "log-hyperbolic" else np.random.default_rng(4).normal(1e-3, 1e-4, 2000)
    fine, whole = fit_sieves(*sieved(d, 0.01), family), fit_sizes(d, family)
    for name, (low, high) in whole.intervals.items():
        assert fine.parameters[name] == pytest.approx(whole.parameters[name], abs=0.02 * (high - low)), name
        np.testing.assert_allclose(fine.intervals[name], (low, high), atol=0.1 * (high - low))


@pytest.mark.client
def test_the_likelihood_is_that_of_scipys_distribution_and_nowhere_near_is_it_higher():
    bounds, counts = sieved(TRUTH.draw(5000, rng=6), 0.3)
    fit = fit_sieves(bounds, counts)
    bounds, counts = bounds[:-1], counts[:-1]  # nothing is that large: scipy's share of it is rounding

    def likelihood(alpha, beta, delta, mu):
        h = stats.genhyperbolic(p=1, a=alpha * delta, b=beta * delta, scale=delta, loc=mu)
        shares = np.diff(np.concatenate([[0.0], h.cdf(np.log(bounds[1:]))]))
        return counts[counts > 0] @ np.log(shares[counts > 0])

    best = [fit.parameters[name] for name in ("alpha", "beta", "delta", "mu")]
    assert fit.log_likelihood == pytest.approx(likelihood(*best), rel=1e-8)
    for k in range(4):
        for sign in (-1, 1):
            near = [p + sign * 0.01 * abs(p) * (i == k) for i, p in enumerate(best)]
            assert likelihood(*near) < fit.log_likelihood


@pytest.mark.unit
def test_families_compare_by_the_same_criterion_from_sieves_too():
    bounds, counts = sieved(TRUTH.draw(5000, rng=6), 0.3)
    fits = {family: fit_sieves(bounds, counts, family) for family in FAMILIES}
    assert min(fits, key=lambda family: fits[family].aic) == "log-hyperbolic"
    assert fits["lognormal"].to_dict()["ks_p_value"] is None


@pytest.mark.unit
@pytest.mark.parametrize(
    ("bounds", "counts", "error", "match"),
    [
        ([0, 1, 2], [1, 2, 3], ShapeError, r"got shape \(3,\) beside bounds of shape \(3,\)"),
        ([0, 2, 1, 3, 4, 5], [1] * 5, InputError, r"must rise from 0 or more, only the last infinite; got \[0.0, 2.0"),
        ([-1, 2, 3, 4, 5, 6], [1] * 5, InputError, "must rise from 0 or more"),
        ([0, 2, 3, 4, 5, 6], [1, 1, 1, -1, 1], InputError, "zero or more; got"),
        ([0, 2, 3, 4, 5, 6], [0, 9, 9, 0, 1], InputError, "needs grains in 5 classes or more; 3 of 5 hold any"),
    ],
)
def test_what_is_no_sieving_is_refused(bounds, counts, error, match):
    with pytest.raises(error, match=match):
        fit_sieves(bounds, counts)


@pytest.mark.unit
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("ends", [(0.15, 0.85), (0.0, 0.8), (0.2, 1.0)])
def test_grains_between_two_bounds_tell_the_whole_distribution_those_beyond_not_being_looked_for(family, ends):
    # Counts that are the shares themselves: the likelihood is highest at the distribution that they are of.
    truth = {"normal": Normal(1e-3, 2e-4), "lognormal": LogNormal(np.log(1e-3), 0.3), "log-hyperbolic": TRUTH}[family]
    sizes = np.linspace(1e-5, 5e-3, 200_001)
    bounds = np.interp(np.linspace(*ends, 14), truth.cdf(sizes), sizes)
    bounds[0] = 0.0 if ends[0] == 0 and family != "normal" else bounds[0]
    bounds[-1] = np.inf if ends[1] == 1 else bounds[-1]
    below = np.append(truth.cdf(bounds[:-1]), 1.0 if ends[1] == 1 else truth.cdf(bounds[-1]))
    counts = 1e6 * np.diff(below)
    fit = fit_sieves(bounds, counts, family)
    for name, (low, high) in fit.intervals.items():
        assert np.isfinite([low, high]).all()
        true = dict(zip(("chi", "xi"), TRUTH.shape, strict=True)).get(name) or getattr(truth, name)
        assert abs(fit.parameters[name] - true) < 0.02 * (high - low), name
    assert fit.ks < 1e-5


@pytest.mark.statistical
def test_a_coarsest_sieve_with_a_bound_of_its_own_leaves_the_fit_as_it_is():
    bounds, counts = sieved(TRUTH.draw(20_000, rng=3), 0.2)
    open_, closed = fit_sieves(bounds, counts), fit_sieves(bounds[:-1], counts[:-1])
    for name, (low, high) in open_.intervals.items():
        assert abs(closed.parameters[name] - open_.parameters[name]) < 0.1 * (high - low), name
    kept = bounds <= np.quantile(TRUTH.draw(20_000, rng=3), 0.97)  # what is coarser was not looked for
    cut = fit_sieves(bounds[kept], counts[: kept.sum() - 1])
    for name in ("chi", "xi", "alpha"):
        low, high = cut.intervals[name]
        true = dict(zip(("chi", "xi"), TRUTH.shape, strict=True)).get(name) or TRUTH.alpha
        assert abs(cut.parameters[name] - true) < 5 / 1.96 * 0.5 * (high - low), name


@pytest.mark.unit
def test_statistics_of_sieves_are_those_worked_by_hand_on_the_curve_between_the_bounds():
    # Coarse to fine, φ from -1 to 4: 5, 20, 40, 25, 10 %; the curve is 0, 5, 25, 65, 90, 100 % at the bounds.
    bounds = 1e-3 * 2.0 ** -np.arange(4.0, -2, -1)
    found = sieve_statistics(bounds, [10, 25, 40, 20, 5])
    p5, p16, p25, p50, p75, p84, p95 = 0, 11 / 20, 1, 1 + 25 / 40, 2 + 10 / 25, 2 + 19 / 25, 3.5
    assert found.folk_ward.mean == pytest.approx((p16 + p50 + p84) / 3, rel=1e-12)
    assert found.folk_ward.sorting == pytest.approx((p84 - p16) / 4 + (p95 - p5) / 6.6, rel=1e-12)
    skewness = (p16 + p84 - 2 * p50) / (2 * (p84 - p16)) + (p5 + p95 - 2 * p50) / (2 * (p95 - p5))
    assert found.folk_ward.skewness == pytest.approx(skewness, rel=1e-12)
    assert found.folk_ward.kurtosis == pytest.approx((p95 - p5) / (2.44 * (p75 - p25)), rel=1e-12)
    assert (found.size_class, found.sorting_class) == ("medium sand", "poorly sorted")
    # d50 has half of the mass below it; d16 is φ84.
    assert found.percentiles["d50"] == pytest.approx(1e-3 * 2**-p50, rel=1e-12)
    assert found.percentiles["d95"] == pytest.approx(1e-3, rel=1e-12)
    assert found.percentiles["d16"] == pytest.approx(1e-3 * 2**-p84, rel=1e-12)
    # Moments of the middles -0.5, 0.5, 1.5, 2.5, 3.5.
    mean = (5 * -0.5 + 20 * 0.5 + 40 * 1.5 + 25 * 2.5 + 10 * 3.5) / 100
    variance = sum(w * (x - mean) ** 2 for w, x in zip((5, 20, 40, 25, 10), np.arange(-0.5, 4), strict=True)) / 100
    assert (found.moments.mean, found.moments.sorting) == pytest.approx((mean, np.sqrt(variance)), rel=1e-12)


@pytest.mark.unit
def test_equal_weights_in_four_classes_are_spread_over_four_phi_and_not_heaped_on_their_middles():
    # Uniform over W = 4 φ: φq = W q / 100, so sorting 0.68 W / 4 + 0.9 W / 6.6 and kurtosis 0.9 / (2.44 · 0.5).
    bounds = [0, 0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3, np.inf]
    weights = [0, 25, 25, 25, 25, 0]
    found = sieve_statistics(bounds, weights)
    assert found.folk_ward.sorting == pytest.approx(0.68 + 3.6 / 6.6, rel=1e-12)  # 1.2255
    assert found.folk_ward.kurtosis == pytest.approx(0.9 / 1.22, rel=1e-12)
    assert (found.sorting_class, found.kurtosis_class) == ("poorly sorted", "platykurtic")
    # Of the middles alone half a class is missing at either end.
    heaped = size_statistics(1e-3 * 2.0 ** -np.array([0.5, -0.5, -1.5, -2.5]), weights=weights[1:-1])
    assert heaped.folk_ward.sorting == pytest.approx(2.72 / 4 + 3 / 6.6, rel=1e-12)  # 1.1345
    assert heaped.kurtosis_class == "very platykurtic"


@pytest.mark.unit
def test_the_finer_the_sieves_the_nearer_are_their_statistics_to_those_of_the_grains():
    phi = np.random.default_rng(3).normal(1.0, 0.6, 20_000)
    sizes, weights = 1e-3 * 2.0**-phi, np.random.default_rng(4).uniform(0.5, 2, phi.size)
    whole = size_statistics(sizes, weights=weights)
    bounds = 1e-3 * 2.0 ** -np.arange(5, -4, -0.02)
    sieved_ = sieve_statistics(bounds, np.histogram(sizes, bounds, weights=weights)[0])
    for kind in ("folk_ward", "moments"):
        for name in ("mean", "sorting", "skewness", "kurtosis"):
            assert getattr(getattr(sieved_, kind), name) == pytest.approx(getattr(getattr(whole, kind), name), abs=5e-3)


@pytest.mark.unit
def test_in_a_gap_a_percentile_is_in_its_middle_and_in_an_open_class_it_is_refused():
    bounds = [0, 1e-3, 2e-3, 4e-3, 8e-3, np.inf]
    assert sieve_statistics(bounds, [0, 3, 0, 3, 0]).percentiles["d50"] == pytest.approx(np.sqrt(8e-6))
    few = sieve_statistics(bounds, [1, 48, 30, 20, 1])
    assert np.isnan([few.moments.mean, few.moments.kurtosis]).all()  # an open class has no middle
    assert np.isfinite([few.folk_ward.kurtosis, few.percentiles["d5"]]).all()
    with pytest.raises(InputError, match=r"φ90, φ95 fall in an open class, which holds 12 %: give it a bound"):
        sieve_statistics(bounds, [12, 38, 30, 20, 0])
    with pytest.raises(InputError, match=r"φ5, φ10 fall in an open class, which holds 12 % and 4 %"):
        sieve_statistics(bounds, [4, 34, 30, 20, 12])
    with pytest.raises(InputError, match="must not all be zero"):
        sieve_statistics(bounds, [0] * 5)
    with pytest.raises(ShapeError, match=r"got shape \(4,\) beside bounds of shape \(6,\)"):
        sieve_statistics(bounds, [1] * 4)
