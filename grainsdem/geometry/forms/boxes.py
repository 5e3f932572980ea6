"""The smallest box around each grain among those that lie flat on one of its faces, and its like in the plane.

A box along the principal axes of inertia would do for most grains, but those of a cube, or of any grain as symmetric,
are whatever rounding makes them. This box is as well defined as the grain, and is the one a grain is measured by when
it is laid on a face and gripped by calipers.

References
----------
.. [1] J. O'Rourke, "Finding minimal enclosing boxes", Int. J. Computer and Information Sciences 14 (1985) 183-199.
.. [2] H. Freeman and R. Shapira, "Determining the minimum-area encasing rectangle for an arbitrary closed curve",
   Communications of the ACM 18 (1975) 409-413.
.. [3] A. M. Andrew, "Another efficient algorithm for convex hulls in two dimensions", Information Processing Letters 9
   (1979) 216-219.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.threads import in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]


def boxes_on_faces(polyhedra: Polyhedra) -> Floats:
    """Return the edges [m], longest first, of each polyhedron's smallest box with a side on one of its faces.

    Returns
    -------
    ndarray, shape (n, 3)
        NaN where there is no face.
    """
    return np.asarray(-np.sort(-standing_boxes(polyhedra).edges, axis=1))


class Boxes(NamedTuple):
    """A box for each polyhedron.

    Parameters
    ----------
    edges : ndarray, shape (n, 3)
        Lengths [m], in the order of the axes; NaN where there is no face.
    axes : ndarray, shape (n, 3, 3)
        Directions of the edges, one a row: unit vectors at right angles, right-handed or left-handed.
    """

    edges: Floats
    axes: Floats


def standing_boxes(polyhedra: Polyhedra) -> Boxes:
    """Return each polyhedron's smallest box with a side on one of its faces, and how it stands."""
    p = polyhedra
    found = Boxes(np.full((len(p), 3), np.nan), np.full((len(p), 3, 3), np.nan))
    normals = face_planes(p).normals
    in_blocks(_boxes, len(p), p.vertices, p.vertex_offsets, p.face_offsets, normals, *found, least=64)
    return found


def rectangles(points: Floats, offsets: NDArray[np.int64]) -> Floats:
    """Return the edges [m] of the smallest rectangle around each row of points in the plane, and their least width.

    Parameters
    ----------
    points : ndarray, shape (n_points, 2)
        Points [m] of all rows, one after another.
    offsets : ndarray of int64, shape (n + 1,)
        Points of row i are ``points[offsets[i]:offsets[i + 1]]``.

    Returns
    -------
    ndarray, shape (n, 3)
        Longer edge, shorter edge, width across the direction in which it is least; NaN where a row has no points.
    """
    edges = np.full((offsets.size - 1, 3), np.nan)
    in_blocks(_rectangles, len(edges), np.ascontiguousarray(points), offsets, edges)
    edges[:, :2] = -np.sort(-edges[:, :2], axis=1)
    return edges


@inner
def hull_in_plane(points, hull):  # type: ignore[no-untyped-def]
    """Sort the points and fill their convex hull, counter-clockwise; return how many corners it has."""
    n = len(points)
    for i in range(1, n):
        x, y = points[i, 0], points[i, 1]
        j = i - 1
        while j >= 0 and (points[j, 0] > x or (points[j, 0] == x and points[j, 1] > y)):
            points[j + 1, 0], points[j + 1, 1] = points[j, 0], points[j, 1]
            j -= 1
        points[j + 1, 0], points[j + 1, 1] = x, y
    count = 0
    for sweep in range(2):
        start = count + 1
        for step in range(n):
            p = points[step] if sweep == 0 else points[n - 1 - step]
            while count > start and _turn(hull[count - 2], hull[count - 1], p) <= 0.0:
                count -= 1
            hull[count, 0], hull[count, 1] = p[0], p[1]
            count += 1
        count -= 1  # the last point of a sweep is the first of the next
    return count


