"""Convex hulls of clouds of points, as polyhedra whose faces are whole polygons.

References
----------
.. [1] C. B. Barber, D. P. Dobkin, H. Huhdanpaa, "The Quickhull algorithm for convex hulls", ACM Trans. Mathematical
   Software 22 (1996) 469-483.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.threads import inner
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray
    from scipy.spatial import ConvexHull

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

FLAT = 1e-10
"""Triangles are of one face where their corners lie within this of its plane, relative to the extent of the points: a
thousand roundings of Qhull's, and a tenth of what validation lets a face be bent by."""


def convex_hull(points: Floats) -> Polyhedra:
    """Return the convex hull of points [m], shape (k, 3), as one polyhedron: see `convex_hulls`."""
    return convex_hulls([points])


def convex_hulls(clouds: Sequence[Floats]) -> Polyhedra:
    """Return the convex hull of each cloud of points.

    Parameters
    ----------
    clouds : sequence of ndarray, shape (k, 3)
        Points [m], at least four that do not lie in one plane.

    Returns
    -------
    Polyhedra
        Their corners, those of a cloud in its order; points on faces and edges are left out. Faces are polygons,
        counter-clockwise seen from outside: triangles in one plane are one face.

    Raises
    ------
    InputError
        If points are not finite, or all in one plane.
    """
    parts = [_hull(np.asarray(cloud, dtype=np.float64)) for cloud in clouds]
    return Polyhedra(
        np.concatenate([points for points, _, _ in parts]) if parts else np.empty((0, 3)),
        offsets_from_counts([len(points) for points, _, _ in parts]),
        offsets_from_counts([len(counts) for _, _, counts in parts]),
        np.concatenate([corners for _, corners, _ in parts]) if parts else np.empty(0, np.int32),
        offsets_from_counts(np.concatenate([counts for _, _, counts in parts]) if parts else []),
    )


class Outline(NamedTuple):
    """The corners of a convex hull, without its faces.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        Corners [m]; some may lie on a face or an edge.
    volume : float
        Volume [m³] of the hull.
    """

    points: Floats
    volume: float


def outline(points: Floats) -> Outline:
    """Return the corners of the convex hull of points [m], shape (k, 3), and its volume; errors as of `convex_hulls`.

    Of a hundred thousand corners faces are no concern.
    """
    _, extent, found = _found(points)
    return Outline(points[np.sort(found.vertices)], float(found.volume) * extent**3)


def _found(points: Floats) -> tuple[Floats, float, ConvexHull]:
    """Return points about their middle in units of their extent, that extent [m], and Qhull's answer to them."""
    from scipy.spatial import ConvexHull, QhullError  # noqa: PLC0415  (half a second)

    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"points must have shape (n, 3); got {points.shape}")
    if not np.isfinite(points).all():
        raise InputError("points of a hull must be finite; some are not")
    lower, upper = points.min(axis=0, initial=np.inf), points.max(axis=0, initial=-np.inf)
    extent = float((upper - lower).max(initial=0.0))
    if len(points) < 4 or not extent > 0:
        raise InputError(f"a hull needs four points that are not in one plane; got {len(points)} points")
    # Qhull's own tolerances grow with the distance from the origin.
    scaled = (points - 0.5 * (lower + upper)) / extent
    try:
        return scaled, extent, ConvexHull(scaled)
    except QhullError as error:
        raise InputError(f"a hull needs points that are not in one plane; these {len(points)} are") from error


def _hull(points: Floats) -> tuple[Floats, Ints, Ints]:
    """Return the corners [m] of a hull, the corners of its faces in turn, and how many each face has."""
    scaled, _, found = _found(points)
    used = np.sort(found.vertices)
    back = np.full(len(points), -1, dtype=np.int32)
    back[used] = np.arange(used.size, dtype=np.int32)
    planes = np.ascontiguousarray(found.equations)
    corners, counts, is_corner = _merge(scaled[used], back[found.simplices], found.neighbors, planes, FLAT)
    if not is_corner.all():
        back = (np.cumsum(is_corner) - 1).astype(np.int32)
        used, corners = used[is_corner], back[corners]
    return points[used], corners, counts


