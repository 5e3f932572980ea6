"""Triangles without order: which corners are one vertex, which triangles hang together, what they enclose.

All of it by tables of numbers that are scattered, in time that grows as the number of triangles does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


class Pieces(NamedTuple):
    """Triangles that hang together by edges.

    Parameters
    ----------
    of : ndarray of int64, shape (m,)
        Piece of each triangle, numbered by its first one.
    open_edges, twisted_edges : ndarray of int64, shape (n,)
        Edges of each piece that do not part two triangles, and those along which both run the same way.
    volumes : ndarray, shape (n,)
        What each encloses [m³]: below zero where it is wound inward.
    """

    of: Ints
    open_edges: Ints
    twisted_edges: Ints
    volumes: Floats


def weld(points: Floats) -> Ints:
    """Return a number for each point, shape (k,): that of the first which is equal to the bit."""
    # Zero has two signs; it gets one.
    bits = np.ascontiguousarray(points + 0.0, dtype=np.float64).view(np.int64).reshape(-1, 3)
    return _weld(bits, _table(len(bits)))  # type: ignore[no-any-return]


def pieces(points: Floats, triangles: Ints, corners: Ints) -> Pieces:
    """Part triangles into pieces that share no edge: two of them may touch at a corner.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        Points [m].
    triangles : ndarray of int64, shape (m, 3)
        Points of each triangle.
    corners : ndarray of int64, shape (m, 3)
        Vertices of each triangle: equal numbers are one vertex.
    """
    m = len(triangles)
    keys, sides = np.empty((3 * m, 2), dtype=np.int64), np.empty(3 * m, dtype=np.int64)
    counts, twists = np.zeros(3 * m, dtype=np.int64), np.zeros(3 * m, dtype=np.int64)
    parents = np.arange(m)
    n_edges = _join(corners, _table(3 * m), keys, sides, counts, twists, parents)
    of = np.empty(m, dtype=np.int64)
    n = _number(parents, of)
    result = Pieces(of, np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64), np.zeros(n))
    _count(of, sides[:n_edges], counts, twists, result.open_edges, result.twisted_edges)
    _enclose(points, triangles, of, result.volumes)
    return result


def _table(n: int) -> Ints:
    """Return an empty table with twice as many places as there are numbers, a power of two."""
    return np.full(1 << max(2 * n, 4).bit_length(), -1, dtype=np.int64)


@inner
def _place(a, b, c, size):  # type: ignore[no-untyped-def]
    """Scatter three numbers over a table whose size is a power of two."""
    key = np.uint64(a) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(29)) ^ np.uint64(b)) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(32)) ^ np.uint64(c)) * np.uint64(0x94D049BB133111EB)
    return np.int64((key ^ (key >> np.uint64(31))) & np.uint64(size - 1))


@njit(cache=True, nogil=True)
def _weld(bits, table):  # type: ignore[no-untyped-def]
    numbers = np.empty(len(bits), dtype=np.int64)
    size = table.size
    for i in range(len(bits)):
        at = _place(bits[i, 0], bits[i, 1], bits[i, 2], size)
        while True:
            k = table[at]
            if k < 0:
                table[at] = i
                numbers[i] = i
                break
            if bits[k, 0] == bits[i, 0] and bits[k, 1] == bits[i, 1] and bits[k, 2] == bits[i, 2]:
                numbers[i] = k
                break
            at = (at + 1) & (size - 1)
    return numbers


@inner
def _root(parents, i):  # type: ignore[no-untyped-def]
    """Return the first triangle that another hangs together with, and shorten the way to it."""
    while parents[i] != i:
        parents[i] = parents[parents[i]]
        i = parents[i]
    return i


@njit(cache=True, nogil=True)
def _join(corners, table, keys, sides, counts, twists, parents):  # type: ignore[no-untyped-def]
    """List the edges: their ends, the first triangle beside each, how many there are, and how many run the same way.

    Triangles beside one edge get a common parent, the first of them.
    """
    size, n = table.size, 0
    for t in range(len(corners)):
        for c in range(3):
            a, b = corners[t, c], corners[t, (c + 1) % 3]
            low, high = min(a, b), max(a, b)
            at = _place(low, high, 0, size)
            while table[at] >= 0 and (keys[table[at], 0] != low or keys[table[at], 1] != high):
                at = (at + 1) & (size - 1)
            e = table[at]
            if e < 0:
                e = table[at] = n
                keys[e, 0], keys[e, 1], sides[e] = low, high, t
                n += 1
            counts[e] += 1
            twists[e] += 1 if a < b else -1
            one, other = _root(parents, sides[e]), _root(parents, t)
            if one != other:
                parents[max(one, other)] = min(one, other)
    return n


@njit(cache=True, nogil=True)
def _number(parents, of):  # type: ignore[no-untyped-def]
    n = 0
    for t in range(parents.size):
        root = _root(parents, t)
        if root == t:
            of[t] = n
            n += 1
        else:
            of[t] = of[root]
    return n


@njit(cache=True, nogil=True)
def _count(of, sides, counts, twists, open_edges, twisted_edges):  # type: ignore[no-untyped-def]
    for e in range(sides.size):
        if counts[e] != 2:
            open_edges[of[sides[e]]] += 1
        elif twists[e] != 0:
            twisted_edges[of[sides[e]]] += 1


@njit(cache=True, nogil=True)
def _enclose(points, triangles, of, volumes):  # type: ignore[no-untyped-def]
    """Add up the tetrahedra over each triangle, from a point of its own piece: far from it digits would cancel."""
    origins = np.full(volumes.size, -1, dtype=np.int64)
    for t in range(len(triangles)):
        p = of[t]
        if origins[p] < 0:
            origins[p] = triangles[t, 0]
        o, a, b, c = points[origins[p]], points[triangles[t, 0]], points[triangles[t, 1]], points[triangles[t, 2]]
        ax, ay, az = a[0] - o[0], a[1] - o[1], a[2] - o[2]
        bx, by, bz = b[0] - o[0], b[1] - o[1], b[2] - o[2]
        cx, cy, cz = c[0] - o[0], c[1] - o[1], c[2] - o[2]
        volumes[p] += (ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)) / 6.0


def farthest(points: Floats, side: int) -> Ints:
    """Return the points that are farthest from the middle of their box, one in each of about ``6 side²`` directions.

    Lengths are relative to the box's edges, and the outermost points along x, y and z are among them.
    """
    lower, upper = points.min(axis=0), points.max(axis=0)
    best = np.full(6 * side * side, -1, dtype=np.int64)
    _look(points, 0.5 * (lower + upper), 1 / np.maximum(upper - lower, np.finfo(float).tiny), side, best)
    return np.unique(np.concatenate([best[best >= 0], points.argmin(axis=0), points.argmax(axis=0)]))


@njit(cache=True, nogil=True)
def _look(points, middle, scale, side, best):  # type: ignore[no-untyped-def]
    """Fill the farthest point through each square of a cube's six faces."""
    distances = np.zeros(best.size)
    for i in range(len(points)):
        x = (points[i, 0] - middle[0]) * scale[0]
        y = (points[i, 1] - middle[1]) * scale[1]
        z = (points[i, 2] - middle[2]) * scale[2]
        if abs(x) >= abs(y) and abs(x) >= abs(z):
            face, along, u, v = 0, x, y, z
        elif abs(y) >= abs(z):
            face, along, u, v = 2, y, z, x
        else:
            face, along, u, v = 4, z, x, y
        if along == 0.0:
            continue
        face += 1 if along > 0.0 else 0
        row = min(int(0.5 * (u / along + 1.0) * side), side - 1)
        column = min(int(0.5 * (v / along + 1.0) * side), side - 1)
        place = (face * side + row) * side + column
        square = x * x + y * y + z * z
        if square > distances[place]:
            best[place], distances[place] = i, square
