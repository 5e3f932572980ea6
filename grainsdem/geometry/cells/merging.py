"""Degenerate cells: vertices that coincide become one, and faces without area go.

Where more than three planes meet in a point, as in every lattice, the dual holds several triangles for one vertex, and
slivers of faces between them that only rounding made.
"""

from __future__ import annotations

import numpy as np

from grainsdem.geometry.threads import inner


@inner
def has_short_edge(vertices, corners, counts, n_faces, tolerance):  # type: ignore[no-untyped-def]
    """Return whether two neighbouring corners of a face are nearer than ``tolerance``."""
    square = tolerance * tolerance
    first = 0
    for f in range(n_faces):
        previous = corners[first + counts[f] - 1]
        for c in range(first, first + counts[f]):
            corner = corners[c]
            dx = vertices[corner, 0] - vertices[previous, 0]
            dy = vertices[corner, 1] - vertices[previous, 1]
            dz = vertices[corner, 2] - vertices[previous, 2]
            if dx * dx + dy * dy + dz * dz < square:
                return True
            previous = corner
        first += counts[f]
    return False


@inner
def _root(parents, i):  # type: ignore[no-untyped-def]
    while parents[i] != i:
        i = parents[i]
    return i


@inner
def _clean_loop(corners, first, count, parents, removed):  # type: ignore[no-untyped-def]
    """Rename the corners of one face, drop repetitions and spikes (a b a), and return how many are left."""
    kept = 0
    for c in range(first, first + count):
        corner = _root(parents, corners[c])
        if removed[corner]:
            continue
        corners[first + kept] = corner
        kept += 1
        shrinking = True
        while shrinking:
            shrinking = False
            if kept >= 2 and corners[first + kept - 1] == corners[first + kept - 2]:
                kept -= 1
                shrinking = True
            elif kept >= 3 and corners[first + kept - 1] == corners[first + kept - 3]:
                kept -= 2
                shrinking = True
    # The same across the seam of the loop.
    start = first
    shrinking = True
    while shrinking and kept >= 2:
        shrinking = False
        if corners[start] == corners[start + kept - 1]:
            kept -= 1
            shrinking = True
        elif kept >= 3 and corners[start] == corners[start + kept - 2]:
            kept -= 2
            shrinking = True
        elif kept >= 3 and corners[start + 1] == corners[start + kept - 1]:
            start += 1
            kept -= 2
            shrinking = True
    for c in range(kept):
        corners[first + c] = corners[start + c]
    return kept


@inner
def merge(vertices, corners, counts, ids, codes, n_vertices, n_faces, tolerance, scratch):  # type: ignore[no-untyped-def]
    """Merge the vertices of one cell that edges shorter than ``tolerance`` join, in place; return the new counts.

    Faces left with fewer than three corners are dropped, and so are vertices that only two faces are left to share.
    ``scratch`` is an integer array of at least 3 rows and as many columns as there are vertices.
    """
    parents, removed, uses = scratch[0], scratch[1], scratch[2]
    for i in range(n_vertices):
        parents[i] = i
        removed[i] = 0
    square = tolerance * tolerance
    first = 0
    for f in range(n_faces):
        previous = corners[first + counts[f] - 1]
        for c in range(first, first + counts[f]):
            corner = corners[c]
            dx = vertices[corner, 0] - vertices[previous, 0]
            dy = vertices[corner, 1] - vertices[previous, 1]
            dz = vertices[corner, 2] - vertices[previous, 2]
            if dx * dx + dy * dy + dz * dz < square:
                a, b = _root(parents, corner), _root(parents, previous)
                parents[max(a, b)] = min(a, b)
            previous = corner
        first += counts[f]
    changed = True
    while changed:
        changed = False
        for i in range(n_vertices):
            uses[i] = 0
        read = write = faces = np.int64(0)  # typed: a literal would have numba compile the callee twice
        for f in range(n_faces):
            count = counts[f]
            left = _clean_loop(corners, read, count, parents, removed)
            if left >= 3:
                for c in range(left):
                    corners[write + c] = corners[read + c]
                    uses[corners[write + c]] += 1
                counts[faces] = left
                ids[faces] = ids[f]
                codes[faces] = codes[f]
                write += left
                faces += 1
            read += count
        n_faces = faces
        for i in range(n_vertices):
            if 0 < uses[i] < 3:
                removed[i] = 1
                changed = True
    total = 0
    for f in range(n_faces):
        total += counts[f]
    kept = 0
    for i in range(n_vertices):
        if uses[i]:
            for axis in range(3):
                vertices[kept, axis] = vertices[i, axis]
            parents[i] = kept
            kept += 1
    for c in range(total):
        corners[c] = parents[corners[c]]
    return kept, n_faces, total
