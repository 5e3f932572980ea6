from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import FAMILIES, LogHyperbolic, fit_sieves, fit_sizes

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
        ([0, 1, 2], [1, 2, 3], ShapeError, r"got \(3,\) and \(3,\)"),
        ([0, 2, 1, 3, 4, 5], [1] * 5, InputError, r"must rise from 0 or more, only the last infinite; got \[0.0, 2.0"),
        ([-1, 2, 3, 4, 5, 6], [1] * 5, InputError, "must rise from 0 or more"),
        ([0, 2, 3, 4, 5, 6], [1, 1, 1, -1, 1], InputError, "zero or more; got"),
        ([0, 2, 3, 4, 5, 6], [0, 9, 9, 0, 1], InputError, "needs grains in 5 classes or more; 3 of 5 hold any"),
    ],
)
def test_what_is_no_sieving_is_refused(bounds, counts, error, match):
    with pytest.raises(error, match=match):
        fit_sieves(bounds, counts)
