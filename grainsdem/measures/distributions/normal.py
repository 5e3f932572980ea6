"""The normal and the lognormal distribution of sizes, the limits that log-hyperbolic ones are held against."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Normal:
    """Normal distribution of a size [m]; what of it lies below zero is left there.

    Parameters
    ----------
    mean, std : float
        Mean and standard deviation [m].

    Raises
    ------
    InputError
        If they are not finite, or ``std`` is not above zero.
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        _check("normal", self.mean, self.std)

    def log_density(self, sizes: ArrayLike) -> Floats:
        """Return the logarithm of the density [1/m] at sizes [m], shape (...)."""
        z = (np.asarray(sizes, dtype=np.float64) - self.mean) / self.std
        return np.asarray(-0.5 * z**2 - np.log(self.std) - 0.5 * np.log(2 * np.pi))

    def density(self, sizes: ArrayLike) -> Floats:
        """Return the density [1/m] at sizes [m], shape (...)."""
        return np.asarray(np.exp(self.log_density(sizes)))

    def cdf(self, sizes: ArrayLike) -> Floats:
        """Return the share that is smaller than each size [m], shape (...)."""
        return self.tails(sizes)[0]

    def tails(self, sizes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the shares that are smaller and larger than each size [m], each exact in its own tail."""
        from scipy.special import ndtr  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

        z = (np.asarray(sizes, dtype=np.float64) - self.mean) / self.std
        return np.asarray(ndtr(z)), np.asarray(ndtr(-z))

    def ppf(self, q: ArrayLike) -> Floats:
        """Return the size [m] that each share is smaller than, shape (...)."""
        from scipy.special import ndtri  # noqa: PLC0415  (scipy.special costs a twentieth of a second)

        return np.asarray(self.mean + self.std * ndtri(np.asarray(q, dtype=np.float64)))


@dataclass(frozen=True, slots=True)
class LogNormal:
    """Lognormal distribution of a size d [m].

    Parameters
    ----------
    mu, sigma : float
        Mean and standard deviation of ln(d / 1 m).

    Raises
    ------
    InputError
        If they are not finite, or ``sigma`` is not above zero.
    """

    mu: float
    sigma: float

    def __post_init__(self) -> None:
        _check("lognormal", self.mu, self.sigma)

    def log_density(self, sizes: ArrayLike) -> Floats:
        """Return the logarithm of the density [1/m] at sizes [m], shape (...); -inf at zero and below."""
        x = _logarithms(sizes)
        inside = np.isfinite(x)
        found = Normal(self.mu, self.sigma).log_density(np.where(inside, x, 0.0)) - np.where(inside, x, 0.0)
        return np.asarray(np.where(inside, found, -np.inf))

    def density(self, sizes: ArrayLike) -> Floats:
        """Return the density [1/m] at sizes [m], shape (...)."""
        return np.asarray(np.exp(self.log_density(sizes)))

    def cdf(self, sizes: ArrayLike) -> Floats:
        """Return the share that is smaller than each size [m], shape (...)."""
        return self.tails(sizes)[0]

    def tails(self, sizes: ArrayLike) -> tuple[Floats, Floats]:
        """Return the shares that are smaller and larger than each size [m], each exact in its own tail."""
        return Normal(self.mu, self.sigma).tails(_logarithms(sizes))

    def ppf(self, q: ArrayLike) -> Floats:
        """Return the size [m] that each share is smaller than, shape (...)."""
        return np.asarray(np.exp(Normal(self.mu, self.sigma).ppf(q)))


def _logarithms(sizes: ArrayLike) -> Floats:
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(np.maximum(np.asarray(sizes, dtype=np.float64), 0.0)))


def _check(name: str, centre: float, spread: float) -> None:
    if not (np.isfinite([centre, spread]).all() and spread > 0):
        raise InputError(f"a {name} distribution needs a finite centre and a spread above 0; got {centre} and {spread}")
