"""Closest points of two convex bodies: Gilbert, Johnson and Keerthi's descent on the Minkowski difference.

Plain compiled functions on vertices, for `separation` to call. The simplex is kept as rows of ``simplex``, shape
(4, 3), with the two vertices that made each row in ``made``, shape (4, 2), and its weight in ``weights``.

References
----------
.. [1] E. G. Gilbert, D. W. Johnson, S. S. Keerthi, "A fast procedure for computing the distance between complex
   objects in three-dimensional space", IEEE J. Robotics and Automation 4 (1988) 193-203.
.. [2] C. Ericson, "Real-time collision detection", Morgan Kaufmann 2005, section 5.1.
"""

from __future__ import annotations

import numpy as np
from numba import njit

SEPARATED = 0
"""The bodies are apart and the closest points are known."""
OVERLAPPING = 1
"""The bodies share a point, or nearly so."""
FAR = 2
"""The bodies are farther apart than the limit; the distance is not known."""


@njit(cache=True)
def _segment(w, i, j, weights, v):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Find the point of a segment nearest to the origin; return its squared distance."""
    dx, dy, dz = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
    square = dx * dx + dy * dy + dz * dz
    t = -(w[i, 0] * dx + w[i, 1] * dy + w[i, 2] * dz)
    t = 0.0 if t <= 0.0 or square == 0.0 else 1.0 if t >= square else t / square
    weights[i] = 1.0 - t
    weights[j] = t
    v[0], v[1], v[2] = w[i, 0] + t * dx, w[i, 1] + t * dy, w[i, 2] + t * dz
    if t == 1.0:
        v[0], v[1], v[2] = w[j, 0], w[j, 1], w[j, 2]
    return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]


@njit(cache=True)
def _triangle(w, i, j, k, weights, v):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Find the point of a triangle nearest to the origin; return its squared distance."""
    ax, ay, az = w[i, 0], w[i, 1], w[i, 2]
    bx, by, bz = w[j, 0] - ax, w[j, 1] - ay, w[j, 2] - az
    cx, cy, cz = w[k, 0] - ax, w[k, 1] - ay, w[k, 2] - az
    d1 = -(bx * ax + by * ay + bz * az)
    d2 = -(cx * ax + cy * ay + cz * az)
    d3 = -(bx * w[j, 0] + by * w[j, 1] + bz * w[j, 2])
    d4 = -(cx * w[j, 0] + cy * w[j, 1] + cz * w[j, 2])
    d5 = -(bx * w[k, 0] + by * w[k, 1] + bz * w[k, 2])
    d6 = -(cx * w[k, 0] + cy * w[k, 1] + cz * w[k, 2])
    weights[i] = weights[j] = weights[k] = 0.0
    nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    square = nx * nx + ny * ny + nz * nz
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if va > 0.0 and vb > 0.0 and vc > 0.0 and square > 0.0:
        # The plane's own normal, not a sum of corners: no digits are lost where the distance is small.
        s = (nx * ax + ny * ay + nz * az) / square
        v[0], v[1], v[2] = s * nx, s * ny, s * nz
        total = va + vb + vc
        weights[i], weights[j], weights[k] = va / total, vb / total, vc / total
        return v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    # On the rim: the nearest of three segments, which no rounding of the region tests can spoil.
    best = np.inf
    p = q = -1
    for e in range(3):
        r, s_ = (i, j) if e == 0 else (j, k) if e == 1 else (i, k)
        distance = _segment(w, r, s_, weights, v)
        if distance < best:
            best, p, q = distance, r, s_
    weights[i] = weights[j] = weights[k] = 0.0
    return _segment(w, p, q, weights, v)


