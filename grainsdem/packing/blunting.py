"""Grains without edges too short for the programs that get them."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.blunt import blunt
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.integrals import centroids, volumes
from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from grainsdem.model import Packing

_logger = logging.getLogger(__name__)

MOST = 0.2
"""Longest edge, in diameters, that may be called short: beyond it little of a grain's form is left."""


@dataclass(frozen=True)
class Merged:
    """Grains without short edges, and what that changed.

    Parameters
    ----------
    packing : Packing
        The grains, each inside what it was.
    n_edges, n_grains : int
        How many edges were short, and of how many grains.
    volume_change : float
        Change of the grains' total volume, relative to what it was: negative or zero.
    largest_volume_change : float
        Change of the volume of the grain that lost most of its own.
    largest_distance : float
        Distance, in diameters of a grain, from what is left of it within which every point of it lies; of the grain
        where it is largest.
    """

    packing: Packing
    n_edges: int
    n_grains: int
    volume_change: float
    largest_volume_change: float
    largest_distance: float


@gated
def merge_edges(packing: Packing, min_edge: float) -> Merged:
    """Return the grains without edges shorter than some part of their diameter, convex and inside what they were.

    Parameters
    ----------
    packing : Packing
        Convex grains, wherever they are.
    min_edge : float
        Shortest edge that is left, in diameters of each grain as `diameters` has them, above 0 and at most 0.2.

    Returns
    -------
    Merged
        The same grains, each about its new centroid, without links to neighbours, and what they lost; grains without
        such edges are the same to the bit. Grains of a planar bed stay prisms.

    Raises
    ------
    InputError
        If ``min_edge`` is out of range, or less than half is left of a grain.

    Notes
    -----
    Two corners at the ends of a short edge become one: of the two the one stays that leaves the larger convex hull. No
    corner moves, so no grain grows and no two overlap that did not; the faces about the corner that goes are cut by a
    triangle.
    """
    check_min_edge(min_edge)
    diameters, sizes = grain_diameters(packing), volumes(packing.grains)
    made = blunt(packing.grains, min_edge * diameters, are_prisms=packing.domain.is_planar)
    refuse_gone(made.is_gone, min_edge)
    is_new = made.n_edges > 0
    steps = np.where(is_new[:, None], centroids(made.shapes), 0.0)
    vertices = made.shapes.vertices - np.repeat(steps, np.diff(made.shapes.vertex_offsets), axis=0)
    left = volumes(made.shapes)
    told = {
        "n_edges": int(made.n_edges.sum()),
        "n_grains": int(is_new.sum()),
        "volume_change": float(left.sum() / sizes.sum() - 1.0) if is_new.any() else 0.0,
        "largest_volume_change": float(np.where(is_new, left / sizes - 1.0, 0.0).min(initial=0.0)),
        "largest_distance": float((made.distances / diameters).max(initial=0.0)),
    }
    _logger.info("%d edges of %d grains were shorter than %g diameters", told["n_edges"], told["n_grains"], min_edge)
    moved = replace(
        packing,
        grains=replace(made.shapes, vertices=vertices),
        positions=packing.positions + np.einsum("nij,nj->ni", to_matrices(packing.quaternions), steps),
        links=None,
    )
    return Merged(moved.with_step("merge_edges", min_edge=float(min_edge), **told), **told)  # type: ignore[arg-type]


def check_min_edge(min_edge: float) -> None:
    """Raise `InputError` unless an edge may be called short."""
    is_number = isinstance(min_edge, (int, float, np.number)) and not isinstance(min_edge, bool)
    if not (is_number and 0 < min_edge <= MOST):
        raise InputError(f"min_edge must be above 0 and at most {MOST:g} diameters; got {min_edge!r}")


def refuse_gone(is_gone: np.ndarray[tuple[int], np.dtype[np.bool_]], min_edge: float) -> None:
    """Raise `InputError` where too little is left of grains."""
    gone = np.flatnonzero(is_gone)
    if gone.size:
        raise InputError(f"min_edge of {min_edge:g} diameters leaves less than half of grains {name_offenders(gone)}")
