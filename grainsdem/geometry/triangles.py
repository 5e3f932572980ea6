"""Triangles of the faces of polyhedra: each face a fan from one of its corners."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.threads import in_blocks
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra


class Triangles(NamedTuple):
    """Triangles of all polyhedra in flat arrays.

    Parameters
    ----------
    indices : ndarray of int32, shape (n_triangles, 3)
        Corners, counter-clockwise seen from outside, local to the polyhedron.
    offsets : ndarray of int64, shape (n + 1,)
        Triangles of polyhedron i are ``indices[offsets[i]:offsets[i + 1]]``.
    """

    indices: NDArray[np.int32]
    offsets: NDArray[np.int64]


def triangles(polyhedra: Polyhedra, *, apexes: NDArray[np.int64] | None = None) -> Triangles:
    """Return the faces as triangles, in the order of the faces.

    Parameters
    ----------
    polyhedra : Polyhedra
        Polyhedra with convex faces.
    apexes : ndarray of int64, shape (n_faces,), optional
        Which corner of each face its fan starts from, counted within the face; the first by default.

    Returns
    -------
    Triangles
        A face of k corners gives k - 2 triangles. A closed polyhedron stays closed.
    """
    starts = polyhedra.face_vertex_offsets[:-1]
    counts = np.diff(polyhedra.face_vertex_offsets)
    first = offsets_from_counts(np.maximum(counts - 2, 0))
    indices = np.empty((first[-1], 3), dtype=np.int32)
    apex = np.zeros(counts.size, dtype=np.int64) if apexes is None else np.asarray(apexes, dtype=np.int64)
    in_blocks(_fans, starts.size, polyhedra.face_vertices, starts, counts, apex, first, indices)
    return Triangles(indices, first[polyhedra.face_offsets])


def best_apexes(polyhedra: Polyhedra) -> NDArray[np.int64]:
    """Return, for every face, the corner whose fan has the largest smallest triangle, shape (n_faces,).

    Notes
    -----
    A fan from the end of a row of collinear corners holds a triangle without area; another does not.
    """
    return best_fans(polyhedra)[0]


def best_fans(polyhedra: Polyhedra) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Return the best apex of every face, and which faces have a triangle without area even so, shapes (n_faces,)."""
    p = polyhedra
    apexes, smallest = np.zeros(p.n_faces, dtype=np.int64), np.empty(p.n_faces)
    mesh = p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets
    in_blocks(_best_apexes, len(p), *mesh, apexes, smallest)
    return apexes, smallest == 0.0


class Facets(NamedTuple):
    """Triangles that stand alone, as formats without shared vertices hold them.

    Parameters
    ----------
    corners : ndarray of float32, shape (m, 3, 3)
        Corners [m] of each triangle, counter-clockwise seen from outside.
    normals : ndarray, shape (m, 3)
        Outward unit normals; not a number for a triangle without area.
    offsets : ndarray of int64, shape (n + 1,)
        Triangles of each polyhedron.
    """

    corners: NDArray[np.float32]
    normals: NDArray[np.float64]
    offsets: NDArray[np.int64]


def facets(polyhedra: Polyhedra, apexes: NDArray[np.integer]) -> Facets:
    """Return the triangles of fans from given corners of the faces, in single precision.

    Parameters
    ----------
    polyhedra : Polyhedra
        Polyhedra whose vertices single precision holds exactly.
    apexes : ndarray of int, shape (n_faces,)
        Which corner of each face its fan starts from: see `best_fans`.
    """
    p = polyhedra
    first = offsets_from_counts(np.maximum(np.diff(p.face_vertex_offsets) - 2, 0))
    corners, normals = np.empty((first[-1], 3, 3), dtype=np.float32), np.empty((first[-1], 3))
    in_blocks(
        _facets, len(p), p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets,
        np.asarray(apexes, dtype=np.int64), first, corners, normals,
    )  # fmt: skip
    return Facets(corners, normals, first[p.face_offsets])


