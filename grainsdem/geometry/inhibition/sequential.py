"""Points that arrive one after another and are refused where others are too near."""

from __future__ import annotations

from typing import TYPE_CHECKING

from numba import njit

from grainsdem.geometry.inhibition.grid import NOBODY, count_near, insert

if TYPE_CHECKING:
    from grainsdem.geometry.inhibition.grid import Floats, Grid, Integers


@njit(cache=True)
def admit(
    grid: Grid, links: Integers, points: Floats, n: int, candidates: Floats, most: Integers, refused: int, patience: int
) -> tuple[int, int]:
    """Offer candidates in turn to the first ``n`` points, until ``points`` is full or patience ends.

    Parameters
    ----------
    grid : Grid
        Holds the first ``n`` points.
    links : ndarray of int64, shape (capacity,)
        The grid's lists.
    points : ndarray, shape (capacity, 3)
        Positions [m]; those admitted are written from row ``n`` on.
    n : int
        Points so far.
    candidates : ndarray, shape (m, 3)
        Positions [m] to try.
    most : ndarray of int64, shape (m,)
        Points that each candidate bears near it.
    refused, patience : int
        Candidates refused in a row so far, and at most.

    Returns
    -------
    n, refused : int
        The same after the batch.
    """
    for row in range(len(candidates)):
        if n == len(points) or refused >= patience:
            break
        if count_near(grid, links, points, candidates[row], NOBODY, most[row]) > most[row]:
            refused += 1
            continue
        points[n] = candidates[row]
        insert(grid, links, points, n)
        n += 1
        refused = 0
    return n, refused
