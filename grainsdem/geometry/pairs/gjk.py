"""Closest points of two convex bodies: Gilbert, Johnson and Keerthi's descent on the Minkowski difference.

References
----------
.. [1] E. G. Gilbert, D. W. Johnson, S. S. Keerthi, "A fast procedure for computing the distance between complex
   objects in three-dimensional space", IEEE J. Robotics and Automation 4 (1988) 193-203.
.. [2] C. Ericson, "Real-time collision detection", Morgan Kaufmann 2005, section 5.1.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.pairs.bodies import Bodies


SEPARATED = 0
"""The bodies are apart and the closest points are known."""
OVERLAPPING = 1
"""The bodies share a point, or nearly so."""
FAR = 2
"""The bodies are farther apart than the limit; the distance is not known."""

MOST_STEPS = 100
"""Steps until the descent gives up; it takes about six, and what is not proven then is searched in full."""


class Simplex(NamedTuple):
    """The points of the Minkowski difference that the descent stands on: scratch, one for each thread.

    Parameters
    ----------
    points : ndarray, shape (4, 3)
        Points b - a [m].
    makers : ndarray of int64, shape (4, 2)
        The vertices a and b of each.
    weights : ndarray, shape (4,)
        Share of each in the nearest point.
    nearest : ndarray, shape (3,)
        The point nearest to the origin [m]: from body a to body b at their closest points.
    spare : ndarray, shape (4,)
        Weights of a trial.
    """

    points: NDArray[np.float64]
    makers: NDArray[np.int64]
    weights: NDArray[np.float64]
    nearest: NDArray[np.float64]
    spare: NDArray[np.float64]


@inner
def make_simplex() -> Simplex:
    """Return scratch for `descend`."""
    return Simplex(np.empty((4, 3)), np.empty((4, 2), dtype=np.int64), np.empty(4), np.empty(3), np.empty(4))


@inner
def _segment(w: NDArray[np.float64], i: int, j: int, weights: NDArray[np.float64], v: NDArray[np.float64]) -> float:
    """Find the point of a segment nearest to the origin; return its squared distance."""
    dx, dy, dz = w[j, 0] - w[i, 0], w[j, 1] - w[i, 1], w[j, 2] - w[i, 2]
    square = dx * dx + dy * dy + dz * dz
    t = -(w[i, 0] * dx + w[i, 1] * dy + w[i, 2] * dz)
    t = 0.0 if t <= 0.0 or square == 0.0 else 1.0 if t >= square else t / square
    weights[i] = 1.0 - t
    weights[j] = t
    if t == 1.0:
        v[0], v[1], v[2] = w[j, 0], w[j, 1], w[j, 2]
    else:
        v[0], v[1], v[2] = w[i, 0] + t * dx, w[i, 1] + t * dy, w[i, 2] + t * dz
        if t > 0.0:
            # Once more square to the segment: of a point much nearer than the ends are, rounding left a part along it.
            rest = (v[0] * dx + v[1] * dy + v[2] * dz) / square
            v[0], v[1], v[2] = v[0] - rest * dx, v[1] - rest * dy, v[2] - rest * dz
    return float(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@inner
def _triangle(
    w: NDArray[np.float64], i: int, j: int, k: int, weights: NDArray[np.float64], v: NDArray[np.float64]
) -> float:
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
    vc = d1 * d4 - d3 * d2
    vb = d5 * d2 - d1 * d6
    va = d3 * d6 - d5 * d4
    if va > 0.0 and vb > 0.0 and vc > 0.0:
        nx, ny, nz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        square = nx * nx + ny * ny + nz * nz
        if square > 0.0:
            # The plane's own normal, not a sum of corners: no digits are lost where the distance is small.
            s = (nx * ax + ny * ay + nz * az) / square
            v[0], v[1], v[2] = s * nx, s * ny, s * nz
            total = va + vb + vc
            weights[i], weights[j], weights[k] = va / total, vb / total, vc / total
            return float(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    # On the rim: the nearest of three segments, which no rounding of the region tests can spoil.
    best = np.inf
    p = q = i
    for e in range(3):
        r, s_ = (i, j) if e == 0 else (j, k) if e == 1 else (i, k)
        distance = _segment(w, r, s_, weights, v)
        if distance < best:
            best, p, q = distance, r, s_
    weights[i] = weights[j] = weights[k] = 0.0
    return _segment(w, p, q, weights, v)


@inner
def _face(f: int) -> tuple[int, int, int, int]:
    """Return the corners of a tetrahedron's face and the corner opposite."""
    if f == 0:
        return 0, 1, 2, 3
    if f == 1:
        return 0, 1, 3, 2
    if f == 2:
        return 0, 2, 3, 1
    return 1, 2, 3, 0


@inner
def _tetrahedron(
    w: NDArray[np.float64], weights: NDArray[np.float64], v: NDArray[np.float64], spare: NDArray[np.float64]
) -> float:
    """Find the point of a tetrahedron nearest to the origin; return its squared distance, 0 where it is inside."""
    inside = True
    for f in range(4):
        i, j, k, o = _face(f)
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
        v[0] = v[1] = v[2] = 0.0
        return 0.0
    best = np.inf
    chosen: Any = np.int64(0)  # typed, as below
    for f in range(4):
        i, j, k, o = _face(f)
        if weights[o] <= 0.0:
            distance = _triangle(w, i, j, k, spare, v)
            if distance < best:
                best, chosen = distance, f
    i, j, k, o = _face(chosen)
    weights[o] = 0.0
    return _triangle(w, i, j, k, weights, v)


