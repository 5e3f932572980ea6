"""The smallest square hole that each grain passes, found by a search over all of its orientations.

A grain that moves along the axis of a hole passes it where its shadow does, and the shadow fits a square along two
directions at right angles where the grain is no wider than the square along both. So the hole's side is the least of
max(w(u), w(v)) over all pairs of directions u and v at right angles, w being the width of the grain. A pair is a
rotation up to the eight that carry a square into itself. The rotations left are a prism about the origin of Rodrigues'
space, which is parted into cubes: those whose middles are best are parted again into eight, and so on.

References
----------
.. [1] F. C. Frank, "Orientation mapping", Metallurgical Transactions A 19 (1988) 403-408: Rodrigues' space.
.. [2] A. Heinz, P. Neumann, "Representation of orientation and disorientation data for cubic, hexagonal, tetragonal and
   orthorhombic crystals", Acta Crystallographica A 47 (1991) 780-789: the prism of the square's symmetry.
"""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from grainsdem.geometry.threads import INNER, in_blocks

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

CUBES = 12
"""Cubes along the prism's base at the beginning: 660 in all, each some 18 degrees across."""

KEPT = np.array([192, 192, 192, 128, 64, 16, *[8] * 7, *[4] * 8])
"""Cubes that are parted again, step by step, never more than before. For 1800 grains of all kinds a search that leaves
out only what a bound excludes found holes 0.1 % smaller at most. After the last step cubes are a ten-millionth wide."""

HOPELESS = 1.25
"""A cube whose middle is wider than the best by this factor along one direction is not looked at along the other."""

BATCH = 64
"""Grains that a thread takes at a time: some hundredths of a second."""


def square_holes(polyhedra: Polyhedra) -> Floats:
    """Return the side [m] of the smallest square hole that each polyhedron passes, shape (n,).

    Returns
    -------
    ndarray, shape (n,)
        NaN where there is no vertex. What is found is some orientation's, and no less than the least of all.
    """
    sides = np.full(len(polyhedra), np.nan)
    points, offsets = np.ascontiguousarray(polyhedra.vertices.T), polyhedra.vertex_offsets
    in_blocks(_search, len(sides), points, offsets, _first_cubes(), 1 / CUBES, KEPT, sides, least=BATCH)
    return sides


@lru_cache(maxsize=1)
def _first_cubes() -> Floats:
    """Return the middles of the cubes that the prism is parted into, shape (m, 3)."""
    base = (2 * np.arange(CUBES) + 1) / CUBES - 1
    height = int(np.ceil(CUBES * np.tan(np.pi / 8)))  # tan(π/8): half of a quarter turn about the hole's axis
    cubes = np.stack(np.meshgrid(base, base, (2 * np.arange(height) + 1 - height) / CUBES, indexing="ij"), axis=-1)
    cubes = cubes.reshape(-1, 3)
    # Half turns about the square's diagonals cut the prism's corners off: cubes that lie beyond are others again.
    inside = np.abs(cubes[:, 0]) + np.abs(cubes[:, 1]) <= np.sqrt(2) + 2 / CUBES
    return np.ascontiguousarray(cubes[inside])


@njit(**INNER)
def _width(a, b, c, x, y, z):  # type: ignore[no-untyped-def]
    """Return the width of points (a, b, c) along a direction (x, y, z)."""
    low, high = 1e300, -1e300
    for k in range(a.size):
        t = x * a[k] + y * b[k] + z * c[k]
        low = min(low, t)
        high = max(high, t)
    return high - low


@njit(**INNER)
def _side(a, b, c, x, y, z, enough):  # type: ignore[no-untyped-def]
    """Return the wider of the widths along the sides of the square turned by Rodrigues' vector, or one > enough."""
    s = 1.0 / (1.0 + x * x + y * y + z * z)
    first = _width(a, b, c, (1.0 + x * x - y * y - z * z) * s, 2.0 * (x * y + z) * s, 2.0 * (x * z - y) * s)
    if first > enough:
        return first
    second = _width(a, b, c, 2.0 * (x * y - z) * s, (1.0 - x * x + y * y - z * z) * s, 2.0 * (y * z + x) * s)
    return max(first, second)


@njit(**INNER)
def _threshold(sides, count, least, most, room):  # type: ignore[no-untyped-def]
    """Return the side, to a thousandth of the range, that as many as there is room for do not exceed."""
    low, high = least, most
    for _ in range(10):
        middle = 0.5 * (low + high)
        below = 0
        for i in range(count):
            below += sides[i] <= middle
        if below > room:
            high = middle
        else:
            low = middle
    return low


@njit(**INNER)
def _smallest(a, b, c, cubes, half, kept):  # type: ignore[no-untyped-def]
    """Return the side of the smallest hole that points (a, b, c) pass, from cubes of half an edge ``half``."""
    room = kept[0]
    sides = np.empty(max(len(cubes), 8 * room))
    chosen, parts = np.empty((room, 3)), np.empty((8 * room, 3))
    best, enough, count = 1e300, 1e300, len(cubes)
    for step in range(kept.size + 1):
        worst = 0.0
        for i in range(count):
            sides[i] = _side(a, b, c, cubes[i, 0], cubes[i, 1], cubes[i, 2], enough)
            worst = max(worst, sides[i])
            if sides[i] < best:
                best = sides[i]
                enough = min(enough, HOPELESS * best)
        if step == kept.size:
            break
        enough = _threshold(sides, count, best, worst, kept[step])
        half *= 0.5
        n = 0
        for i in range(count):
            if sides[i] <= enough and n < kept[step]:
                chosen[n, 0], chosen[n, 1], chosen[n, 2] = cubes[i, 0], cubes[i, 1], cubes[i, 2]
                n += 1
        for i in range(n):
            for k in range(8):
                parts[8 * i + k, 0] = chosen[i, 0] + (half if k & 1 else -half)
                parts[8 * i + k, 1] = chosen[i, 1] + (half if k & 2 else -half)
                parts[8 * i + k, 2] = chosen[i, 2] + (half if k & 4 else -half)
        cubes, count = parts, 8 * n
    return best


@njit(cache=True, nogil=True)
def _search(start, stop, points, offsets, cubes, half, kept, sides):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        k, l = offsets[i], offsets[i + 1]
        if l > k:
            sides[i] = _smallest(points[0, k:l], points[1, k:l], points[2, k:l], cubes, half, kept)
