"""Short edges of a surface merged away: a mesher has to make a tetrahedron as small, or as flat, as the shortest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.triangles import vector_areas

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

THINNEST = 1e-4
"""Height of a triangle, in edges of one, below which it has no direction to hold against another."""


def merged(points: Floats, triangles: Ints, keys: Ints, walls: NDArray[np.bool_], shortest: float) -> tuple[Ints, Ints]:
    """Return the triangles of a closed surface without edges shorter than ``shortest``, and their keys.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Corners; those that go are left here, and no triangle has them.
    triangles : ndarray of int, shape (m, 3)
        Corners of the triangles.
    keys : ndarray of int, shape (m,)
        What each is part of.
    walls : ndarray of bool, shape (n, k)
        Which walls each corner lies on. It stays on them.
    shortest : float
        Length below which an edge goes, where neither the surface's form nor a wall forbids it.
    """
    refused: set[tuple[int, int]] = set()
    while True:
        edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
        short = np.unique(edges[lengths < shortest], axis=0)
        lengths = np.linalg.norm(points[short[:, 0]] - points[short[:, 1]], axis=1)
        for a, b in short[np.argsort(lengths, kind="stable")].tolist():
            if (a, b) in refused:
                continue
            found = _collapsed(points, triangles, walls, a, b)
            if found is not None:
                rows, triangles = found
                keys = keys[rows]
                break
            refused.add((a, b))
        else:
            return triangles, keys


def _collapsed(
    points: Floats, triangles: Ints, walls: NDArray[np.bool_], a: int, b: int
) -> tuple[NDArray[np.bool_], Ints] | None:
    """Return which triangles stay, and those, when an edge goes; none where its going would spoil the surface."""
    if (walls[b] & ~walls[a]).any():
        a, b = b, a
    if (walls[b] & ~walls[a]).any():
        return None
    has_a, has_b = (triangles == a).any(axis=1), (triangles == b).any(axis=1)
    both = has_a & has_b
    around = [set(triangles[rows].ravel().tolist()) - {a, b} for rows in (has_a, has_b)]
    # Two corners in common, those of the two triangles that vanish: else the surface would touch itself.
    if both.sum() != 2 or len(around[0] & around[1]) != 2:
        return None
    moved = np.where(triangles == b, a, triangles)
    changed = has_b & ~both
    before, after = vector_areas(points[triangles[changed]]), vector_areas(points[moved[changed]])
    corners = points[moved[changed]]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    if (2 * np.linalg.norm(after, axis=1) < THINNEST * longest**2).any() or ((before * after).sum(axis=1) < 0).any():
        return None
    return ~both, moved[~both]
