from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import genhyperbolic, lognorm, norm

from grainsdem.errors import InputError
from grainsdem.measures import LogHyperbolic, LogNormal, Normal
from grainsdem.measures.distributions.climbing import Point
from grainsdem.measures.distributions.likelihood import hyperbolic_likelihood, hyperbolic_scores, over_phi, theta_of

SHAPES = [(3.0, 1.0, 0.8), (40.0, -5.0, 2.0), (2.0, 1.9, 0.05), (1.2, 0.0, 1e-3), (40.0, 15.0, 3.0)]


def scipys(h):
    return genhyperbolic(p=1, a=h.alpha * h.delta, b=h.beta * h.delta, scale=h.delta, loc=h.mu)


@pytest.mark.client
@pytest.mark.parametrize("shape", SHAPES)
def test_density_and_both_tails_are_those_of_scipys_generalised_hyperbolic(shape):
    h = LogHyperbolic(*shape, -7.0)
    oracle = scipys(h)
    x = oracle.mean() + oracle.std() * np.linspace(-5, 5, 21)
    d = np.exp(x)
    np.testing.assert_allclose(h.log_density(d) + x, oracle.logpdf(x), rtol=1e-9, atol=1e-9)
    below, above = h.tails(d)
    np.testing.assert_allclose(below, oracle.cdf(x), rtol=1e-6, atol=1e-9)  # scipy's quadrature is good to 1e-8
    np.testing.assert_allclose(above, oracle.sf(x), rtol=1e-6, atol=1e-9)


@pytest.mark.unit
def test_tails_end_at_zero_and_one_and_there_are_no_sizes_below_zero():
    h = LogHyperbolic(3.0, 1.0, 0.8, -7.0)
    np.testing.assert_array_equal(h.tails([-1.0, 0.0, np.inf]), [[0, 0, 1], [1, 1, 0]])
    np.testing.assert_array_equal(h.density([-1.0, 0.0]), 0)
    assert h.density(h.mode) * h.mode > h.density(1.01 * h.mode) * 1.01 * h.mode
    assert h.cdf([[1e-3], [2e-3]]).shape == (2, 1)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("ours", "scipys"), [(Normal(2.0, 0.3), norm(2.0, 0.3)), (LogNormal(0.7, 0.3), lognorm(0.3, scale=np.exp(0.7)))]
)
def test_normal_and_lognormal_are_scipys(ours, scipys):
    d = np.linspace(0.0, 4.0, 9)
    np.testing.assert_allclose(ours.density(d), scipys.pdf(d), rtol=1e-12)
    np.testing.assert_allclose(ours.tails(d), [scipys.cdf(d), scipys.sf(d)], rtol=1e-9)


@pytest.mark.property
@settings(max_examples=40, deadline=None)
@given(st.floats(-3, 3), st.floats(-3, 3), st.floats(-8, 8), st.floats(-8, 2))
def test_the_density_is_the_slope_of_the_cdf_and_the_tails_sum_to_one(v, tau, log_zeta, mu):
    zeta, width = np.exp(log_zeta), np.exp(tau)
    delta = width * np.sqrt(zeta) / np.cosh(v)
    gamma = zeta / delta
    h = LogHyperbolic(gamma * np.cosh(v), gamma * np.sinh(v), delta, mu)
    assert h.zeta == pytest.approx(zeta, rel=1e-6)
    chi, xi = h.shape
    assert 0 <= abs(chi) < xi < 1
    x = np.log(h.mode) + 0.5 * width * np.linspace(-2, 2, 9)
    below, above = h.tails(np.exp(x))
    np.testing.assert_allclose(below + above, 1, rtol=1e-12)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    half = 0.5 * np.diff(x)
    inner = (x[:-1] + half)[:, None] + half[:, None] * nodes
    found = half * ((h.density(np.exp(inner)) * np.exp(inner)) @ weights)
    np.testing.assert_allclose(np.diff(below), found, rtol=1e-3, atol=1e-6)  # a corner at small ζ tires the nodes


@pytest.mark.statistical
@pytest.mark.parametrize("shape", SHAPES[:3])
def test_draws_have_the_moments_of_the_distribution(shape):
    h, n = LogHyperbolic(*shape, -7.0), 20_000
    x, oracle = np.log(h.draw(n, rng=5)), scipys(h)
    mean, variance, kurtosis = oracle.mean(), oracle.var(), float(oracle.stats("k"))
    assert abs(x.mean() - mean) < 5 * np.sqrt(variance / n)
    assert abs(x.var() - variance) < 5 * variance * np.sqrt((kurtosis + 2) / n)
    np.testing.assert_array_equal(x, np.log(h.draw(n, rng=5)))


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(-2, 2), st.floats(-4, 4))
def test_derivatives_of_the_likelihood_are_its_differences(c, log_tau, v, w):
    x = np.random.default_rng(1).standard_normal(50)
    phi, h = np.array([c, log_tau, v, w]), 1e-5

    def evaluate(phi):
        return over_phi(lambda theta: hyperbolic_likelihood(theta, x))(phi)

    point = evaluate(phi)
    steps = h * np.eye(4)
    gradient = [(evaluate(phi + s).value - evaluate(phi - s).value) / (2 * h) for s in steps]
    curvature = [(evaluate(phi + s).gradient - evaluate(phi - s).gradient) / (2 * h) for s in steps]
    size = 1 + np.abs(point.curvature).max()
    np.testing.assert_allclose(point.gradient, gradient, rtol=1e-5, atol=1e-5 * size)
    np.testing.assert_allclose(point.curvature, curvature, rtol=1e-5, atol=1e-5 * size)  # terms of θ cancel over φ
    theta, jacobian = theta_of(phi)
    np.testing.assert_allclose(hyperbolic_scores(theta, x).sum(axis=0) @ jacobian, point.gradient, atol=1e-9 * size)


@pytest.mark.unit
def test_what_is_no_distribution_is_refused():
    for numbers in [(1.0, 1.0, 1.0, 0.0), (1.0, 0.0, 0.0, 0.0), (np.nan, 0.0, 1.0, 0.0), (1.0, -2.0, 1.0, 0.0)]:
        with pytest.raises(InputError, match=r"alpha > \|beta\| and delta > 0; got alpha"):
            LogHyperbolic(*numbers)
    with pytest.raises(InputError, match="a normal distribution needs"):
        Normal(0.0, 0.0)
    with pytest.raises(InputError, match="a lognormal distribution needs"):
        LogNormal(np.inf, 1.0)
    with pytest.raises(InputError, match="zero or more; got -1"):
        LogHyperbolic(1.0, 0.0, 1.0, 0.0).draw(-1)


@pytest.mark.unit
def test_a_likelihood_without_a_top_has_no_covariance():
    from grainsdem.measures.distributions.climbing import climb, covariance

    def ridge(theta):
        return Point(-(theta[0] ** 2), np.array([-2 * theta[0], 0.0]), np.diag([-2.0, 0.0]))

    theta, top = climb(ridge, np.array([3.0, 1.0]), logarithms=())
    np.testing.assert_allclose(theta, [0, 1], atol=1e-4)
    assert np.isnan(covariance(top)).all()
