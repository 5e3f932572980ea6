"""Whole packings made larger or smaller: in metres, until grains or domain have the size asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.forms.sizes import grain_diameters, weighted_percentiles
from grainsdem.geometry.integrals import volumes
from grainsdem.roots import cube_roots, raised

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing


def rescale(packing: Packing, factor: float) -> Packing:
    """Return the whole packing, domain included, scaled about the origin: another grain size, the same structure.

    Parameters
    ----------
    packing : Packing
        Any packing.
    factor : float
        Ratio of new to old lengths, positive.

    Raises
    ------
    InputError
        If the factor is not positive and finite.
    """
    if not (np.isfinite(factor) and factor > 0):
        raise InputError(f"factor must be positive and finite; got {factor}")
    links = packing.links
    return replace(
        packing,
        grains=replace(packing.grains, vertices=packing.grains.vertices * factor),
        positions=packing.positions * factor,
        domain=packing.domain.scaled(factor),
        links=None if links is None else links.scaled(factor),
    ).with_step("rescale", factor=float(factor))


def resize(
    packing: Packing,
    *,
    mean_diameter: float | None = None,
    median_diameter: float | None = None,
    side: float | None = None,
    diameters: ArrayLike | None = None,
) -> Packing:
    """Return the whole packing in metres: scaled until its grains, or its domain, have the size asked for, exactly.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    mean_diameter : float
        Mean equal-volume diameter [m] by number; of equal area in a planar bed.
    median_diameter : float
        Median diameter [m] by mass.
    side : float
        Length [m] of the domain along x.
    diameters : array_like, shape (n_cells,)
        Diameter [m] of the grain of each cell of the tessellation, as `graded_cells` and `sized_cells` were asked for
        them; of those that were dropped, too. Give one of the four: with the number of grains, which the packing has
        already, the others follow.

    Raises
    ------
    InputError
        If not exactly one is given, or it is not positive and finite; if diameters are given of grains that have left
        their cells.
    """
    given = {"mean_diameter": mean_diameter, "median_diameter": median_diameter, "side": side}
    known = {name: value for name, value in given.items() if value is not None}
    if len(known) + (diameters is not None) != 1:
        told = [f"{name}={value}" for name, value in known.items()] + ["diameters"] * (diameters is not None)
        raise InputError(
            f"give one of mean_diameter, median_diameter, side and diameters; got {', '.join(told) or 'none'}"
        )
    if diameters is not None:
        return rescale(packing, 1 / ratio_to(np.asarray(diameters, dtype=np.float64), packing))
    ((name, wanted),) = known.items()
    if not (np.isfinite(wanted) and wanted > 0):
        raise InputError(f"{name} must be positive and finite; got {wanted}")
    return rescale(packing, wanted / size_of(packing, name))


def size_of(packing: Packing, name: str) -> float:
    """Return the ``mean_diameter``, ``median_diameter`` or ``side`` [m] of a packing."""
    if name == "side":
        return float(packing.domain.lengths[0])
    d = grain_diameters(packing)
    if name == "mean_diameter":
        return float(d.mean())
    return float(weighted_percentiles(d, np.array(50.0), packing.densities * volumes(packing.grains)))


def ratio_to(diameters: NDArray[np.float64], packing: Packing) -> float:
    """Return how many times larger grains are than asked for: the same for all, as their cells fill the domain.

    Parameters
    ----------
    diameters : ndarray, shape (n_cells,)
        Diameters [m] of all cells' grains, those included that were dropped.
    packing : Packing
        The grains, scaled in their cells.

    Raises
    ------
    InputError
        If the grains have left their cells, or a diameter is not positive and finite.

    Notes
    -----
    Cells of the total volume V have V d_i³ / Σ d³ each, and grains the same share of their cells.
    """
    if packing.links is None:
        raise InputError("the grains have left the cells that were sized")
    if not (diameters.size and np.isfinite(diameters).all() and (diameters > 0).all()):
        raise InputError(f"diameters must be positive and finite; got {np.asarray(diameters).min(initial=np.inf)}")
    share = volumes(packing.grains).sum() / packing.links.cell_volumes.sum()
    domain = packing.domain
    if domain.is_planar:
        return float(np.sqrt(4 / np.pi * share * domain.volume / domain.lengths[2] / (diameters**2).sum()))
    return float(cube_roots(6 / np.pi * share * domain.volume / raised(diameters, 3).sum()))
