from __future__ import annotations

import json

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import minimize

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import FAMILIES, LogHyperbolic, fit_sizes

# ζ = 1 and β/α = 0.64: of all shapes about the one whose parameters are told best from draws.
TRUTH = LogHyperbolic(alpha=5.0, beta=3.2, delta=1 / np.sqrt(5.0**2 - 3.2**2), mu=np.log(0.5e-3))


VALUES = {name: getattr(TRUTH, name) for name in ("alpha", "beta", "delta", "mu")}
VALUES |= dict(zip(("chi", "xi"), TRUTH.shape, strict=True))


def errors(fit, names):
    return {name: fit.parameters[name] / VALUES[name] - 1 for name in names}


def standard_errors(fit, names):
    """Half of an interval of 68.27 %, relative to its middle."""
    return {n: 0.5 * (fit.intervals[n][1] - fit.intervals[n][0]) / abs(fit.parameters[n]) for n in names}


@pytest.mark.statistical
@pytest.mark.parametrize("seed", range(4))
def test_the_well_conditioned_parameters_of_20_000_draws_are_recovered_within_five_percent(seed):
    d = TRUTH.draw(20_000, rng=seed)
    fit = fit_sizes(d, confidence=0.6827)
    found = fit.distribution
    for name, error in errors(fit, ("chi", "xi")).items():
        assert abs(error) < 0.05, name
    assert abs(found.mode / TRUTH.mode - 1) < 0.05
    quartiles = [np.interp([0.25, 0.5, 0.75], h.cdf(np.sort(d)), np.sort(d)) for h in (found, TRUTH)]
    np.testing.assert_allclose(*quartiles, rtol=0.05)
    # α, β and δ are correlated at 0.9: their standard errors alone are 5 %, so 5 % cannot be had from 20 000.
    names = ("alpha", "beta", "delta", "mu")
    sizes = standard_errors(fit, names)
    assert 0.03 < sizes["delta"] < 0.07
    for name, error in errors(fit, names).items():
        assert abs(error) < 5 * sizes[name], name


@pytest.mark.slow
@pytest.mark.statistical
def test_all_parameters_are_recovered_within_five_percent_where_the_draws_are_enough():
    fit = fit_sizes(TRUTH.draw(400_000, rng=1), confidence=0.6827)
    names = ("alpha", "beta", "delta", "mu", "chi", "xi")
    assert max(standard_errors(fit, names).values()) < 0.05 / 3
    for name, error in errors(fit, names).items():
        assert abs(error) < 0.05, name


@pytest.mark.slow
@pytest.mark.statistical
def test_intervals_hold_the_truth_as_often_as_they_say():
    repeats, confidence = 100, 0.9
    fits = [fit_sizes(TRUTH.draw(1000, rng=seed), confidence=confidence) for seed in range(repeats)]
    held = 5 * np.sqrt(confidence * (1 - confidence) / repeats)
    for name, value in VALUES.items():
        share = np.mean([fit.intervals[name][0] <= value <= fit.intervals[name][1] for fit in fits])
        assert abs(share - confidence) < held, name


@pytest.mark.statistical
@pytest.mark.parametrize("family", ["normal", "lognormal"])
def test_intervals_of_normal_and_lognormal_hold_the_truth_as_often_as_they_say(family):
    repeats, confidence, rng = 400, 0.9, np.random.default_rng(2)
    held = np.zeros(2)
    for _ in range(repeats):
        x = rng.normal(1.0, 0.1, 12)
        fit = fit_sizes(x if family == "normal" else np.exp(x), family, confidence=confidence)
        held += [low <= value <= high for value, (low, high) in zip((1.0, 0.1), fit.intervals.values(), strict=True)]
    np.testing.assert_allclose(held / repeats, confidence, atol=5 * np.sqrt(confidence * (1 - confidence) / repeats))


@pytest.mark.client
def test_no_search_over_scipys_density_finds_a_higher_likelihood():
    d = TRUTH.draw(300, rng=7)
    x = np.log(d)
    fit = fit_sizes(d)

    def missing(p):
        mu, log_delta, log_gamma, beta = p
        delta, alpha = np.exp(log_delta), np.hypot(np.exp(log_gamma), beta)
        return -stats.genhyperbolic.logpdf(x, p=1, a=alpha * delta, b=beta * delta, loc=mu, scale=delta).sum()

    start = [TRUTH.mu, np.log(TRUTH.delta), np.log(TRUTH.gamma), TRUTH.beta]
    search = minimize(missing, start, method="Nelder-Mead", options={"fatol": 1e-8, "xatol": 1e-8, "maxiter": 3000})
    assert fit.log_likelihood + x.sum() == pytest.approx(-search.fun, abs=1e-5)
    np.testing.assert_allclose([fit.parameters["mu"], fit.parameters["beta"]], search.x[[0, 3]], rtol=1e-3)


@pytest.mark.client
def test_normal_and_lognormal_are_scipys_fits_and_so_is_the_distance_of_kolmogorov_and_smirnov():
    d = TRUTH.draw(500, rng=3)
    normal, lognormal = fit_sizes(d, "normal"), fit_sizes(d, "lognormal")
    np.testing.assert_allclose(list(normal.parameters.values()), stats.norm.fit(d), rtol=1e-12)
    shape, _, scale = stats.lognorm.fit(d, floc=0)
    np.testing.assert_allclose(list(lognormal.parameters.values()), [np.log(scale), shape], rtol=1e-4)
    for fit, frozen in ((normal, stats.norm(*stats.norm.fit(d))), (lognormal, stats.lognorm(shape, scale=scale))):
        oracle = stats.kstest(d, frozen.cdf)
        assert fit.ks == pytest.approx(oracle.statistic, rel=1e-4)
        assert fit.ks_p_value == pytest.approx(oracle.pvalue, rel=1e-3)
        assert fit.aic == pytest.approx(4 - 2 * frozen.logpdf(d).sum(), rel=1e-9)


