"""One cell from its neighbours: the seeds are tried in growing balls until none farther out can reach it.

A seed j at r from the site cuts the cell by the plane r · x = (|r|² + w − w_j) / 2. It can do so only if it is nearer, in
the power distance, to one of the cell's vertices than the site is; the same holds for a box of seeds and their
largest weight.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from grainsdem.tessellation.clipping import CUT, UNTOUCHED, cut, start_box

GROWTH = 1.55
"""Ratio of the radii of successive balls."""

FIRST_BALL = 0.32
"""Radius of the first ball, relative to the diagonal of the box of some 12 seeds around the site."""


@njit(cache=True)
def _reaches(geo, n_tri, x, y, z, box, weight):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return whether a seed in ``box`` could be nearer to a vertex of the cell than the site at (x, y, z) is."""
    lx, ly, lz = box[0] - x, box[1] - y, box[2] - z
    hx, hy, hz = box[3] - x, box[4] - y, box[5] - z
    gain = box[6] - weight
    hits = 0
    for t in range(n_tri):
        vx, vy, vz = geo[0, t], geo[1, t], geo[2, t]
        dx = max(lx - vx, vx - hx, 0.0)
        dy = max(ly - vy, vy - hy, 0.0)
        dz = max(lz - vz, vz - hz, 0.0)
        hits += dx * dx + dy * dy + dz * dz < geo[3, t] + gain
    return hits > 0


@njit(cache=True)
def _farthest(geo, n_tri):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return the largest squared distance of a vertex from the site."""
    result = 0.0
    for t in range(n_tri):
        result = max(result, geo[3, t])
    return result


@njit(cache=True)
def _first_radius(boxes, depth, place, n):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return a radius that a few seeds are expected in."""
    level = max(depth - 1, 0)
    node = (((place + 1) << level) - 1) // n + (1 << level)
    # A box of one seed, or of equal seeds, has no size; its parents do.
    while node >= 1:
        d = 0.0
        for axis in range(3):
            d += (boxes[node, 3 + axis] - boxes[node, axis]) ** 2
        if d > 0.0:
            return FIRST_BALL * d**0.5
        node >>= 1
    return 1.0


