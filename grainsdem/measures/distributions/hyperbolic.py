"""The log-hyperbolic distribution of sizes: the logarithm of its density is a hyperbola over the logarithm of size.

References
----------
.. [1] O. Barndorff-Nielsen, "Exponentially decreasing distributions for the logarithm of particle size", Proc. R. Soc.
   Lond. A 353 (1977) 401-419.
.. [2] N. R. J. Fieller, E. C. Flenley, W. Olbricht, "Statistics of particle size data", J. R. Stat. Soc. C 41 (1992)
   127-146.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated_noun
from grainsdem.memory import A_SEED, allow_memory

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

PANELS = 240
"""Panels of the integral of the density: each is a twelfth of a standard deviation wide at most."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)

TAIL = 60.0
"""Exponent at which tails are cut: exp(-60) is far below the rounding of a probability."""


@gated_noun
@dataclass(frozen=True, slots=True)
class LogHyperbolic:
    r"""Log-hyperbolic distribution of a size d [m].

    Parameters
    ----------
    alpha, beta : float
        Steepness of the two tails over ln d: slopes α + β to the fine side and -(α - β) to the coarse side; α > abs(β).
    delta : float
        Width of the rounded part between them, above 0.
    mu : float
        Place of it, in ln(d / 1 m).

    Raises
    ------
    InputError
        If a number is out of its range.

    Notes
    -----
    With γ = √(α² - β²) and x = ln d,

    .. math:: \ln f(x) = \ln \frac{γ}{2 α δ K_1(δγ)} - α \sqrt{δ^2 + (x-μ)^2} + β (x-μ)

    The lognormal distribution is its limit for δ → ∞ at δ/γ = σ², the log-Laplace that for δ → 0.
    """

    alpha: float
    beta: float
    delta: float
    mu: float

    def __post_init__(self) -> None:
        numbers = (self.alpha, self.beta, self.delta, self.mu)
        if not (np.isfinite(numbers).all() and self.alpha > abs(self.beta) and self.delta > 0):
            raise InputError(
                f"a log-hyperbolic distribution needs finite alpha > |beta| and delta > 0; got alpha = {self.alpha}, "
                f"beta = {self.beta}, delta = {self.delta}, mu = {self.mu}"
            )

    @property
    def gamma(self) -> float:
        """√(α² - β²)."""
        return float(np.sqrt((self.alpha - self.beta) * (self.alpha + self.beta)))

    @property
    def zeta(self) -> float:
        """δ γ: the larger, the nearer to the lognormal distribution."""
        return self.delta * self.gamma

    @property
    def shape(self) -> tuple[float, float]:
        """Place (χ, ξ) in the shape triangle 0 <= abs(χ) < ξ < 1: asymmetry, and how far the tails are from normal.

        ξ = (1 + δγ)^(-1/2) and χ = ξ β/α know neither the place nor the width of the distribution.
        """
        xi = float(1 / np.sqrt(1 + self.zeta))
        return xi * self.beta / self.alpha, xi

    @property
    def mode(self) -> float:
        """Size [m] at which the density over ln d is highest, exp(μ + δβ/γ)."""
        return float(np.exp(self.mu + self.delta * self.beta / self.gamma))

    def log_density(self, sizes: ArrayLike) -> Floats:
        """Return the logarithm of the density [1/m] at sizes [m], shape (...); -inf at zero and below."""
        from scipy.special import k1e  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

        d = np.asarray(sizes, dtype=np.float64)
        x = np.log(np.where(d > 0, d, 1.0))
        y = np.where(np.isinf(d), 0.0, x - self.mu)
        zeta = self.zeta
        height = np.log(self.gamma / (2 * self.alpha * self.delta * k1e(zeta)))
        # ζ - α √(δ² + y²) + β y, with the large terms taken together first
        found = height + (zeta - self.alpha * np.hypot(self.delta, y)) + self.beta * y - x
        return np.asarray(np.where(np.isnan(d), np.nan, np.where((d > 0) & np.isfinite(d), found, -np.inf)))

    def density(self, sizes: ArrayLike) -> Floats:
        """Return the density [1/m] at sizes [m], shape (...)."""
        return np.asarray(np.exp(self.log_density(sizes)))

    def cdf(self, sizes: ArrayLike) -> Floats:
        """Return the share that is smaller than each size [m], shape (...)."""
        return self.tails(sizes)[0]

    def tails(self, sizes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the shares that are smaller and larger than each size [m], each exact in its own tail."""
        given = np.asarray(sizes, dtype=np.float64)
        d = np.where(np.isnan(given), 0.0, given)
        turn = np.arctanh(self.beta / self.alpha)
        low, high = span(self.zeta)
        edges = np.linspace(low, high, PANELS + 1)
        panels = _integral(edges[:-1], edges[1:], self.zeta, turn)
        total = panels.sum()
        below = np.concatenate([[0.0], np.cumsum(panels)])
        above = np.concatenate([np.cumsum(panels[::-1])[::-1], [0.0]])
        with np.errstate(divide="ignore"):
            u = np.arcsinh((np.log(np.maximum(d, 0.0)) - self.mu) / self.delta) - turn
        u = np.clip(u, low, high)
        k = np.minimum(((u - low) / (high - low) * PANELS).astype(np.int64), PANELS - 1)
        part = _integral(edges[k], u, self.zeta, turn)
        smaller = np.where(u < high, np.clip((below[k] + part) / total, 0.0, 1.0), 1.0)
        larger = np.where(u < high, np.clip((above[k] - part) / total, 0.0, 1.0), 0.0)
        return np.where(np.isnan(given), np.nan, smaller), np.where(np.isnan(given), np.nan, larger)

    def ppf(self, q: ArrayLike) -> Floats:
        """Return the size [m] that each share is smaller than, shape (...); by halving, to fifteen digits."""
        share = np.asarray(q, dtype=np.float64)
        low, high = span(self.zeta)
        turn = np.arctanh(self.beta / self.alpha)
        below, above = np.full(share.shape, low), np.full(share.shape, high)
        for _ in range(60):
            middle = 0.5 * (below + above)
            is_below = self.cdf(np.exp(self.mu + self.delta * np.sinh(middle + turn))) < share
            below, above = np.where(is_below, middle, below), np.where(is_below, above, middle)
        found = np.exp(self.mu + self.delta * np.sinh(0.5 * (below + above) + turn))
        return np.where((share >= 0) & (share <= 1), found, np.nan)

    def draw(self, n: int, *, rng: np.random.Generator | int | None = None) -> Floats:
        """Return ``n`` sizes [m] at random: normal ones whose variance is generalised inverse Gaussian."""
        from scipy.stats import geninvgauss  # noqa: PLC0415  (scipy.stats costs half a second)

        if n < 0:
            raise InputError(f"the number of draws must be zero or more; got {n}")
        allow_memory(n, A_SEED, "draws")
        generator = np.random.default_rng(rng)
        variance = geninvgauss.rvs(1.0, self.zeta, scale=self.delta / self.gamma, size=n, random_state=generator)
        logarithms = self.mu + self.beta * variance + np.sqrt(variance) * generator.standard_normal(n)
        return np.asarray(np.exp(logarithms))


def span(zeta: float) -> tuple[float, float]:
    """Return from where to where the density is integrated.

    Notes
    -----
    With x = μ + δ sinh(u + u₀) and tanh u₀ = β/α the density becomes cosh(u + u₀) exp(-ζ cosh u), up to a factor: a
    peak about zero, whatever the asymmetry.
    """
    reach = np.arccosh(1 + TAIL / zeta)
    reach = float(np.arccosh(1 + (TAIL + reach) / zeta))  # cosh grows with the tail: a little farther
    return -reach, reach


def _integral(low: Floats, high: Floats, zeta: float, turn: float) -> Floats:
    """Integrate cosh(u + u₀) exp(-ζ (cosh u - 1)) / cosh u₀ from each lower to each upper bound."""
    half = 0.5 * (high - low)
    u = (low + half)[..., None] + half[..., None] * NODES
    values = np.cosh(u + turn) / np.cosh(turn) * np.exp(-2 * zeta * np.sinh(0.5 * u) ** 2)
    return np.asarray(half * (values @ WEIGHTS))
