"""How much of a region is void, and which region inside a bed is free of its walls."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.clipping import box_planes, solid_volume
from grainsdem.geometry.forms.sizes import above_zero, grain_diameters
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Box = tuple[NDArray[np.float64], NDArray[np.float64]]

SURFACE_PERCENTILE = 10.0
"""Share of columns [%] whose top may lie below the surface of a bed: a few pits, or a heap's foot."""

COLUMN_WIDTH = 1.0
"""Width of the columns that the surface is looked for in, in mean diameters: wide enough to hold a grain."""


@gated
def porosity(packing: Packing, *, region: Literal["cells", "domain"] | tuple[ArrayLike, ArrayLike] = "cells") -> float:
    """Return the void fraction of a region.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap.
    region : {"cells", "domain"} or tuple of two array_like, shape (3,)
        ``"cells"``: the union of the cells that the grains grew in. ``"domain"``: the whole container. Or
        the lower and upper corner [m] of a box, `core_box` for one.

    Returns
    -------
    float
        1 - (solid volume inside) / (volume), exact: grains that cross the region's border count with the
        part inside, and across periodic faces with their images.

    Raises
    ------
    InputError
        If a grain's volume is not above zero, ``"cells"`` is asked for after the grains left their cells, the box is
        none, or it reaches out of a periodic axis.
    """
    if isinstance(region, str):
        if region == "cells":
            return _of_cells(packing)
        if region == "domain":
            domain = packing.domain
            planes = np.vstack([box_planes(domain.lower, domain.upper), domain.planes])
            return float(1 - solid_volume(packing, planes) / domain.volume)
        raise InputError(f"region must be 'cells', 'domain' or the two corners of a box; got {region!r}")
    try:
        lower, upper = (np.asarray(corner, dtype=np.float64) for corner in region)
    except (TypeError, ValueError) as error:
        raise InputError(f"region must be 'cells', 'domain' or the two corners of a box; got {region!r}") from error
    return _of_box(packing, lower, upper)


@gated
def core_box(packing: Packing, *, margin: float = 1.0) -> Box:
    """Return a box inside a bed, away from walls, floor and free surface.

    Parameters
    ----------
    packing : Packing
        A bed that lies on the floor of its domain.
    margin : float
        Distance from walls, floor and surface in mean equal-volume diameters, zero or more. Flat walls order
        the grains beside them: porosity is higher within about one diameter.

    Returns
    -------
    lower, upper : ndarray, shape (3,)
        Corners [m]. Along a periodic axis the box takes the whole domain.

    Raises
    ------
    InputError
        If there are no grains, ``margin`` is negative, or the box would be thinner than one diameter.

    Notes
    -----
    In a domain cut by planes, a cylinder or a hopper, the box is narrowed in x and y until its corners keep that
    distance from them too.

    The floor's area is parted into columns about one diameter wide. Each column's top is its highest vertex, and the
    surface is the tenth percentile of the tops: a grain that lies alone on the bed lifts one column and changes
    nothing, and the box stays below all but the deepest pits. Wider columns would each find one of the highest grains
    of the surface, and put the surface where a bed is half empty already.
    """
    if not 0 <= margin < np.inf:
        raise InputError(f"margin must be zero or more and finite; got {margin}")
    if len(packing) == 0:
        raise InputError("a core needs a bed; the packing has no grains")
    domain = packing.domain
    d = float(grain_diameters(packing.grains).mean())
    inset = np.where(domain.periodic, 0.0, margin * d)
    lower, upper = domain.lower + inset, domain.upper - inset
    _refuse_thin(lower[:2], upper[:2], d, margin)
    lower, upper = _within_planes(packing, lower, upper, margin * d)
    _refuse_thin(lower[:2], upper[:2], d, margin)
    if not domain.periodic[2]:
        upper[2] = _surface(packing, lower[:2], upper[:2], COLUMN_WIDTH * d) - margin * d
    _refuse_thin(lower, upper, d, margin)
    return lower, upper


def _of_cells(packing: Packing) -> float:
    if packing.links is None:
        raise InputError("the grains have left the cells they grew in; give region='domain' or the corners of a box")
    return float(1 - above_zero(volumes(packing)).sum() / packing.links.cell_volumes.sum())


def _of_box(packing: Packing, lower: NDArray[np.float64], upper: NDArray[np.float64]) -> float:
    planes = box_planes(lower, upper)
    domain = packing.domain
    # A millionth of the domain: a corner that came from a file may be rounded.
    slack = 1e-6 * domain.lengths
    outside = domain.periodic & ((lower < domain.lower - slack) | (upper > domain.upper + slack))
    if outside.any():
        raise InputError(
            f"along a periodic axis the box must lie in the domain, {domain.lower.tolist()} to "
            f"{domain.upper.tolist()}; got {lower.tolist()} to {upper.tolist()}"
        )
    return float(1 - solid_volume(packing, planes) / np.prod(upper - lower))


def _within_planes(packing: Packing, lower: NDArray[np.float64], upper: NDArray[np.float64], inset: float) -> Box:
    """Return the box narrowed in x and y about its middle until its part in the bed is off the domain's planes."""
    planes = packing.domain.planes
    if len(planes) == 0:
        return lower, upper
    top = min(float(upper[2]), float(world_vertices(packing)[:, 2].max()))
    low, high = lower.copy(), np.append(upper[:2], max(top, float(lower[2])))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    normals = np.abs(planes[:, :3])
    room = planes[:, 3] - inset - planes[:, :3] @ middle - normals[:, 2] * half[2]
    reach = normals[:, :2] @ half[:2]
    # A level plane does not mind how narrow the box is.
    shares = np.where(reach > 0, room / np.where(reach > 0, reach, 1.0), 1.0)
    half[:2] *= float(np.clip(shares.min(), 0.0, 1.0))
    return np.append(middle[:2] - half[:2], lower[2]), np.append(middle[:2] + half[:2], upper[2])


def _surface(packing: Packing, lower: NDArray[np.float64], upper: NDArray[np.float64], width: float) -> float:
    """Return the height [m] of the free surface over a rectangle of the floor."""
    vertices = world_vertices(packing)
    counts = np.maximum(np.floor((upper - lower) / width), 1).astype(np.int64)
    columns = np.floor((vertices[:, :2] - lower) / (upper - lower) * counts).astype(np.int64)
    inside = ((columns >= 0) & (columns < counts)).all(axis=1)
    # A column without a grain is a pit down to the floor.
    tops = np.full(int(counts.prod()), packing.domain.lower[2])
    np.maximum.at(tops, columns[inside, 0] * counts[1] + columns[inside, 1], vertices[inside, 2])
    return float(np.percentile(tops, SURFACE_PERCENTILE))


def _refuse_thin(lower: NDArray[np.float64], upper: NDArray[np.float64], d: float, margin: float) -> None:
    size = upper - lower
    if (size < d).any():
        raise InputError(
            f"the bed is too small for a core {margin:g} diameters inside it: each edge must be at least "
            f"one mean diameter, {d:.4g} m; got {', '.join(f'{s:.4g}' for s in size)} m"
        )
