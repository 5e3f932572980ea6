"""Grains with fewer corners, inside what they were: levels of detail for large beds."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.hulls import convex_hulls
from grainsdem.geometry.selection import replaced, select

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

FEWEST = 6
"""Fewest corners a grain: with fewer, those that are spread widest may lie in one plane."""


def fewer_corners(shapes: Polyhedra, most: int) -> Polyhedra:
    """Return convex polyhedra of at most so many corners each: the convex hulls of corners that are spread wide.

    The first is the farthest from the middle, each further one the farthest from those before it. What has no more
    corners, or would be flat, is as it was.
    """
    rows = np.flatnonzero(np.diff(shapes.vertex_offsets) > most)
    clouds = [_spread(shapes.vertices_of(i), most) for i in rows.tolist()]
    try:
        return replaced(shapes, rows, [convex_hulls(clouds)])
    except InputError:  # some are flat
        return replaced(shapes, rows, [_hull(shapes, i, cloud) for i, cloud in zip(rows.tolist(), clouds, strict=True)])


def _hull(shapes: Polyhedra, i: int, cloud: Floats) -> Polyhedra:
    """Return the hull of some corners of a polyhedron, or the polyhedron where they lie in one plane."""
    try:
        return convex_hulls([cloud])
    except InputError:
        return select(shapes, np.array([i]))[0]


def _spread(points: Floats, most: int) -> Floats:
    """Return so many of the points, far from each other."""
    chosen = [int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))]
    nearest = np.full(len(points), np.inf)
    while len(chosen) < most:
        nearest = np.minimum(nearest, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(nearest)))
    spread: Floats = points[np.sort(chosen)]
    return spread
