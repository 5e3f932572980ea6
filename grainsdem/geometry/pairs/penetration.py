"""Depth of two overlapping convex bodies: the least over every direction that can attain it.

The shortest way out is along a face normal of either body or along the cross product of an edge of each whose arcs
meet on the Gauss map. A point of each body bounds from below how deep every candidate can be, which leaves a few
faces and edges of the many; the answer is that of the full search.

References
----------
.. [1] D. Gregorius, "The separating axis test between convex polyhedra", Game Developers Conference 2013.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.geometry.pairs.patches import nearest_on_segments
from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.pairs.bodies import Bodies


PROVEN = 2e-15
"""How near, relative to two grains, a bound must come to their distance to prove it: some twenty roundings."""


@inner
def along(solids: Bodies, a: int, b: int, t: NDArray[np.float64], nx: float, ny: float, nz: float) -> float:
    """Return how far body b lies beyond body a along a direction; negative where they overlap along it."""
    x = solids.vertices
    high, low = -np.inf, np.inf
    for k in range(solids.vertex_ranges[a, 0], solids.vertex_ranges[a, 1]):
        high = max(high, nx * x[k, 0] + ny * x[k, 1] + nz * x[k, 2])
    for k in range(solids.vertex_ranges[b, 0], solids.vertex_ranges[b, 1]):
        low = min(low, nx * x[k, 0] + ny * x[k, 1] + nz * x[k, 2])
    return float(low + (nx * t[0] + ny * t[1] + nz * t[2]) - high)


@inner
def _room(solids: Bodies, f: int, px: float, py: float, pz: float) -> float:
    """Return how deep a point lies under a face's plane."""
    n = solids.normals
    return float(solids.heights[f] - (n[f, 0] * px + n[f, 1] * py + n[f, 2] * pz))


@inner
def _try_face(
    solids: Bodies, a: int, b: int, t: NDArray[np.float64], f: int, sign: float, best: float, n: NDArray[np.float64]
) -> float:
    """Take a face's normal where it separates better than the best so far."""
    nx, ny, nz = sign * solids.normals[f, 0], sign * solids.normals[f, 1], sign * solids.normals[f, 2]
    if nx * nx + ny * ny + nz * nz < 0.5:
        return best  # a face without area has no normal
    s = along(solids, a, b, t, nx, ny, nz)
    if s > best:
        n[0], n[1], n[2] = nx, ny, nz
        return s
    return best


@inner
def search_faces(
    solids: Bodies, a: int, b: int, t: NDArray[np.float64], pa: NDArray[np.float64], pb: NDArray[np.float64],
    best: float, n: NDArray[np.float64],
) -> float:  # fmt: skip
    """Return the largest separation along face normals, where above ``best``, and fill its direction ``n``.

    ``pa`` lies in body a and ``pb`` in body b: along a face's normal b reaches at least as deep as ``pb`` lies.
    """
    fa0, fa1, fb0, fb1 = (
        solids.face_ranges[a, 0], solids.face_ranges[a, 1], solids.face_ranges[b, 0], solids.face_ranges[b, 1],
    )  # fmt: skip
    qx, qy, qz = pa[0] - t[0], pa[1] - t[1], pa[2] - t[2]
    # The shallowest face first: it prunes nearly all others.
    # Typed: a literal would have numba compile the callee twice.
    first: Any = np.int64(-1)
    shallow, sign = np.inf, 1.0
    for f in range(fa0, fa1):
        room = _room(solids, f, pb[0], pb[1], pb[2])
        if room < shallow:
            first, shallow = f, room
    for f in range(fb0, fb1):
        room = _room(solids, f, qx, qy, qz)
        if room < shallow:
            first, shallow, sign = f, room, -1.0
    if first >= 0:
        best = _try_face(solids, a, b, t, first, sign, best, n)
    for f in range(fa0, fa1):
        if -_room(solids, f, pb[0], pb[1], pb[2]) > best:
            best = _try_face(solids, a, b, t, f, 1.0, best, n)
    for f in range(fb0, fb1):
        if -_room(solids, f, qx, qy, qz) > best:
            best = _try_face(solids, a, b, t, f, -1.0, best, n)
    return best


