"""Convex polyhedra without short edges, each inside what it was."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.edges import edge_lengths, edges
from grainsdem.geometry.hulls import convex_hull, outline
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.selection import replaced, select
from grainsdem.ragged import owners, sum_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

ALIKE = 1e-9
"""Two corners of a prism lie above each other where they are this near seen along its axis, relative to its extent."""


class Blunted(NamedTuple):
    """Polyhedra without short edges.

    Parameters
    ----------
    shapes : Polyhedra
        The polyhedra; those without short edges are the same to the bit.
    n_edges : ndarray of int64, shape (n,)
        How many edges of each were short.
    distances : ndarray, shape (n,)
        Distance [m] from what is left of each within which every point of it lies.
    is_gone : ndarray of bool, shape (n,)
        Which would lose more than half of their volume; they are as they were.
    """

    shapes: Polyhedra
    n_edges: NDArray[np.int64]
    distances: Floats
    is_gone: NDArray[np.bool_]


def blunt(shapes: Polyhedra, shortest: Floats, *, are_prisms: bool = False) -> Blunted:
    """Return convex polyhedra whose short edges are gone.

    Parameters
    ----------
    shapes : Polyhedra
        Closed convex polyhedra.
    shortest : ndarray, shape (n,)
        Length [m] below which an edge of each is short.
    are_prisms : bool
        Whether they are prisms along z that are to stay so; edges along z are never short.

    Notes
    -----
    Of the shortest edge the corner goes without which the convex hull of the others is larger, until no edge is short.
    All corners are corners of the polyhedron, so that it contains what is left.
    """
    found = edges(shapes)
    is_short = edge_lengths(shapes, found) < shortest[owners(found.offsets)]
    if are_prisms:
        is_short &= ~_is_upright(shapes, found.ends + shapes.vertex_offsets[owners(found.offsets)][:, None])
    n_edges = sum_rows(is_short.astype(np.int64), found.offsets)
    rows = np.flatnonzero(n_edges)
    distances, is_gone, made = np.zeros(len(shapes)), np.zeros(len(shapes), dtype=bool), []
    for i in rows.tolist():
        one = select(shapes, np.array([i]))[0]
        try:
            left = _blunt(one, float(shortest[i]), are_prisms=are_prisms)
            is_gone[i] = 2.0 * volumes(left)[0] < volumes(one)[0]
        except InputError:  # flat
            is_gone[i] = True
        made.append(one if is_gone[i] else left)
        apart = np.linalg.norm(one.vertices[:, None] - made[-1].vertices[None], axis=2)
        distances[i] = apart.min(axis=1).max()
    return Blunted(replaced(shapes, rows, made), n_edges, distances, is_gone)


def _is_upright(shapes: Polyhedra, ends: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return which edges lie along z."""
    across = shapes.vertices[ends[:, 1], :2] - shapes.vertices[ends[:, 0], :2]
    extent = float(np.abs(shapes.vertices).max(initial=0.0))
    upright: NDArray[np.bool_] = np.hypot(*across.T) < ALIKE * extent
    return upright


def _blunt(one: Polyhedra, shortest: float, *, are_prisms: bool) -> Polyhedra:
    """Return one polyhedron without its short edges, or raise `InputError` where nothing would be left."""
    while True:
        found = edges(one)
        lengths = edge_lengths(one, found)
        if are_prisms:
            lengths[_is_upright(one, found.ends.astype(np.int64))] = np.inf
        k = int(np.argmin(lengths))
        if lengths[k] >= shortest:
            return one
        clouds = [_without(one.vertices, int(corner), are_prisms=are_prisms) for corner in found.ends[k]]
        one = convex_hull(max(clouds, key=_volume))


def _without(points: Floats, corner: int, *, are_prisms: bool) -> Floats:
    """Return the points but for one, and of a prism but for the one above or below it too."""
    is_left: NDArray[np.bool_] = np.arange(len(points)) != corner
    if are_prisms:
        extent = float(np.abs(points).max())
        is_left = np.hypot(*(points - points[corner])[:, :2].T) >= ALIKE * extent
    left: Floats = points[is_left]
    return left


def _volume(points: Floats) -> float:
    """Return the volume of the convex hull of points, zero where they have none."""
    try:
        return outline(points).volume
    except InputError:
        return 0.0