@njit(cache=True)
def _tetrahedron(w, weights, v):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Find the point of a tetrahedron nearest to the origin; return its squared distance, 0 where it is inside."""
    best = np.inf
    chosen = -1
    inside = True
    for f in range(4):
        # Face f leaves out row 3 - f: the last row is the newest, so its own faces come last.
        i, j, k, o = (0, 1, 2, 3) if f == 0 else (0, 1, 3, 2) if f == 1 else (0, 2, 3, 1) if f == 2 else (1, 2, 3, 0)
        ax, ay, az = w[i, 0], w[i, 1], w[i, 2]
        bx, by, bz = w[j, 0] - ax, w[j, 1] - ay, w[j, 2] - az
        cx, cy, cz = w[k, 0] - ax, w[k, 1] - ay, w[k, 2] - az
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        opposite = nx * (w[o, 0] - ax) + ny * (w[o, 1] - ay) + nz * (w[o, 2] - az)
        origin = -(nx * ax + ny * ay + nz * az)
        weights[o] = origin / opposite if opposite != 0.0 else -1.0
        if opposite == 0.0 or origin * opposite < 0.0:
            inside = False
    if inside:
        v[:] = 0.0
        return 0.0
    scratch = weights.copy()
    for f in range(4):
        i, j, k, o = (0, 1, 2, 3) if f == 0 else (0, 1, 3, 2) if f == 1 else (0, 2, 3, 1) if f == 2 else (1, 2, 3, 0)
        if weights[o] <= 0.0:
            distance = _triangle(w, i, j, k, scratch, v)
            if distance < best:
                best, chosen = distance, f
    i, j, k, o = (
        (0, 1, 2, 3) if chosen == 0 else (0, 1, 3, 2) if chosen == 1 else (0, 2, 3, 1) if chosen == 2 else (1, 2, 3, 0)
    )
    weights[o] = 0.0
    return _triangle(w, i, j, k, weights, v)


@njit(cache=True)
def descend(x, a0, a1, b0, b1, offset, limit, simplex, made, weights, v):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Find the vector ``v`` from body a to body b at their closest points.

    ``x`` holds all vertices, ``a0`` to ``a1`` and ``b0`` to ``b1`` those of the two, ``offset`` the vector from the
    frame of a to that of b. Returns the state, the number of rows of the simplex, and the least distance of the two
    along ``v``, which is a lower bound of their distance.
    """
    v[:] = offset
    if v[0] == 0.0 and v[1] == 0.0 and v[2] == 0.0:
        v[0] = 1.0
    n = 0
    square = np.inf
    lower = -np.inf
    last = np.zeros(3)
    for _ in range(100):
        p, q = a0, b0
        high, low = -np.inf, np.inf
        for k in range(a0, a1):
            s = v[0] * x[k, 0] + v[1] * x[k, 1] + v[2] * x[k, 2]
            if s > high:
                high, p = s, k
        for k in range(b0, b1):
            s = v[0] * x[k, 0] + v[1] * x[k, 1] + v[2] * x[k, 2]
            if s < low:
                low, q = s, k
        wx = x[q, 0] + offset[0] - x[p, 0]
        wy = x[q, 1] + offset[1] - x[p, 1]
        wz = x[q, 2] + offset[2] - x[p, 2]
        along = v[0] * wx + v[1] * wy + v[2] * wz
        norm = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
        lower = along / norm
        if lower > limit:
            return FAR, n, lower
        # 1e-14: what is left of the digits of v · w once v · v is taken away.
        done = n > 0 and square - along <= 1e-14 * square
        for r in range(n):
            done = done or (made[r, 0] == p and made[r, 1] == q)
        if done:
            return SEPARATED, n, lower
        last[:] = v
        simplex[n, 0], simplex[n, 1], simplex[n, 2] = wx, wy, wz
        made[n, 0], made[n, 1] = p, q
        if n == 0:
            weights[0] = 1.0
            v[0], v[1], v[2] = wx, wy, wz
            now = wx * wx + wy * wy + wz * wz
        elif n == 1:
            now = _segment(simplex, 0, 1, weights, v)
        elif n == 2:
            now = _triangle(simplex, 0, 1, 2, weights, v)
        else:
            now = _tetrahedron(simplex, weights, v)
        n += 1
        if now <= 0.0:
            return OVERLAPPING, n, lower
        rows = n
        n = 0
        for r in range(rows):
            if weights[r] > 0.0:
                simplex[n] = simplex[r]
                made[n] = made[r]
                weights[n] = weights[r]
                n += 1
        if now >= square:
            # No progress: rounding rules. The caller compares v with the lower bound.
            v[:] = last if lower > 0.0 else v
            return SEPARATED, n, lower
        square = now
    return SEPARATED, n, lower
