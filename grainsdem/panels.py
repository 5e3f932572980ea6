"""What a figure of curves is drawn from: panels, each with axes, curves and dots."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import ArrayLike, NDArray

SMOOTHED = 40
"""Points that a curve is smoothed to, each the mean of those around it: forces of a few hundred grains fluctuate."""


class Panel(NamedTuple):
    """One set of axes.

    Parameters
    ----------
    x_label, y_label : str
        What the axes show.
    curves : mapping of str to tuple of array_like
        For each name x, y, and, where there is a third one, half the width of a band around y; each of shape (n,).
    points : mapping of str to tuple of array_like
        The same for what is drawn as dots.
    """

    x_label: str
    y_label: str
    curves: Mapping[str, tuple[ArrayLike, ...]]
    points: Mapping[str, tuple[ArrayLike, ...]] = {}


def smoothed(values: ArrayLike) -> NDArray[np.float64]:
    """Return the means of equal parts of a series, forty at most."""
    row = np.asarray(values, dtype=np.float64)
    return np.array([part.mean() for part in np.array_split(row, min(SMOOTHED, len(row)))])
