"""Convex polyhedra with their faces moved inward: the half-spaces of the faces, cut anew."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.cells.cutting import CUT, EMPTY, FULL, HOME, LOST, cut, polish, start_box
from grainsdem.geometry.cells.emitting import BROKEN, emit
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

ON_PLANE = 8 * np.finfo(np.float64).eps
"""Distance within which a vertex counts as on a plane, relative to the box that it is cut from: a few roundings."""

SHORTEST = 512 * np.finfo(np.float64).eps
"""Length below which an edge is rounding, relative to the same: many roundings, as planes may meet at small angles."""

WIDEST = 1e-9
"""Largest relative length that repairs may take for rounding."""

CHUNK = 256
"""Polyhedra that are worth a thread."""


class Insets(NamedTuple):
    """Polyhedra whose faces were moved inward.

    Parameters
    ----------
    shapes : Polyhedra
        As many as before, in the same frames; without faces where nothing is left.
    faces : ndarray of int64, shape (n_faces,)
        Number, among the faces before, of each face that is left.
    is_gone : ndarray of bool, shape (n,)
        Where nothing is left.
    is_unsound : ndarray of bool, shape (n,)
        Where the half-spaces of the faces enclose nothing: open, or not finite.
    """

    shapes: Polyhedra
    faces: NDArray[np.int64]
    is_gone: NDArray[np.bool_]
    is_unsound: NDArray[np.bool_]


@inner
def _carve(points, normals, moves, slack, radius, work):  # type: ignore[no-untyped-def]
    """Cut the cell of one polyhedron out of a box; return status and the numbers of triangles and planes."""
    geo, tri, planes, tags = work
    start_box(
        geo,
        tri,
        planes,
        tags,
        radius,
        radius,
        radius,
        np.full(3, 2.0 * radius),
        np.zeros(3, dtype=np.bool_),
        np.int64(0),
    )
    n_tri, n_planes = np.int64(8), np.int64(6)  # typed: a literal would have numba compile every callee twice
    for f in range(len(normals)):
        nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
        if nx == 0.0 and ny == 0.0 and nz == 0.0:
            continue  # a face without area bounds nothing
        # A plane that supports the body, whatever rounding did to the normal of a small face: moved inward, no such
        # plane cuts what the true faces leave.
        height = -np.inf
        for v in range(len(points)):
            height = max(height, nx * points[v, 0] + ny * points[v, 1] + nz * points[v, 2])
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, nx, ny, nz, height - moves[f], slack)
        if status == CUT:
            tags[0, n_planes] = f
            tags[1, n_planes] = HOME
            n_planes += 1
        elif status in (EMPTY, FULL, LOST):
            return status, n_tri, n_planes
    polish(geo, tri, planes, n_tri, 8.0 * slack)
    return CUT, n_tri, n_planes


@inner
def _copy(i, mesh, v, c, batch):  # type: ignore[no-untyped-def]
    """Write a polyhedron that does not move into the buffers; return the numbers of vertices, faces and corners."""
    vertices, vertex_offsets, face_offsets, corners, corner_offsets = mesh
    out_vertices, counts, ids, _, out_corners = batch
    v0, n_v = vertex_offsets[i], vertex_offsets[i + 1] - vertex_offsets[i]
    for k in range(n_v):
        for axis in range(3):
            out_vertices[v + k, axis] = vertices[v0 + k, axis]
    f0, f1 = face_offsets[i], face_offsets[i + 1]
    for f in range(f0, f1):
        counts[f] = corner_offsets[f + 1] - corner_offsets[f]
        ids[f] = f - f0
    c0, n_c = corner_offsets[f0], corner_offsets[f1] - corner_offsets[f0]
    for k in range(n_c):
        out_corners[c + k] = corners[c0 + k]
    return n_v, f1 - f0, n_c


@njit(cache=True, nogil=True)
def _inset(first, last, mesh, normals, moves, starts, batch, spans, status):  # type: ignore[no-untyped-def]
    """Inset the polyhedra from ``first`` to ``last`` with work arrays for the largest of them."""
    vertices, vertex_offsets, face_offsets = mesh[0], mesh[1], mesh[2]
    out_vertices, counts, ids, codes, out_corners = batch
    most = np.int64(0)
    for i in range(first, last):
        most = max(most, face_offsets[i + 1] - face_offsets[i])
    size = 2 * (most + 6) + 4
    work = (
        np.empty((8, size)),
        np.zeros((11, size), dtype=np.int32),
        np.empty((4, size)),
        np.zeros((4, size), dtype=np.int32),
    )
    for i in range(first, last):
        f0, f1 = face_offsets[i], face_offsets[i + 1]
        v, v_end = starts[i, 0], starts[i + 1, 0]
        c, c_end = starts[i, 1], starts[i + 1, 1]
        farthest = 0.0
        for f in range(f0, f1):
            farthest = max(farthest, moves[f])
        if farthest == 0.0:
            spans[i, 0], spans[i, 1], spans[i, 2] = _copy(i, mesh, v, c, batch)
            status[i] = CUT
            continue
        points = vertices[vertex_offsets[i] : vertex_offsets[i + 1]]
        square = 0.0
        for k in range(len(points)):
            square = max(square, points[k, 0] ** 2 + points[k, 1] ** 2 + points[k, 2] ** 2)
        radius = 2.0 * np.sqrt(square)
        wide = 1.0
        n_v = n_f = n_c = np.int64(0)
        code = BROKEN
        while code in (BROKEN, LOST) and wide * SHORTEST <= WIDEST:
            code, n_tri, n_planes = _carve(points, normals[f0:f1], moves[f0:f1], wide * ON_PLANE * radius, radius, work)
            if code == CUT:
                code, n_v, n_f, n_c = emit(
                    work[0], work[1], work[3], n_tri, n_planes, wide * SHORTEST * radius,
                    out_vertices[v:v_end], counts[f0:f1], ids[f0:f1], codes[f0:f1], out_corners[c:c_end],
                )  # fmt: skip
            wide *= 8.0
        for f in range(f0, f0 + n_f):
            if ids[f] < 0:
                code = BROKEN  # a side of the box is left: no faces bound the polyhedron there
        status[i] = code
        if code == CUT:
            spans[i, 0], spans[i, 1], spans[i, 2] = n_v, n_f, n_c


def inset_shapes(polyhedra: Polyhedra, moves: NDArray[np.float64]) -> Insets:
    """Return convex polyhedra with each face moved inward by a distance of its own.

    Parameters
    ----------
    polyhedra : Polyhedra
        Convex, each about a point within; what does not move at all is returned to the bit.
    moves : ndarray, shape (n_faces,)
        Distances [m], zero or more.

    Returns
    -------
    Insets
        Shapes, their faces' old numbers, and where nothing is left. Faces and edges that the others cut off are gone.

    Notes
    -----
    With one distance for all its faces, a body becomes its erosion by a ball of that radius, exactly: what lies as far
    inside all planes that touch the body, and those of its faces are enough [1]_.

    References
    ----------
    .. [1] R. Schneider, "Convex Bodies: The Brunn-Minkowski Theory", 2nd ed. (2014), section 3.1.
    """
    p = polyhedra
    n = len(p)
    n_faces = np.diff(p.face_offsets)
    # A polyhedron of F faces has at most 2 F - 4 vertices and 6 F - 12 corners.
    room = np.stack([np.maximum(2 * n_faces, np.diff(p.vertex_offsets)),
                     np.maximum(6 * n_faces, np.diff(p.face_vertex_offsets[p.face_offsets]))], axis=1)  # fmt: skip
    starts = np.stack([offsets_from_counts(column) for column in room.T], axis=1)
    batch = (
        np.empty((starts[-1, 0], 3)),
        np.empty(p.n_faces, dtype=np.int32),
        np.empty(p.n_faces, dtype=np.int32),
        np.empty(p.n_faces, dtype=np.int8),
        np.empty(starts[-1, 1], dtype=np.int32),
    )
    spans, status = np.zeros((n, 3), dtype=np.int64), np.empty(n, dtype=np.int8)
    mesh = p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets
    moves = np.asarray(moves, np.float64)
    in_blocks(_inset, n, mesh, face_planes(p).normals, moves, starts, batch, spans, status, least=CHUNK)
    vertices, vertex_offsets = _filled(starts[:-1, 0], spans[:, 0])
    faces, face_offsets = _filled(p.face_offsets[:-1], spans[:, 1])
    corners, _ = _filled(starts[:-1, 1], spans[:, 2])
    shapes = Polyhedra(
        batch[0][vertices], vertex_offsets, face_offsets, batch[4][corners], offsets_from_counts(batch[1][faces])
    )
    old = batch[2][faces].astype(np.int64) + np.repeat(p.face_offsets[:-1], spans[:, 1])
    return Insets(shapes, old, (status == EMPTY) | _is_flat(shapes, status == CUT), ~np.isin(status, (CUT, EMPTY)))


def _filled(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the flat indices of rows that begin at ``starts``, and the offsets of the rows without the gaps."""
    offsets = offsets_from_counts(counts)
    return np.arange(offsets[-1]) + np.repeat(starts - offsets[:-1], counts), offsets


def _is_flat(shapes: Polyhedra, is_there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which shapes are thinner than rounding: no ball inside is larger than 3 V / A."""
    measured = integrate(shapes)
    sizes = np.sqrt(measured.areas)
    return is_there & ~(3 * measured.volumes > SHORTEST * sizes * measured.areas)