@inner
def _nearest(n: int, simplex: Simplex) -> float:
    """Find the point of the first ``n`` points' hull nearest to the origin; return its squared distance."""
    w, weights, v = simplex.points, simplex.weights, simplex.nearest
    if n == 1:
        weights[0] = 1.0
        v[0], v[1], v[2] = w[0, 0], w[0, 1], w[0, 2]
        return float(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    # Typed: a literal would have numba compile every callee twice.
    first: Any = np.int64(0)
    second: Any = np.int64(1)
    third: Any = np.int64(2)
    if n == 2:
        return _segment(w, first, second, weights, v)
    if n == 3:
        return _triangle(w, first, second, third, weights, v)
    return _tetrahedron(w, weights, v, simplex.spare)


@inner
def _drop_unused(n: int, simplex: Simplex) -> int:
    """Keep the points that carry weight; return their number."""
    kept = 0
    for r in range(n):
        if simplex.weights[r] > 0.0:
            if kept != r:
                for c in range(3):
                    simplex.points[kept, c] = simplex.points[r, c]
                simplex.makers[kept, 0], simplex.makers[kept, 1] = simplex.makers[r, 0], simplex.makers[r, 1]
                simplex.weights[kept] = simplex.weights[r]
            kept += 1
    return kept


@inner
def descend(
    solids: Bodies, a: int, b: int, offset: NDArray[np.float64], limit: float, simplex: Simplex
) -> tuple[int, int, float]:
    """Find the closest points of bodies ``a`` and ``b``, whose frames ``offset`` leads from one to the other.

    Returns the state, the number of points of the simplex, and how far apart the bodies are along its nearest point:
    a lower bound of their distance, which proves it where the two agree.
    """
    x = solids.vertices
    v, w = simplex.nearest, simplex.points
    a0, a1, b0, b1 = (
        solids.vertex_ranges[a, 0],
        solids.vertex_ranges[a, 1],
        solids.vertex_ranges[b, 0],
        solids.vertex_ranges[b, 1],
    )
    tx, ty, tz = offset[0], offset[1], offset[2]
    v[0], v[1], v[2] = tx, ty, tz
    if tx * tx + ty * ty + tz * tz == 0.0:
        v[0] = 1.0
    n = 0
    square = np.inf
    lower = -np.inf
    for _ in range(MOST_STEPS):
        vx, vy, vz = v[0], v[1], v[2]
        p, q = a0, b0
        high, low = -np.inf, np.inf
        for k in range(a0, a1):
            s = vx * x[k, 0] + vy * x[k, 1] + vz * x[k, 2]
            if s > high:
                high, p = s, k
        for k in range(b0, b1):
            s = vx * x[k, 0] + vy * x[k, 1] + vz * x[k, 2]
            if s < low:
                low, q = s, k
        wx, wy, wz = x[q, 0] + tx - x[p, 0], x[q, 1] + ty - x[p, 1], x[q, 2] + tz - x[p, 2]
        along = vx * wx + vy * wy + vz * wz
        lower = along / np.sqrt(vx * vx + vy * vy + vz * vz)
        if lower > limit:
            return FAR, n, lower
        # 1e-14: what is left of the digits of v · w once v · v is taken away.
        done = n > 0 and square - along <= 1e-14 * square
        for r in range(n):
            done = done or (simplex.makers[r, 0] == p and simplex.makers[r, 1] == q)
        if done:
            return SEPARATED, n, lower
        w[n, 0], w[n, 1], w[n, 2] = wx, wy, wz
        simplex.makers[n, 0], simplex.makers[n, 1] = p, q
        first, second, third = simplex.weights[0], simplex.weights[1], simplex.weights[2]
        now = _nearest(n + 1, simplex)
        if now <= 0.0:
            return OVERLAPPING, n + 1, lower
        if now >= square:
            # No progress: rounding rules, and may have put the point anywhere. What stood before stands; the caller
            # compares its distance with the bound.
            simplex.weights[0], simplex.weights[1], simplex.weights[2] = first, second, third
            v[0], v[1], v[2] = vx, vy, vz
            return SEPARATED, n, lower
        n = _drop_unused(n + 1, simplex)
        square = now
    return SEPARATED, n, lower


@inner
def closest_points(
    solids: Bodies, n: int, offset: NDArray[np.float64], simplex: Simplex, on_a: NDArray[np.float64],
    on_b: NDArray[np.float64],
) -> float:  # fmt: skip
    """Fill the points of both bodies that the simplex stands for; return their distance."""
    total = 0.0
    for r in range(n):
        total += simplex.weights[r]
    square = 0.0
    for c in range(3):
        on_a[c] = on_b[c] = 0.0
        for r in range(n):
            share = simplex.weights[r] / total
            on_a[c] += share * solids.vertices[simplex.makers[r, 0], c]
            on_b[c] += share * (solids.vertices[simplex.makers[r, 1], c] + offset[c])
        square += (on_b[c] - on_a[c]) ** 2
    return float(np.sqrt(square))
