"""What pairs and rows of voxels say: how many pairs lie in which phase, and how long the runs of each phase are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from grainsdem.geometry.threads import in_blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Counts = NDArray[np.int64]


def count_pairs(
    labels: NDArray[np.int32], offset: tuple[int, int, int], periodic: NDArray[np.bool_]
) -> tuple[int, int, int]:
    """Return how many pairs of voxels an offset parts, how many lie both in grains, and how many in grain and void.

    Parameters
    ----------
    labels : ndarray of int32, shape (nz, ny, nx)
        Positive in grains, zero in the void; pairs with a negative label are left out.
    offset : tuple of int
        From the first voxel to the second along z, y and x.
    periodic : ndarray of bool, shape (3,)
        Which axes, z, y and x, wrap around.
    """
    counts = np.zeros((labels.shape[0], 3), dtype=np.int64)
    in_blocks(_count_pairs, len(labels), labels, np.array(offset, dtype=np.int64), periodic, counts, least=1)
    pairs, solid, mixed = counts.sum(axis=0).tolist()
    return pairs, solid, mixed


@njit(cache=True, nogil=True)
def _count_pairs(start, stop, labels, offset, periodic, counts):  # type: ignore[no-untyped-def]
    nz, ny, nx = labels.shape
    for k in range(start, stop):
        k2 = k + offset[0]
        if periodic[0]:
            k2 %= nz
        if k2 < 0 or k2 >= nz:
            continue
        pairs = solid = mixed = 0
        for j in range(ny):
            j2 = j + offset[1]
            if periodic[1]:
                j2 %= ny
            if j2 < 0 or j2 >= ny:
                continue
            for i in range(nx):
                i2 = i + offset[2]
                if periodic[2]:
                    i2 %= nx
                if i2 < 0 or i2 >= nx:
                    continue
                a, b = labels[k, j, i], labels[k2, j2, i2]
                if a >= 0 and b >= 0:
                    pairs += 1
                    solid += (a > 0) & (b > 0)
                    mixed += (a > 0) != (b > 0)
        counts[k, 0], counts[k, 1], counts[k, 2] = pairs, solid, mixed


def run_lengths(rows: NDArray[np.int8], *, wraps: bool) -> tuple[Counts, Counts]:
    """Return how often runs of each length occur in rows of voxels, in grains and in the void.

    Parameters
    ----------
    rows : ndarray of int8, shape (n, length)
        1 in grains, 0 in the void, -1 outside.
    wraps : bool
        Whether a row goes on at its beginning.

    Returns
    -------
    solid, void : ndarray of int64, shape (length + 1,)
        Entry k counts the runs of k voxels. A run that the end of a row or what lies outside cuts is left out.
    """
    counts = np.zeros((64, 2, rows.shape[1] + 1), dtype=np.int64)
    in_blocks(_run_lengths, len(counts), rows, wraps, counts, least=1)
    void, solid = counts.sum(axis=0)
    return solid, void


@njit(cache=True, nogil=True)
def _run_lengths(start, stop, rows, wraps, counts):  # type: ignore[no-untyped-def]
    n_parts, n = counts.shape[0], rows.shape[1]
    for part in range(start, stop):
        for r in range(part, rows.shape[0], n_parts):
            # The first run begins where the phase changes for the first time: what comes before is cut, or wraps.
            first = 1
            while first < n and rows[r, first] == rows[r, first - 1]:
                first += 1
            if first == n:
                continue
            phase, before, length = rows[r, first], rows[r, first - 1], 0
            end = first + n if wraps else n
            for c in range(first, end):
                here = rows[r, c % n]
                if here != phase:
                    if phase >= 0 and before >= 0 and here >= 0:
                        counts[part, phase, length] += 1
                    before, phase, length = phase, here, 0
                length += 1
            if wraps and phase >= 0 and before >= 0 and rows[r, first] >= 0 and rows[r, first] != phase:
                counts[part, phase, length] += 1
