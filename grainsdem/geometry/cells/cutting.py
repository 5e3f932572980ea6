"""One convex cell, cut plane by plane in the dual: a vertex of the cell is a triangle of three planes.

A cell is held in work arrays that the caller owns, so that no cell costs an allocation:

``geo`` : float64 (8, n_triangles)
    Rows x, y, z of the vertex, its squared distance from the site, its distance beyond the plane that is tried, and
    three rows of scratch.
``tri`` : int32 (11, n_triangles)
    Rows 0-2: the planes of the triangle, counter-clockwise seen from outside. Rows 3-5: the triangle across the edge
    from plane k to plane k + 1. Row 6: marks. Rows 7-10: scratch.
``planes`` : float64 (4, n_planes)
    Outward unit normal and distance from the site.
``tags`` : int32 (4, n_planes)
    Cell or wall behind the plane, code of the periodic image, and two rows of scratch.

The dual stays a triangulated sphere whatever rounding does: a cut removes a disk of triangles and closes the hole with
a fan. Where rounding would have it remove anything but a disk, the disk is grown from the farthest vertex as far as it
goes (topology first, after Sugihara), and what is left over lies within rounding of the plane.

References
----------
.. [1] N. Ray, D. Sokolov, S. Lefebvre, B. Lévy, "Meshless Voronoi on the GPU", ACM Trans. Graphics 37 (2018) 265.
.. [2] K. Sugihara, M. Iri, "A robust topology-oriented incremental algorithm for Voronoi diagrams", Int. J. Comput.
   Geometry Appl. 4 (1994) 179-228.
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from grainsdem.geometry.threads import inner

UNTOUCHED, CUT, EMPTY, FULL, LOST = 0, 1, 2, 3, 5
"""What a cut did: nothing, cut, left nothing, found the work arrays too small, or met rounding too large."""

MOST_LEFT = 1000.0
"""How far beyond a plane rounding may leave a vertex, relative to the slack."""


HOME = 13
"""Code of the image that is not shifted; (sx + 1) · 9 + (sy + 1) · 3 + sz + 1 in general."""


@inner
def start_box(geo, tri, planes, tags, x, y, z, lengths, periodic, seed):  # type: ignore[no-untyped-def]
    """Make the cell of the site at (x, y, z) the box from 0 to ``lengths``; planes -x, +x, -y, +y, -z, +z.

    Along a periodic axis it ends at the site's own images, which bound its cell whatever the weights.
    """
    step = 9
    for axis in range(3):
        place = x if axis == 0 else (y if axis == 1 else z)
        for side in range(2):
            p = 2 * axis + side
            planes[0, p] = planes[1, p] = planes[2, p] = 0.0
            planes[axis, p] = 1.0 if side else -1.0
            tags[2, p] = -1
            if periodic[axis]:
                planes[3, p] = 0.5 * lengths[axis]
                tags[0, p] = seed
                tags[1, p] = HOME + step if side else HOME - step
            else:
                planes[3, p] = lengths[axis] - place if side else place
                tags[0, p] = -1 - p
                tags[1, p] = HOME
        step //= 3
    for t in range(8):
        bx, by, bz = t & 1, (t >> 1) & 1, t >> 2
        geo[0, t] = planes[3, 1] if bx else -planes[3, 0]
        geo[1, t] = planes[3, 3] if by else -planes[3, 2]
        geo[2, t] = planes[3, 5] if bz else -planes[3, 4]
        geo[3, t] = geo[0, t] ** 2 + geo[1, t] ** 2 + geo[2, t] ** 2
        tri[6, t] = 0
        # The corner (+, +, +) sees its planes x, y, z counter-clockwise from outside; each minus mirrors that.
        tri[0, t] = bx
        if (bx + by + bz) & 1:
            tri[1, t], tri[2, t] = 2 + by, 4 + bz
            tri[3, t], tri[4, t], tri[5, t] = t ^ 4, t ^ 1, t ^ 2
        else:
            tri[1, t], tri[2, t] = 4 + bz, 2 + by
            tri[3, t], tri[4, t], tri[5, t] = t ^ 2, t ^ 1, t ^ 4


@inner
def _flood(geo, tri, limit, seed):  # type: ignore[no-untyped-def]
    """Mark the triangles beyond ``limit`` that hang together with ``seed``; count them and the edges of their rim."""
    tri[7, 0] = seed
    tri[6, seed] = 1
    count = 1
    rim = 0
    at = 0
    while at < count:
        t = tri[7, at]
        at += 1
        for k in range(3):
            u = tri[3 + k, t]
            if geo[4, u] > limit:
                if tri[6, u] == 0:
                    tri[6, u] = 1
                    tri[7, count] = u
                    count += 1
            else:
                rim += 1
    return count, rim


@inner
def _grow_disk(geo, tri, tags, limit, seed, count):  # type: ignore[no-untyped-def]
    """Mark again, but only what keeps the marked set a disk; return its size and that of its rim."""
    for at in range(count):
        t = tri[7, at]
        tri[6, t] = 0
        for k in range(3):
            tags[3, tri[k, t]] = 0
    tri[6, seed] = 1
    for k in range(3):
        tags[3, tri[k, seed]] = 1
    tri[7, 0] = seed
    count = 1
    grew = True
    while grew:
        grew = False
        at = 0
        while at < count:
            t = tri[7, at]
            at += 1
            for k in range(3):
                u = tri[3 + k, t]
                if tri[6, u] or not geo[4, u] > limit:
                    continue
                shared = 0
                inside = 0
                for j in range(3):
                    shared += tri[6, tri[3 + j, u]]
                    inside += tags[3, tri[j, u]]
                # One shared edge and a new corner, or two shared edges: the set stays a disk. Anything else pinches it.
                if (shared == 1 and inside == 2) or shared == 2:
                    tri[6, u] = 1
                    for j in range(3):
                        tags[3, tri[j, u]] = 1
                    tri[7, count] = u
                    count += 1
                    grew = True
    rim = 0
    for at in range(count):
        for k in range(3):
            rim += 1 - tri[6, tri[3 + k, tri[7, at]]]
    return count, rim


@inner
def _walk_rim(tri, tags, n_planes, count):  # type: ignore[no-untyped-def]
    """List the rim of the marked set in rows 8 (triangle) and 9 (edge); return its length, −1 where it pinches."""
    t = k = -1
    for at in range(count):
        for j in range(3):
            if tri[6, tri[3 + j, tri[7, at]]] == 0:
                t, k = tri[7, at], j
        if t >= 0:
            break
    first_t, first_k = t, k
    length = 0
    # The number of the plane to come is new at every cut, so it serves as the stamp of this walk.
    while True:
        plane = tri[k, t]
        if tags[2, plane] == n_planes:
            return -1
        tags[2, plane] = n_planes
        tri[8, length] = t
        tri[9, length] = k
        length += 1
        k = k + 1 if k < 2 else 0
        u = tri[3 + k, t]
        while tri[6, u]:
            if tri[3, u] == t:
                k = 1
            elif tri[4, u] == t:
                k = 2
            else:
                k = 0
            t = u
            u = tri[3 + k, t]
        if t == first_t and k == first_k:
            return length


@inner
def cut(geo, tri, planes, tags, n_tri, n_planes, rx, ry, rz, half, slack):  # type: ignore[no-untyped-def]
    """Cut the cell by r · x <= half and return what that did, and the new number of triangles.

    A vertex beyond the plane by ``slack`` or less counts as on it. Where the cell was cut, the new plane has the number
    ``n_planes``; the caller writes its tags.
    """
    norm = sqrt(rx * rx + ry * ry + rz * rz)
    limit = slack * norm
    beyond = 0
    for t in range(n_tri):
        value = rx * geo[0, t] + ry * geo[1, t] + rz * geo[2, t] - half
        geo[4, t] = value
        beyond += value > limit
    if beyond == 0:
        return UNTOUCHED, n_tri
    if beyond == n_tri:
        return EMPTY, 0
    if n_planes >= planes.shape[1] or n_tri + 2 >= geo.shape[1]:
        return FULL, n_tri
    seed = np.int64(0)  # typed: a literal would have numba compile every callee twice
    for t in range(1, n_tri):
        if geo[4, t] > geo[4, seed]:
            seed = np.int64(t)
    count, rim = _flood(geo, tri, limit, seed)
    length = _walk_rim(tri, tags, n_planes, count)
    if length != rim:
        for p in range(n_planes):
            tags[2, p] = -1
        count, rim = _grow_disk(geo, tri, tags, limit, seed, count)
        length = _walk_rim(tri, tags, n_planes, count)
    if count != beyond:
        for t in range(n_tri):
            if tri[6, t] == 0 and geo[4, t] > MOST_LEFT * limit:
                return LOST, n_tri
    planes[0, n_planes] = rx / norm
    planes[1, n_planes] = ry / norm
    planes[2, n_planes] = rz / norm
    planes[3, n_planes] = half / norm
    tags[2, n_planes] = -1
    for e in range(length):
        t = tri[8, e]
        k = tri[9, e]
        u = tri[3 + k, t]
        inner = min(geo[4, u], 0.0)
        # On the edge from the kept vertex to the lost one: a convex combination stays inside whatever the rounding.
        f = inner / (inner - geo[4, t])
        geo[5, e] = geo[0, u] + f * (geo[0, t] - geo[0, u])
        geo[6, e] = geo[1, u] + f * (geo[1, t] - geo[1, u])
        geo[7, e] = geo[2, u] + f * (geo[2, t] - geo[2, u])
        tri[8, e] = tri[k, t]
        tri[9, e] = u
        # The slot of the edge is noted now: the old triangle's number may be given to a new one below.
        j = 3
        while tri[j, u] != t or tri[j - 3, u] != tri[k + 1 if k < 2 else 0, t]:
            j += 1
        tri[10, e] = j
    new_size = n_tri + length - count
    for e in range(length):
        t = tri[7, e] if e < count else n_tri + e - count
        tri[7, e] = t
    for e in range(length):
        t = tri[7, e]
        ahead = e + 1 if e + 1 < length else 0
        behind = e - 1 if e > 0 else length - 1
        geo[0, t], geo[1, t], geo[2, t] = geo[5, e], geo[6, e], geo[7, e]
        geo[3, t] = geo[0, t] ** 2 + geo[1, t] ** 2 + geo[2, t] ** 2
        tri[0, t] = tri[8, e]
        tri[1, t] = tri[8, ahead]
        tri[2, t] = n_planes
        tri[3, t] = tri[9, e]
        tri[4, t] = tri[7, ahead]
        tri[5, t] = tri[7, behind]
        tri[tri[10, e], tri[9, e]] = t
        tri[6, t] = 0
    if count > length:
        last = n_tri - 1
        for e in range(length, count):
            t = tri[7, e]
            if t < new_size:
                while tri[6, last] == 1:
                    last -= 1
                for row in range(4):
                    geo[row, t] = geo[row, last]
                for row in range(6):
                    tri[row, t] = tri[row, last]
                for k in range(3):
                    u = tri[3 + k, t]
                    for j in range(3, 6):
                        if tri[j, u] == last:
                            tri[j, u] = t
                last -= 1
        for e in range(length, count):
            tri[6, tri[7, e]] = 0
    return CUT, new_size


@inner
def polish(geo, tri, planes, n_tri, most):  # type: ignore[no-untyped-def]
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