@njit(cache=True)
def grow(place, tree, frame, banned, work):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Build the cell of the seed at ``place`` of the tree in the work arrays; return status, triangles and planes.

    ``frame`` is (lengths, periodic, walls, slack): the box runs from 0 to ``lengths``, ``walls``, shape (k, 4), are the
    planes n · x <= d that cut it further, ``slack`` is the distance within which a vertex counts as on a plane.
    ``banned`` are neighbours not to be had: 27 · seed + code of the image.
    """
    order, points, weights, boxes, depth = tree
    lengths, periodic, walls, slack = frame
    geo, tri, planes, tags, stack = work
    n = len(points)
    x, y, z = points[place, 0], points[place, 1], points[place, 2]
    weight = weights[place]
    gain = boxes[1, 6] - weight
    low = np.empty(3)
    high = np.empty(3)
    for axis in range(3):
        if periodic[axis]:
            # The site's own images bound its cell, whatever the weights.
            high[axis] = 0.5 * lengths[axis]
            low[axis] = -high[axis]
        else:
            low[axis] = -points[place, axis]
            high[axis] = lengths[axis] - points[place, axis]
    start_box(geo, tri, planes, tags, low, high)
    n_tri, n_planes = 8, 6
    step = 9
    for axis in range(3):
        if periodic[axis]:
            tags[0, 2 * axis] = tags[0, 2 * axis + 1] = order[place]
            tags[1, 2 * axis] -= step
            tags[1, 2 * axis + 1] += step
        step //= 3
    for w in range(len(walls)):
        a, b, c = walls[w, 0], walls[w, 1], walls[w, 2]
        status, n_tri = cut(
            geo, tri, planes, tags, n_tri, n_planes, a, b, c, walls[w, 3] - (a * x + b * y + c * z), slack
        )
        if status == CUT:
            tags[0, n_planes] = -7 - w
            tags[1, n_planes] = 13
            n_planes += 1
        elif status != UNTOUCHED:
            return status, n_tri, n_planes
    far = _farthest(geo, n_tri)
    reach = far**0.5 + (far + gain) ** 0.5
    inner = -1.0
    radius = min(_first_radius(boxes, depth, place, n), reach)
    first_leaf = 1 << depth
    while True:
        outer = radius * radius
        for code in range(27):
            sx, sy, sz = code // 9 - 1, code // 3 % 3 - 1, code % 3 - 1
            if (sx and not periodic[0]) or (sy and not periodic[1]) or (sz and not periodic[2]):
                continue
            # Seen from the image, the site is shifted the other way.
            qx, qy, qz = x - sx * lengths[0], y - sy * lengths[1], z - sz * lengths[2]
            stack[0] = 1
            depth_of_stack = 1
            while depth_of_stack:
                depth_of_stack -= 1
                node = stack[depth_of_stack]
                box = boxes[node]
                dx = max(box[0] - qx, qx - box[3], 0.0)
                dy = max(box[1] - qy, qy - box[4], 0.0)
                dz = max(box[2] - qz, qz - box[5], 0.0)
                if dx * dx + dy * dy + dz * dz > outer:
                    continue
                if inner >= 0.0:
                    dx = max(qx - box[0], box[3] - qx)
                    dy = max(qy - box[1], box[4] - qy)
                    dz = max(qz - box[2], box[5] - qz)
                    if dx * dx + dy * dy + dz * dz <= inner or not _reaches(geo, n_tri, qx, qy, qz, box, weight):
                        continue
                if node < first_leaf:
                    # The nearer child is taken first: its cuts may spare the other.
                    left = boxes[2 * node]
                    nearer = 0
                    for axis in range(3):
                        if left[3 + axis] - left[axis] != box[3 + axis] - box[axis]:
                            q = qx if axis == 0 else (qy if axis == 1 else qz)
                            right = boxes[2 * node + 1]
                            nearer = int(2.0 * q > left[axis] + right[3 + axis])
                            break
                    stack[depth_of_stack] = 2 * node + 1 - nearer
                    stack[depth_of_stack + 1] = 2 * node + nearer
                    depth_of_stack += 2
                    continue
                k = node - first_leaf
                for p in range((k * n) >> depth, ((k + 1) * n) >> depth):
                    rx, ry, rz = points[p, 0] - qx, points[p, 1] - qy, points[p, 2] - qz
                    square = rx * rx + ry * ry + rz * rz
                    if square > outer or square <= inner or p == place:
                        continue
                    half = 0.5 * (square + weight - weights[p])
                    # No vertex lies farther than √far along r.
                    if half > 0.0 and half * half >= far * square:
                        continue
                    if len(banned) and _is_banned(banned, 27 * order[p] + code):
                        continue
                    status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, rx, ry, rz, half, slack)
                    if status == CUT:
                        tags[0, n_planes] = order[p]
                        tags[1, n_planes] = code
                        n_planes += 1
                        far = _farthest(geo, n_tri)
                    elif status != UNTOUCHED:
                        return status, n_tri, n_planes
        reach = far**0.5 + (far + gain) ** 0.5
        if radius >= reach:
            break
        inner = outer
        radius = min(radius * GROWTH, reach)
    _polish(geo, tri, planes, n_tri, 64.0 * slack)
    return CUT, n_tri, n_planes


@njit(cache=True)
def _is_banned(banned, key):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for other in banned:
        if other == key:
            return True
    return False


@njit(cache=True)
def _polish(geo, tri, planes, n_tri, most):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Move every vertex to where its three planes meet, if that is well defined and not farther than ``most``.

    The vertices carry the rounding of the large cell that they were cut from; their planes do not.
    """
    for t in range(n_tri):
        a, b, c = tri[0, t], tri[1, t], tri[2, t]
        ax, ay, az, ad = planes[0, a], planes[1, a], planes[2, a], planes[3, a]
        bx, by, bz, bd = planes[0, b], planes[1, b], planes[2, b], planes[3, b]
        cx, cy, cz, cd = planes[0, c], planes[1, c], planes[2, c], planes[3, c]
        ux, uy, uz = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
        det = ax * ux + ay * uy + az * uz
        if abs(det) < 1e-3:  # below, the meeting point is worth no more than the vertex as it is
            continue
        vx, vy, vz = cy * az - cz * ay, cz * ax - cx * az, cx * ay - cy * ax
        wx, wy, wz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        px = (ad * ux + bd * vx + cd * wx) / det
        py = (ad * uy + bd * vy + cd * wy) / det
        pz = (ad * uz + bd * vz + cd * wz) / det
        if (px - geo[0, t]) ** 2 + (py - geo[1, t]) ** 2 + (pz - geo[2, t]) ** 2 <= most * most:
            geo[0, t], geo[1, t], geo[2, t] = px, py, pz
            geo[3, t] = px * px + py * py + pz * pz