@njit(cache=True, inline="always")
def _turn(a, b, c):  # type: ignore[no-untyped-def]
    """Twice the signed area of a triangle."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


@inner
def _rectangle(points, hull):  # type: ignore[no-untyped-def]
    """Return the edges of the smallest rectangle around points, their least width, and the direction of the first edge.

    Both the rectangle and the least width are by a side of the hull.
    """
    count = hull_in_plane(points, hull)
    best, length, width, least = np.inf, 0.0, 0.0, np.inf
    along_x, along_y = 1.0, 0.0
    for i in range(count):
        k = i + 1 if i + 1 < count else 0
        ux, uy = hull[k, 0] - hull[i, 0], hull[k, 1] - hull[i, 1]
        norm = np.sqrt(ux * ux + uy * uy)
        if norm == 0.0:
            continue
        ux, uy = ux / norm, uy / norm
        along_low, along_high, across_low, across_high = np.inf, -np.inf, np.inf, -np.inf
        for j in range(count):
            x, y = hull[j, 0], hull[j, 1]
            along, across = ux * x + uy * y, ux * y - uy * x
            along_low, along_high = min(along_low, along), max(along_high, along)
            across_low, across_high = min(across_low, across), max(across_high, across)
        area = (along_high - along_low) * (across_high - across_low)
        if area < best:
            best, length, width = area, along_high - along_low, across_high - across_low
            along_x, along_y = ux, uy
        least = min(least, across_high - across_low)
    return length, width, least, along_x, along_y


@njit(cache=True, nogil=True)
def _rectangles(start, stop, points, offsets, edges):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        n = offsets[i + 1] - offsets[i]
        if n > 0:
            found = _rectangle(points[offsets[i] : offsets[i + 1]].copy(), np.empty((n + 2, 2)))
            edges[i, 0], edges[i, 1], edges[i, 2] = found[0], found[1], found[2]


@njit(cache=True, nogil=True)
def _boxes(start, stop, vertices, vertex_offsets, face_offsets, normals, edges, axes):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        n = vertex_offsets[i + 1] - v0
        shadow = np.empty((n, 2))
        hull = np.empty((n + 2, 2))
        best = np.inf
        for f in range(face_offsets[i], face_offsets[i + 1]):
            nx, ny, nz = normals[f, 0], normals[f, 1], normals[f, 2]
            # Two axes across the normal, from the world axis that it has least of.
            if abs(nx) <= abs(ny) and abs(nx) <= abs(nz):
                ux, uy, uz = 0.0, nz, -ny
            elif abs(ny) <= abs(nz):
                ux, uy, uz = -nz, 0.0, nx
            else:
                ux, uy, uz = ny, -nx, 0.0
            norm = np.sqrt(ux * ux + uy * uy + uz * uz)
            if not norm > 0.0:
                continue
            ux, uy, uz = ux / norm, uy / norm, uz / norm
            wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
            low, high = np.inf, -np.inf
            for k in range(n):
                x, y, z = vertices[v0 + k, 0], vertices[v0 + k, 1], vertices[v0 + k, 2]
                height = nx * x + ny * y + nz * z
                low, high = min(low, height), max(high, height)
                shadow[k, 0] = ux * x + uy * y + uz * z
                shadow[k, 1] = wx * x + wy * y + wz * z
            length, width, _, px, py = _rectangle(shadow, hull)
            if length * width * (high - low) < best:
                best = length * width * (high - low)
                edges[i, 0], edges[i, 1], edges[i, 2] = length, width, high - low
                axes[i, 0, 0], axes[i, 0, 1], axes[i, 0, 2] = px * ux + py * wx, px * uy + py * wy, px * uz + py * wz
                axes[i, 1, 0], axes[i, 1, 1], axes[i, 1, 2] = px * wx - py * ux, px * wy - py * uy, px * wz - py * uz
                axes[i, 2, 0], axes[i, 2, 1], axes[i, 2, 2] = nx, ny, nz
