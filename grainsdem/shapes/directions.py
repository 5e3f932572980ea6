"""Directions spread evenly over the sphere."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_STEPS = 150
"""Steps in which directions push one another apart; more move none by a hundredth of their distance."""

_MOST_PUSHED = 512
"""Directions that push one another; more lie evenly enough on their spiral."""


@lru_cache(maxsize=32)
def spread(n: int) -> Floats:
    """Return ``n`` unit vectors spread evenly, shape (n, 3): a spiral, in which few push one another apart.

    Notes
    -----
    Each goes the way in which the others push it, as like charges do [1]_, and back onto the sphere, in steps that
    become smaller.

    References
    ----------
    .. [1] J. J. Thomson, "On the structure of the atom", Philosophical Magazine 7 (1904) 237-265.
    """
    rows = np.arange(n) + 0.5
    height = 1 - 2 * rows / n
    angle = np.pi * (3 - np.sqrt(5)) * rows
    around = np.sqrt(1 - height**2)
    points = np.column_stack([around * np.cos(angle), around * np.sin(angle), height])
    if n > _MOST_PUSHED:
        return points
    spacing = np.sqrt(4 * np.pi / n)
    for step in range(_STEPS):
        between = points[:, None] - points
        square = (between**2).sum(axis=2) + np.eye(n)
        push = (between / (square * np.sqrt(square))[:, :, None]).sum(axis=1)
        # Only what lies along the sphere moves a point along it.
        push -= (push * points).sum(axis=1, keepdims=True) * points
        length = np.sqrt((push**2).sum(axis=1)).max()
        if not length > 0:
            break
        points = points + push / length * (0.2 * spacing * (1 - step / _STEPS))
        points /= np.sqrt((points**2).sum(axis=1, keepdims=True))
    return points
