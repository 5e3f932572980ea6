"""Cells whose sizes are a function of place."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.memory import A_CELL, allow_memory
from grainsdem.roots import raised
from grainsdem.tessellation.sized import sized_cells

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain, Tessellation

    Floats = NDArray[np.float64]

STEPS = 48
"""Places along each axis at which sizes are asked for before there are seeds."""

STEEPEST = 20.0
"""Largest ratio of two sizes: of more there are thousands of small grains for a large one."""

_AGAIN = 2
"""Times that sizes are asked for anew where the seeds have come to lie."""


class PlacedCells(NamedTuple):
    """Cells, and the sizes that were asked of them.

    Parameters
    ----------
    cells : Tessellation
        The cells; they fill the domain, so that they have the sizes up to one factor.
    diameters : ndarray, shape (n,)
        Equal-volume diameter [m] of the grain of each.
    """

    cells: Tessellation
    diameters: Floats


@gated
def placed_cells(
    domain: Domain,
    size: Callable[[Floats, Floats, Floats], ArrayLike],
    *,
    n: int,
    tolerance: float = 0.01,
    relaxations: int = 5,
    rng: np.random.Generator | int | None = None,
) -> PlacedCells:
    """Return Laguerre cells whose sizes are a function of place.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    size : callable
        Takes x, y and z [m], shape (m,) each, and returns the equal-volume diameter [m] of a grain there, shape (m,) or
        one for all; in a planar domain that of the circle of its area. Only ratios count: cells fill the domain.
    n : int
        Number of cells: there are more where they are smaller.
    tolerance, relaxations, rng
        See `sized_cells`.

    Raises
    ------
    InputError
        If a size is not positive and finite, sizes differ by more than 20 to 1, or a value is out of range.
    ConvergenceError
        If the volumes do not come within the tolerance.

    Examples
    --------
    >>> bed = placed_cells(Domain.cube(), lambda x, y, z: 1 + 2 * z * z, n=500, rng=1)  # doctest: +SKIP
    """
    if n < 1:
        raise InputError(f"the number of cells must be 1 or more; got {n}")
    allow_memory(n, A_CELL, "cells")
    generator = np.random.default_rng(rng)
    seeds = _seeds(domain, size, n, generator)
    for left in range(_AGAIN, 0, -1):
        diameters = _sizes(size, seeds)
        cells = sized_cells(
            domain,
            diameters,
            seeds=seeds,
            tolerance=tolerance,
            relaxations=relaxations if left > 1 else 0,
            rng=generator,
        )
        seeds = cells.sites
    return PlacedCells(cells, diameters)


def _seeds(domain: Domain, size: Callable[..., ArrayLike], n: int, rng: np.random.Generator) -> Floats:
    """Return n seeds [m] at random, as many a volume as grains of the sizes there fill it, shape (n, 3)."""
    steps = (STEPS, STEPS, 1 if domain.is_planar else STEPS)
    step = domain.lengths / np.array(steps)
    corners = domain.lower + np.indices(steps).reshape(3, -1).T * step
    # A lattice's cell that a plane cuts holds places of the domain where its middle lies in it.
    corners = corners[domain.contains(corners + 0.5 * step)]
    weights = 1 / raised(_sizes(size, corners + 0.5 * step), 2 if domain.is_planar else 3)
    ends = np.cumsum(weights)
    chosen = np.searchsorted(ends / ends[-1], rng.random(n), side="right")
    within = rng.random((n, 3))
    if domain.is_planar:
        within[:, 2] = 0.5
    found = corners[np.minimum(chosen, len(corners) - 1)] + within * step
    out = ~domain.contains(found)
    found[out] = corners[np.minimum(chosen[out], len(corners) - 1)] + 0.5 * step
    return np.asarray(found)


def _sizes(size: Callable[..., ArrayLike], points: Floats) -> Floats:
    """Return the sizes [m] at points, checked."""
    given = np.asarray(size(points[:, 0], points[:, 1], points[:, 2]), dtype=np.float64)
    if given.shape not in ((), (len(points),)):
        raise ShapeError(f"size returns one number for each of {len(points)} places; got shape {given.shape}")
    sizes = np.broadcast_to(given, (len(points),))
    if not (np.isfinite(sizes).all() and (sizes > 0).all()):
        raise InputError(f"sizes must be positive and finite everywhere; got {float(sizes.min())}")
    if sizes.max() > STEEPEST * sizes.min():
        raise InputError(
            f"sizes differ by {STEEPEST:g} to 1 at most; got {float(sizes.min()):g} to {float(sizes.max()):g}"
        )
    return np.array(sizes)
