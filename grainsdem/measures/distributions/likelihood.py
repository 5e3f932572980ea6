"""Likelihood of the log-hyperbolic distribution, with exact first and second derivatives, and the climb to its top.

The likelihood is that of θ = (μ, ln δ, ln γ, β), over which it is defined everywhere; α = √(γ² + β²). It is climbed
over φ = (c, ln τ, v, ln ζ) instead, with the mode c = μ + δ sinh v, τ = δ cosh v / √ζ, sinh v = β/γ and ζ = δγ: toward
the lognormal distribution the four of θ go to infinity together, while c and τ stay at its mean and standard deviation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.measures.distributions.climbing import Point, climb

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

MOST_ZETA = 1e6
"""ζ = δγ from where the distribution is the lognormal one: its kurtosis is within 3e-6 of it."""

LEAST_ZETA = 1e-4
"""ζ from where its rounded part is a corner."""

MOST_LEAN = 6.0
"""v = artanh(β/α) from where one tail is as steep as a wall: β/α is within 1e-5 of one."""

LOGARITHMS = (1, 2, 3)
"""The parameters of φ whose steps are kept short."""


def hyperbolic_likelihood(theta: Floats, x: Floats) -> Point:
    """Return the log-likelihood of logarithms of sizes ``x``, shape (n,), and its derivatives by θ."""
    from scipy.special import k0e, k1e  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    mu, log_delta, log_gamma, beta = theta
    delta, gamma = np.exp(log_delta), np.exp(log_gamma)
    alpha, zeta, n = np.hypot(gamma, beta), delta * gamma, x.size
    y = x - mu
    r = np.hypot(delta, y)
    k1 = float(k1e(zeta))
    q = zeta * float(k0e(zeta)) / k1  # ζ K₀/K₁
    bend = 2 * q + (q - zeta) * (q + zeta)  # dq / d ln ζ
    sum_r, sum_y, slopes = r.sum(), y.sum(), (y / r).sum()
    inverse, cubes, odd = (delta**2 / r).sum(), (delta**2 / r**3).sum(), (delta**2 * y / r**3).sum()
    value = n * (log_gamma - np.log(2 * alpha) - log_delta - np.log(k1)) + (zeta - alpha * r).sum() + beta * sum_y
    g2, b = gamma**2 / alpha, beta / alpha
    gradient = np.array(
        [
            alpha * slopes - n * beta,
            n * q - alpha * inverse,
            n * (2 + q - (gamma / alpha) ** 2) - g2 * sum_r,
            -n * beta / alpha**2 - b * sum_r + sum_y,
        ]
    )
    turned = gamma**2 * beta / alpha**3
    h = np.empty((4, 4))
    h[0, 0] = -alpha * cubes
    h[0, 1] = -alpha * odd
    h[0, 2] = g2 * slopes
    h[0, 3] = b * slopes - n
    h[1, 1] = n * bend - alpha * (2 * inverse - delta**2 * cubes)
    h[1, 2] = n * bend - g2 * inverse
    h[1, 3] = -b * inverse
    h[2, 2] = n * (bend - 2 * (gamma * beta) ** 2 / alpha**4) - gamma**2 * (alpha**2 + beta**2) / alpha**3 * sum_r
    h[2, 3] = 2 * n * gamma**2 * beta / alpha**4 + turned * sum_r
    h[3, 3] = -n * (gamma**2 - beta**2) / alpha**4 - gamma**2 / alpha**3 * sum_r
    rows, columns = np.tril_indices(4, -1)
    h[rows, columns] = h[columns, rows]
    return Point(float(value), gradient, h)


def hyperbolic_scores(theta: Floats, x: Floats) -> Floats:
    """Return the derivative of each logarithm's log-density by θ, shape (n, 4)."""
    from scipy.special import k0e, k1e  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    mu, log_delta, log_gamma, beta = theta
    delta, gamma = np.exp(log_delta), np.exp(log_gamma)
    alpha, zeta = np.hypot(gamma, beta), delta * gamma
    q = zeta * float(k0e(zeta)) / float(k1e(zeta))
    y = x - mu
    r = np.hypot(delta, y)
    return np.stack(
        [
            alpha * y / r - beta,
            q - alpha * delta**2 / r,
            2 + q - (gamma / alpha) ** 2 - gamma**2 / alpha * r,
            y - beta / alpha**2 - beta / alpha * r,
        ],
        axis=-1,
    )


def theta_of(phi: Floats) -> tuple[Floats, Floats]:
    """Return θ of φ, and the derivatives ∂θ/∂φ, shape (4, 4)."""
    c, log_tau, v, w = phi
    t, sech2 = np.tanh(v), 1 / np.cosh(v) ** 2
    m, b = np.exp(log_tau + 0.5 * w), np.exp(0.5 * w - log_tau)
    beta = b * np.sinh(v) * np.cosh(v)
    theta = np.array([c - m * t, log_tau + 0.5 * w - np.log(np.cosh(v)), 0.5 * w - log_tau + np.log(np.cosh(v)), beta])
    jacobian = np.array(
        [
            [1.0, -m * t, -m * sech2, -0.5 * m * t],
            [0.0, 1.0, -t, 0.5],
            [0.0, -1.0, t, 0.5],
            [0.0, -beta, b * np.cosh(2 * v), 0.5 * beta],
        ]
    )
    return theta, jacobian


