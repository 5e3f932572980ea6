"""What sedimentologists say of sizes: percentiles, graphic and moment statistics in φ units, their names; and of a bed.

References
----------
.. [1] R. L. Folk and W. C. Ward, "Brazos River bar: a study in the significance of grain size parameters",
   J. Sedimentary Petrology 27 (1957) 3-26.
.. [2] S. J. Blott and K. Pye, "GRADISTAT: a grain size distribution and statistics package for the analysis of
   unconsolidated sediments", Earth Surface Processes and Landforms 26 (2001) 1237-1248.
.. [3] C. K. Wentworth, "A scale of grade and class terms for clastic sediments", J. Geology 30 (1922) 377-392.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.integrals import volumes
from grainsdem.measures.distributions.fits import FAMILIES, check_options, fit_sizes
from grainsdem.measures.grains.sizes import percentiles, sieve_diameters

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PERCENTAGES = (5, 10, 16, 25, 50, 75, 84, 90, 95)

MILLIMETRE = 1e-3

# Name of each class, and the φ value, or the statistic, below which it ends.
_SIZES = {
    "boulders": -8.0,
    "cobbles": -6.0,
    "pebbles": -2.0,
    "granules": -1.0,
    "very coarse sand": 0.0,
    "coarse sand": 1.0,
    "medium sand": 2.0,
    "fine sand": 3.0,
    "very fine sand": 4.0,
    "silt": 8.0,
    "clay": np.inf,
}
_SORTING = {
    "very well sorted": 0.35,
    "well sorted": 0.5,
    "moderately well sorted": 0.71,
    "moderately sorted": 1.0,
    "poorly sorted": 2.0,
    "very poorly sorted": 4.0,
    "extremely poorly sorted": np.inf,
}
_SKEWNESS = {
    "very coarse skewed": -0.3,
    "coarse skewed": -0.1,
    "symmetrical": 0.1,
    "fine skewed": 0.3,
    "very fine skewed": np.inf,
}
_KURTOSIS = {
    "very platykurtic": 0.67,
    "platykurtic": 0.9,
    "mesokurtic": 1.11,
    "leptokurtic": 1.5,
    "very leptokurtic": 3.0,
    "extremely leptokurtic": np.inf,
}


@dataclass(frozen=True, slots=True)
class PhiStatistics:
    """Four statistics of sizes in φ units, of graphic or of moment kind.

    Parameters
    ----------
    mean, sorting : float
        In φ; a larger mean is finer.
    skewness, kurtosis : float
        Positive skewness is a tail of fine grains. Kurtosis of a normal distribution is 1 for the graphic kind and 3
        for moments. Both are NaN where all sizes are one.
    """

    mean: float
    sorting: float
    skewness: float
    kurtosis: float


@dataclass(frozen=True, slots=True)
class SizeStatistics:
    """What `size_statistics` says of sizes, and `sieve_statistics` of sieves.

    Parameters
    ----------
    percentiles : dict of str to float
        ``d5`` to ``d95`` [m].
    folk_ward : PhiStatistics
        Graphic statistics of Folk and Ward.
    moments : PhiStatistics
        Statistics by the method of moments, weighted as the percentiles are; NaN of sieves of which an open one holds
        any.
    size_class, sorting_class, skewness_class, kurtosis_class : str
        Wentworth's name of the graphic mean, and Folk and Ward's of the other three.
    """

    percentiles: dict[str, float]
    folk_ward: PhiStatistics
    moments: PhiStatistics
    size_class: str
    sorting_class: str
    skewness_class: str
    kurtosis_class: str

    def to_dict(self) -> dict[str, Any]:
        """Return the same as JSON values; None for what is not a number."""
        found = asdict(self)
        for kind in ("folk_ward", "moments"):
            found[kind] = {name: value if np.isfinite(value) else None for name, value in found[kind].items()}
        return found


def to_phi(sizes: ArrayLike) -> Floats:
    """Return sizes [m] in φ units, -log₂(d / 1 mm).

    Examples
    --------
    >>> to_phi([2e-3, 0.5e-3]).tolist()
    [-1.0, 1.0]
    """
    return np.asarray(-np.log2(np.asarray(sizes, dtype=np.float64) / MILLIMETRE))


@gated
def size_statistics(sizes: ArrayLike, *, weights: ArrayLike | None = None) -> SizeStatistics:
    """Return percentiles, graphic and moment statistics of grains' sizes, and the names of their classes.

    Parameters
    ----------
    sizes : array_like, shape (n,)
        Sizes [m], above zero, one a grain. Of weights in classes see `sieve_statistics`: the middles of classes are not
        sizes, and statistics of them come out narrower than the sample.
    weights : array_like, shape (n,), optional
        What each grain counts for: its volume or mass gives statistics by those. Without it each counts for one.

    Returns
    -------
    SizeStatistics

    Raises
    ------
    ShapeError, InputError
        As `percentiles` does, and if a size is not above zero.

    Notes
    -----
    Percentiles are those of `percentiles`, each grain in the middle of its own step (Hazen); of φ they are taken of φ
    itself. With these, from coarse to fine, the graphic statistics are

    mean (φ16 + φ50 + φ84) / 3, sorting (φ84 - φ16) / 4 + (φ95 - φ5) / 6.6, skewness (φ16 + φ84 - 2 φ50) / 2 (φ84 - φ16)
    + (φ5 + φ95 - 2 φ50) / 2 (φ95 - φ5), kurtosis (φ95 - φ5) / 2.44 (φ75 - φ25).
    """
    d = np.asarray(sizes, dtype=np.float64)
    if not (d > 0).all():
        raise InputError(f"sizes must be above zero to have a logarithm; {int((~(d > 0)).sum())} of {d.size} are not")
    return described(
        percentiles(d, PERCENTAGES, weights=weights),
        # The percentile is taken of φ itself: between two sizes a line over φ is not one over d.
        percentiles(to_phi(d), PERCENTAGES, weights=weights),
        by_moments(to_phi(d), np.ones(d.shape) if weights is None else np.asarray(weights, np.float64)),
    )


def described(sizes: Floats, phi: Floats, moments: PhiStatistics) -> SizeStatistics:
    """Return the statistics, and their names, of percentiles in metres and in φ at `PERCENTAGES`, and of moments."""
    graphic = _graphic(phi)
    return SizeStatistics(
        percentiles={f"d{q}": mark for q, mark in zip(PERCENTAGES, sizes.tolist(), strict=True)},
        folk_ward=graphic,
        moments=moments,
        size_class=_name(_SIZES, graphic.mean),
        sorting_class=_name(_SORTING, graphic.sorting),
        skewness_class=_name(_SKEWNESS, graphic.skewness),
        kurtosis_class=_name(_KURTOSIS, graphic.kurtosis),
    )


@gated
def size_distribution(
    packing: Packing, *, diameter: Literal["volume", "sieve"] = "volume", confidence: float = 0.95
) -> dict[str, Any]:
    """Return all that is said of the sizes of a bed's grains, as JSON values in SI units.

    Parameters
    ----------
    packing : Packing
        A bed of at least one grain.
    diameter : {"volume", "sieve"}
        That of the sphere of equal volume, in a planar bed of the circle of equal area; or the side of the smallest
        square hole that a grain passes (see `sieve_diameters`).
    confidence : float
        How often the intervals of the fits are to hold the truth.

    Returns
    -------
    dict
        ``diameter``, which is ``"area"`` in a planar bed; ``n_grains``; ``by_number`` and ``by_volume``, each as
        `SizeStatistics.to_dict` has it; ``fits``, for each family what `SizeFit.to_dict` has, or None where the grains
        are too few or all of one size.

    Raises
    ------
    InputError
        If there is no grain, the diameter is unknown, or a planar bed is to be sieved.
    """
    if diameter not in ("volume", "sieve"):
        raise InputError(f"diameter must be 'volume' or 'sieve'; got {diameter!r}")
    if not len(packing):
        raise InputError("a distribution of sizes needs at least one grain; the packing has none")
    if diameter == "sieve" and packing.domain.is_planar:
        raise InputError("a planar bed has no sieve diameters; take those of equal area")
    check_options(FAMILIES[0], confidence)
    sizes = grain_diameters(packing) if diameter == "volume" else sieve_diameters(packing)
    try:
        fits = {family: fit_sizes(sizes, family, confidence=confidence).to_dict() for family in FAMILIES}
    except InputError:  # too few, or all of one size
        fits = None
    return {
        "diameter": "area" if packing.domain.is_planar else diameter,
        "n_grains": len(packing),
        "by_number": size_statistics(sizes).to_dict(),
        "by_volume": size_statistics(sizes, weights=volumes(packing.grains)).to_dict(),
        "fits": fits,
    }


def _graphic(phi: Floats) -> PhiStatistics:
    p5, _, p16, p25, p50, p75, p84, _, p95 = phi.tolist()
    mean, sorting = (p16 + p50 + p84) / 3, (p84 - p16) / 4 + (p95 - p5) / 6.6
    if min(p84 - p16, p75 - p25) <= 1e-12 * max(1.0, abs(p50)):
        return PhiStatistics(mean, sorting, np.nan, np.nan)
    skewness = (p16 + p84 - 2 * p50) / (2 * (p84 - p16)) + (p5 + p95 - 2 * p50) / (2 * (p95 - p5))
    return PhiStatistics(mean, sorting, skewness, (p95 - p5) / (2.44 * (p75 - p25)))


def by_moments(phi: Floats, weights: Floats) -> PhiStatistics:
    """Return mean, standard deviation, skewness and kurtosis of weighted φ."""
    share = weights / weights.sum()
    mean = float(share @ phi)
    sorting = float(np.sqrt(share @ (phi - mean) ** 2))
    if sorting <= 1e-12 * max(1.0, abs(mean)):
        return PhiStatistics(mean, sorting, np.nan, np.nan)
    z = (phi - mean) / sorting
    return PhiStatistics(mean, sorting, float(share @ z**3), float(share @ z**4))


def _name(classes: dict[str, float], value: float) -> str:
    """Return the class that a value falls in; empty for NaN."""
    return next((name for name, end in classes.items() if value < end), "")
