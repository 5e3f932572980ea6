"""One cell from its neighbours: the seeds are tried in growing balls until none farther out can reach it.

A seed j at r from the site cuts the cell by the plane r · x = (|r|² + w − w_j) / 2. It does so only if it is nearer, in
the power distance, to one of the cell's vertices than the site is; the same holds for a box of seeds and their
largest weight.
"""

from __future__ import annotations

from math import sqrt

import numpy as np
from numba import njit

from grainsdem.geometry.cells.cutting import CUT, HOME, UNTOUCHED, cut, polish, start_box
from grainsdem.geometry.threads import inner

GROWTH = 1.4
"""Ratio of the radii of successive balls."""

FIRST_BALL = 0.38
"""Radius of the first ball, relative to the diagonal of the box of some 10 seeds around the site."""

SURROUNDINGS = 0.85
"""Width of what is gathered around a leaf for all its seeds, relative to the same diagonal."""


@inner
def _reaches(geo, n_tri, x, y, z, boxes, node, weight):  # type: ignore[no-untyped-def]
    """Return whether a seed in the box of ``node`` could be nearer to a vertex of the cell than its site is."""
    lx, ly, lz = boxes[node, 0] - x, boxes[node, 1] - y, boxes[node, 2] - z
    hx, hy, hz = boxes[node, 3] - x, boxes[node, 4] - y, boxes[node, 5] - z
    gain = boxes[node, 6] - weight
    hits = 0
    for t in range(n_tri):
        vx, vy, vz = geo[0, t], geo[1, t], geo[2, t]
        dx = max(lx - vx, vx - hx, 0.0)
        dy = max(ly - vy, vy - hy, 0.0)
        dz = max(lz - vz, vz - hz, 0.0)
        hits += dx * dx + dy * dy + dz * dz < geo[3, t] + gain
    return hits > 0


@inner
def _farthest(geo, n_tri):  # type: ignore[no-untyped-def]
    """Return the largest squared distance of a vertex from the site."""
    result = 0.0
    for t in range(n_tri):
        result = max(result, geo[3, t])
    return result


@inner
def _shift(k):  # type: ignore[no-untyped-def]
    """Return 0, -1, 1 for k = 0, 1, 2: the seeds of the domain itself come before their images."""
    return 0 if k == 0 else (-1 if k == 1 else 1)


@inner
def _spacing(boxes, node):  # type: ignore[no-untyped-def]
    """Return the diagonal of the box of the node above ``node``, or of the first one up that has a size."""
    while node > 1:
        node >>= 1
        d = 0.0
        for axis in range(3):
            d += (boxes[node, 3 + axis] - boxes[node, axis]) ** 2
        if d > 0.0:
            return sqrt(d)
    return 1.0


@inner
def leaf_of(place, depth, n):  # type: ignore[no-untyped-def]
    """Return the leaf, from 0, that holds a place of the tree."""
    return (((place + 1) << depth) - 1) // n


