"""The grains of a packing as flat arrays that the pair kernels read."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit, prange

from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

CHUNK = 512
"""Items that one thread takes at a time: its scratch arrays are made once for all of them."""


class Bodies(NamedTuple):
    """Convex bodies, turned as they stand, each about its own position.

    Parameters
    ----------
    vertices : ndarray, shape (n_vertices, 3)
        Turned vertices [m].
    vertex_offsets, face_offsets, corners, corner_offsets : ndarray
        As in `Polyhedra`: which vertices and faces are whose, and the corners of each face.
    normals, heights, areas : ndarray, shapes (n_faces, 3), (n_faces,) and (n_faces,)
        Planes n · x = h [m] and areas [m²] of the faces.
    edges : ndarray of int32, shape (n_edges, 4)
        Two vertices and the two faces beside each edge, local to the body; the first face runs along the edge.
    edge_offsets : ndarray of int64, shape (n + 1,)
        Edges of body i are ``edges[edge_offsets[i]:edge_offsets[i + 1]]``.
    radii : ndarray, shape (n,)
        Largest distance [m] of a vertex from the body's position.
    """

    vertices: NDArray[np.float64]
    vertex_offsets: NDArray[np.int64]
    face_offsets: NDArray[np.int64]
    corners: NDArray[np.int32]
    corner_offsets: NDArray[np.int64]
    normals: NDArray[np.float64]
    heights: NDArray[np.float64]
    areas: NDArray[np.float64]
    edges: NDArray[np.int32]
    edge_offsets: NDArray[np.int64]
    radii: NDArray[np.float64]


def bodies(packing: Packing) -> Bodies:
    """Return the grains of a packing, turned."""
    g = packing.grains
    turned = np.empty_like(g.vertices)
    radii = np.zeros(len(g))
    _turn(g.vertices, g.vertex_offsets, to_matrices(packing.quaternions), turned, radii)
    planes = face_planes(Polyhedra(turned, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets))
    ends = g.face_vertex_offsets[g.face_offsets]
    most = int(np.diff(g.vertex_offsets).max(initial=0))
    raw = np.empty((int(ends[-1]), 4), dtype=np.int32)
    found = np.zeros(len(g), dtype=np.int64)
    _find_edges(g.face_offsets, g.face_vertices, g.face_vertex_offsets, ends, most, raw, found)
    offsets = offsets_from_counts(found)
    rows = np.arange(offsets[-1]) + np.repeat(ends[:-1] - offsets[:-1], found)
    return Bodies(
        turned,
        g.vertex_offsets,
        g.face_offsets,
        g.face_vertices,
        g.face_vertex_offsets,
        *planes,
        raw[rows],
        offsets,
        radii,
    )


@njit(cache=True, parallel=True)
def _turn(
    vertices: NDArray[np.float64],
    vertex_offsets: NDArray[np.int64],
    matrices: NDArray[np.float64],
    turned: NDArray[np.float64],
    radii: NDArray[np.float64],
) -> None:
    for i in prange(vertex_offsets.size - 1):
        r = matrices[i]
        for k in range(vertex_offsets[i], vertex_offsets[i + 1]):
            square = 0.0
            for c in range(3):
                turned[k, c] = r[c, 0] * vertices[k, 0] + r[c, 1] * vertices[k, 1] + r[c, 2] * vertices[k, 2]
                square += turned[k, c] * turned[k, c]
            radii[i] = max(radii[i], np.sqrt(square))


@njit(cache=True, parallel=True)
def _find_edges(
    face_offsets: NDArray[np.int64],
    corners: NDArray[np.int32],
    corner_offsets: NDArray[np.int64],
    ends: NDArray[np.int64],
    most: int,
    edges: NDArray[np.int32],
    found: NDArray[np.int64],
) -> None:
    """List the edges that two faces share; an edge of an open mesh is left out."""
    n = face_offsets.size - 1
    for block in prange((n + CHUNK - 1) // CHUNK):
        beside = np.full((most, most), -1, dtype=np.int32)
        for i in range(block * CHUNK, min(n, (block + 1) * CHUNK)):
            f0, f1 = face_offsets[i], face_offsets[i + 1]
            count = 0
            for f in range(f0, f1):
                c0, c1 = corner_offsets[f], corner_offsets[f + 1]
                for c in range(c0, c1):
                    p, q = corners[c], corners[c0 if c + 1 == c1 else c + 1]
                    other = beside[q, p]
                    if other < 0:
                        beside[p, q] = f - f0
                        continue
                    row = ends[i] + count
                    edges[row, 0], edges[row, 1], edges[row, 2], edges[row, 3] = q, p, other, f - f0
                    count += 1
            found[i] = count
            for f in range(f0, f1):
                c0, c1 = corner_offsets[f], corner_offsets[f + 1]
                for c in range(c0, c1):
                    beside[corners[c], corners[c0 if c + 1 == c1 else c + 1]] = -1
