"""Convex shapes of few corners that stand for shapes of many: corners are taken one after another, by their volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.hulls import convex_hull
from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.shapes.directions import spread

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.hulls import Outline
    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

FEWEST = 4
"""Corners that a shape has at least."""

_CANDIDATES = 2048
"""Corners that are chosen among, at most: of a hull that has more, the farthest in this many directions."""

_ENOUGH = 1e-6
"""Share of the volume below which no further corner adds anything: that of a scan's noise on a flat face."""


class Simplified(NamedTuple):
    """A convex shape of few corners inside another.

    Parameters
    ----------
    shape : Polyhedra
        One polyhedron; its corners are some of the other's.
    cut : float
        Share of the other's volume that it lacks: exact.
    """

    shape: Polyhedra
    cut: float


def simplified(hull: Outline, most: int) -> Simplified:
    """Return the hull of at most so many corners of a convex polyhedron, and the share of volume cut off.

    Parameters
    ----------
    hull : Outline
        Corners and volume of a convex polyhedron.
    most : int
        Corners, four or more.

    Raises
    ------
    InputError
        If fewer than four corners are asked for.

    Notes
    -----
    Four corners far apart come first. Then always that one which adds most: a point above some faces adds a third of
    the sum of their areas times its heights over them, and what its own hull closes besides.
    """
    if most < FEWEST:
        raise InputError(f"a shape has {FEWEST} corners or more; got {most}")
    if len(hull.points) <= most:
        return Simplified(convex_hull(hull.points), 0.0)
    whole = hull.volume
    points = _candidates(hull.points)
    chosen = _far_apart(points)
    while True:
        shape = convex_hull(points[chosen])
        if len(chosen) >= most:
            break
        planes = face_planes(shape)
        above = np.maximum(points @ planes.normals.T - planes.heights, 0.0)
        gains = above @ planes.areas / 3
        best = int(np.argmax(gains))
        if gains[best] <= _ENOUGH * whole:
            break
        chosen.append(best)
    return Simplified(shape, max(0.0, 1 - float(volumes(shape)[0]) / whole))


def _candidates(points: Floats) -> Floats:
    if len(points) <= _CANDIDATES:
        return points
    directions = spread(_CANDIDATES)
    farthest = [np.argmax(directions[k : k + 64] @ points.T, axis=1) for k in range(0, _CANDIDATES, 64)]
    chosen: Floats = points[np.unique(np.concatenate(farthest))]
    return chosen


def _far_apart(points: Floats) -> list[int]:
    """Return four points far from one another: two ends, the farthest from their line, and from the plane of three."""
    first = int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))
    arms = points - points[first]
    second = int(np.argmax((arms**2).sum(axis=1)))
    away = np.cross(arms, arms[second])
    third = int(np.argmax((away**2).sum(axis=1)))
    fourth = int(np.argmax(np.abs(arms @ np.cross(arms[second], arms[third]))))
    return [first, second, third, fourth]
