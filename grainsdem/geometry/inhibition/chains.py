"""Markov chains whose states are patterns of points, weighted by c to the number of near pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from grainsdem.geometry.inhibition.grid import NOBODY, count_near, insert, remove

if TYPE_CHECKING:
    from grainsdem.geometry.inhibition.grid import Floats, Grid, Integers

ALL = np.int64(np.iinfo(np.int64).max)
"""No limit to the count of near points."""


@njit(cache=True)
def fill(grid: Grid, links: Integers, points: Floats, n: int) -> None:
    """Enter the first ``n`` points into an empty grid."""
    for k in range(n):
        insert(grid, links, points, k)


@njit(cache=True)
def move(
    grid: Grid, links: Integers, points: Floats, candidates: Floats, picks: Floats, chances: Floats, c: float
) -> None:
    """Try to move one point after another to a new place, their number kept.

    Parameters
    ----------
    grid : Grid
        Holds all points.
    links : ndarray of int64, shape (n,)
        The grid's lists.
    points : ndarray, shape (n, 3)
        Positions [m], changed in place.
    candidates : ndarray, shape (m, 3)
        New places [m], uniform in the domain.
    picks, chances : ndarray, shape (m,)
        Uniform numbers in [0, 1): which point, and whether it moves.
    c : float
        Inhibition.
    """
    for row in range(len(candidates)):
        k = int(picks[row] * len(points))
        after = count_near(grid, links, points, candidates[row], k, ALL if c > 0 else np.int64(0))
        accepted = after == 0
        if after > 0 and c > 0:
            before = count_near(grid, links, points, points[k], k, ALL)
            accepted = after <= before or chances[row] < c ** (after - before)
        if accepted:
            remove(grid, links, points, k)
            points[k] = candidates[row]
            insert(grid, links, points, k)


@njit(cache=True)
def bear_and_bury(
    grid: Grid,
    links: Integers,
    points: Floats,
    n: int,
    candidates: Floats,
    kinds: Floats,
    picks: Floats,
    chances: Floats,
    activity: float,
    c: float,
) -> int:
    """Try births and deaths in turn, with even chances.

    Parameters
    ----------
    grid, links, points, candidates, picks, chances, c
        As for `move`, with room for ``n`` + m points.
    n : int
        Points so far.
    kinds : ndarray, shape (m,)
        Uniform numbers in [0, 1): below a half a birth, else a death.
    activity : float
        Points expected where none keeps any away: intensity times volume.

    Returns
    -------
    int
        Number of points after the batch.
    """
    for row in range(len(candidates)):
        if kinds[row] < 0.5:
            near = count_near(grid, links, points, candidates[row], NOBODY, ALL)
            if chances[row] * (n + 1) < activity * c**near:
                points[n] = candidates[row]
                insert(grid, links, points, n)
                n += 1
        elif n > 0:
            k = int(picks[row] * n)
            near = count_near(grid, links, points, points[k], k, ALL)
            if chances[row] * activity * c**near < n:
                remove(grid, links, points, k)
                n -= 1
                if k < n:
                    # The last takes the place of the one that left, so that there are no gaps.
                    remove(grid, links, points, n)
                    points[k] = points[n]
                    insert(grid, links, points, k)
    return n
