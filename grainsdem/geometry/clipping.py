"""Exact volume of convex grains inside half-spaces: a box, a wall, a slice."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.threads import in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

ROUNDING = 64 * np.finfo(np.float64).eps
"""Error of a vertex's distance to a plane, relative to the lengths that the distance is computed from."""


def box_planes(lower: ArrayLike, upper: ArrayLike) -> NDArray[np.float64]:
    """Return the six half-spaces n · x <= d that make a box.

    Parameters
    ----------
    lower, upper : array_like, shape (3,)
        Opposite corners [m].

    Returns
    -------
    ndarray, shape (6, 4)
        Rows (n_x, n_y, n_z, d), n the outward unit normal, d [m]; lower faces first.

    Raises
    ------
    ShapeError
        If a corner is not three numbers.
    InputError
        If the upper corner does not lie above the lower one along every axis, or one is not finite.
    """
    corners = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if corners[0].shape != (3,) or corners[1].shape != (3,):
        raise ShapeError(f"corners must have shape (3,); got {corners[0].shape} and {corners[1].shape}")
    if not (np.isfinite(corners).all() and (corners[1] > corners[0]).all()):
        raise InputError(
            f"a box's upper corner must lie above its lower corner along every axis, both finite; "
            f"got {corners[0].tolist()} and {corners[1].tolist()}"
        )
    eye = np.eye(3)
    return np.vstack([np.column_stack([-eye, -corners[0]]), np.column_stack([eye, corners[1]])])


@inner
def _gather(i, rotation, mesh):  # type: ignore[no-untyped-def]
    """Return the turned corner points of one polyhedron, face after face, and the start of each face."""
    vertices, vertex_offsets, face_offsets, corners, corner_offsets = mesh
    f0, f1 = face_offsets[i], face_offsets[i + 1]
    c0, v0 = corner_offsets[f0], vertex_offsets[i]
    points = np.empty((corner_offsets[f1] - c0, 3))
    starts = np.empty(f1 - f0 + 1, dtype=np.int64)
    for f in range(f0, f1 + 1):
        starts[f - f0] = corner_offsets[f] - c0
    for c in range(points.shape[0]):
        v = v0 + corners[c0 + c]
        for k in range(3):
            points[c, k] = (
                rotation[k, 0] * vertices[v, 0] + rotation[k, 1] * vertices[v, 1] + rotation[k, 2] * vertices[v, 2]
            )
    return points, starts


@inner
def _cut(points, starts, plane, slack):  # type: ignore[no-untyped-def]
    """Return the part of a convex polyhedron at n · x <= d, in the same layout, closed by a cap."""
    nx, ny, nz, d = plane
    n_faces, n = starts.size - 1, points.shape[0]
    # An edge of a face gives at most two points to the cut face and one to the cap.
    out = np.empty((3 * n, 3))
    out_starts = np.zeros(n_faces + 2, dtype=np.int64)
    cap = np.empty((n, 3))
    filled = n_cap = 0
    for f in range(n_faces):
        a = starts[f + 1] - 1
        sa = nx * points[a, 0] + ny * points[a, 1] + nz * points[a, 2] - d
        if abs(sa) <= slack:
            sa = 0.0
        for b in range(starts[f], starts[f + 1]):
            sb = nx * points[b, 0] + ny * points[b, 1] + nz * points[b, 2] - d
            if abs(sb) <= slack:
                sb = 0.0
            if (sa <= 0.0) != (sb <= 0.0):
                t = sa / (sa - sb)
                for k in range(3):
                    out[filled, k] = cap[n_cap, k] = points[a, k] + t * (points[b, k] - points[a, k])
                filled += 1
                n_cap += 1
            if sb <= 0.0:
                for k in range(3):
                    out[filled, k] = points[b, k]
                filled += 1
            a, sa = b, sb
        out_starts[f + 1] = filled
    if n_cap >= 3:
        # The cap is convex: its corners in order of the angle about their mean, seen against the normal.
        # Each edge of the polyhedron gives its crossing twice; the copies follow one another and span no
        # area.
        ux, uy, uz = (0.0, nz, -ny) if abs(nx) < 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz) else (-nz, 0.0, nx)
        wx, wy, wz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
        norm_u = np.sqrt(ux * ux + uy * uy + uz * uz)
        norm_w = np.sqrt(wx * wx + wy * wy + wz * wz)
        mx = my = mz = 0.0
        for k in range(n_cap):
            mx += cap[k, 0] / n_cap
            my += cap[k, 1] / n_cap
            mz += cap[k, 2] / n_cap
        angles = np.empty(n_cap)
        order = np.empty(n_cap, dtype=np.int64)
        for k in range(n_cap):
            x, y, z = cap[k, 0] - mx, cap[k, 1] - my, cap[k, 2] - mz
            angles[k] = np.arctan2((x * wx + y * wy + z * wz) / norm_w, (x * ux + y * uy + z * uz) / norm_u)
            # A few corners: sorted as they come, where numba's own sort would take long to compile.
            place = k
            while place > 0 and angles[order[place - 1]] > angles[k]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = k
        for k in range(n_cap):
            for c in range(3):
                out[filled, c] = cap[order[k], c]
            filled += 1
    out_starts[n_faces + 1] = filled
    return out[:filled], out_starts


