"""Statistics of, and distributions fitted to, classes of size: what sieves give, where no grain's own size is known.

References
----------
.. [1] O. Barndorff-Nielsen, "Exponentially decreasing distributions for the logarithm of particle size", Proc. R. Soc.
   Lond. A 353 (1977) 401-419.
.. [2] N. R. J. Fieller, E. C. Flenley, W. Olbricht, "Statistics of particle size data", J. R. Stat. Soc. C 41 (1992)
   127-146.
.. [3] R. L. Folk and W. C. Ward, "Brazos River bar: a study in the significance of grain size parameters",
   J. Sedimentary Petrology 27 (1957) 3-26.
.. [4] S. J. Blott and K. Pye, "GRADISTAT: a grain size distribution and statistics package for the analysis of
   unconsolidated sediments", Earth Surface Processes and Landforms 26 (2001) 1237-1248.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.measures.distributions.climbing import Point, climb, covariance
from grainsdem.measures.distributions.fits import Family, SizeFit, StandardFit, check_options, hyperbolic_parameters
from grainsdem.measures.distributions.hyperbolic import NODES, WEIGHTS, span
from grainsdem.measures.distributions.likelihood import hyperbolic_scores, standard_start
from grainsdem.measures.distributions.normal import LogNormal, Normal
from grainsdem.measures.distributions.statistics import (
    MILLIMETRE,
    PERCENTAGES,
    PhiStatistics,
    SizeStatistics,
    by_moments,
    described,
    to_phi,
)

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

PANELS = 8
"""Panels of the integral over one class; classes of sieves are narrower than a standard deviation as a rule."""

LEAST_SHARE = 1e-300
"""Share below which a class counts as impossible, but not as infinitely so."""


@gated
def sieve_statistics(bounds: ArrayLike, weights: ArrayLike) -> SizeStatistics:
    """Return percentiles, graphic and moment statistics of weights in classes of size, and the names of their classes.

    Parameters
    ----------
    bounds : array_like, shape (k + 1,)
        Bounds [m] of the classes, rising; the first may be 0 (the pan), the last infinite: such classes are open.
    weights : array_like, shape (k,)
        Mass, or share of it, in each class; or counts.

    Returns
    -------
    SizeStatistics
        Its ``moments`` are those of the middles of the classes in φ, each with its weight; NaN where an open class,
        which has no middle, holds any.

    Raises
    ------
    ShapeError
        If the arrays are not of shapes (k + 1,) and (k,).
    InputError
        If bounds do not rise, weights are negative, not finite or all zero, or a percentile from 5 to 95 % falls in an
        open class: it is not extrapolated. A bound for that class, or finer sieves, cure it.

    Notes
    -----
    The method of Folk and Ward: the running sum of the weights is known at the bounds of the classes, and the curve of
    it over φ is a line from bound to bound. The percentiles of it, those in metres too, give the graphic statistics of
    `size_statistics`. Where the curve is level, between the two sides of a gap, a percentile is in the gap's middle.

    Examples
    --------
    Equal weights in four classes one φ wide are spread evenly over 4 φ: sorting 0.68 · 4 / 4 + 0.9 · 4 / 6.6.

    >>> round(sieve_statistics([0.5e-3, 1e-3, 2e-3, 4e-3, 8e-3], [1, 1, 1, 1]).folk_ward.sorting, 4)
    1.2255
    """
    edges, w = _checked(bounds, weights, 0)
    if not w.any():
        raise InputError(f"weights must not all be zero; got {w.tolist()}")
    with np.errstate(divide="ignore"):
        limits, w = to_phi(edges)[::-1], w[::-1]  # from coarse to fine, as φ rises
    passed = 100 * np.concatenate([[0.0], np.cumsum(w)]) / w.sum()
    phi = np.array([_crossing(limits, passed, q) for q in PERCENTAGES])
    is_open = ~np.isfinite(limits[1:] - limits[:-1])
    if not np.isfinite(phi).all():
        bad = ", ".join(f"φ{q}" for q, value in zip(PERCENTAGES, phi, strict=True) if not np.isfinite(value))
        held = " and ".join(f"{100 * share:.3g} %" for share in (w / w.sum())[is_open & (w > 0)])
        raise InputError(f"{bad} fall in an open class, which holds {held}: give it a bound, or sieve finer")
    middles = 0.5 * (limits[1:] + limits[:-1])[~is_open]
    moments = PhiStatistics(*[np.nan] * 4) if w[is_open].any() else by_moments(middles, w[~is_open])
    # The symmetry of the percentages makes the φ from coarse to fine the sizes from fine to coarse.
    return described(MILLIMETRE * 2.0 ** -phi[::-1], phi, moments)


def _crossing(limits: Floats, passed: Floats, q: float) -> float:
    """Return where a rising curve of straight pieces reaches q; in the middle where it is level there."""
    first = int(np.searchsorted(passed, q - 1e-9))  # a running sum is off by its rounding
    last = int(np.searchsorted(passed, q + 1e-9, side="right")) - 1
    if last >= first:
        return float(0.5 * (limits[first] + limits[last]))
    if not np.isfinite(limits[last : first + 1]).all():
        return np.nan
    part = (q - passed[last]) / (passed[first] - passed[last])
    return float(limits[last] + part * (limits[first] - limits[last]))


@gated
def fit_sieves(
    bounds: ArrayLike, counts: ArrayLike, family: Family = "log-hyperbolic", *, confidence: float = 0.95
) -> SizeFit:
    """Fit a distribution to the number of grains in classes of size by maximum likelihood.

    Parameters
    ----------
    bounds : array_like, shape (k + 1,)
        Bounds [m] of the classes, rising. The first is 0 where there is a pan, the last infinite where all that stays
        on the coarsest sieve is counted, be it none. Bounds that are neither say that grains beyond them were not
        looked for: the distribution is fitted to those between, and tells how many lie beyond.
    counts : array_like, shape (k,)
        Grains in each class. Shares of mass may be given instead; the intervals are those of as many grains as they
        sum to, so that only counts have ones that mean something.
    family : {"normal", "lognormal", "log-hyperbolic"}
        What to fit.
    confidence : float
        How often the intervals are to hold the truth, between 0 and 1.

    Returns
    -------
    SizeFit
        Its ``log_likelihood`` is that of the counts, up to a constant that is the same for every family; ``ks`` is the
        largest distance at the bounds, and has no p-value.

    Raises
    ------
    ShapeError
        If the arrays are not of shapes (k + 1,) and (k,).
    InputError
        If bounds do not rise, counts are negative or not finite, too few classes hold a grain, or an option is out of
        range.

    Notes
    -----
    What is maximised is Σ n_k ln[(F(b_{k+1}) - F(b_k)) / (F(b_K) - F(b_0))], by Newton's method with the expected
    information; between 0 and infinity the divisor is 1.
    """
    check_options(family, confidence)
    edges, n = _checked(bounds, counts, 5 if family == "log-hyperbolic" else 3)
    logarithmic = family != "normal"
    with np.errstate(divide="ignore"):
        ends = np.log(edges) if logarithmic else edges
    centre, spread, skewness, kurtosis = _moments(ends, n)
    standard = (ends - centre) / spread
    if family == "log-hyperbolic":
        found = StandardFit(
            lambda theta: _hyperbolic(theta, standard, n), standard_start(skewness, kurtosis), centre, spread
        )
        h = found.distribution
        fit = SizeFit(family, h, hyperbolic_parameters(h), found.intervals(confidence), confidence, edge=found.edge)
        return _finished(edges, n, fit)
    theta, top = climb(lambda t: _normal(t, standard, n), np.zeros(2), logarithms=(1,))
    mean, std = centre + spread * float(theta[0]), spread * float(np.exp(theta[1]))
    distribution = LogNormal(mean, std) if logarithmic else Normal(mean, std)
    reach = _quantile(confidence) * np.sqrt(np.diag(covariance(top)))
    names = ("mu", "sigma") if logarithmic else ("mean", "std")
    intervals = {
        names[0]: (mean - spread * float(reach[0]), mean + spread * float(reach[0])),
        names[1]: (std * float(np.exp(-reach[1])), std * float(np.exp(reach[1]))),
    }
    parameters = {names[0]: mean, names[1]: std}
    return _finished(edges, n, SizeFit(family, distribution, parameters, intervals, confidence))


def _hyperbolic(theta: Floats, ends: Floats, n: Floats) -> Point:
    """Return the likelihood of counts between standardised logarithms, its gradient, and the expected information."""
    from scipy.special import k1e  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    mu, log_delta, log_gamma, beta = theta
    delta, zeta, turn = np.exp(log_delta), np.exp(log_delta + log_gamma), np.arcsinh(beta * np.exp(-log_gamma))
    low, high = span(float(zeta))
    cuts = np.clip(np.arcsinh((ends - mu) / delta) - turn, low, high)
    parts = cuts[:-1, None] + np.diff(cuts)[:, None] * np.arange(PANELS + 1) / PANELS
    half = 0.5 * np.diff(parts, axis=1)
    u = (parts[:, :-1] + half)[..., None] + half[..., None] * NODES
    mass = half[..., None] * WEIGHTS * np.cosh(u + turn) / np.cosh(turn) * np.exp(-2 * zeta * np.sinh(0.5 * u) ** 2)
    mass /= 2 * float(k1e(zeta))
    scores = hyperbolic_scores(theta, mu + delta * np.sinh(u + turn))
    return _counted(n, mass.sum(axis=(1, 2)), np.einsum("kpq,kpqi->ki", mass, scores))


def _normal(theta: Floats, ends: Floats, n: Floats) -> Point:
    """Return the same for a normal distribution of mean θ₀ and standard deviation exp θ₁."""
    z = (ends - theta[0]) / np.exp(theta[1])
    below, above = Normal(0.0, 1.0).tails(z)
    shares = np.where(z[:-1] > 0, above[:-1] - above[1:], below[1:] - below[:-1])
    density = np.exp(-0.5 * z**2) / np.sqrt(2 * np.pi)
    moved = np.where(np.isfinite(z), z, 0.0) * density
    slopes = np.stack([-np.diff(density) / np.exp(theta[1]), -np.diff(moved)], axis=1)
    return _counted(n, shares, slopes)


def _counted(n: Floats, shares: Floats, slopes: Floats) -> Point:
    """Return the likelihood of counts from each class's share and its derivatives, shape (k, parameters).

    Grains are known to lie between the first and the last bound, no more: shares are of what lies there.
    """
    whole = max(float(shares.sum()), LEAST_SHARE)
    shares, slopes = shares / whole, (slopes - np.outer(shares / whole, slopes.sum(axis=0))) / whole
    shares = np.maximum(shares, LEAST_SHARE)
    relative = slopes / shares[:, None]
    information = n.sum() * np.einsum("k,ki,kj->ij", shares, relative, relative)
    return Point(float(n @ np.log(shares)), n @ relative, -information)


def _moments(ends: Floats, n: Floats) -> tuple[float, float, float, float]:
    """Return mean, standard deviation, skewness and excess kurtosis from the middles of classes."""
    finite = ends.copy()
    # An open class is taken to be as wide as the one beside it.
    if not np.isfinite(finite[0]):
        finite[0] = 2 * finite[1] - finite[2]
    if not np.isfinite(finite[-1]):
        finite[-1] = 2 * finite[-2] - finite[-3]
    middles, share = 0.5 * (finite[1:] + finite[:-1]), n / n.sum()
    centre = float(share @ middles)
    spread = float(np.sqrt(share @ (middles - centre) ** 2))
    z = (middles - centre) / spread
    return centre, spread, float(share @ z**3), float(share @ z**4) - 3


def _finished(edges: Floats, n: Floats, fit: SizeFit) -> SizeFit:
    """Return a fit with its likelihood and its distance from the counts."""
    below, above = fit.distribution.tails(edges)
    shares = np.where(below[:-1] > 0.5, above[:-1] - above[1:], below[1:] - below[:-1])
    shares /= max(float(shares.sum()), LEAST_SHARE)
    value = float(n @ np.log(np.maximum(shares, LEAST_SHARE)))
    ks = float(np.abs(np.cumsum(n) / n.sum() - np.cumsum(shares)).max())
    return replace(fit, log_likelihood=value, n=float(n.sum()), ks=ks)


def _quantile(confidence: float) -> float:
    from scipy.special import ndtri  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    return float(ndtri(0.5 + 0.5 * confidence))


def _checked(bounds: ArrayLike, counts: ArrayLike, least: int) -> tuple[Floats, Floats]:
    edges, n = np.asarray(bounds, dtype=np.float64), np.asarray(counts, dtype=np.float64)
    if edges.ndim != 1 or n.shape != (edges.size - 1,):
        raise ShapeError(f"bounds and counts must have shapes (k + 1,) and (k,); got {edges.shape} and {n.shape}")
    if not (edges[0] >= 0 and np.isfinite(edges[:-1]).all() and (np.diff(edges) > 0).all()):
        raise InputError(f"bounds must rise from 0 or more, only the last infinite; got {edges.tolist()}")
    if not (np.isfinite(n).all() and (n >= 0).all()):
        raise InputError(f"counts and weights must be finite, zero or more; got {n.tolist()}")
    if np.count_nonzero(n) < least:
        raise InputError(
            f"this family needs grains in {least} classes or more; {np.count_nonzero(n)} of {n.size} hold any"
        )
    return edges, n
