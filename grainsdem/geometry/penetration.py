"""Depth of two overlapping convex bodies: the least over every direction that can attain it.

The shortest way out is along a face normal of either body or along the cross product of an edge of each whose arcs
meet on the Gauss map. A point that both bodies share bounds from below how deep each candidate can be, which leaves
a few faces and edges of the many; the answer is that of the full search.

References
----------
.. [1] D. Gregorius, "The separating axis test between convex polyhedra", Game Developers Conference 2013.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def along(x, a0, a1, b0, b1, t, nx, ny, nz):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return how far body b lies beyond body a along a direction; negative where they overlap along it."""
    high, low = -np.inf, np.inf
    for k in range(a0, a1):
        high = max(high, nx * x[k, 0] + ny * x[k, 1] + nz * x[k, 2])
    for k in range(b0, b1):
        low = min(low, nx * x[k, 0] + ny * x[k, 1] + nz * x[k, 2])
    return low + (nx * t[0] + ny * t[1] + nz * t[2]) - high


@njit(cache=True)
def _try_face(x, a0, a1, b0, b1, t, normals, f, sign, best, n):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Take a face's normal where it separates better than the best so far."""
    nx, ny, nz = sign * normals[f, 0], sign * normals[f, 1], sign * normals[f, 2]
    s = along(x, a0, a1, b0, b1, t, nx, ny, nz)
    if s > best and nx * nx + ny * ny + nz * nz > 0.5:
        n[0], n[1], n[2] = nx, ny, nz
        return s
    return best


@njit(cache=True)
def _room(normals, heights, f, p, ox, oy, oz):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return how deep a point lies under a face's plane."""
    return heights[f] - (normals[f, 0] * (p[0] - ox) + normals[f, 1] * (p[1] - oy) + normals[f, 2] * (p[2] - oz))


@njit(cache=True)
def search_faces(x, a0, a1, b0, b1, t, normals, heights, fa0, fa1, fb0, fb1, pa, pb, best, n):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the largest separation along face normals, where above ``best``; ``pa``, ``pb`` lie in a and in b."""
    # The shallowest face first: it prunes nearly all others.
    first, shallow, sign = -1, np.inf, 1.0
    for f in range(fa0, fa1):
        room = _room(normals, heights, f, pb, 0.0, 0.0, 0.0)
        if room < shallow:
            first, shallow = f, room
    for f in range(fb0, fb1):
        room = _room(normals, heights, f, pa, t[0], t[1], t[2])
        if room < shallow:
            first, shallow, sign = f, room, -1.0
    if first >= 0:
        best = _try_face(x, a0, a1, b0, b1, t, normals, first, sign, best, n)
    for f in range(fa0, fa1):
        if -_room(normals, heights, f, pb, 0.0, 0.0, 0.0) > best:
            best = _try_face(x, a0, a1, b0, b1, t, normals, f, 1.0, best, n)
    for f in range(fb0, fb1):
        if -_room(normals, heights, f, pa, t[0], t[1], t[2]) > best:
            best = _try_face(x, a0, a1, b0, b1, t, normals, f, -1.0, best, n)
    return best


@njit(cache=True)
def search_edges(
    x, t, normals, heights, edges, a, b, edge_offsets, vertex_offsets, face_offsets, pa, pb, best, n, picked
):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the largest separation along cross products of edges, where above ``best``.

    ``edges`` holds, for every edge, its two vertices and the two faces beside it, local to the grain. ``picked``
    receives the two edges whose cross product ``n`` is.
    """
    va, vb = vertex_offsets[a], vertex_offsets[b]
    fa, fb = face_offsets[a], face_offsets[b]
    for e in range(edge_offsets[a], edge_offsets[a + 1]):
        u, w = fa + edges[e, 2], fa + edges[e, 3]
        if min(_room(normals, heights, u, pb, 0.0, 0.0, 0.0), _room(normals, heights, w, pb, 0.0, 0.0, 0.0)) > -best:
            continue
        p = va + edges[e, 0]
        q = va + edges[e, 1]
        dx, dy, dz = x[q, 0] - x[p, 0], x[q, 1] - x[p, 1], x[q, 2] - x[p, 2]
        for g in range(edge_offsets[b], edge_offsets[b + 1]):
            c, d = fb + edges[g, 2], fb + edges[g, 3]
            # The arcs u–w and (−c)–(−d) of the Gauss map must cross.
            c_side = normals[c, 0] * dx + normals[c, 1] * dy + normals[c, 2] * dz
            d_side = normals[d, 0] * dx + normals[d, 1] * dy + normals[d, 2] * dz
            if c_side * d_side >= 0.0:
                continue
            r = vb + edges[g, 0]
            s = vb + edges[g, 1]
            ex, ey, ez = x[s, 0] - x[r, 0], x[s, 1] - x[r, 1], x[s, 2] - x[r, 2]
            u_side = normals[u, 0] * ex + normals[u, 1] * ey + normals[u, 2] * ez
            w_side = normals[w, 0] * ex + normals[w, 1] * ey + normals[w, 2] * ez
            if u_side * w_side >= 0.0 or c_side * w_side >= 0.0:
                continue
            nx, ny, nz = dy * ez - dz * ey, dz * ex - dx * ez, dx * ey - dy * ex
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            lengths = np.sqrt((dx * dx + dy * dy + dz * dz) * (ex * ex + ey * ey + ez * ez))
            # Parallel edges have no cross product of their own; a face normal beside them does as well.
            if norm <= 1e-12 * lengths:
                continue
            nx, ny, nz = nx / norm, ny / norm, nz / norm
            out = nx * (normals[u, 0] + normals[w, 0]) + ny * (normals[u, 1] + normals[w, 1])
            out += nz * (normals[u, 2] + normals[w, 2])
            if out < 0.0:
                nx, ny, nz = -nx, -ny, -nz
            gap = nx * (x[r, 0] + t[0] - x[p, 0]) + ny * (x[r, 1] + t[1] - x[p, 1]) + nz * (x[r, 2] + t[2] - x[p, 2])
            if gap > best:
                best = gap
                n[0], n[1], n[2] = nx, ny, nz
                picked[0], picked[1] = e, g
    return best