@inner
def search_edges(
    solids: Bodies, a: int, b: int, t: NDArray[np.float64], pb: NDArray[np.float64], best: float,
    n: NDArray[np.float64], picked: NDArray[np.int64],
) -> float:  # fmt: skip
    """Return the largest separation along cross products of edges, where above ``best``.

    Fills its direction ``n`` and the two edges ``picked``. ``pb`` lies in body b.
    """
    x, edges, normals = solids.vertices, solids.edges, solids.normals
    va, vb = solids.vertex_ranges[a, 0], solids.vertex_ranges[b, 0]
    fa, fb = solids.face_ranges[a, 0], solids.face_ranges[b, 0]
    for e in range(solids.edge_ranges[a, 0], solids.edge_ranges[a, 1]):
        u, w = fa + edges[e, 2], fa + edges[e, 3]
        # A direction between u and w is at least as deep as the shallower of the two planes above pb; where it
        # separates, pb is above one of them.
        if min(_room(solids, u, pb[0], pb[1], pb[2]), _room(solids, w, pb[0], pb[1], pb[2])) > max(-best, 0.0):
            continue
        p, q = va + edges[e, 0], va + edges[e, 1]
        dx, dy, dz = x[q, 0] - x[p, 0], x[q, 1] - x[p, 1], x[q, 2] - x[p, 2]
        for g in range(solids.edge_ranges[b, 0], solids.edge_ranges[b, 1]):
            c, d = fb + edges[g, 2], fb + edges[g, 3]
            # The arcs u to w and -c to -d of the Gauss map must cross.
            c_side = normals[c, 0] * dx + normals[c, 1] * dy + normals[c, 2] * dz
            d_side = normals[d, 0] * dx + normals[d, 1] * dy + normals[d, 2] * dz
            if c_side * d_side >= 0.0:
                continue
            r, s = vb + edges[g, 0], vb + edges[g, 1]
            ex, ey, ez = x[s, 0] - x[r, 0], x[s, 1] - x[r, 1], x[s, 2] - x[r, 2]
            u_side = normals[u, 0] * ex + normals[u, 1] * ey + normals[u, 2] * ez
            w_side = normals[w, 0] * ex + normals[w, 1] * ey + normals[w, 2] * ez
            if u_side * w_side >= 0.0 or c_side * w_side >= 0.0:
                continue
            nx, ny, nz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            # Parallel edges have no cross product of their own; a face normal beside them does as well.
            if norm <= 1e-12 * np.sqrt((dx * dx + dy * dy + dz * dz) * (ex * ex + ey * ey + ez * ez)):
                continue
            out = nx * (normals[u, 0] + normals[w, 0]) + ny * (normals[u, 1] + normals[w, 1])
            out += nz * (normals[u, 2] + normals[w, 2])
            norm = norm if out >= 0.0 else -norm
            nx, ny, nz = nx / norm, ny / norm, nz / norm
            gap = nx * (x[r, 0] + t[0] - x[p, 0]) + ny * (x[r, 1] + t[1] - x[p, 1]) + nz * (x[r, 2] + t[2] - x[p, 2])
            if gap > best:
                best = gap
                n[0], n[1], n[2] = nx, ny, nz
                picked[0], picked[1] = e, g
    return best


@inner
def solve_near(
    solids: Bodies, a: int, b: int, t: NDArray[np.float64], pa: NDArray[np.float64], pb: NDArray[np.float64],
    apart: float, n: NDArray[np.float64], picked: NDArray[np.int64], segments: NDArray[np.float64],
) -> float:  # fmt: skip
    """Return the signed gap of bodies that touch, overlap or nearly do; fill its normal and the deepest points."""
    size = solids.radii[a] + solids.radii[b]
    norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    best = -np.inf
    picked[0] = picked[1] = -1
    if norm > 0.0:
        n[0], n[1], n[2] = n[0] / norm, n[1] / norm, n[2] / norm
        best = along(solids, a, b, t, n[0], n[1], n[2])
    if best < apart - PROVEN * size:
        # The head start lets a direction that is no better than rounding lose to the face normal that it is near.
        head = best - 1e-13 * size
        found = search_faces(solids, a, b, t, pa, pb, head, n)
        best = found if found > head else best
    if best < -1e-13 * size or best < apart - PROVEN * size:
        # Apart too: rounding spoils a direction between points that nearly meet, and none that is square to two edges.
        best = search_edges(solids, a, b, t, pb, best, n, picked)
    if picked[0] >= 0:
        x, va, vb = solids.vertices, solids.vertex_ranges[a, 0], solids.vertex_ranges[b, 0]
        for c in range(3):
            for end in range(2):
                segments[end, c] = x[va + solids.edges[picked[0], end], c]
                segments[2 + end, c] = x[vb + solids.edges[picked[1], end], c] + t[c]
        nearest_on_segments(segments[0], segments[1], segments[2], segments[3], pa, pb)
    elif best < 0.0:
        _find_deepest(solids, a, b, t, best, n, pa, pb)
    return best


@inner
def _find_deepest(
    solids: Bodies,
    a: int,
    b: int,
    t: NDArray[np.float64],
    gap: float,
    n: NDArray[np.float64],
    pa: NDArray[np.float64],
    pb: NDArray[np.float64],
) -> None:
    """Fill the deepest points of bodies whose shortest way out is along a face normal of one of them."""
    x, normals = solids.vertices, solids.normals
    of_a = False
    for f in range(solids.face_ranges[a, 0], solids.face_ranges[a, 1]):
        of_a = of_a or (normals[f, 0] == n[0] and normals[f, 1] == n[1] and normals[f, 2] == n[2])
    other, sign = (b, -1.0) if of_a else (a, 1.0)
    high = -np.inf
    for k in range(solids.vertex_ranges[other, 0], solids.vertex_ranges[other, 1]):
        s = sign * (n[0] * x[k, 0] + n[1] * x[k, 1] + n[2] * x[k, 2])
        if s > high:
            high = s
            for c in range(3):
                if of_a:
                    pb[c] = x[k, c] + t[c]
                    pa[c] = pb[c] - gap * n[c]
                else:
                    pa[c] = x[k, c]
                    pb[c] = pa[c] + gap * n[c]