@pytest.mark.unit
def test_the_criterion_picks_the_family_that_drew_the_sizes():
    rng = np.random.default_rng(5)
    drawn = {
        "normal": rng.normal(1.0, 0.2, 3000),
        "lognormal": rng.lognormal(0.0, 0.4, 3000),
        "log-hyperbolic": TRUTH.draw(3000, rng=5),
    }
    for family, d in drawn.items():
        best = min(FAMILIES, key=lambda f, d=d: fit_sizes(d, f).aic)
        assert best == family


@pytest.mark.unit
@pytest.mark.parametrize(
    ("sizes", "edge", "chi"),
    [
        (np.exp(stats.norm.ppf((np.arange(4000) + 0.5) / 4000)), "lognormal", 0.0),
        (np.exp(stats.laplace.ppf((np.arange(4000) + 0.5) / 4000)), "log-Laplace", 0.0),
        (np.exp(stats.gamma(2.0).ppf((np.arange(4000) + 0.5) / 4000)), "one-sided", 1.0),
    ],
)
def test_a_fit_on_an_edge_of_the_shape_triangle_says_so_and_is_still_a_distribution(sizes, edge, chi):
    fit = fit_sizes(sizes)
    assert fit.edge == edge
    assert abs(fit.parameters["chi"]) <= fit.parameters["xi"]
    assert fit.parameters["chi"] == pytest.approx(chi * fit.parameters["xi"], abs=0.02)
    low, high = fit.intervals["xi"]
    assert low <= fit.parameters["xi"] <= high
    assert fit.log_likelihood >= fit_sizes(sizes, "lognormal").log_likelihood - 1e-3
    found = json.loads(json.dumps(fit.to_dict(), allow_nan=False))
    assert found["intervals"]["alpha"] == [None, None]


@pytest.mark.unit
@pytest.mark.parametrize(
    "sizes",
    [
        np.repeat([1e-3, 2e-3], 50),
        np.append(np.random.default_rng(1).normal(1e-3, 1e-5, 200), 1.0),
        np.append(np.random.default_rng(1).normal(1e-3, 1e-5, 200), 1e-12),
        np.geomspace(1e-9, 1e9, 100),
        1e-3 * (1 + 1e-9 * np.random.default_rng(1).standard_normal(500)),
        np.concatenate([np.random.default_rng(k).normal(mean, 0.05, 300) for k, mean in enumerate((1.0, 3.0))]),
        np.linspace(1.0, 2.0, 10),
    ],
    ids=["two sizes", "a boulder", "dust", "eighteen decades", "nearly one", "two kinds", "ten"],
)
def test_odd_sizes_have_a_fit_that_is_no_less_likely_than_the_lognormal_one(sizes):
    fit = fit_sizes(sizes)
    assert fit.log_likelihood >= fit_sizes(sizes, "lognormal").log_likelihood - 1e-3
    assert 0 <= abs(fit.parameters["chi"]) <= fit.parameters["xi"] <= 1
    low, high = fit.intervals["xi"]
    assert low <= fit.parameters["xi"] <= high
    np.testing.assert_allclose(fit.distribution.tails(sizes), np.clip(fit.distribution.tails(sizes), 0, 1))


@pytest.mark.property
@pytest.mark.parametrize("factor", [1e-6, 3.0, 1e4])
def test_the_unit_of_length_moves_the_place_of_a_fit_and_nothing_else(factor):
    d = TRUTH.draw(800, rng=2)
    one, other = fit_sizes(d), fit_sizes(factor * d)
    for name in ("alpha", "beta", "delta", "chi", "xi"):
        assert other.parameters[name] == pytest.approx(one.parameters[name], rel=1e-4)
    assert other.parameters["mu"] == pytest.approx(one.parameters["mu"] + np.log(factor), abs=1e-4)
    assert other.ks == pytest.approx(one.ks, rel=1e-4)
    assert other.log_likelihood == pytest.approx(one.log_likelihood - 800 * np.log(factor), rel=1e-9)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("sizes", "family", "confidence", "error", "match"),
    [
        (np.ones((3, 4)), "normal", 0.95, ShapeError, r"shape \(n,\); got shape \(3, 4\)"),
        (np.arange(1.0, 6.0), "normal", 0.95, InputError, "10 sizes or more; got 5"),
        (np.arange(20.0), "normal", 0.95, InputError, "positive and finite; 1 of 20"),
        (np.full(20, 2e-3), "log-hyperbolic", 0.95, InputError, "all 20 sizes are 0.002 m"),
        (np.arange(1.0, 21.0), "weibull", 0.95, InputError, "'normal', 'lognormal' or 'log-hyperbolic'; got 'weibull'"),
        (np.arange(1.0, 21.0), "normal", 1.0, InputError, "between 0 and 1; got 1.0"),
    ],
)
def test_what_cannot_be_fitted_is_refused(sizes, family, confidence, error, match):
    with pytest.raises(error, match=match):
        fit_sizes(sizes, family, confidence=confidence)
