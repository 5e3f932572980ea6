"""Smaller grains in place (porosity), and the whole packing in another size (units)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from grainsdem.errors import InputError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.clipping import box_planes, solid_volume
from grainsdem.geometry.forms.sizes import grain_diameters, weighted_percentiles
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model.arrays import LONGEST, SHORTEST
from grainsdem.packing.inset import OUT, set_apart, slacks
from grainsdem.ragged import owners, sum_rows
from grainsdem.roots import cube_roots, raised

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

About = Literal["centroid", "seed", "vertex_mean"]
Region: TypeAlias = 'Literal["cells", "domain"] | tuple[ArrayLike, ArrayLike]'


@gated
def shrink(
    packing: Packing,
    *,
    scale: float | None = None,
    porosity: float | None = None,
    solid_fraction: float | None = None,
    void_ratio: float | None = None,
    gap: float | None = None,
    about: About | ArrayLike = "centroid",
    region: Region = "cells",
) -> Packing:
    """Return the packing with every grain made smaller in its cell: scaled by one factor for all, or inset to a gap.

    Parameters
    ----------
    packing : Packing
        Grains in place, fresh from `carve` or shrunk before.
    scale : float
        Linear factor F of the paper's equation 5, in (0, 1]: volume changes by F³, measured from the grains as
        they are.
    porosity, solid_fraction, void_ratio : float
        Void fraction of the region in [0, 1), one minus that, or volume of void over volume of solid, zero or more:
        reached exactly.
    gap : float
        Distance [m] between the faces of neighbours, zero or more, the same everywhere: every face is moved inward to
        half of it from the plane of its cell, walls included. Shapes change: faces and edges vanish, and small grains
        lose more of their volume than large ones. Give one of the five.
    about : {"centroid", "seed", "vertex_mean"} or array_like, shape (n, 3)
        What each grain is scaled about: its centroid, the seed of its cell, the mean of its vertices as the paper
        has it, or a point [m] of your own inside its cell.
    region : {"cells", "domain"} or tuple of two array_like, shape (3,)
        What the porosity is of: the union of the cells that the grains grew in, the whole domain, or the box between
        two corners [m].

    Returns
    -------
    Packing
        Same grains and neighbours, smaller shapes; their centroids move where they shrink about another point.

    Raises
    ------
    InputError
        If not exactly one of the five is given, it is out of range, the porosity or gap asked for would need grains
        larger than they are, a grain would shrink about a point outside its cell, or it would vanish by the gap.

    Notes
    -----
    Every point x of a grain moves to F x + (1 - F) c, within the hull of grain and centre, which its convex cell
    holds: no overlap. The union of the kept cells has the volume Σ V_cell, so its porosity is 1 - F³ Σ V / Σ V_cell,
    and F follows in closed form; F² in a planar bed, whose prisms shrink in the plane only. In a box, F is the root of
    the exact volume that the box cuts out of the grains.
    """
    given = {
        "scale": scale,
        "porosity": porosity,
        "solid_fraction": solid_fraction,
        "void_ratio": void_ratio,
        "gap": gap,
    }
    known = [name for name, value in given.items() if value is not None]
    if len(known) != 1:
        got = ", ".join(f"{name}={given[name]}" for name in known) or "none"
        raise InputError(f"give one of scale, porosity, solid_fraction, void_ratio and gap; got {got}")
    if gap is not None:
        _refuse_unused(about, region)
        return set_apart(packing, gap).with_step("shrink", gap=float(gap))
    arms = _arms(packing, about)
    if scale is None:
        scale = _scale_for(packing, arms, _porosity(known[0], given[known[0]]), region)
    if not 0 < scale <= 1:
        raise InputError(f"scale must lie in (0, 1]; got {scale}")
    options = {name: float(value) for name, value in given.items() if value is not None and name != "scale"}
    named = about if isinstance(about, str) else "points"
    return _scaled(packing, arms, scale).with_step("shrink", scale=float(scale), about=named, **options)


def _refuse_unused(about: About | ArrayLike, region: Region) -> None:
    """Raise `InputError` where options of scaling are given beside a gap."""
    if not isinstance(about, str) or about != "centroid":
        raise InputError("a gap moves faces, not vertices about a point: leave out about")
    if not isinstance(region, str) or region != "cells":
        raise InputError("a gap is the same in every region: leave out region")


def _porosity(name: str, value: float | None) -> float:
    """Return the porosity that one of the measures of void stands for."""
    value = np.nan if value is None else float(value)
    if name == "void_ratio":
        if not (value >= 0 and np.isfinite(value)):
            raise InputError(f"void_ratio must be zero or more and finite; got {value}")
        return value / (1 + value)
    if name == "solid_fraction":
        if not 0 < value <= 1:
            raise InputError(f"solid_fraction must lie in (0, 1]; got {value}")
        return 1 - value
    if not 0 <= value < 1:
        raise InputError(f"porosity must lie in [0, 1); got {value}")
    return value


def _arms(packing: Packing, about: About | ArrayLike) -> Floats:
    """Return the vectors [m] from the centroids to the points that grains shrink about, shape (n, 3)."""
    n = len(packing)
    if isinstance(about, str):
        if about == "centroid":
            return np.zeros((n, 3))
        if about == "vertex_mean":
            grains = packing.grains
            means = sum_rows(grains.vertices, grains.vertex_offsets) / np.diff(grains.vertex_offsets)[:, None]
            return _in_plane(packing, np.einsum("nij,nj->ni", to_matrices(packing.quaternions), means))
        if about != "seed":
            raise InputError(f"about must be 'centroid', 'seed', 'vertex_mean' or points, shape (n, 3); got {about!r}")
        if packing.links is None or packing.links.sites is None:
            raise InputError("the packing does not know its seeds; carve it again, or give them as points: about=seeds")
        arms = packing.links.sites - packing.positions
    else:
        points = np.asarray(about, dtype=np.float64)
        if points.shape != (n, 3) or not np.isfinite(points).all():
            raise InputError(f"about must be {n} finite points, shape ({n}, 3); got shape {points.shape}")
        arms = points - packing.positions
    arms = _in_plane(packing, arms)
    _refuse_outside(packing, arms)
    return arms


def _in_plane(packing: Packing, arms: Floats) -> Floats:
    return arms * [1.0, 1.0, 0.0] if packing.domain.is_planar else arms


def _refuse_outside(packing: Packing, arms: Floats) -> None:
    """Raise `InputError` where a centre lies outside the cell of its grain, or the grain where cells are unknown."""
    beyond = slacks(packing, cells=True)
    owner = owners(packing.grains.face_offsets)
    out = np.einsum("fi,fi->f", beyond.normals, arms[owner]) - beyond.distances
    bad = np.unique(owner[out > OUT * cube_roots(volumes(packing.grains))[owner]])
    if bad.size:
        raise InputError(
            f"grains can shrink only about points in their own cells; {bad.size} of {len(packing)} lie outside: "
            f"{name_offenders(bad)}"
        )


def _scaled(packing: Packing, arms: Floats, scale: float) -> Packing:
    """Return the grains scaled about their centroids plus ``arms``."""
    grains, links = packing.grains, packing.links
    factor = np.array([scale, scale, 1.0]) if packing.domain.is_planar else np.full(3, scale)
    if links is not None and links.rooms is not None:
        links = replace(links, rooms=links.rooms * scale)
    return replace(
        packing,
        grains=replace(grains, vertices=grains.vertices * factor),
        positions=packing.positions + (1 - scale) * arms,
        links=links,
    )


def _scale_for(packing: Packing, arms: Floats, porosity: float, region: Region) -> float:
    if isinstance(region, str) and region == "cells":
        if packing.links is None:
            raise InputError("porosity can be set only while grains are in the cells they grew in; use scale")
        ratio = (1 - porosity) * packing.links.cell_volumes.sum() / volumes(packing.grains).sum()
        _refuse_growth(ratio, porosity)
        power = 2 if packing.domain.is_planar else 3
        return float(min(ratio, 1.0) ** (1 / power))
    return _scale_in(packing, arms, porosity, *_bounds(packing, region))


def _bounds(packing: Packing, region: Region) -> tuple[Floats, float]:
    """Return the planes of a region, and its volume [m³]."""
    domain = packing.domain
    if isinstance(region, str):
        if region != "domain":
            raise InputError(f"region must be 'cells', 'domain' or the two corners of a box; got {region!r}")
        return np.vstack([box_planes(domain.lower, domain.upper), domain.planes]), domain.volume
    try:
        lower, upper = (np.asarray(corner, dtype=np.float64) for corner in region)
    except (TypeError, ValueError) as error:
        raise InputError(f"region must be 'cells', 'domain' or the two corners of a box; got {region!r}") from error
    planes = box_planes(lower, upper)
    return planes, float(np.prod(upper - lower))


def _scale_in(packing: Packing, arms: Floats, porosity: float, planes: Floats, volume: float) -> float:
    """Return the factor at which the grains leave the porosity inside half-spaces of the given volume."""
    from scipy.optimize import brentq  # noqa: PLC0415  (a tenth of a second, and only for boxes)

    wanted = (1 - porosity) * volume
    now = solid_volume(packing, planes)
    _refuse_growth(wanted / now if now > 0 else np.inf, porosity)
    if wanted >= now:
        return 1.0

    def excess(scale: float) -> float:
        return solid_volume(_scaled(packing, arms, scale), planes) - wanted

    # Below this factor all grains together are smaller than what is wanted in the box.
    power = 2 if packing.domain.is_planar else 3
    least = 0.5 * float((wanted / volumes(packing.grains).sum()) ** (1 / power))
    least = min(least, 0.5)
    return float(brentq(excess, least, 1.0, xtol=1e-15, rtol=4 * np.finfo(float).eps))


def _refuse_growth(ratio: float, porosity: float) -> None:
    """Raise `InputError` where grains would have to grow by ``ratio`` in volume."""
    # 1e-12: asking again for the porosity that the packing has must not fail by rounding.
    if ratio > 1 + 1e-12:
        now = 1 - (1 - porosity) / ratio
        raise InputError(f"porosity can only grow: the packing has {now:.6g} already; got {porosity}")


@gated
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
    if not SHORTEST <= factor <= LONGEST:
        raise InputError(f"factor must be positive and finite, {SHORTEST:g} to {LONGEST:g}; got {factor}")
    links = packing.links
    return replace(
        packing,
        grains=replace(packing.grains, vertices=packing.grains.vertices * factor),
        positions=packing.positions * factor,
        domain=packing.domain.scaled(factor),
        links=None if links is None else links.scaled(factor),
    ).with_step("rescale", factor=float(factor))


@gated
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


@gated
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