@inner
def _find_planes(points, triangles, beside, planes, flat, plane_of):  # type: ignore[no-untyped-def]
    """Fill the number of the plane that each triangle lies in, and return the first triangle of each plane.

    From the first one goes on to those beside it, as long as their corners lie in its plane.
    """
    m, n = len(triangles), 0
    first, waiting = np.empty(m, dtype=np.int64), np.empty(m, dtype=np.int64)
    plane_of[:] = -1
    for t in range(m):
        if plane_of[t] >= 0:
            continue
        e, first[n], plane_of[t] = planes[t], t, n
        waiting[0], left = t, 1
        while left > 0:
            left -= 1
            at = waiting[left]
            for side in range(3):
                other = beside[at, side]
                # A face behind a sharp edge may be so narrow that its corners lie in this plane.
                if plane_of[other] >= 0 or (
                    e[0] * planes[other, 0] + e[1] * planes[other, 1] + e[2] * planes[other, 2] <= 0.0
                ):
                    continue
                is_in = True
                for c in range(3):
                    p = points[triangles[other, c]]
                    is_in = is_in and abs(e[0] * p[0] + e[1] * p[1] + e[2] * p[2] + e[3]) <= flat
                if is_in:
                    plane_of[other], waiting[left] = n, other
                    left += 1
        n += 1
    return first[:n]


@njit(cache=True)
def _merge(points, triangles, beside, planes, flat):  # type: ignore[no-untyped-def]
    """Return the faces that triangles in one plane make, each around its middle, and which points are corners.

    A corner has three faces or more; a point with two lies on an edge, one with one in a face.
    """
    m, k = len(triangles), len(points)
    plane_of = np.empty(m, dtype=np.int64)
    first = _find_planes(points, triangles, beside, planes, flat, plane_of)
    n = first.size
    order = np.argsort(plane_of, kind="mergesort")
    mark = np.full(k, -1, dtype=np.int64)
    faces = np.empty(3 * m, dtype=np.int32)
    ends = np.zeros(n + 1, dtype=np.int64)
    degree = np.zeros(k, dtype=np.int64)
    angles = np.empty(3 * m)
    total, row = 0, 0
    for g in range(n):
        begin = total
        x = y = z = 0.0
        while row < m and plane_of[order[row]] == g:
            for c in range(3):
                v = triangles[order[row], c]
                if mark[v] != g:
                    mark[v] = g
                    faces[total] = v
                    total += 1
                    degree[v] += 1
                    x, y, z = x + points[v, 0], y + points[v, 1], z + points[v, 2]
            row += 1
        size = total - begin
        x, y, z = x / size, y / size, z / size
        e = planes[first[g]]
        a = faces[begin]
        ux, uy, uz = points[a, 0] - x, points[a, 1] - y, points[a, 2] - z
        wx, wy, wz = e[1] * uz - e[2] * uy, e[2] * ux - e[0] * uz, e[0] * uy - e[1] * ux
        for i in range(begin, total):
            v = faces[i]
            px, py, pz = points[v, 0] - x, points[v, 1] - y, points[v, 2] - z
            angles[i] = np.arctan2(px * wx + py * wy + pz * wz, px * ux + py * uy + pz * uz)
        for i in range(begin + 1, total):
            v, angle, j = faces[i], angles[i], i - 1
            while j >= begin and angles[j] > angle:
                faces[j + 1], angles[j + 1] = faces[j], angles[j]
                j -= 1
            faces[j + 1], angles[j + 1] = v, angle
        ends[g + 1] = total
    corners = np.empty(total, dtype=np.int32)
    counts = np.empty(n, dtype=np.int32)
    kept = 0
    for g in range(n):
        before = kept
        for i in range(ends[g], ends[g + 1]):
            if degree[faces[i]] >= 3:
                corners[kept] = faces[i]
                kept += 1
        counts[g] = kept - before
    return corners[:kept], counts, degree >= 3
