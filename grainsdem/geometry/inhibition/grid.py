"""Points in a grid of linked lists: the neighbours of any place in constant time, while points come and go."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]
    Integers = NDArray[np.int64]

LEAST_WRAPPED = 4
"""Cells along an axis that wraps: with fewer, what the distance reaches could be one cell twice, before and behind."""


X: Any = np.int64(0)
Y: Any = np.int64(1)
Z: Any = np.int64(2)
"""Axes; typed, as for a literal numba would compile a callee once more."""

NOBODY: Any = np.int64(-1)
"""A number that no point has."""


class Grid(NamedTuple):
    """The cells of a box, and the first point in each.

    Parameters
    ----------
    lower, lengths : ndarray, shape (3,)
        Corner and edges of the box [m].
    wraps : ndarray of bool, shape (3,)
        Which axes wrap around.
    distance : float
        What is near [m]; no cell is narrower, but for axes with one cell.
    counts : ndarray of int64, shape (3,)
        Cells along each axis.
    heads : ndarray of int64, shape (n_cells,)
        First point in each cell, -1 where there is none.
    """

    lower: Floats
    lengths: Floats
    wraps: NDArray[np.bool_]
    distance: float
    counts: Integers
    heads: Integers


def make_grid(domain: Domain, distance: float, n: int) -> Grid:
    """Return an empty grid for about ``n`` points, with cells no narrower than ``distance`` [m]."""
    lengths = np.ascontiguousarray(domain.lengths)
    axes = 2 if domain.is_planar else 3
    # About a point a cell: more cells would cost memory and find nothing sooner.
    size = max(distance, float(np.prod(lengths[:axes]) / max(n, 1)) ** (1 / axes))
    counts = np.maximum(1, (lengths / size).astype(np.int64))
    counts[axes:] = 1
    counts[domain.periodic & (counts < LEAST_WRAPPED)] = 1
    heads = np.full(int(np.prod(counts)), -1, dtype=np.int64)
    return Grid(np.array(domain.lower), lengths, np.array(domain.periodic), float(distance), counts, heads)


@inner
def locate(grid: Grid, point: Floats, axis: int) -> Any:
    """Return the cell along one axis that a point lies in."""
    k = int((point[axis] - grid.lower[axis]) / grid.lengths[axis] * grid.counts[axis])
    return min(max(k, 0), grid.counts[axis] - 1)


@inner
def find_cell(grid: Grid, point: Floats) -> Any:
    """Return the number of the cell that a point lies in."""
    i, j, k = locate(grid, point, X), locate(grid, point, Y), locate(grid, point, Z)
    return (i * grid.counts[1] + j) * grid.counts[2] + k


@njit(cache=True)
def insert(grid: Grid, links: Integers, points: Floats, k: int) -> None:
    """Put point k at the head of its cell's list."""
    cell = find_cell(grid, points[k])
    links[k] = grid.heads[cell]
    grid.heads[cell] = k


@njit(cache=True)
def remove(grid: Grid, links: Integers, points: Floats, k: int) -> None:
    """Take point k out of its cell's list."""
    cell = find_cell(grid, points[k])
    if grid.heads[cell] == k:
        grid.heads[cell] = links[k]
        return
    before = grid.heads[cell]
    while links[before] != k:
        before = links[before]
    links[before] = links[k]


@inner
def search_range(grid: Grid, place: Floats, axis: int) -> Any:
    """Return the first and last cell along one axis that the distance reaches; beyond the ends where the axis wraps."""
    count = grid.counts[axis]
    if count == 1:
        return np.int64(0), np.int64(0)
    unit = (place[axis] - grid.lower[axis]) / grid.lengths[axis] * count
    reach = grid.distance / grid.lengths[axis] * count
    # Where rounding put a point into the cell beside its own, the comparison of distances is as uncertain.
    low, high = np.int64(np.floor(unit - reach)), np.int64(np.floor(unit + reach))
    if grid.wraps[axis]:
        return low, high
    return max(low, np.int64(0)), min(high, count - 1)


@inner
def wrap(k: int, count: int) -> Any:
    """Return the cell that is meant by one up to one count beyond an end."""
    if k < 0:
        return k + count
    if k >= count:
        return k - count
    return k


@njit(cache=True)
def count_near(grid: Grid, links: Integers, points: Floats, place: Floats, itself: int, most: Any) -> Any:
    """Return how many points lie nearer to a place than the grid's distance, ``itself`` left out.

    The count stops where it exceeds ``most``. Along axes that wrap the nearest image counts.
    """
    found = np.int64(0)
    square = grid.distance * grid.distance
    nx, ny, nz = grid.counts[0], grid.counts[1], grid.counts[2]
    low_x, high_x = search_range(grid, place, X)
    low_y, high_y = search_range(grid, place, Y)
    low_z, high_z = search_range(grid, place, Z)
    for a in range(low_x, high_x + 1):
        for b in range(low_y, high_y + 1):
            for c in range(low_z, high_z + 1):
                other = grid.heads[(wrap(a, nx) * ny + wrap(b, ny)) * nz + wrap(c, nz)]
                while other >= 0:
                    if other != itself:
                        away = 0.0
                        for axis in range(3):
                            step = abs(points[other, axis] - place[axis])
                            if grid.wraps[axis]:
                                step = min(step, grid.lengths[axis] - step)
                            away += step * step
                        if away < square:
                            found += 1
                            if found > most:
                                return found
                    other = links[other]
    return found