@inner
def _volume(points, starts):  # type: ignore[no-untyped-def]
    """Return the volume of a closed polyhedron given by the corner points of its faces."""
    volume6 = 0.0
    for f in range(starts.size - 1):
        a = starts[f]
        for b in range(a + 1, starts[f + 1] - 1):
            p, q, r = points[a], points[b], points[b + 1]
            volume6 += (
                p[0] * (q[1] * r[2] - q[2] * r[1])
                + p[1] * (q[2] * r[0] - q[0] * r[2])
                + p[2] * (q[0] * r[1] - q[1] * r[0])
            )
    return volume6 / 6.0


@njit(cache=True, nogil=True)
def _clipped(start, stop, mesh, rotations, positions, planes, volumes):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        points, starts = _gather(i, rotations[i], mesh)
        empty = points.shape[0] == 0
        for j in range(planes.shape[0]):
            if empty:
                break
            nx, ny, nz = planes[j, 0], planes[j, 1], planes[j, 2]
            # About the grain's own origin, so that a grain far from the world's loses no digits.
            px, py, pz = nx * positions[i, 0], ny * positions[i, 1], nz * positions[i, 2]
            d = planes[j, 3] - (px + py + pz)
            # A vertex this near lies in the plane: the signs of rounding errors would cut a face at random.
            slack = ROUNDING * (abs(px) + abs(py) + abs(pz) + abs(planes[j, 3]))
            least, most = np.inf, -np.inf
            for c in range(points.shape[0]):
                s = nx * points[c, 0] + ny * points[c, 1] + nz * points[c, 2] - d
                least, most = min(least, s), max(most, s)
            slack += ROUNDING * (most - least)
            if least >= -slack:
                empty = True
            elif most > slack:
                points, starts = _cut(points, starts, (nx, ny, nz, d), slack)
        volumes[i] = 0.0 if empty else _volume(points, starts)


def clipped_volumes(packing: Packing, planes: ArrayLike) -> NDArray[np.float64]:
    """Return the volume of each grain inside all of the given half-spaces.

    Parameters
    ----------
    packing : Packing
        Convex grains in the world. Periodic images are not looked at.
    planes : array_like, shape (k, 4)
        Half-spaces n · x <= d as rows (n_x, n_y, n_z, d) in world coordinates; n of any length but zero.
        No plane at all leaves every grain whole.

    Returns
    -------
    ndarray, shape (n,)
        Volumes [m³]; a grain wholly inside keeps its own, one wholly outside has zero.

    Raises
    ------
    ShapeError
        If ``planes`` is not of shape (k, 4).
    InputError
        If a plane is not finite or has no normal.

    Notes
    -----
    Each face polygon is clipped by one plane after another (Sutherland and Hodgman 1974) and the cut is
    closed by a convex cap, so the result is exact to rounding.
    """
    half_spaces = np.ascontiguousarray(planes, dtype=np.float64)
    if half_spaces.ndim != 2 or half_spaces.shape[1] != 4:
        raise ShapeError(f"planes must have shape (k, 4); got {half_spaces.shape}")
    bad = np.flatnonzero(~np.isfinite(half_spaces).all(axis=1) | (half_spaces[:, :3] == 0).all(axis=1))
    if bad.size:
        raise InputError(f"planes must be finite with a normal; plane {bad[0]} is {half_spaces[bad[0]].tolist()}")
    result = np.empty(len(packing))
    g = packing.grains
    mesh = g.vertices, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets
    in_blocks(_clipped, len(packing), mesh, to_matrices(packing.quaternions), packing.positions, half_spaces, result)
    return result


def solid_volume(packing: Packing, planes: NDArray[np.float64]) -> float:
    """Return the volume [m³] of all grains, periodic images included, inside half-spaces within the domain."""
    domain = packing.domain
    solid = 0.0
    for image in product(*((-1, 0, 1) if wraps else (0,) for wraps in domain.periodic)):
        moved = planes.copy()
        moved[:, 3] += planes[:, :3] @ (np.array(image) * domain.lengths)
        solid += float(clipped_volumes(packing, moved).sum())
    return solid
