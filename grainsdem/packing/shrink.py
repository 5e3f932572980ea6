"""Smaller grains in place (porosity), and the whole packing in another size (units)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import CellLinks, Packing


def shrink(packing: Packing, *, scale: float | None = None, porosity: float | None = None) -> Packing:
    """Return the packing with every grain scaled about its own centroid.

    Parameters
    ----------
    packing : Packing
        Grains in place, fresh from `carve` or shrunk before.
    scale : float
        Linear factor F of the paper's equation 5, in (0, 1]: volume changes by F³, measured from the grains as
        they are.
    porosity : float
        Void fraction of the region that the grains' own cells fill, in [0, 1), reached exactly. Give this or ``scale``.

    Returns
    -------
    Packing
        Same grains, positions and neighbours, smaller shapes.

    Raises
    ------
    InputError
        If not exactly one of the two is given, it is out of range, or the porosity asked for would need grains larger
        than their cells.

    Notes
    -----
    The union of the kept cells has the volume Σ V_cell, so the porosity after scaling by F is
    1 − F³ Σ V / Σ V_cell, and F follows in closed form.
    """
    if (scale is None) == (porosity is None):
        raise InputError(f"give either scale or porosity; got scale={scale}, porosity={porosity}")
    if scale is None:
        scale = _scale_for(packing, porosity)
    if not 0 < scale <= 1:
        raise InputError(f"scale must lie in (0, 1]; got {scale}")
    grains = packing.grains
    planar = packing.domain.is_planar
    factor = np.array([scale, scale, 1.0]) if planar else np.full(3, scale)
    return replace(packing, grains=replace(grains, vertices=grains.vertices * factor)).with_step(
        "shrink", scale=float(scale), porosity=porosity
    )


def _scale_for(packing: Packing, porosity: float | None) -> float:
    if porosity is None or not 0 <= porosity < 1:
        raise InputError(f"porosity must lie in [0, 1); got {porosity}")
    if packing.links is None:
        raise InputError("porosity can be set only while grains are in the cells they grew in; use scale")
    ratio = (1 - porosity) * packing.links.cell_volumes.sum() / volumes(packing.grains).sum()
    # 1e-12: asking again for the porosity that the packing has must not fail by rounding.
    if ratio > 1 + 1e-12:
        now = 1 - (1 - porosity) / ratio
        raise InputError(f"porosity can only grow: the packing has {now:.6g} already; got {porosity}")
    power = 2 if packing.domain.is_planar else 3
    return float(min(ratio, 1.0) ** (1 / power))


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
        links=None if links is None else CellLinks(links.neighbors, links.shifts, links.cell_volumes * factor**3),
    ).with_step("rescale", factor=float(factor))
