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

from grainsdem.geometry.threads import in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

CUBES = 12
"""Cubes along the prism's base at the beginning: 660 in all, each some 18 degrees across."""

KEPT = np.array([192, 192, 192, 128, 64, 16, *[8] * 7, *[4] * 8])
"""Cubes that are parted again, step by step, never more than before. For 1800 grains of all kinds a search that leaves
out only what a bound excludes found holes 0.1 % smaller at most. After the last step cubes are a ten-millionth wide."""

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


@inner
def _widths(a, b, c, u, n, low, high):  # type: ignore[no-untyped-def]
    """Fill ``high`` with the widths of points (a, b, c) along the first n directions of u, shape (3, m)."""
    x, y, z, last = u[0], u[1], u[2], a.size - 1
    for i in range(n):
        low[i], high[i] = 1e300, -1e300
    # Four points at a time, and all directions in the inner loop, which then is one of vectors.
    for k in range(0, a.size, 4):
        k1, k2, k3 = min(k + 1, last), min(k + 2, last), min(k + 3, last)
        for i in range(n):
            t0 = x[i] * a[k] + y[i] * b[k] + z[i] * c[k]
            t1 = x[i] * a[k1] + y[i] * b[k1] + z[i] * c[k1]
            t2 = x[i] * a[k2] + y[i] * b[k2] + z[i] * c[k2]
            t3 = x[i] * a[k3] + y[i] * b[k3] + z[i] * c[k3]
            low[i] = min(t0, t1, t2, t3, low[i])
            high[i] = max(t0, t1, t2, t3, high[i])
    for i in range(n):
        high[i] -= low[i]


@inner
def _sides(a, b, c, cubes, count, enough, sides, work):  # type: ignore[no-untyped-def]
    """Fill the sides of the squares that Rodrigues' vectors turn; return the least and the most of those <= enough.

    Of a square that is too wide one way the other is not looked at.
    """
    u, low, high, left = work
    n = count
    for i in range(count):
        left[i], sides[i] = i, 0.0
    for way in range(2):
        for k in range(n):
            x, y, z = cubes[left[k], 0], cubes[left[k], 1], cubes[left[k], 2]
            s = 1.0 / (1.0 + x * x + y * y + z * z)
            if way == 0:
                u[0, k], u[1, k], u[2, k] = (1.0 + x * x - y * y - z * z) * s, 2 * (x * y + z) * s, 2 * (x * z - y) * s
            else:
                u[0, k], u[1, k], u[2, k] = 2 * (x * y - z) * s, (1.0 - x * x + y * y - z * z) * s, 2 * (y * z + x) * s
        _widths(a, b, c, u, n, low, high)
        least, most, kept = 1e300, 0.0, 0
        for k in range(n):
            i = left[k]
            sides[i] = max(sides[i], high[k])
            if sides[i] <= enough:
                least, most = min(least, sides[i]), max(most, sides[i])
                left[kept] = i
                kept += 1
        n = kept
    return least, most


@inner
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


@inner
def _smallest(a, b, c, cubes, half, kept):  # type: ignore[no-untyped-def]
    """Return the side of the smallest hole that points (a, b, c) pass, from cubes of half an edge ``half``."""
    room, count = kept[0], len(cubes)
    most = max(count, 8 * room)
    sides, chosen, parts = np.empty(most), np.empty((room, 3)), np.empty((8 * room, 3))
    work = np.empty((3, most)), np.empty(most), np.empty(most), np.empty(most, dtype=np.int64)
    best, enough = 1e300, 1e300
    for step in range(kept.size + 1):
        least, worst = _sides(a, b, c, cubes, count, enough, sides, work)
        best = min(best, least)
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
