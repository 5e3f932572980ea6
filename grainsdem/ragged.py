"""Offsets arithmetic: the only module that knows the CSR layout.

A ragged array is a flat array and ``offsets`` of length n + 1: row i is ``flat[offsets[i]:offsets[i + 1]]``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import ShapeError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def offsets_from_counts(counts: ArrayLike) -> NDArray[np.int64]:
    """Return the offsets, shape (n + 1,), of rows with the given lengths.

    Examples
    --------
    >>> offsets_from_counts([2, 0, 3])
    array([0, 2, 2, 5])
    """
    counts = np.asarray(counts, dtype=np.int64)
    offsets = np.zeros(counts.size + 1, dtype=np.int64)
    np.cumsum(counts, out=offsets[1:])
    return offsets


def counts_from_offsets(offsets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the length of each row, shape (n,)."""
    return np.diff(offsets)


def check_offsets(name: str, offsets: NDArray[np.int64], n_flat: int) -> None:
    """Raise `ShapeError` unless ``offsets`` starts at 0, never falls and ends at ``n_flat``."""
    if offsets.ndim != 1 or offsets.size == 0 or offsets[0] != 0 or offsets[-1] != n_flat:
        ends = "nothing" if offsets.size == 0 else f"{offsets.flat[0]} … {offsets.flat[-1]}"
        raise ShapeError(f"{name} must run from 0 to {n_flat}; got {ends}")
    if np.any(np.diff(offsets) < 0):
        raise ShapeError(f"{name} must never fall; it falls after entry {int(np.argmax(np.diff(offsets) < 0))}")


def owners(offsets: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the row of every flat entry, shape (n_flat,).

    Examples
    --------
    >>> owners(np.array([0, 2, 2, 5]))
    array([0, 0, 2, 2, 2])
    """
    return np.repeat(np.arange(offsets.size - 1, dtype=np.int64), np.diff(offsets))


def take_indices(offsets: NDArray[np.int64], rows: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat indices of the chosen rows in their order, and the offsets of the result.

    Parameters
    ----------
    offsets : ndarray of int64, shape (n + 1,)
        Offsets of the ragged array.
    rows : array_like of int, shape (m,)
        Rows to take, in any order, repeated or not.

    Returns
    -------
    indices : ndarray of int64, shape (k,)
        Such that ``flat[indices]`` is the new flat array.
    new_offsets : ndarray of int64, shape (m + 1,)
        Offsets of the new flat array.

    Examples
    --------
    >>> take_indices(np.array([0, 2, 2, 5]), [2, 0])
    (array([2, 3, 4, 0, 1]), array([0, 3, 5]))
    """
    rows = np.asarray(rows, dtype=np.int64)
    counts = np.diff(offsets)[rows]
    new_offsets = offsets_from_counts(counts)
    indices = np.arange(new_offsets[-1], dtype=np.int64) + np.repeat(offsets[rows] - new_offsets[:-1], counts)
    return indices, new_offsets


def sum_rows(values: NDArray[Any], offsets: NDArray[np.int64]) -> NDArray[Any]:
    """Return the sum of each row over axis 0, shape (n, ...); an empty row sums to zero."""
    n = offsets.size - 1
    filled = np.flatnonzero(np.diff(offsets))
    result = np.zeros((n, *values.shape[1:]), dtype=values.dtype)
    if filled.size:
        result[filled] = np.add.reduceat(values, offsets[filled], axis=0)
    return result
