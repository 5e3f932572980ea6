"""Cells between ellipsoids in a domain, parted from all that they might meet."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.bounds import near_in
from grainsdem.geometry.cells.between import cells_between
from grainsdem.model import Polyhedra, Tessellation
from grainsdem.ragged import offsets_from_counts
from grainsdem.tessellation.engine.frame import Frame

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

_TRIES = 12
"""Times that cells are looked for in wider surroundings."""


def grown(
    domain: Domain,
    sites: Floats,
    weights: Floats,
    forms: Floats,
    reach: Floats,
    *,
    cuts: Callable[[Floats], tuple[NDArray[np.int64], Floats]] | None = None,
) -> tuple[Tessellation, Floats]:
    """Return the cells between ellipsoids in a domain, and how far [m] they reach from their sites along each axis.

    Parameters
    ----------
    domain : Domain
        What they grow in.
    sites, weights, forms : ndarray, shapes (n, 3), (n,) and (n, 3, 3)
        Centres [m], weights [m²] and forms, see `cells.between`.
    reach : ndarray, shape (n, 3)
        How far [m] they are guessed to reach. What is returned is certain: every pair of cells whose boxes meet was
        parted, so that no two overlap.
    cuts : callable, optional
        Called with how far cells are guessed to reach; returns offsets, shape (n + 1,), of the rows of planes that cut
        each cell besides, shape (m, 4): unit normals, and distances [m] from the site.
    """
    frame = Frame.of(domain)
    reach, none = reach.copy(), (np.zeros(len(sites) + 1, dtype=np.int64), np.empty((0, 4)))
    for _ in range(_TRIES):
        near = _surroundings(domain, sites, reach)
        offsets, planes = none if cuts is None else cuts(reach)
        further = offsets, planes * np.array([1.0, 1.0, 1.0, 1 / frame.scale])
        ellipsoids = frame.inward(sites), weights / frame.scale**2, forms
        found = cells_between(frame.kernel, ellipsoids, near, further, tolerance=frame.merge_tolerance)
        shapes = replace(found.shapes, vertices=found.shapes.vertices * frame.scale)
        extent = _extents(shapes)
        is_short = (extent > reach).any(axis=1) | ~found.is_sound
        if not is_short.any():
            codes = found.codes.astype(np.int64)
            shifts = np.column_stack([codes // 9 - 1, codes // 3 % 3 - 1, codes % 3 - 1]).astype(np.int8)
            return Tessellation(domain, sites, weights, shapes, found.neighbors, shifts), 1.1 * extent + 0.05 * reach
        reach = np.where(found.is_sound[:, None], np.maximum(reach, 1.05 * extent), 1.4 * reach)
    raise InputError("cells of these forms cannot be told apart: ask for more grains, or ratios nearer to one")


def _extents(shapes: Polyhedra) -> Floats:
    """Return the largest coordinate [m] of each shape along each axis, of either sign, shape (n, 3)."""
    extent = np.zeros((len(shapes), 3))
    filled = np.flatnonzero(np.diff(shapes.vertex_offsets))
    if filled.size:
        extent[filled] = np.maximum.reduceat(np.abs(shapes.vertices), shapes.vertex_offsets[filled], axis=0)
    return extent


def _surroundings(
    domain: Domain, sites: Floats, reach: Floats
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return what may bound each cell: offsets, numbers, the nearest first, and codes of their images."""
    images = near_in(domain, sites - reach, sites + reach)
    pairs, shifts = images.pairs.astype(np.int64), images.shifts.astype(np.int64)
    if (np.abs(shifts) > 1).any():
        raise InputError("the domain is too short along an axis that wraps: ask for more grains, or a larger domain")
    first, second = np.concatenate([pairs, pairs[:, ::-1]]).T
    shifts = np.concatenate([shifts, -shifts])
    away = sites[second] + shifts * domain.lengths - sites[first]
    order = np.lexsort([second, (away * away).sum(axis=1), first])
    codes = (shifts[:, 0] + 1) * 9 + (shifts[:, 1] + 1) * 3 + shifts[:, 2] + 1
    return offsets_from_counts(np.bincount(first, minlength=len(sites))), second[order], codes[order]
