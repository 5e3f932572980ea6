"""What the sections of a bed are in the mean over all planes, from its grains in space."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import above_zero
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.raster.slicing import mean_widths
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


@gated
def widths(packing: Packing, direction: ArrayLike) -> Floats:
    """Return the width [m] of each grain along a direction: the distance of the planes that hold it, shape (n,).

    Parameters
    ----------
    packing : Packing
        Any packing.
    direction : array_like, shape (3,)
        Of any length but zero.

    Raises
    ------
    InputError
        If the direction is not finite or has no length.
    """
    unit = np.asarray(direction, dtype=np.float64)
    if unit.shape != (3,) or not np.isfinite(unit).all() or not unit.any():
        raise InputError(f"a direction is three finite numbers, not all zero; got {unit.tolist()}")
    if len(packing) == 0:
        return np.empty(0)
    heights = world_vertices(packing) @ (unit / np.linalg.norm(unit))
    starts = packing.grains.vertex_offsets[:-1]
    return np.maximum.reduceat(heights, starts) - np.minimum.reduceat(heights, starts)


@gated
def expected_section(packing: Packing, *, normal: ArrayLike | None = None) -> dict[str, float]:
    """Return what a section is in the mean over all planes that meet the domain.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap, all of them within the domain or its periodic images.
    normal : array_like, shape (3,), optional
        Normal of the planes; by default planes of all directions, each alike.

    Returns
    -------
    dict
        ``area_fraction`` = V_V, the solid fraction of the domain (Delesse); ``n_per_area`` = N_V w [m⁻²], w the mean
        width of a grain, along the normal or over all directions (DeHoff and Rhines); ``mean_area`` [m²] of a polygon,
        the mean volume of a grain over w.

    Raises
    ------
    InputError
        If there is no grain, one's volume is not above zero, or the normal is none.
    """
    if len(packing) == 0:
        raise InputError("sections need at least one grain; the packing has none")
    solid = float(above_zero(volumes(packing)).sum())
    width = float((mean_widths(packing) if normal is None else widths(packing, normal)).sum())
    volume = packing.domain.volume
    return {"area_fraction": solid / volume, "n_per_area": width / volume, "mean_area": solid / width}