def over_phi(evaluate: Callable[[Floats], Point]) -> Callable[[Floats], Point]:
    """Return a likelihood of θ as one of φ."""

    def evaluate_phi(phi: Floats) -> Point:
        theta, jacobian = theta_of(phi)
        value, gradient, curvature = evaluate(theta)
        return Point(value, gradient @ jacobian, jacobian.T @ curvature @ jacobian + _bend(phi, gradient))

    return evaluate_phi


def _bend(phi: Floats, gradient: Floats) -> Floats:
    """Return Σ_k (∂L/∂θ_k) ∂²θ_k/∂φ²."""
    _, log_tau, v, w = phi
    t, sech2 = np.tanh(v), 1 / np.cosh(v) ** 2
    m, b = np.exp(log_tau + 0.5 * w), np.exp(0.5 * w - log_tau)
    # Over (ln τ, v, ln ζ): μ and β are a factor exp(± ln τ + ln ζ / 2) times a function of v.
    sides_mu, sides_beta = np.array([1.0, 0.0, 0.5]), np.array([-1.0, 0.0, 0.5])
    turn = np.array([0.0, 1.0, 0.0])
    total = np.zeros((4, 4))
    for weight, sides, f, f1, f2 in (
        (gradient[0], sides_mu, -m * t, -m * sech2, 2 * m * t * sech2),
        (gradient[3], sides_beta, 0.5 * b * np.sinh(2 * v), b * np.cosh(2 * v), 2 * b * np.sinh(2 * v)),
    ):
        mixed = np.outer(sides, turn)
        total[1:, 1:] += weight * (f * np.outer(sides, sides) + f1 * (mixed + mixed.T) + f2 * np.outer(turn, turn))
    total[2, 2] += (gradient[2] - gradient[1]) * sech2
    return total


def standard_start(skewness: float, kurtosis: float) -> Floats:
    """Return φ of mean zero and variance one, near the given skewness and excess kurtosis.

    Notes
    -----
    For small ξ the skewness is 3χ and the excess kurtosis 3ξ². The mean is μ + δ sinh(v) K₂/K₁ and the variance δ²
    [K₂/(ζK₁) + sinh²(v) (K₃/K₁ - (K₂/K₁)²)], with all K at ζ.
    """
    from scipy.special import kve  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    xi = float(np.clip(np.sqrt(max(kurtosis, 0.0) / 3), 0.2, 0.8))
    v = float(np.arctanh(np.clip(skewness / (3 * xi), -0.8, 0.8)))
    zeta, lean = xi**-2 - 1, np.sinh(v)
    k1, k2, k3 = (float(kve(order, zeta)) for order in (1, 2, 3))
    delta = 1 / np.sqrt(k2 / (zeta * k1) + lean**2 * (k3 / k1 - (k2 / k1) ** 2))
    return np.array([delta * lean * (1 - k2 / k1), np.log(delta * np.cosh(v) / np.sqrt(zeta)), v, np.log(zeta)])


def climb_hyperbolic(evaluate: Callable[[Floats], Point], start: Floats) -> tuple[Floats, Point]:
    """Return φ of the highest likelihood; where that is at infinity, as far as the limits of this module."""
    upper = np.array([np.inf, np.inf, MOST_LEAN, np.log(MOST_ZETA)])
    lower = np.array([-np.inf, -np.inf, -MOST_LEAN, np.log(LEAST_ZETA)])
    return climb(evaluate, start, logarithms=LOGARITHMS, lower=lower, upper=upper)


def profile_zeta(evaluate: Callable[[Floats], Point], phi: Floats, top: float, drop: float) -> tuple[float, float]:
    """Return between which ln ζ the highest likelihood for a given ζ is within ``drop`` of the top.

    The ends are minus and plus infinity where it is so as far as `LEAST_ZETA` or `MOST_ZETA`.
    """
    from scipy.optimize import brentq  # noqa: PLC0415  (scipy.optimize costs a tenth of a second)

    bound = np.array([np.inf, np.inf, MOST_LEAN])
    latest = phi[:3].copy()
    # Where a likelihood has several tops, a second climb may end on another: what was found stays.
    found = {float(phi[3]): -drop}

    def missing(w: float) -> float:
        nonlocal latest
        if w in found:
            return found[w]

        def restricted(three: Floats) -> Point:
            point = evaluate(np.append(three, w))
            return Point(point.value, point.gradient[:3], point.curvature[:3, :3])

        latest, point = climb(restricted, latest, logarithms=(1, 2), lower=-bound, upper=bound)
        found[w] = top - point.value - drop
        return found[w]

    ends = []
    for sign, limit in ((-1.0, np.log(LEAST_ZETA)), (1.0, np.log(MOST_ZETA))):
        latest, inner, step = phi[:3].copy(), float(phi[3]), 0.1
        while sign * (inner + sign * step - limit) < 0 and missing(inner + sign * step) <= 0:
            inner, step = inner + sign * step, 2 * step
        outer = inner + sign * step
        if sign * (outer - limit) >= 0:
            ends.append(sign * np.inf)
        else:
            ends.append(float(brentq(missing, min(inner, outer), max(inner, outer), xtol=1e-4)))
    return ends[0], ends[1]
