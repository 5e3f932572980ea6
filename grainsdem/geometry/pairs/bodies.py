"""The grains of a packing as flat arrays that the pair kernels read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.threads import in_blocks
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing


class Bodies(NamedTuple):
    """Convex bodies, turned as they stand, each about its own position.

    They are laid out in memory as they lie in space, so that what is near is met together; ids are the packing's.

    Parameters
    ----------
    vertices : ndarray, shape (n_vertices, 3)
        Turned vertices [m].
    vertex_ranges, face_ranges, edge_ranges : ndarray of int64, shape (n, 2)
        Vertices of body i are ``vertices[vertex_ranges[i, 0]:vertex_ranges[i, 1]]``; faces and edges likewise.
    corners : ndarray of int32, shape (n_corners,)
        Corners of all faces, local to the body.
    corner_offsets : ndarray of int64, shape (n_faces + 1,)
        Corners of face f are ``corners[corner_offsets[f]:corner_offsets[f + 1]]``.
    normals, heights, areas : ndarray, shapes (n_faces, 3), (n_faces,) and (n_faces,)
        Planes n · x = h [m] and areas [m²] of the faces.
    edges : ndarray of int32, shape (n_edges, 4)
        Two vertices and the two faces beside each edge, local to the body; the first face runs along the edge.
    radii : ndarray, shape (n,)
        Largest distance [m] of a vertex from the body's position.
    """

    vertices: NDArray[np.float64]
    vertex_ranges: NDArray[np.int64]
    face_ranges: NDArray[np.int64]
    edge_ranges: NDArray[np.int64]
    corners: NDArray[np.int32]
    corner_offsets: NDArray[np.int64]
    normals: NDArray[np.float64]
    heights: NDArray[np.float64]
    areas: NDArray[np.float64]
    edges: NDArray[np.int32]
    radii: NDArray[np.float64]


def bodies(packing: Packing) -> Bodies:
    """Return the grains of a packing, turned."""
    g = packing.grains
    order = _order_in_space(packing.positions)
    ends = g.face_vertex_offsets[g.face_offsets]
    vertex_offsets, face_offsets, corner_starts = (
        offsets_from_counts(np.diff(offsets)[order]) for offsets in (g.vertex_offsets, g.face_offsets, ends)
    )
    turned, corners = np.empty_like(g.vertices), np.empty_like(g.face_vertices)
    corner_offsets = np.zeros_like(g.face_vertex_offsets)
    radii = np.zeros(len(g))
    in_blocks(
        _lay_out,
        len(g),
        (g.vertices, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets),
        order,
        to_matrices(packing.quaternions),
        (vertex_offsets, face_offsets, corner_starts),
        turned,
        corners,
        corner_offsets,
        radii,
    )
    planes = face_planes(Polyhedra(turned, vertex_offsets, face_offsets, corners, corner_offsets))
    most = int(np.diff(vertex_offsets).max(initial=0))
    raw = np.empty((corners.size, 4), dtype=np.int32)
    found = np.zeros(len(g), dtype=np.int64)
    in_blocks(_find_edges, len(g), face_offsets, corners, corner_offsets, corner_starts, most, raw, found)
    edge_offsets = offsets_from_counts(found)
    rows = np.arange(edge_offsets[-1]) + np.repeat(corner_starts[:-1] - edge_offsets[:-1], found)
    ranges = [_ranges(offsets, order) for offsets in (vertex_offsets, face_offsets, edge_offsets)]
    return Bodies(turned, ranges[0], ranges[1], ranges[2], corners, corner_offsets, *planes, raw[rows], radii)


def standing(solids: Bodies, ids: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return the turned vertices [m] of some bodies, one after another, and their offsets."""
    starts, ends = solids.vertex_ranges[ids].T
    offsets = offsets_from_counts(ends - starts)
    return solids.vertices[np.arange(offsets[-1]) + np.repeat(starts - offsets[:-1], ends - starts)], offsets


def _ranges(offsets: NDArray[np.int64], order: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return first and last row of each item, from the offsets of the items in ``order``."""
    ranges = np.empty((order.size, 2), dtype=np.int64)
    ranges[order, 0], ranges[order, 1] = offsets[:-1], offsets[1:]
    return ranges


def _order_in_space(positions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the order in which grains lie along a curve that fills space (Morton 1966)."""
    lower, upper = positions.min(axis=0, initial=np.inf), positions.max(axis=0, initial=-np.inf)
    span = np.maximum(upper - lower, np.finfo(float).tiny)
    key = np.zeros(len(positions), dtype=np.uint64)
    for axis in range(3):
        x = ((positions[:, axis] - lower[axis]) / span[axis] * 1023).astype(np.uint64)
        for shift, mask in ((16, 0x030000FF), (8, 0x0300F00F), (4, 0x030C30C3), (2, 0x09249249)):
            x = (x | (x << np.uint64(shift))) & np.uint64(mask)
        key |= x << np.uint64(axis)
    return np.argsort(key, kind="stable")


@njit(cache=True, nogil=True)
def _lay_out(
    start: int,
    stop: int,
    old: tuple[NDArray[Any], ...],
    order: NDArray[np.int64],
    matrices: NDArray[np.float64],
    starts: tuple[NDArray[np.int64], ...],
    turned: NDArray[np.float64],
    corners: NDArray[np.int32],
    corner_offsets: NDArray[np.int64],
    radii: NDArray[np.float64],
) -> None:
    """Turn the vertices and copy the corners of each grain to where its neighbours in space are."""
    vertices, vertex_offsets, face_offsets, old_corners, old_offsets = old
    vertex_starts, face_starts, corner_starts = starts
    for k in range(start, stop):
        i = order[k]
        r = matrices[i]
        for v in range(vertex_offsets[i + 1] - vertex_offsets[i]):
            old_v = vertex_offsets[i] + v
            x, y, z = vertices[old_v, 0], vertices[old_v, 1], vertices[old_v, 2]
            square = 0.0
            for c in range(3):
                s = r[c, 0] * x + r[c, 1] * y + r[c, 2] * z
                turned[vertex_starts[k] + v, c] = s
                square += s * s
            radii[i] = max(radii[i], np.sqrt(square))
        first = old_offsets[face_offsets[i]]
        for f in range(face_offsets[i + 1] - face_offsets[i]):
            # Each face writes where it ends: the next one starts there.
            end = old_offsets[face_offsets[i] + f + 1] - first
            corner_offsets[face_starts[k] + f + 1] = corner_starts[k] + end
        for c in range(old_offsets[face_offsets[i + 1]] - first):
            corners[corner_starts[k] + c] = old_corners[first + c]


@njit(cache=True, nogil=True)
def _find_edges(
    start: int,
    stop: int,
    face_offsets: NDArray[np.int64],
    corners: NDArray[np.int32],
    corner_offsets: NDArray[np.int64],
    ends: NDArray[np.int64],
    most: int,
    edges: NDArray[np.int32],
    found: NDArray[np.int64],
) -> None:
    """List the edges that two faces share; an edge of an open mesh is left out."""
    beside = np.full((most, most), -1, dtype=np.int32)
    for i in range(start, stop):
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
