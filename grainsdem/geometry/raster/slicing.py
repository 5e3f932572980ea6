"""Polygons in which a plane cuts convex grains, and what of a polygon lies inside a convex outline."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.gate import gated
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.model.given import grains_of
from grainsdem.ragged import offsets_from_counts, take_indices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.raster.copies import Copies
    from grainsdem.model import Packing
    from grainsdem.model.given import Grains

    Floats = NDArray[np.float64]


class Polygons(NamedTuple):
    """Convex polygons in a plane.

    Parameters
    ----------
    points : ndarray, shape (n_points, 2)
        Corners [m] of all polygons, counter-clockwise seen from the normal's tip.
    offsets : ndarray of int64, shape (k + 1,)
        Corners of polygon j are ``points[offsets[j]:offsets[j + 1]]``.
    ids : ndarray of int64, shape (k,)
        The grain that each is cut from.
    shifts : ndarray of int64, shape (k, 3)
        The grain's periodic image, in whole domain lengths.
    """

    points: Floats
    offsets: NDArray[np.int64]
    ids: NDArray[np.int64]
    shifts: NDArray[np.int64]


def cut_polygons(packing: Packing, found: Copies, frame: Floats, distance: float) -> Polygons:
    """Return the polygons in which a plane cuts grains and their images, each whole.

    Parameters
    ----------
    packing : Packing
        Convex grains.
    found : Copies
        Those that are cut.
    frame : ndarray, shape (3, 3)
        Unit vectors u, v, n as rows; n is the plane's normal and u × v = n.
    distance : float
        The plane is n · x = distance [m].

    Notes
    -----
    A vertex in the plane counts as below it, so that of two grains that share a face in the plane one is cut.
    """
    grains = packing.grains
    # The box's nearest and farthest corner: most grains need no look at their vertices.
    reach = 0.5 * (found.upper - found.lower) @ np.abs(frame[2])
    apart = np.abs(0.5 * (found.upper + found.lower) @ frame[2] - distance)
    near = np.flatnonzero(apart <= reach + found.slack)
    ids, centres = found.ids[near], found.centres[near]
    matrices = frame @ to_matrices(packing.quaternions[ids])
    mesh = grains.vertices, grains.vertex_offsets, grains.face_offsets, grains.face_vertices, grains.face_vertex_offsets
    counts = np.zeros(ids.size, dtype=np.int64)
    _count(mesh, ids, centres, matrices, frame, distance, found.slack, counts)
    offsets = offsets_from_counts(counts)
    points = np.empty((offsets[-1], 2))
    _cut(mesh, ids, centres, matrices, frame, distance, found.slack, offsets, points, counts)
    rows = np.flatnonzero(counts)
    indices, _ = take_indices(offsets, rows)
    places = indices - np.repeat(offsets[rows], np.diff(offsets)[rows])
    kept = places < np.repeat(counts[rows], np.diff(offsets)[rows])
    return Polygons(points[indices[kept]], offsets_from_counts(counts[rows]), ids[rows], found.shifts[near[rows]])


@inner
def _sides(mesh, i, centre, matrix, frame, distance, slack):  # type: ignore[no-untyped-def]
    """Return a grain's vertices along u and v about its centre, and above the plane."""
    vertices, vertex_offsets = mesh[0], mesh[1]
    v0 = vertex_offsets[i]
    n = vertex_offsets[i + 1] - v0
    turned = np.empty((n, 3))
    level = distance - (frame[2, 0] * centre[0] + frame[2, 1] * centre[1] + frame[2, 2] * centre[2])
    for k in range(n):
        x, y, z = vertices[v0 + k, 0], vertices[v0 + k, 1], vertices[v0 + k, 2]
        for c in range(3):
            turned[k, c] = matrix[c, 0] * x + matrix[c, 1] * y + matrix[c, 2] * z
        turned[k, 2] -= level
        # A vertex this near lies in the plane: the signs of rounding errors would cut at random.
        if abs(turned[k, 2]) <= slack:
            turned[k, 2] = 0.0
    return turned


@njit(cache=True)
def _count(mesh, ids, centres, matrices, frame, distance, slack, counts):  # type: ignore[no-untyped-def]
    for j in range(ids.size):
        i = ids[j]
        turned = _sides(mesh, i, centres[j], matrices[j], frame, distance, slack)
        for f in range(mesh[2][i], mesh[2][i + 1]):
            c0, c1 = mesh[4][f], mesh[4][f + 1]
            a = mesh[3][c1 - 1]
            for c in range(c0, c1):
                b = mesh[3][c]
                # Each edge is met twice, once upward.
                if turned[a, 2] <= 0.0 and turned[b, 2] > 0.0:
                    counts[j] += 1
                a = b


