"""Distributions fitted to sizes by maximum likelihood, with intervals, AIC and the distance of Kolmogorov and Smirnov.

References
----------
.. [1] O. E. Barndorff-Nielsen, P. Blæsild, J. L. Jensen, M. Sørensen, "The fascination of sand", in A Celebration of
   Statistics, Springer (1985) 57-87: the shape triangle.
.. [2] H. Akaike, "A new look at the statistical model identification", IEEE Trans. Automatic Control 19 (1974) 716-723.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.measures.distributions.climbing import covariance
from grainsdem.measures.distributions.hyperbolic import LogHyperbolic
from grainsdem.measures.distributions.likelihood import (
    climb_hyperbolic,
    hyperbolic_likelihood,
    over_phi,
    profile_zeta,
    standard_start,
    theta_of,
)
from grainsdem.measures.distributions.normal import LogNormal, Normal

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.measures.distributions.climbing import Point

    Floats = NDArray[np.float64]
    Interval = tuple[float, float]

Family = Literal["normal", "lognormal", "log-hyperbolic"]

FAMILIES: tuple[Family, ...] = ("normal", "lognormal", "log-hyperbolic")

LEAST_SIZES = 10
"""Sizes below which nothing is fitted: four parameters of fewer mean nothing."""

EDGE = 1e-2
"""Distance of (χ, ξ) from an edge of the shape triangle, relative to ξ along it, below which a fit is on the edge."""


@dataclass(frozen=True, slots=True)
class SizeFit:
    """A distribution fitted to sizes.

    Parameters
    ----------
    family : {"normal", "lognormal", "log-hyperbolic"}
        What was fitted.
    distribution : Normal, LogNormal or LogHyperbolic
        The distribution of the highest likelihood.
    parameters : dict of str to float
        Its parameters, those of the shape triangle ``chi`` and ``xi`` with them.
    intervals : dict of str to tuple of float
        Interval of each parameter at the ``confidence``; NaN where there is none, on an edge of the shape triangle.
    confidence : float
        How often such intervals hold the truth.
    log_likelihood : float
        Logarithm of the likelihood of the sizes in metres, the same for every family.
    n : float
        How many sizes were fitted.
    ks, ks_p_value : float
        Largest distance between the distribution and the sizes' own, and how often as many draws of a distribution
        *known beforehand* would be as far from it. Of a fitted one they are nearer: the true value is lower.
    edge : {None, "lognormal", "log-Laplace", "one-sided"}
        The edge of the shape triangle that a log-hyperbolic fit ran to: a limit, of which fewer parameters are known.
    """

    family: Family
    distribution: Normal | LogNormal | LogHyperbolic
    parameters: dict[str, float]
    intervals: dict[str, Interval]
    confidence: float
    log_likelihood: float = float("nan")
    n: float = 0.0
    ks: float = float("nan")
    ks_p_value: float = float("nan")
    edge: str | None = None

    @property
    def aic(self) -> float:
        """Akaike's criterion, 2 k - 2 ln L with k parameters: the lower, the better the family."""
        return 2 * (4 if self.family == "log-hyperbolic" else 2) - 2 * self.log_likelihood

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as JSON values; None for what is not a number."""
        return {
            "parameters": {name: _number(value) for name, value in self.parameters.items()},
            "intervals": {name: [_number(low), _number(high)] for name, (low, high) in self.intervals.items()},
            "confidence": self.confidence,
            "log_likelihood": self.log_likelihood,
            "aic": self.aic,
            "n": self.n,
            "ks": self.ks,
            "ks_p_value": _number(self.ks_p_value),
            "edge": self.edge,
        }


@gated
def fit_sizes(sizes: ArrayLike, family: Family = "log-hyperbolic", *, confidence: float = 0.95) -> SizeFit:
    """Fit a distribution to sizes by maximum likelihood, each size counting for one.

    Parameters
    ----------
    sizes : array_like, shape (n,)
        Sizes [m], above zero; at least ten, not all equal.
    family : {"normal", "lognormal", "log-hyperbolic"}
        What to fit.
    confidence : float
        How often the intervals are to hold the truth, between 0 and 1.

    Returns
    -------
    SizeFit

    Raises
    ------
    ShapeError
        If ``sizes`` is not one-dimensional.
    InputError
        If there are too few sizes, one is not positive and finite, all are equal, or an option is out of range.

    Notes
    -----
    Of normal and lognormal distributions the intervals are those of Student and χ². Of the log-hyperbolic one they
    follow from the observed information, that of ξ from the profile of the likelihood. α, β and δ are strongly
    correlated, the more so the nearer to the lognormal limit; place, width and (χ, ξ) are known much better.
    """
    d = _checked(sizes)
    check_options(family, confidence)
    if family == "log-hyperbolic":
        return _fit_hyperbolic(d, confidence)
    values = d if family == "normal" else np.log(d)
    centre, spread = float(values.mean()), float(values.std())
    distribution = Normal(centre, spread) if family == "normal" else LogNormal(centre, spread)
    names = ("mean", "std") if family == "normal" else ("mu", "sigma")
    intervals = dict(zip(names, _normal_intervals(centre, spread, d.size, confidence), strict=True))
    parameters = dict(zip(names, (centre, spread), strict=True))
    return _finished(d, SizeFit(family, distribution, parameters, intervals, confidence))


def check_options(family: str, confidence: float) -> None:
    """Raise `InputError` unless the family is one of ours and the confidence between 0 and 1."""
    if family not in FAMILIES:
        raise InputError(
            f"the family must be {', '.join(map(repr, FAMILIES[:-1]))} or {FAMILIES[-1]!r}; got {family!r}"
        )
    if not 0 < confidence < 1:
        raise InputError(f"confidence must lie between 0 and 1; got {confidence}")


class StandardFit:
    """A log-hyperbolic distribution fitted to standardised logarithms of sizes, (ln d - centre) / spread.

    Parameters
    ----------
    evaluate : callable
        The likelihood of θ and its derivatives.
    phi : ndarray, shape (4,)
        Where to begin.
    centre, spread : float
        What the logarithms were standardised by.
    """

    def __init__(self, evaluate: Callable[[Floats], Point], phi: Floats, centre: float, spread: float) -> None:
        self._evaluate = over_phi(evaluate)
        self._centre, self._spread = centre, spread
        self._phi, self._top = climb_hyperbolic(self._evaluate, phi)
        if self.edge is not None:
            # Sizes of several kinds have several tops, of which one on an edge may not be the highest.
            for other in (standard_start(0.0, 0.0), standard_start(0.0, 1.0)):
                self._phi, self._top = max(
                    (self._phi, self._top), climb_hyperbolic(self._evaluate, other), key=lambda found: found[1].value
                )
        self._theta, self._jacobian = theta_of(self._phi)

    @property
    def distribution(self) -> LogHyperbolic:
        """The distribution of the highest likelihood, of sizes in metres."""
        mu, log_delta, log_gamma, beta = self._theta
        s = self._spread
        alpha = float(np.hypot(np.exp(log_gamma), beta)) / s
        # On the edge itself α and |β| are one number; a rounding apart, they are still a distribution.
        beta = float(np.clip(beta / s, -np.nextafter(alpha, 0), np.nextafter(alpha, 0)))
        return LogHyperbolic(alpha, beta, float(np.exp(log_delta)) * s, self._centre + s * float(mu))

    @property
    def edge(self) -> str | None:
        """The edge of the shape triangle that the fit is on, if any."""
        chi, xi = self._shape()
        if xi < EDGE:
            return "lognormal"
        if 1 - xi < EDGE:
            return "log-Laplace"
        return "one-sided" if abs(chi) > (1 - EDGE) * xi else None

    def intervals(self, confidence: float) -> dict[str, Interval]:
        """Return the interval of each parameter, and of χ and ξ."""
        from scipy.special import ndtri  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

        z = float(ndtri(0.5 + 0.5 * confidence))
        low, high = profile_zeta(self._evaluate, self._phi, self._top.value, 0.5 * z**2)
        xi = (float(1 / np.sqrt(1 + np.exp(high))), float(1 / np.sqrt(1 + np.exp(low))))
        names = ("alpha", "beta", "delta", "mu", "chi")
        if self.edge is not None:
            return {**dict.fromkeys(names, (np.nan, np.nan)), "xi": xi}
        cov = covariance(self._top)
        mu, log_delta, log_gamma, beta = self._theta
        s, gamma = self._spread, np.exp(log_gamma)
        alpha = np.hypot(gamma, beta)
        # Each on a scale where it is nearly normal: ln α, β, ln δ, μ, artanh χ.
        j = self._jacobian
        chi, _ = self._shape()
        chi_v, chi_w = self._shape_slopes()
        slopes = np.array(
            [
                (gamma**2 * j[2] + beta * j[3]) / alpha**2,
                j[3],
                j[1],
                j[0],
                np.array([0, 0, chi_v, chi_w]) / (1 - chi**2),
            ]
        )
        reach = z * np.sqrt(np.einsum("ki,ij,kj->k", slopes, cov, slopes))
        centres = np.array([np.log(alpha), beta, log_delta, mu, np.arctanh(chi)])
        ends = np.stack([centres - reach, centres + reach], axis=1)
        ends[0], ends[1] = np.exp(ends[0]) / s, ends[1] / s
        ends[2], ends[3] = np.exp(ends[2]) * s, self._centre + s * ends[3]
        ends[4] = np.tanh(ends[4])
        found: dict[str, Interval] = {name: (float(a), float(b)) for name, (a, b) in zip(names, ends, strict=True)}
        return found | {"xi": xi}

    def _shape(self) -> tuple[float, float]:
        xi = float(1 / np.sqrt(1 + np.exp(self._phi[3])))
        return xi * float(np.tanh(self._phi[2])), xi

    def _shape_slopes(self) -> tuple[float, float]:
        """Return ∂χ/∂v and ∂χ/∂ln ζ."""
        chi, xi = self._shape()
        return xi / float(np.cosh(self._phi[2])) ** 2, -0.5 * chi * (1 - xi**2)


def _fit_hyperbolic(d: Floats, confidence: float) -> SizeFit:
    x = np.log(d)
    centre, spread = float(x.mean()), float(x.std())
    y = (x - centre) / spread
    start = standard_start(float((y**3).mean()), float((y**4).mean()) - 3)
    found = StandardFit(lambda theta: hyperbolic_likelihood(theta, y), start, centre, spread)
    h = found.distribution
    intervals = found.intervals(confidence)
    return _finished(d, SizeFit("log-hyperbolic", h, hyperbolic_parameters(h), intervals, confidence, edge=found.edge))


def hyperbolic_parameters(h: LogHyperbolic) -> dict[str, float]:
    """Return the parameters that a fit lists."""
    chi, xi = h.shape
    return {"alpha": h.alpha, "beta": h.beta, "delta": h.delta, "mu": h.mu, "chi": chi, "xi": xi}


def _normal_intervals(centre: float, spread: float, n: int, confidence: float) -> tuple[Interval, Interval]:
    from scipy.special import chdtri, stdtrit  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

    tail = 0.5 - 0.5 * confidence
    reach = float(stdtrit(n - 1, 1 - tail)) * spread / np.sqrt(n - 1)
    low, high = (float(spread * np.sqrt(n / chdtri(n - 1, share))) for share in (tail, 1 - tail))
    return (centre - reach, centre + reach), (low, high)


def _finished(d: Floats, fit: SizeFit) -> SizeFit:
    """Return a fit with its likelihood and its distance from the sizes."""
    from scipy.stats import kstwo  # noqa: PLC0415  (scipy.stats costs half a second)

    below, above = fit.distribution.tails(np.sort(d))
    rank = np.arange(1, d.size + 1)
    ks = float(max((rank / d.size - below).max(), (1 - (rank - 1) / d.size - above).max()))
    return replace(
        fit,
        log_likelihood=float(fit.distribution.log_density(d).sum()),
        n=float(d.size),
        ks=ks,
        ks_p_value=float(kstwo.sf(ks, d.size)),
    )


def _checked(sizes: ArrayLike) -> Floats:
    d = np.asarray(sizes, dtype=np.float64)
    if d.ndim != 1:
        raise ShapeError(f"sizes must have shape (n,); got {d.shape}")
    if d.size < LEAST_SIZES:
        raise InputError(f"a fit needs {LEAST_SIZES} sizes or more; got {d.size}")
    bad = ~(np.isfinite(d) & (d > 0))
    if bad.any():
        raise InputError(f"sizes must be positive and finite; {int(bad.sum())} of {d.size} are not")
    # Sizes that differ by rounding only are one size: their spread is that of the rounding.
    if np.ptp(d) <= 1e-12 * d.max():
        raise InputError(f"all {d.size} sizes are {d[0]:.6g} m: one size has no distribution to fit")
    return d


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
