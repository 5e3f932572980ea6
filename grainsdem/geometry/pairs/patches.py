"""What touches what: the corner, edge or face of each body that meets the other, and the area that they share."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.pairs.bodies import Bodies

    Floats = NDArray[np.float64]

VERTEX, EDGE, FACE = 0, 1, 2
"""Kinds of what a grain touches with, by dimension."""

PARALLEL = 1e-3
"""Angle [rad] below which a face or an edge lies flat in a contact: across a grain of diameter d its ends then differ
by less than 1e-3 d, the depth that soft contacts are allowed."""


class Patch(NamedTuple):
    """Two polygons and the plane that they are laid into: scratch, one for each thread.

    Parameters
    ----------
    polygon_a, polygon_b : ndarray of int64, shape (room,)
        Vertices that the two bodies touch with.
    flat_a, flat_b, spare : ndarray, shape (room, 2)
        The polygons in the plane [m], and one more for cutting.
    across, up : ndarray, shape (3,)
        Axes of the plane.
    centre : ndarray, shape (2,)
        Centre of what the two share, in the plane [m].
    """

    polygon_a: NDArray[np.int64]
    polygon_b: NDArray[np.int64]
    flat_a: Floats
    flat_b: Floats
    spare: Floats
    across: Floats
    up: Floats
    centre: Floats


@inner
def make_patch(room: int) -> Patch:
    """Return scratch for polygons of up to ``room`` corners."""
    return Patch(
        np.empty(room, dtype=np.int64),
        np.empty(room, dtype=np.int64),
        np.empty((room, 2)),
        np.empty((room, 2)),
        np.empty((room, 2)),
        np.empty(3),
        np.empty(3),
        np.empty(2),
    )


@inner
def take_face(solids: Bodies, a: int, face: int, polygon: NDArray[np.int64]) -> int:
    """Fill the corners of a face of body ``a``; return their number."""
    start = solids.corner_offsets[face]
    count = solids.corner_offsets[face + 1] - start
    for c in range(count):
        polygon[c] = solids.vertex_ranges[a, 0] + solids.corners[start + c]
    return int(count)


@inner
def find_facing(solids: Bodies, a: int, b: int, t: Floats, n: Floats) -> tuple[int, int]:
    """Fill the normal of the face of ``a`` that looks most towards ``b``; return it and the face of ``b`` facing it.

    The second is -1 where none is parallel to the first.
    """
    normals = solids.normals
    face, other = -1, -1
    best, least = -np.inf, np.inf
    for f in range(solids.face_ranges[a, 0], solids.face_ranges[a, 1]):
        s = normals[f, 0] * t[0] + normals[f, 1] * t[1] + normals[f, 2] * t[2]
        if s > best:
            best, face = s, f
    if face < 0:
        return face, other
    n[0], n[1], n[2] = normals[face, 0], normals[face, 1], normals[face, 2]
    for f in range(solids.face_ranges[b, 0], solids.face_ranges[b, 1]):
        s = n[0] * normals[f, 0] + n[1] * normals[f, 1] + n[2] * normals[f, 2]
        if s < least:
            least, other = s, f
    if least > -0.5:
        return face, -1
    x = n[1] * normals[other, 2] - n[2] * normals[other, 1]
    y = n[2] * normals[other, 0] - n[0] * normals[other, 2]
    z = n[0] * normals[other, 1] - n[1] * normals[other, 0]
    # Tilted by less than this, the two planes are as far apart as their grains to within 1e-11 of a grain.
    return face, other if x * x + y * y + z * z <= 1e-22 else -1


@inner
def share_patch(solids: Bodies, count_a: int, count_b: int, t: Floats, n: Floats, patch: Patch) -> tuple[int, float]:
    """Cut one of the two polygons by the other, seen along ``n``; return the corners left and their area."""
    u, w = patch.across, patch.up
    _basis(n, u, w)
    _project(solids, patch.polygon_a, count_a, u, w, patch.flat_a)
    _project(solids, patch.polygon_b, count_b, u, w, patch.flat_b)
    x = u[0] * t[0] + u[1] * t[1] + u[2] * t[2]
    y = w[0] * t[0] + w[1] * t[1] + w[2] * t[2]
    for c in range(count_b):
        patch.flat_b[c, 0] += x
        patch.flat_b[c, 1] += y
    # Seen from the tip of n, faces of a run counter-clockwise and those of b clockwise.
    if count_a >= 3:
        shared = _clip(patch.flat_b, count_b, patch.flat_a, count_a, 1.0, patch.spare)
        return shared, _area_and_centre(patch.flat_b, shared, patch.centre)
    shared = _clip(patch.flat_a, count_a, patch.flat_b, count_b, -1.0, patch.spare)
    return shared, _area_and_centre(patch.flat_a, shared, patch.centre)


@inner
def find_feature(solids: Bodies, a: int, nx: float, ny: float, nz: float, polygon: NDArray[np.int64]) -> int:
    """Fill the corners of what body ``a`` touches with in a direction; return their number."""
    x, edges = solids.vertices, solids.edges
    v0, v1 = solids.vertex_ranges[a, 0], solids.vertex_ranges[a, 1]
    face: Any = np.int64(-1)  # typed: a literal would have numba compile the callee twice
    widest = 0.0
    for f in range(solids.face_ranges[a, 0], solids.face_ranges[a, 1]):
        c = nx * solids.normals[f, 0] + ny * solids.normals[f, 1] + nz * solids.normals[f, 2]
        # 1 - cos θ = θ²/2; the largest face, as slivers may lie beside the one that carries the contact.
        if c >= 1.0 - 0.5 * PARALLEL * PARALLEL and solids.areas[f] > widest:
            widest, face = solids.areas[f], f
    if face >= 0:
        return take_face(solids, a, face, polygon)
    top, high = v0, -np.inf
    for k in range(v0, v1):
        s = nx * x[k, 0] + ny * x[k, 1] + nz * x[k, 2]
        if s > high:
            high, top = s, k
    polygon[0] = top
    longest = 0.0
    for e in range(solids.edge_ranges[a, 0], solids.edge_ranges[a, 1]):
        p, q = v0 + edges[e, 0], v0 + edges[e, 1]
        at_p = nx * x[p, 0] + ny * x[p, 1] + nz * x[p, 2]
        at_q = nx * x[q, 0] + ny * x[q, 1] + nz * x[q, 2]
        length = np.sqrt((x[q, 0] - x[p, 0]) ** 2 + (x[q, 1] - x[p, 1]) ** 2 + (x[q, 2] - x[p, 2]) ** 2)
        if high - min(at_p, at_q) <= PARALLEL * length and length > longest:
            longest = length
            polygon[0], polygon[1] = p, q
    return 2 if longest > 0.0 else 1


@inner
def _basis(n: Floats, u: Floats, w: Floats) -> None:
    """Fill two unit vectors such that (u, w, n) is right-handed."""
    if abs(n[0]) <= abs(n[1]) and abs(n[0]) <= abs(n[2]):
        u[0], u[1], u[2] = 0.0, n[2], -n[1]
    elif abs(n[1]) <= abs(n[2]):
        u[0], u[1], u[2] = -n[2], 0.0, n[0]
    else:
        u[0], u[1], u[2] = n[1], -n[0], 0.0
    norm = np.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
    u[0], u[1], u[2] = u[0] / norm, u[1] / norm, u[2] / norm
    w[0] = n[1] * u[2] - n[2] * u[1]
    w[1] = n[2] * u[0] - n[0] * u[2]
    w[2] = n[0] * u[1] - n[1] * u[0]


@inner
def _project(solids: Bodies, polygon: NDArray[np.int64], count: int, u: Floats, w: Floats, flat: Floats) -> None:
    """Lay a polygon into the plane of (u, w)."""
    x = solids.vertices
    for c in range(count):
        k = polygon[c]
        px, py, pz = x[k, 0], x[k, 1], x[k, 2]
        flat[c, 0] = u[0] * px + u[1] * py + u[2] * pz
        flat[c, 1] = w[0] * px + w[1] * py + w[2] * pz


@inner
def _clip(subject: Floats, n_subject: int, window: Floats, n_window: int, turn: float, spare: Floats) -> int:
    """Cut a polygon, segment or point by a convex polygon (Sutherland and Hodgman); return its number of corners.

    ``turn`` is 1 where the window runs counter-clockwise, else −1. The result lies in ``subject``.
    """
    count = n_subject
    for e in range(n_window):
        a, b = e, e + 1 if e + 1 < n_window else 0
        ax, ay = window[a, 0], window[a, 1]
        ex, ey = turn * (window[b, 0] - ax), turn * (window[b, 1] - ay)
        outside = 0
        for c in range(count):
            if ex * (subject[c, 1] - ay) < ey * (subject[c, 0] - ax):
                outside += 1
        if outside == 0:
            continue  # most edges cut nothing
        if outside == count:
            return 0
        kept = 0
        here = ex * (subject[0, 1] - ay) - ey * (subject[0, 0] - ax)
        for c in range(count):
            d = c + 1 if c + 1 < count else 0
            there = ex * (subject[d, 1] - ay) - ey * (subject[d, 0] - ax)
            if here >= 0.0:
                spare[kept, 0], spare[kept, 1] = subject[c, 0], subject[c, 1]
                kept += 1
            if (here > 0.0 and there < 0.0) or (here < 0.0 and there > 0.0):
                s = here / (here - there)
                spare[kept, 0] = subject[c, 0] + s * (subject[d, 0] - subject[c, 0])
                spare[kept, 1] = subject[c, 1] + s * (subject[d, 1] - subject[c, 1])
                kept += 1
            here = there
        count = kept
        for c in range(count):
            subject[c, 0], subject[c, 1] = spare[c, 0], spare[c, 1]
        if count == 0:
            return 0
    return count


@inner
def _area_and_centre(polygon: Floats, count: int, centre: Floats) -> float:
    """Return the area of a flat polygon and fill its centroid; its middle where it has no area."""
    if count == 0:
        return 0.0
    area = mx = my = 0.0
    for c in range(1, count - 1):
        ax, ay = polygon[c, 0] - polygon[0, 0], polygon[c, 1] - polygon[0, 1]
        bx, by = polygon[c + 1, 0] - polygon[0, 0], polygon[c + 1, 1] - polygon[0, 1]
        part = 0.5 * (ax * by - ay * bx)
        area += part
        mx += part * (ax + bx) / 3.0
        my += part * (ay + by) / 3.0
    size = 0.0
    for c in range(count):
        size = max(size, abs(polygon[c, 0] - polygon[0, 0]), abs(polygon[c, 1] - polygon[0, 1]))
    # A segment cut by a window comes back as a polygon whose area is rounding alone.
    if abs(area) > 1e-14 * size * size:
        centre[0], centre[1] = polygon[0, 0] + mx / area, polygon[0, 1] + my / area
        return abs(area)
    # Its corners lie on a line, some more than once: midway between the outermost.
    for k in range(2):
        low = high = polygon[0, k]
        for c in range(count):
            low, high = min(low, polygon[c, k]), max(high, polygon[c, k])
        centre[k] = 0.5 * (low + high)
    return 0.0


@inner
def nearest_on_segments(p: Floats, q: Floats, r: Floats, s: Floats, on_first: Floats, on_second: Floats) -> None:
    """Fill the closest points of the segments p–q and r–s."""
    a = e = f = b = c = 0.0
    for k in range(3):
        a += (q[k] - p[k]) * (q[k] - p[k])
        e += (s[k] - r[k]) * (s[k] - r[k])
        f += (s[k] - r[k]) * (p[k] - r[k])
        c += (q[k] - p[k]) * (p[k] - r[k])
        b += (q[k] - p[k]) * (s[k] - r[k])
    across = a * e - b * b
    u = min(max((b * f - c * e) / across, 0.0), 1.0) if across > 1e-14 * a * e else 0.5
    w = (b * u + f) / e if e > 0.0 else 0.0
    if w < 0.0 or w > 1.0 or e == 0.0:
        w = min(max(w, 0.0), 1.0)
        u = min(max((b * w - c) / a, 0.0), 1.0) if a > 0.0 else 0.0
    for k in range(3):
        on_first[k] = p[k] + u * (q[k] - p[k])
        on_second[k] = r[k] + w * (s[k] - r[k])
