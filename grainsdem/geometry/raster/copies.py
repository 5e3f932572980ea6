"""The grains that reach into a box, periodic images included."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.geometry.bounds import boxes
from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

ROUNDING = 64 * np.finfo(np.float64).eps
"""Error of a place in the world, relative to the largest coordinate that it is computed from."""


class Copies(NamedTuple):
    """Grains and their periodic images, by grain and then by image.

    Parameters
    ----------
    ids : ndarray of int64, shape (m,)
        The grain of each copy.
    shifts : ndarray of int64, shape (m, 3)
        Its image, in whole domain lengths.
    centres : ndarray, shape (m, 3)
        Its position [m].
    lower, upper : ndarray, shape (m, 3)
        Corners [m] of its box.
    slack : float
        Length [m] within which the grains' places are rounded.
    """

    ids: NDArray[np.int64]
    shifts: NDArray[np.int64]
    centres: Floats
    lower: Floats
    upper: Floats
    slack: float


def copies(packing: Packing, lower: Floats, upper: Floats, *, wraps: tuple[bool, bool, bool] = (True,) * 3) -> Copies:
    """Return the grains whose box meets a box, and all their periodic images that do.

    Parameters
    ----------
    packing : Packing
        Any packing.
    lower, upper : ndarray, shape (3,)
        Corners [m] of the box; infinite where it has no end along an axis that does not wrap.
    wraps : tuple of bool
        Along which axes images are looked for, where the domain is periodic.
    """
    low, high = boxes(packing)
    domain = packing.domain
    corners = low, high, domain.lower, domain.upper
    slack = ROUNDING * max(float(np.abs(corner).max(initial=0.0)) for corner in corners)
    lower, upper = lower - slack, upper + slack
    ids = np.arange(len(packing))
    shifts = np.zeros((len(packing), 3), dtype=np.int64)
    for axis in range(3):
        if wraps[axis] and domain.periodic[axis]:
            ids, shifts = _repeated(axis, ids, shifts, domain.lengths[axis], (low, high), (lower, upper))
        else:
            met = (high[ids, axis] >= lower[axis]) & (low[ids, axis] <= upper[axis])
            ids, shifts = ids[met], shifts[met]
    moves = shifts * domain.lengths
    return Copies(ids, shifts, packing.positions[ids] + moves, low[ids] + moves, high[ids] + moves, slack)


def _repeated(
    axis: int,
    ids: NDArray[np.int64],
    shifts: NDArray[np.int64],
    period: float,
    box: tuple[Floats, Floats],
    window: tuple[Floats, Floats],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Repeat copies along a periodic axis as often as they meet the window."""
    first = np.ceil((window[0][axis] - box[1][ids, axis]) / period).astype(np.int64)
    last = np.floor((window[1][axis] - box[0][ids, axis]) / period).astype(np.int64)
    rows, steps = spread(first, last)
    repeated = shifts[rows]
    repeated[:, axis] = steps
    return ids[rows], repeated


def spread(first: NDArray[np.int64], last: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return for each row the whole numbers from its first to its last: the rows, repeated, and the numbers.

    Examples
    --------
    >>> spread(np.array([4, 7, 0]), np.array([5, 6, 0]))
    (array([0, 0, 2]), array([4, 5, 0]))
    """
    counts = np.maximum(last - first + 1, 0)
    rows = np.repeat(np.arange(counts.size), counts)
    return rows, first[rows] + np.arange(rows.size) - np.repeat(np.cumsum(counts) - counts, counts)


def turned_normals(packing: Packing, normals: Floats) -> Floats:
    """Return the faces' unit normals in the world, shape (n_faces, 3)."""
    counts = np.diff(packing.grains.face_offsets)
    matrices = np.repeat(to_matrices(packing.quaternions), counts, axis=0)
    turned: Floats = np.einsum("nij,nj->ni", matrices, normals)
    return turned