@njit(cache=True, nogil=True)
def _fans(start, stop, corners, starts, counts, apexes, first, indices):  # type: ignore[no-untyped-def]
    for f in range(start, stop):
        c0, k, a = starts[f], counts[f], apexes[f]
        for t in range(k - 2):
            row = first[f] + t
            indices[row, 0] = corners[c0 + a]
            indices[row, 1] = corners[c0 + (a + t + 1) % k]
            indices[row, 2] = corners[c0 + (a + t + 2) % k]


@njit(cache=True, nogil=True)
def _best_apexes(start, stop, vertices, vertex_offsets, face_offsets, corners, corner_offsets, result, areas):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        for f in range(face_offsets[i], face_offsets[i + 1]):
            c0 = corner_offsets[f]
            k = corner_offsets[f + 1] - c0
            best = -1.0
            for apex in range(k):
                a = v0 + corners[c0 + apex]
                smallest = np.inf
                for t in range(k - 2):
                    b = v0 + corners[c0 + (apex + t + 1) % k]
                    d = v0 + corners[c0 + (apex + t + 2) % k]
                    ux, uy, uz = (
                        vertices[b, 0] - vertices[a, 0],
                        vertices[b, 1] - vertices[a, 1],
                        vertices[b, 2] - vertices[a, 2],
                    )
                    wx, wy, wz = (
                        vertices[d, 0] - vertices[a, 0],
                        vertices[d, 1] - vertices[a, 1],
                        vertices[d, 2] - vertices[a, 2],
                    )
                    x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
                    smallest = min(smallest, x * x + y * y + z * z)
                # Of corners equal within rounding the first wins: a square's fan must not hang on a bit.
                if best < 0.0 or smallest > best * (1.0 + 1e-9):
                    best = smallest
                    result[f] = apex
            areas[f] = best


@njit(cache=True, nogil=True)
def _facets(start, stop, vertices, vertex_offsets, face_offsets, corners, corner_offsets, apexes, first, out, normals):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        for f in range(face_offsets[i], face_offsets[i + 1]):
            c0 = corner_offsets[f]
            k = corner_offsets[f + 1] - c0
            a = v0 + corners[c0 + apexes[f]]
            for t in range(k - 2):
                row = first[f] + t
                b = v0 + corners[c0 + (apexes[f] + t + 1) % k]
                d = v0 + corners[c0 + (apexes[f] + t + 2) % k]
                for j in range(3):
                    out[row, 0, j] = vertices[a, j]
                    out[row, 1, j] = vertices[b, j]
                    out[row, 2, j] = vertices[d, j]
                ux, uy = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
                uz = vertices[b, 2] - vertices[a, 2]
                wx, wy = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1]
                wz = vertices[d, 2] - vertices[a, 2]
                x, y, z = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
                length = np.sqrt(x * x + y * y + z * z)
                if length > 0.0:
                    normals[row, 0], normals[row, 1], normals[row, 2] = x / length, y / length, z / length
                else:
                    normals[row, 0] = normals[row, 1] = normals[row, 2] = np.nan


def vector_areas(corners: NDArray[np.float64] | NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the outward normal of each triangle, as long as its area [m²], shape (m, 3).

    Parameters
    ----------
    corners : ndarray, shape (m, 3, 3)
        Corners [m] of each triangle, counter-clockwise seen from outside; single precision is multiplied in double.
    """
    result = np.empty((len(corners), 3))
    in_blocks(_vector_areas, len(corners), corners, result)
    return result


@njit(cache=True, nogil=True)
def _vector_areas(start, stop, corners, result):  # type: ignore[no-untyped-def]
    for t in range(start, stop):
        ax, ay, az = np.float64(corners[t, 0, 0]), np.float64(corners[t, 0, 1]), np.float64(corners[t, 0, 2])
        ux, uy, uz = corners[t, 1, 0] - ax, corners[t, 1, 1] - ay, corners[t, 1, 2] - az
        wx, wy, wz = corners[t, 2, 0] - ax, corners[t, 2, 1] - ay, corners[t, 2, 2] - az
        result[t, 0] = 0.5 * (uy * wz - uz * wy)
        result[t, 1] = 0.5 * (uz * wx - ux * wz)
        result[t, 2] = 0.5 * (ux * wy - uy * wx)
