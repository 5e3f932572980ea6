"""How round the corners of outlines are: the largest arcs that fit into them.

An outline is seen along an edge of the grain's smallest box. A polygon may stand for itself or for a smooth curve that
it goes along: a corner that turns little is part of an arc, one that turns by a right angle is a corner.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numba import njit

from grainsdem.geometry.forms.boxes import hull_in_plane, standing_boxes
from grainsdem.geometry.threads import in_blocks, inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

SMOOTH = np.pi / 4
"""A corner that turns by no more is part of an arc: one bevel on a right angle leaves two of these."""

SHARP = np.pi / 2
"""A corner that turns by no less is sharp; between the two it counts in part."""

FINE = 0.01
"""A side that cuts less off the corner of its neighbours than this, relative to the circle inside, is none."""

_ONE_POINT = 1e-9
"""Corners nearer than this, relative to the outline, lie behind one another; sides that turn by less are one."""


def outline_roundnesses(polyhedra: Polyhedra, *, upright: bool = False) -> Floats:
    """Return the roundness of each polyhedron's outlines, shape (n, 3).

    They are seen along the edges of its smallest box, or along x, y and z where it stands upright.
    """
    p = polyhedra
    result = np.full((len(p), 3), np.nan)
    axes = np.tile(np.eye(3), (len(p), 1, 1)) if upright else standing_boxes(p).axes
    in_blocks(_measure, len(p), p.vertices, p.vertex_offsets, axes, result, least=64)
    return result


@njit(cache=True, nogil=True)
def _measure(start, stop, vertices, offsets, axes, result):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        n = offsets[i + 1] - offsets[i]
        shadow, hull = np.empty((n, 2)), np.empty((n + 2, 2))
        for along in range(3):
            u, w = axes[i, (along + 1) % 3], axes[i, (along + 2) % 3]
            for k in range(n):
                v = vertices[offsets[i] + k]
                shadow[k, 0] = u[0] * v[0] + u[1] * v[1] + u[2] * v[2]
                shadow[k, 1] = w[0] * v[0] + w[1] * v[1] + w[2] * v[2]
            count = hull_in_plane(shadow, hull)
            result[i, along] = _roundness(hull[:count].copy())


@inner
def _turn(a, b):  # type: ignore[no-untyped-def]
    """Return the angle by which one side turns to the next."""
    return np.arctan2(a[0] * b[1] - a[1] * b[0], a[0] * b[0] + a[1] * b[1])


@inner
def _lines(points):  # type: ignore[no-untyped-def]
    """Return the sides of a polygon as lines n · x = d, in their order, those that are no points."""
    count = len(points)
    extent = 0.0
    for i in range(count):
        extent = max(extent, abs(points[i, 0] - points[0, 0]) + abs(points[i, 1] - points[0, 1]))
    lines, kept = np.empty((count, 3)), 0
    last = points[0]
    for i in range(1, count + 1):
        p = points[i % count]
        x, y = p[0] - last[0], p[1] - last[1]
        length = np.sqrt(x * x + y * y)
        if length > _ONE_POINT * extent:
            lines[kept, 0], lines[kept, 1] = y / length, -x / length
            lines[kept, 2] = lines[kept, 0] * last[0] + lines[kept, 1] * last[1]
            last = p
            # What goes straight on is the same side.
            if kept == 0 or abs(_turn(lines[kept - 1], lines[kept])) > _ONE_POINT:
                kept += 1
    if kept > 1 and abs(_turn(lines[kept - 1], lines[0])) <= _ONE_POINT:
        kept -= 1
    return lines[:kept]


@inner
def _sides(lines):  # type: ignore[no-untyped-def]
    """Return the turn at the beginning of each side, and its length."""
    n = len(lines)
    turns, lengths = np.empty(n), np.empty(n)
    for i in range(n):
        turns[i] = _turn(lines[i - 1], lines[i])
    for i in range(n):
        a, b, c = lines[i - 1], lines[i], lines[(i + 1) % n]
        # From where it meets the side before to where it meets the next, along itself.
        first = (a[2] - (a[0] * b[0] + a[1] * b[1]) * b[2]) / (a[1] * b[0] - a[0] * b[1])
        second = (c[2] - (c[0] * b[0] + c[1] * b[1]) * b[2]) / (c[1] * b[0] - c[0] * b[1])
        lengths[i] = second - first
    return turns, lengths


@inner
def _circle(lines):  # type: ignore[no-untyped-def]
    """Return the radius of the largest circle in a polygon: its sides move inward until the last three meet."""
    left = lines.copy()
    n = len(left)
    while True:
        best, place = np.inf, 0
        for i in range(n):
            a, b, c = left[i - 1], left[i], left[(i + 1) % n]
            # Where three sides moved by the same distance meet.
            px, py, p = b[0] - a[0], b[1] - a[1], b[2] - a[2]
            qx, qy, q = c[0] - b[0], c[1] - b[1], c[2] - b[2]
            det = px * qy - py * qx
            if det <= 1e-14:
                continue
            x, y = (p * qy - py * q) / det, (px * q - p * qx) / det
            distance = b[2] - b[0] * x - b[1] * y
            if distance < best:
                best, place = distance, i
        if n <= 3 or best == np.inf:
            return best
        for i in range(place, n - 1):
            left[i] = left[i + 1]
        n -= 1
        left = left[:n]


@inner
def _without_fine_sides(lines, radius):  # type: ignore[no-untyped-def]
    """Leave out sides that cut next to nothing off the corner that their neighbours would make."""
    while len(lines) > 3:
        turns, lengths = _sides(lines)
        n = len(lines)
        least, place = FINE * radius, -1
        for i in range(n):
            before, after = turns[i], turns[(i + 1) % n]
            if before + after > SMOOTH + 1e-9:
                continue
            cut = lengths[i] * np.tan(before) * np.tan(after) / (np.tan(before) + np.tan(after))
            if cut < least:
                least, place = cut, i
        if place < 0:
            break
        left = np.empty((n - 1, 3))
        left[:place], left[place:] = lines[:place], lines[place + 1 :]
        lines = left
    return lines


@inner
def _roundness(points):  # type: ignore[no-untyped-def]
    """Return the mean radius of the arcs that fit into the corners, each counted by its turn, over the circle's.

    All arcs grow alike. Where two have used up a side between them, both have their radius.
    """
    lines = _lines(points)
    if len(lines) < 3:
        return np.nan
    radius = _circle(lines)
    lines = _without_fine_sides(lines, radius)
    turns, lengths = _sides(lines)
    n = len(lines)
    arcs, is_done = np.full(n, radius), np.zeros(n, dtype=np.bool_)
    while True:
        best, place = radius, -1
        for i in range(n):
            k = (i + 1) % n
            a, b = np.tan(0.5 * min(turns[i], 3.0)), np.tan(0.5 * min(turns[k], 3.0))
            used = (arcs[i] * a if is_done[i] else 0.0) + (arcs[k] * b if is_done[k] else 0.0)
            needed = (0.0 if is_done[i] else a) + (0.0 if is_done[k] else b)
            if needed > 0.0 and (lengths[i] - used) / needed < best:
                best, place = max((lengths[i] - used) / needed, 0.0), i
        if place < 0:
            break
        for k in (place, (place + 1) % n):
            if not is_done[k]:
                arcs[k], is_done[k] = best, True
    total = 0.0
    for i in range(n):
        share = min(max((SHARP - turns[i]) / (SHARP - SMOOTH), 0.0), 1.0)
        # A right angle that was rounded is one still.
        if SHARP - turns[i] < 1e-6:
            share = 0.0
        total += turns[i] * share * arcs[i]
    return total / (2.0 * np.pi * radius)
