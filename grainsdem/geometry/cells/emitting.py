"""From a cell in the dual to a polyhedron: vertices, and faces as loops of corners."""

from __future__ import annotations

import numpy as np

from grainsdem.geometry.cells.cutting import CUT, EMPTY, FULL
from grainsdem.geometry.cells.merging import has_short_edge, merge
from grainsdem.geometry.threads import inner

BROKEN = 4
"""Status of a cell that does not obey V − E + F = 2."""


@inner
def emit(geo, tri, tags, n_tri, n_planes, tolerance, vertices, counts, ids, codes, corners):  # type: ignore[no-untyped-def]
    """Write one cell of `cutting` into the buffers; return status and the numbers of vertices, faces and corners."""
    if n_tri > len(vertices) or n_tri // 2 + 2 > len(counts) or 3 * n_tri > len(corners):
        return FULL, 0, 0, 0
    for p in range(n_planes):
        tags[2, p] = -1
    for t in range(n_tri):
        for axis in range(3):
            vertices[t, axis] = geo[axis, t]
            tags[2, tri[axis, t]] = t
    n_faces = n_corners = np.int64(0)  # typed: a literal would have numba compile every callee twice
    for p in range(n_planes):
        first = tags[2, p]
        if first < 0:
            continue
        start = n_corners
        t = first
        while True:
            corners[n_corners] = t
            n_corners += 1
            k = 0 if tri[0, t] == p else (1 if tri[1, t] == p else 2)
            t = tri[3 + (k + 2) % 3, t]
            if t == first:
                break
        counts[n_faces] = n_corners - start
        ids[n_faces] = tags[0, p]
        codes[n_faces] = tags[1, p]
        n_faces += 1
    n_vertices = n_tri
    if has_short_edge(vertices, corners, counts, n_faces, tolerance):
        n_vertices, n_faces, n_corners = merge(
            vertices, corners, counts, ids, codes, n_vertices, n_faces, tolerance, tri[7:10]
        )
    if n_faces == 0:
        return EMPTY, 0, 0, 0
    if 2 * (n_vertices + n_faces - 2) != n_corners:
        return BROKEN, 0, 0, 0
    return CUT, n_vertices, n_faces, n_corners
