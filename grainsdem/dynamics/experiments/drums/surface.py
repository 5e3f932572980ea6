"""How steep the surface of a bed in a drum is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

CHORD = 0.5
"""Middle share of the bed's chord in which the slope of the surface is taken."""


def surface_angle(side: Floats, height: Floats, guess: float) -> float:
    """Return the slope [rad] of a bed's surface across a drum, NaN where it has too few grains.

    Parameters
    ----------
    side, height : ndarray, shape (n,)
        Centroids [d] across the axis.
    guess : float
        Slope [rad] from which the middle of the chord is found.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.meshgrid(np.arange(-8.0, 9.0) / 2, np.arange(-6.0, 1.0) / 2)
    >>> turned = np.exp(0.5j) * (x + 1j * y).ravel()
    >>> round(surface_angle(turned.real, turned.imag, 0.45), 6)
    0.5
    """
    turned = np.exp(-1j * guess) * (side + 1j * height)
    along, above = turned.real, turned.imag
    low, high = np.quantile(along, [0.02, 0.98])
    middle, half = 0.5 * (low + high), 0.5 * CHORD * (high - low)
    n_bins = max(int(2 * half), 3)
    bins = np.floor((along - middle + half) / (2 * half) * n_bins).astype(int)
    inside = (bins >= 0) & (bins < n_bins)
    tops, where = np.full(n_bins, -np.inf), np.zeros(n_bins)
    for k in np.flatnonzero(inside).tolist():
        if above[k] > tops[bins[k]]:
            tops[bins[k]], where[bins[k]] = above[k], along[k]
    seen = np.isfinite(tops)
    if seen.sum() < 3:
        return float("nan")
    slope = float(np.polyfit(where[seen], tops[seen], 1)[0])
    return guess + float(np.arctan(slope))
