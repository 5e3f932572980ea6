"""What is wrong with polyhedra that should be closed, outward and convex, and the smallest of their parts."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.threads import in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import FacePlanes
    from grainsdem.model import Polyhedra


class Defects(NamedTuple):
    """Defects of shape, one row a polyhedron; zeros for a sound one, but for the last two.

    Parameters
    ----------
    open_edges : ndarray of int64, shape (n,)
        Edges that do not lie between exactly two faces, and faces of fewer than three corners; the deviation of
        V - E + F from 2 where there are none of either.
    inward_faces : ndarray of int64, shape (n,)
        Faces whose outer side looks to the mean of the vertices.
    dents : ndarray, shape (n,)
        How far [m] corners would have to move until no vertex lies beyond the plane of a face.
    shortest_edges : ndarray, shape (n,)
        Length [m] of the shortest edge.
    smallest_faces : ndarray, shape (n,)
        Area [m²] of the smallest face.
    """

    open_edges: NDArray[np.int64]
    inward_faces: NDArray[np.int64]
    dents: NDArray[np.float64]
    shortest_edges: NDArray[np.float64]
    smallest_faces: NDArray[np.float64]


def find_defects(polyhedra: Polyhedra) -> Defects:
    """Return what is wrong with each polyhedron.

    Parameters
    ----------
    polyhedra : Polyhedra
        Anything with finite vertices.

    Returns
    -------
    Defects
        One row a polyhedron.

    Notes
    -----
    A vertex beyond a face's plane by b, at a distance r from a face of width w, is cured by moving that face's
    corners by b w / r. This is what counts as a dent: the plane of a sliver is known no better than its corners
    allow, and rounding there means nothing for the shape.
    """
    n = len(polyhedra)
    result = Defects(np.zeros(n, np.int64), np.zeros(n, np.int64), np.zeros(n), np.full(n, np.inf), np.full(n, np.inf))
    p = polyhedra
    planes = face_planes(p)
    most = int(np.diff(p.vertex_offsets).max(initial=0))
    mesh = p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets
    in_blocks(_find, n, *mesh, planes, most, result)
    return result


@inner
def _distance(x: NDArray[np.float64], p: int, q: int) -> float:
    """Return how far two vertices are apart."""
    square = 0.0
    for axis in range(3):
        square += (x[p, axis] - x[q, axis]) ** 2
    return float(np.sqrt(square))


@njit(cache=True, nogil=True)
def _find(
    start: int,
    stop: int,
    x: NDArray[np.float64],
    vertex_offsets: NDArray[np.int64],
    face_offsets: NDArray[np.int64],
    corners: NDArray[np.int32],
    corner_offsets: NDArray[np.int64],
    planes: FacePlanes,
    most: int,
    out: Defects,
) -> None:
    open_edges, inward_faces, dents, shortest_edges, smallest_faces = out
    uses = np.zeros((most, most), dtype=np.int32)
    is_used = np.zeros(most, dtype=np.bool_)
    for i in range(start, stop):
        v0, v1, f0, f1 = vertex_offsets[i], vertex_offsets[i + 1], face_offsets[i], face_offsets[i + 1]
        is_used[: v1 - v0] = False
        mean = np.zeros(3)
        for k in range(v0, v1):
            for axis in range(3):
                mean[axis] += x[k, axis] / (v1 - v0)
        bad = 0
        for f in range(f0, f1):
            c0, c1 = corner_offsets[f], corner_offsets[f + 1]
            if c1 - c0 < 3:
                bad += 1
            for c in range(c0, c1):
                p, q = corners[c], corners[c0 if c + 1 == c1 else c + 1]
                uses[min(p, q), max(p, q)] += 1
                is_used[p] = True
                shortest_edges[i] = min(shortest_edges[i], _distance(x, v0 + p, v0 + q))
            smallest_faces[i] = min(smallest_faces[i], planes.areas[f])
        edges = 0
        for f in range(f0, f1):
            c0, c1 = corner_offsets[f], corner_offsets[f + 1]
            for c in range(c0, c1):
                p, q = corners[c], corners[c0 if c + 1 == c1 else c + 1]
                count = uses[min(p, q), max(p, q)]
                if count > 0:
                    edges += 1
                    uses[min(p, q), max(p, q)] = 0
                    if count != 2:
                        bad += 1
        used = 0
        for k in range(v1 - v0):
            used += is_used[k]
        open_edges[i] = bad if bad > 0 else abs(used - edges + (f1 - f0) - 2)
        for f in range(f0, f1):
            if planes.areas[f] == 0.0:
                continue
            c0, c1 = corner_offsets[f], corner_offsets[f + 1]
            middle = np.zeros(3)
            longest = 0.0
            for c in range(c0, c1):
                p, q = v0 + corners[c], v0 + corners[c0 if c + 1 == c1 else c + 1]
                for axis in range(3):
                    middle[axis] += x[p, axis] / (c1 - c0)
                longest = max(longest, _distance(x, p, q))
            width = 2.0 * planes.areas[f] / longest
            sign = 1.0
            inward = 0.0
            for axis in range(3):
                inward += planes.normals[f, axis] * (mean[axis] - middle[axis])
            if inward >= 0.0:
                inward_faces[i] += 1
                sign = -1.0
            for k in range(v0, v1):
                beyond = 0.0
                square = 0.0
                for c in range(3):
                    beyond += sign * planes.normals[f, c] * (x[k, c] - middle[c])
                    square += (x[k, c] - middle[c]) ** 2
                if beyond > 0.0:
                    dents[i] = max(dents[i], beyond * min(1.0, width / np.sqrt(square)))