@njit(cache=True)
def _cut(mesh, ids, centres, matrices, frame, distance, slack, offsets, points, counts):  # type: ignore[no-untyped-def]
    for j in range(ids.size):
        n = offsets[j + 1] - offsets[j]
        counts[j] = 0
        if n < 3:
            continue
        i = ids[j]
        turned = _sides(mesh, i, centres[j], matrices[j], frame, distance, slack)
        corners = np.empty((n, 2))
        filled = 0
        for f in range(mesh[2][i], mesh[2][i + 1]):
            c0, c1 = mesh[4][f], mesh[4][f + 1]
            a = mesh[3][c1 - 1]
            for c in range(c0, c1):
                b = mesh[3][c]
                if turned[a, 2] <= 0.0 and turned[b, 2] > 0.0:
                    t = turned[a, 2] / (turned[a, 2] - turned[b, 2])
                    for k in range(2):
                        corners[filled, k] = turned[a, k] + t * (turned[b, k] - turned[a, k])
                    filled += 1
                a = b
        mx = my = 0.0
        for k in range(n):
            mx += corners[k, 0] / n
            my += corners[k, 1] / n
        angles = np.empty(n)
        order = np.empty(n, dtype=np.int64)
        for k in range(n):
            angles[k] = np.arctan2(corners[k, 1] - my, corners[k, 0] - mx)
            place = k
            while place > 0 and angles[order[place - 1]] > angles[k]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = k
        shift_u = frame[0, 0] * centres[j, 0] + frame[0, 1] * centres[j, 1] + frame[0, 2] * centres[j, 2]
        shift_v = frame[1, 0] * centres[j, 0] + frame[1, 1] * centres[j, 1] + frame[1, 2] * centres[j, 2]
        kept = 0
        start = offsets[j]
        last = order[n - 1]
        for k in range(n):
            # Edges that end in one vertex of the plane give it once each.
            du, dv = corners[order[k], 0] - corners[last, 0], corners[order[k], 1] - corners[last, 1]
            if abs(du) + abs(dv) > 4.0 * slack:
                points[start + kept, 0] = corners[order[k], 0] + shift_u
                points[start + kept, 1] = corners[order[k], 1] + shift_v
                kept += 1
                last = order[k]
        counts[j] = kept if kept >= 3 else 0


def areas_inside(points: Floats, offsets: NDArray[np.int64], outline: Floats) -> Floats:
    """Return the area [m²] of each polygon inside a convex outline, counter-clockwise, shape (k,)."""
    following = np.roll(outline, -1, axis=0) - outline
    normals = np.column_stack([following[:, 1], -following[:, 0]])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    planes = np.column_stack([normals, np.einsum("ij,ij->i", normals, outline)])
    result = np.empty(offsets.size - 1)
    _clip(points, offsets, planes, result)
    return result


@njit(cache=True)
def _clip(points, offsets, planes, areas):  # type: ignore[no-untyped-def]
    for j in range(areas.size):
        corners = points[offsets[j] : offsets[j + 1]].copy()
        for p in range(planes.shape[0]):
            n = corners.shape[0]
            if n == 0:
                break
            out = np.empty((n + 2, 2))
            filled = 0
            a = n - 1
            sa = planes[p, 0] * corners[a, 0] + planes[p, 1] * corners[a, 1] - planes[p, 2]
            for b in range(n):
                sb = planes[p, 0] * corners[b, 0] + planes[p, 1] * corners[b, 1] - planes[p, 2]
                if (sa <= 0.0) != (sb <= 0.0):
                    t = sa / (sa - sb)
                    for k in range(2):
                        out[filled, k] = corners[a, k] + t * (corners[b, k] - corners[a, k])
                    filled += 1
                if sb <= 0.0:
                    out[filled, 0], out[filled, 1] = corners[b, 0], corners[b, 1]
                    filled += 1
                a, sa = b, sb
            corners = out[:filled]
        area = 0.0
        for k in range(1, corners.shape[0] - 1):
            ax, ay = corners[k, 0] - corners[0, 0], corners[k, 1] - corners[0, 1]
            bx, by = corners[k + 1, 0] - corners[0, 0], corners[k + 1, 1] - corners[0, 1]
            area += 0.5 * (ax * by - ay * bx)
        areas[j] = area


@gated
def mean_widths(grains: Grains) -> Floats:
    """Return the mean width [m] of each grain of a packing, or of each polyhedron, over all directions, shape (n,).

    Notes
    -----
    Of a convex polyhedron it is Σ l θ / 4π over the edges, l the length and θ the angle between the normals of the two
    faces beside the edge (Santaló 1976). A cube of edge 1 has 3/2.
    """
    g = grains_of(grains)
    result = np.zeros(len(g))
    mesh = g.vertices, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets
    in_blocks(_widths, len(g), *mesh, result)
    return result


@njit(cache=True, nogil=True)
def _widths(start, stop, vertices, vertex_offsets, face_offsets, corners, corner_offsets, result):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        f0, f1 = face_offsets[i], face_offsets[i + 1]
        c0 = corner_offsets[f0]
        n = corner_offsets[f1] - c0
        ends = np.empty((n, 2), dtype=np.int64)
        face = np.empty(n, dtype=np.int64)
        normals = np.zeros((f1 - f0, 3))
        for f in range(f0, f1):
            s, e = corner_offsets[f], corner_offsets[f + 1]
            a = v0 + corners[s]
            for c in range(s + 1, e - 1):
                b, d = v0 + corners[c], v0 + corners[c + 1]
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
                normals[f - f0, 0] += uy * wz - uz * wy
                normals[f - f0, 1] += uz * wx - ux * wz
                normals[f - f0, 2] += ux * wy - uy * wx
            for c in range(s, e):
                following = c + 1 if c + 1 < e else s
                ends[c - c0, 0], ends[c - c0, 1] = v0 + corners[c], v0 + corners[following]
                face[c - c0] = f - f0
        total = 0.0
        for p in range(n):
            if ends[p, 0] > ends[p, 1]:
                continue
            for q in range(n):
                if ends[q, 0] == ends[p, 1] and ends[q, 1] == ends[p, 0]:
                    ax, ay, az = normals[face[p], 0], normals[face[p], 1], normals[face[p], 2]
                    bx, by, bz = normals[face[q], 0], normals[face[q], 1], normals[face[q], 2]
                    x, y, z = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
                    angle = np.arctan2(np.sqrt(x * x + y * y + z * z), ax * bx + ay * by + az * bz)
                    square = 0.0
                    for k in range(3):
                        square += (vertices[ends[p, 1], k] - vertices[ends[p, 0], k]) ** 2
                    total += np.sqrt(square) * angle
                    break
        result[i] = total / (4.0 * np.pi)
