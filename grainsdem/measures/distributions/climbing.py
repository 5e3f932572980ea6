"""Newton's climb to the top of a likelihood, and how far around it one may still stand."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Point(NamedTuple):
    """A likelihood and its derivatives.

    Parameters
    ----------
    value : float
        Logarithm of the likelihood.
    gradient : ndarray, shape (k,)
        Its first derivatives.
    curvature : ndarray, shape (k, k)
        Its second derivatives, or minus the information that is expected.
    """

    value: float
    gradient: Floats
    curvature: Floats


MOST_STEPS = 300
"""Steps of a climb; a dozen is usual, a hundred where the top is at infinity."""

LITTLE = 1e-9
"""Gain of the logarithm of the likelihood that ends a climb."""

FARTHEST = 1.5
"""Longest step of a parameter that is a logarithm: a factor of 4.5."""


def climb(
    evaluate: Callable[[Floats], Point],
    start: Floats,
    *,
    logarithms: tuple[int, ...],
    lower: Floats | None = None,
    upper: Floats | None = None,
) -> tuple[Floats, Point]:
    """Return where a likelihood is highest, and what it is there.

    Parameters
    ----------
    evaluate : callable
        The likelihood and its derivatives at parameters, shape (k,).
    start : ndarray, shape (k,)
        Where to begin.
    logarithms : tuple of int
        Parameters that are logarithms, whose steps are kept short.
    lower, upper : ndarray, shape (k,), optional
        Bounds of the parameters.

    Notes
    -----
    Directions in which the likelihood curves upward are climbed by the size of their curvature, and steps that do not
    lead upward are damped (Levenberg and Marquardt). Parameters on a bound stay there while they are drawn beyond it.
    """
    low = np.full(start.shape, -np.inf) if lower is None else lower
    high = np.full(start.shape, np.inf) if upper is None else upper
    theta = np.clip(start, low, high)
    here = evaluate(theta)
    damping = 1e-3
    for _ in range(MOST_STEPS):
        free = ~((theta <= low) & (here.gradient <= 0) | (theta >= high) & (here.gradient >= 0))
        step = np.zeros(theta.shape)
        step[free] = _newton(here.gradient[free], here.curvature[np.ix_(free, free)], damping)
        if float(here.gradient @ step) < LITTLE:
            break
        longest = max((abs(float(step[k])) for k in logarithms), default=0.0)
        step *= min(1.0, FARTHEST / max(longest, 1e-300))
        beyond = np.clip(theta + step, low, high)
        there = evaluate(beyond)
        if there.value > here.value:
            theta, here, damping = beyond, there, max(0.1 * damping, 1e-9)
        elif damping > 1e12:  # rounding hides what is left to gain
            break
        else:
            damping = max(10.0 * damping, 1e-3)
    return theta, here


def _newton(gradient: Floats, curvature: Floats, damping: float) -> Floats:
    """Return Newton's step, upward in every direction."""
    if not gradient.size:
        return gradient
    values, vectors = np.linalg.eigh(-curvature)
    largest = float(np.abs(values).max())
    if not largest > 0:  # level as far as rounding tells: there is no step
        return np.zeros(gradient.shape)
    scale = np.maximum(np.abs(values), 1e-12 * largest) * (1 + damping)
    return np.asarray(vectors @ (vectors.T @ gradient / scale))


def covariance(point: Point) -> Floats:
    """Return the covariance of the parameters at the top, from the information there; NaN where there is no top."""
    information = -point.curvature
    values = np.linalg.eigvalsh(information)
    if not values[0] > 1e-12 * values[-1]:
        return np.full(information.shape, np.nan)
    return np.asarray(np.linalg.inv(information))