@inner
def gather(leaf, tree, frame, around, named, stack):  # type: ignore[no-untyped-def]
    """List the seeds around a leaf for all its cells; return their number and how far the list is complete.

    Rows of ``around``: x, y, z, weight, and one of scratch. Rows of ``named``: place of the seed, code of its periodic
    image, and one of scratch.
    """
    _, points, weights, boxes, depth = tree
    lengths, periodic, _, _ = frame
    n = len(points)
    room = around.shape[1] - 1
    first_leaf = 1 << depth
    home = first_leaf + leaf
    ax, ay, az = boxes[home, 0], boxes[home, 1], boxes[home, 2]
    bx, by, bz = boxes[home, 3], boxes[home, 4], boxes[home, 5]
    kx, ky, kz = 3 if periodic[0] else 1, 3 if periodic[1] else 1, 3 if periodic[2] else 1
    spacing = _spacing(boxes, home)
    radius = SURROUNDINGS * spacing
    # At the rim of a cluster the leaf may be larger than the whole of it: then the list is made shorter.
    while radius > 1e-3 * spacing:
        most = radius * radius
        count = 0
        for image in range(kx * ky * kz):
            sx, sy, sz = _shift(image // (ky * kz)), _shift(image // kz % ky), _shift(image % kz)
            ox, oy, oz = sx * lengths[0], sy * lengths[1], sz * lengths[2]
            code = 9 * sx + 3 * sy + sz + HOME
            stack[0] = 1
            waiting = 1
            while waiting:
                waiting -= 1
                node = stack[waiting]
                dx = max(boxes[node, 0] + ox - bx, ax - boxes[node, 3] - ox, 0.0)
                dy = max(boxes[node, 1] + oy - by, ay - boxes[node, 4] - oy, 0.0)
                dz = max(boxes[node, 2] + oz - bz, az - boxes[node, 5] - oz, 0.0)
                if dx * dx + dy * dy + dz * dz > most:
                    continue
                if node < first_leaf:
                    stack[waiting] = 2 * node
                    stack[waiting + 1] = 2 * node + 1
                    waiting += 2
                    continue
                k = node - first_leaf
                first, last = (k * n) >> depth, ((k + 1) * n) >> depth
                if count + last - first > room:
                    count = room + 1
                    break
                for p in range(first, last):
                    px, py, pz = points[p, 0] + ox, points[p, 1] + oy, points[p, 2] + oz
                    dx, dy, dz = max(px - bx, ax - px, 0.0), max(py - by, ay - py, 0.0), max(pz - bz, az - pz, 0.0)
                    around[0, count], around[1, count], around[2, count] = px, py, pz
                    around[3, count] = weights[p]
                    named[0, count] = p
                    named[1, count] = code
                    count += dx * dx + dy * dy + dz * dz <= most
            if count > room:
                break
        if count <= room:
            return count, radius
        radius *= 0.5
    return 0, -1.0


@njit(cache=True, inline="always")
def _try_leaf(leaf, place, qx, qy, qz, code, inner, outer, far, n_tri, n_planes, tree, slack, banned, work):  # type: ignore[no-untyped-def]
    """Cut the cell by the seeds of a leaf at inner < |r|² <= outer; return status and what `grow` tracks."""
    order, points, weights, _, depth = tree
    geo, tri, planes, tags, _ = work
    n = len(points)
    weight = weights[place]
    for p in range((leaf * n) >> depth, ((leaf + 1) * n) >> depth):
        rx, ry, rz = points[p, 0] - qx, points[p, 1] - qy, points[p, 2] - qz
        square = rx * rx + ry * ry + rz * rz
        if square > outer or square <= inner or p == place:
            continue
        half = 0.5 * (square + (weight - weights[p]))
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
            return status, n_tri, n_planes, far
    return CUT, n_tri, n_planes, far


@inner
def _try_ball(inner, outer, large, place, far, n_tri, n_planes, tree, frame, banned, work):  # type: ignore[no-untyped-def]
    """Cut the cell by all seeds at inner < |r|² <= outer; ``large``: test large boxes against the vertices too."""
    _, points, weights, boxes, depth = tree
    lengths, periodic, _, slack = frame
    geo, _, _, _, stack = work
    x, y, z = points[place, 0], points[place, 1], points[place, 2]
    weight = weights[place]
    first_leaf = 1 << depth
    kx, ky, kz = 3 if periodic[0] else 1, 3 if periodic[1] else 1, 3 if periodic[2] else 1
    for image in range(kx * ky * kz):
        sx, sy, sz = _shift(image // (ky * kz)), _shift(image // kz % ky), _shift(image % kz)
        code = 9 * sx + 3 * sy + sz + HOME
        # Seen from the image, the site is shifted the other way.
        qx, qy, qz = x - sx * lengths[0], y - sy * lengths[1], z - sz * lengths[2]
        stack[0] = 1
        waiting = 1
        while waiting:
            waiting -= 1
            node = stack[waiting]
            # Entries, not rows: a view of a row would be counted in and out at every step.
            lx, ly, lz = boxes[node, 0] - qx, boxes[node, 1] - qy, boxes[node, 2] - qz
            hx, hy, hz = qx - boxes[node, 3], qy - boxes[node, 4], qz - boxes[node, 5]
            dx, dy, dz = max(lx, hx, 0.0), max(ly, hy, 0.0), max(lz, hz, 0.0)
            if dx * dx + dy * dy + dz * dz > outer:
                continue
            dx, dy, dz = min(lx, hx), min(ly, hy), min(lz, hz)
            if dx * dx + dy * dy + dz * dz <= inner:
                continue
            # Large boxes are worth the test only where the cell is long and the ball holds many: in clusters.
            if (node >= first_leaf or large) and not _reaches(geo, n_tri, qx, qy, qz, boxes, node, weight):
                continue
            if node < first_leaf:
                stack[waiting] = 2 * node
                stack[waiting + 1] = 2 * node + 1
                waiting += 2
                continue
            status, n_tri, n_planes, far = _try_leaf(
                node - first_leaf,
                place,
                qx,
                qy,
                qz,
                code,
                inner,
                outer,
                far,
                n_tri,
                n_planes,
                tree,
                slack,
                banned,
                work,
            )
            if status != CUT:
                return status, n_tri, n_planes, far
    return CUT, n_tri, n_planes, far


@njit(cache=True, inline="always")
def _try_listed(inner, outer, count, place, x, y, z, far, n_tri, n_planes, tree, slack, banned, around, named, work):  # type: ignore[no-untyped-def]
    """Cut the cell by the listed seeds at inner < |r|² <= outer, whose squared distances stand in the list."""
    order, _, weights, _, _ = tree
    geo, tri, planes, tags, _ = work
    weight = weights[place]
    chosen = 0
    # Written always and counted where it fits: a branch here would be guessed wrong half the time.
    for at in range(count):
        named[2, chosen] = at
        chosen += (around[4, at] <= outer) & (around[4, at] > inner)
    if inner < 0.0:
        # The first few in the order of their distance: the sooner the cell is small, the fewer cuts are in vain.
        for i in range(1, chosen):
            at = named[2, i]
            j = i
            while j > 0 and around[4, named[2, j - 1]] > around[4, at]:
                named[2, j] = named[2, j - 1]
                j -= 1
            named[2, j] = at
    for i in range(chosen):
        at = named[2, i]
        p = named[0, at]
        square = around[4, at]
        half = 0.5 * (square + (weight - around[3, at]))
        # No vertex lies farther than √far along r.
        if (half > 0.0 and half * half >= far * square) or p == place:
            continue
        if len(banned) and _is_banned(banned, 27 * order[p] + named[1, at]):
            continue
        rx, ry, rz = around[0, at] - x, around[1, at] - y, around[2, at] - z
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, rx, ry, rz, half, slack)
        if status == CUT:
            tags[0, n_planes] = order[p]
            tags[1, n_planes] = named[1, at]
            n_planes += 1
            far = _farthest(geo, n_tri)
        elif status != UNTOUCHED:
            return status, n_tri, n_planes, far
    return CUT, n_tri, n_planes, far


@inner
def grow(place, tree, frame, banned, around, named, count, known, work):  # type: ignore[no-untyped-def]
    """Build the cell of the seed at ``place`` of the tree in the work arrays; return status, triangles and planes.

    ``frame`` is (lengths, periodic, walls, slack): the box runs from 0 to ``lengths``, ``walls``, shape (k, 4), are the
    planes n · x <= d that cut it further, ``slack`` is the distance within which a vertex counts as on a plane.
    ``banned`` are neighbours not to be had: 27 · seed + code of the image. ``around``, ``named``, ``count`` and
    ``known`` are what `gather` made for the leaf of the place.
    """
    order, points, weights, boxes, depth = tree
    lengths, periodic, walls, slack = frame
    geo, tri, planes, tags, _ = work
    x, y, z = points[place, 0], points[place, 1], points[place, 2]
    gain = boxes[1, 6] - weights[place]
    start_box(geo, tri, planes, tags, x, y, z, lengths, periodic, order[place])
    # Typed: a literal would have numba compile every callee twice.
    n_tri, n_planes = np.int64(8), np.int64(6)
    for w in range(len(walls)):
        a, b, c = walls[w, 0], walls[w, 1], walls[w, 2]
        half = walls[w, 3] - (a * x + b * y + c * z)
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, a, b, c, half, slack)
        if status == CUT:
            tags[0, n_planes] = -7 - w
            tags[1, n_planes] = HOME
            n_planes += 1
        elif status != UNTOUCHED:
            return status, n_tri, n_planes
    for at in range(count):
        dx, dy, dz = around[0, at] - x, around[1, at] - y, around[2, at] - z
        around[4, at] = dx * dx + dy * dy + dz * dz
    far = _farthest(geo, n_tri)
    reach = sqrt(far) + sqrt(far + gain)
    radius = min(FIRST_BALL * _spacing(boxes, (1 << depth) + leaf_of(place, depth, len(points))), reach)
    inner = -1.0
    rounds = 0
    while True:
        outer = radius * radius
        if radius <= known:
            status, n_tri, n_planes, far = _try_listed(
                inner, outer, count, place, x, y, z, far, n_tri, n_planes, tree, slack, banned, around, named, work
            )
        else:
            status, n_tri, n_planes, far = _try_ball(
                inner, outer, rounds > 2, place, far, n_tri, n_planes, tree, frame, banned, work
            )
        if status != CUT:
            return status, n_tri, n_planes
        reach = sqrt(far) + sqrt(far + gain)
        if radius >= reach:
            break
        inner = outer
        grown = radius * GROWTH
        # The list is used to its end before the tree is searched.
        radius = min(known if radius < known < grown else grown, reach)
        rounds += 1
    polish(geo, tri, planes, n_tri, 64.0 * slack)
    return CUT, n_tri, n_planes


@inner
def _is_banned(banned, key):  # type: ignore[no-untyped-def]
    for other in banned:  # noqa: SIM110  (numba compiles no generators)
        if other == key:
            return True
    return False
