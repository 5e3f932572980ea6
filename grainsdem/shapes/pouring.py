"""Grains of any shapes laid out loose, none overlapping: what is poured."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import sphere_diameters
from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.geometry.loose import Arrivals, admit, as_bodies
from grainsdem.geometry.rotations import identity_quaternions, random_quaternions
from grainsdem.geometry.selection import select
from grainsdem.memory import A_CELL, allow_memory
from grainsdem.model import QUARTZ_DENSITY, Domain, Grading, Packing
from grainsdem.shapes.mixing import dealt, diameters_of, kinds_of, of_grading, shares_of
from grainsdem.shapes.sizing import scaled

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Polyhedra
    from grainsdem.shapes.mixing import Law
    from grainsdem.shapes.scans import Scans

    Floats = NDArray[np.float64]

SOLID_FRACTION = 0.3
"""Solid fraction of what is laid out: random places without overlap run out at about a third."""

_GAP = 1e-3
"""Smallest distance of grains and to walls, relative to the smallest diameter: apart in any file's single precision."""

_PATIENCE = 200
"""Places that a grain is offered until the lid is raised."""

_RAISE = 1.02
"""How much higher the lid gets then."""

_BATCH = 20_000
"""Places that are drawn at once."""

_DENSEST = 0.6
"""Solid fraction that no random places reach."""

_NARROWEST = 4.0
"""Least width of a box that is made for the grains, in diameters of the sphere around the largest."""

_RAISES = 300
"""How often in a row the lid is raised for one grain: the box is then four hundred times as high."""


@gated
def pack(
    shapes: Polyhedra | Scans | Sequence[Polyhedra | Scans],
    sizes: ArrayLike | Law | Grading,
    domain: Domain | None = None,
    *,
    n: int | None = None,
    shares: ArrayLike | None = None,
    by: Literal["number", "mass"] = "number",
    density: ArrayLike = QUARTZ_DENSITY,
    solid_fraction: float = SOLID_FRACTION,
    higher: bool = True,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Packing:
    """Return grains of given shapes and sizes at random places and rotations, none overlapping: ready to be poured.

    Parameters
    ----------
    shapes : Polyhedra, Scans, or a sequence of them
        Convex shapes of any size. Of a sequence each entry is one kind: of an entry of many shapes every grain of that
        kind has one, drawn at random. Of a single set of shapes each shape is a kind.
    sizes : float, array_like, shape (n,), a law or a Grading
        Diameter [m] of the sphere of each grain's volume; or one for all, or a distribution with quantiles (``ppf``, as
        those of `scipy.stats` have) that ``n`` grains take at equal steps of probability; or a curve of percent passing
        by mass that ``n`` grains have, of square holes that they pass or of equal-volume diameters.
    domain : Domain, optional
        What they are poured into: they fill it from the floor. By default a box as wide as high, and no narrower than
        four of the largest grain.
    n : int, optional
        Number of grains, where sizes do not tell.
    shares : array_like, shape (n_kinds,), optional
        Shares of the kinds, of any sum; equal by default.
    by : {"number", "mass"}
        What they are shares of.
    density : array_like, shape () or (n_kinds,)
        Density [kg/m³] of all grains, or of each kind.
    solid_fraction : float
        Of the part of the domain that is filled, at most, in (0, 0.6): where random places run out before, as they do
        for rods, flakes and tetrahedra, it is filled higher.
    higher : bool
        Whether the domain may be made higher than it is. Otherwise what does not fit is refused.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called with the number of grains in place and of all.

    Returns
    -------
    Packing
        Grains in the order of the sizes, their kinds as `Packing.classes`, no nearer to one another or to a wall than a
        thousandth of the smallest diameter. The domain has the floor and walls of the one given, and reaches at least
        as high as the grains do.

    Raises
    ------
    InputError
        If a value is out of range, a shape is not convex, the grains do not fit into a domain that may not be made
        higher, or the largest finds no place between the walls.

    Notes
    -----
    From the largest to the smallest each grain is offered random places and rotations, and pushed away from what is in
    its way there, until it is free. The shapes themselves decide, not spheres around them.
    """
    generator = np.random.default_rng(rng)
    if n is not None:
        allow_memory(n, A_CELL, "grains")
    kinds = kinds_of(shapes)
    densities = np.asarray(density, dtype=np.float64)
    if densities.shape not in ((), (len(kinds),)):
        raise ShapeError(f"density must be one number, or one for each of {len(kinds)} kinds; got {densities.shape}")
    if not (np.isfinite(densities).all() and (densities > 0).all()):
        raise InputError(f"density must be positive and finite; got {densities.tolist()}")
    densities = np.broadcast_to(densities, len(kinds))
    asked = shares_of(shares, len(kinds))
    if isinstance(sizes, Grading):
        if n is None:
            raise InputError("a grading needs the number of grains, n")
        diameters, kind_of, shape_of = of_grading(
            sizes, kinds, n, shares=asked, densities=densities, by=by, rng=generator
        )
    else:
        diameters = diameters_of(sizes, n, generator)
        kind_of = dealt(diameters, asked, densities, by, generator)
        counts = np.diff(kinds.offsets)[kind_of]
        shape_of = kinds.offsets[kind_of] + (generator.random(diameters.size) * counts).astype(np.int64)
    grains = scaled(select(kinds.shapes, shape_of)[0], diameters)
    room = _Room(domain, solid_fraction, higher)
    arrivals, box = room.filled_with(grains, diameters, generator, progress)
    return Packing(
        grains, arrivals.positions, arrivals.quaternions, densities[kind_of], box, classes=kind_of.astype(np.int32)
    ).with_step("pack", n_grains=len(grains), n_kinds=len(kinds), by=by, solid_fraction=solid_fraction)


@gated
def scatter(
    packing: Packing,
    *,
    domain: Domain | None = None,
    solid_fraction: float = SOLID_FRACTION,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Packing:
    """Return the grains of a bed at random places and rotations, none overlapping: ready to be poured.

    Parameters
    ----------
    packing : Packing
        Convex grains in space; each keeps its shape, density, friction and class.
    domain : Domain, optional
        What they are poured into, made higher where they need it; by default the packing's own.
    solid_fraction : float
        Of the part of the domain that is filled, at most, in (0, 0.6).
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called with the number of grains in place and of all.

    Returns
    -------
    Packing
        Grains in their order, no nearer to one another or to a wall than a thousandth of the smallest diameter.

    Raises
    ------
    InputError
        As `pack` does.

    Notes
    -----
    `shuffle` lifts grains onto a lattice with room for the largest at every place: of sizes 8 : 1 it makes a column a
    hundred times as high as the bed. Here small grains lie between large ones, and the column is twice as high.
    """
    if len(packing) == 0:
        raise InputError("there is nothing to scatter: the packing has no grains")
    sizes = sphere_diameters(volumes(packing.grains))
    room = _Room(packing.domain if domain is None else domain, solid_fraction, higher=True)
    arrivals, box = room.filled_with(packing.grains, sizes, np.random.default_rng(rng), progress)
    return replace(
        packing, positions=arrivals.positions, quaternions=arrivals.quaternions, domain=box, links=None
    ).with_step("scatter", solid_fraction=solid_fraction)


class _Room:
    """What grains are laid out in: a domain, or a box that is made for them."""

    def __init__(self, domain: Domain | None, solid_fraction: float, higher: bool) -> None:
        if not 0 < solid_fraction < _DENSEST:
            raise InputError(f"solid_fraction must lie in (0, {_DENSEST}); got {solid_fraction}")
        self._domain, self._solid_fraction = domain, solid_fraction
        self._is_bound = domain is not None and not higher

    def filled_with(
        self,
        grains: Polyhedra,
        diameters: Floats,
        rng: np.random.Generator,
        progress: Callable[[int, int], None] | None,
    ) -> tuple[Arrivals, Domain]:
        """Return the grains with places, and the domain as high as they reach."""
        content = float(np.pi / 6 * (diameters**3).sum())
        reaches = _reaches(grains)
        most, fraction = float(reaches[0].max()), self._solid_fraction
        box = _box_for(content, fraction, most) if self._domain is None else _checked(self._domain, most)
        arrivals = _arranged(grains, reaches, box, _GAP * diameters.min())
        lid = _filled(arrivals, box, content, fraction, is_bound=self._is_bound, rng=rng, progress=progress)
        top = np.append(box.upper[:2], lid if self._domain is None else max(lid, box.upper[2]))
        return arrivals, Domain(box.lower, top, box.periodic, planes=box.planes)


def _reaches(grains: Polyhedra) -> tuple[Floats, Floats]:
    """Return the radii [m] of the spheres about each centroid around the grain, and in it."""
    squares = (grains.vertices**2).sum(axis=1)
    outer = np.sqrt(np.maximum.reduceat(squares, grains.vertex_offsets[:-1]))
    inner = np.minimum.reduceat(face_planes(grains).heights, grains.face_offsets[:-1])
    return outer, inner


def _box_for(content: float, solid_fraction: float, reach: float) -> Domain:
    """Return a box for so much volume [m³], as wide as high where the largest grain's reach [m] lets it."""
    side = max(np.cbrt(content / solid_fraction), 2 * _NARROWEST * reach)
    return Domain.box((side, side, side))


def _checked(domain: Domain, reach: float) -> Domain:
    """Return the domain, or raise `InputError` where grains cannot be poured into it."""
    if domain.is_planar:
        raise InputError("shapes are packed in space; the domain is a slab, one grain thick")
    if domain.periodic[2]:
        raise InputError("grains are poured along z, and the domain wraps around along it")
    short = np.flatnonzero(domain.periodic & (domain.lengths < 4 * reach * (1 + _GAP)))
    if short.size:
        raise InputError(
            f"a periodic axis must be twice as long as the largest grain, which may reach {2 * reach:.4g} m; "
            f"{'xyz'[short[0]]} is {domain.lengths[short[0]]:.4g} m"
        )
    return domain


def _arranged(grains: Polyhedra, reaches: tuple[Floats, Floats], box: Domain, gap: float) -> Arrivals:
    """Return the grains, the largest first, before any has a place."""
    outer, inner = reaches
    n, most = len(grains), float(outer.max())
    levels = np.floor(np.log2(most / outer)).astype(np.int64)
    # Twice the largest reach of each size.
    cells = np.repeat(2 * most * 0.5 ** np.arange(levels.max() + 1)[:, None], 3, axis=1)
    counts = np.where(box.periodic, np.floor(box.lengths / cells), 0).astype(np.int64)
    cells = np.where(counts > 0, box.lengths / np.maximum(counts, 1), cells)
    return Arrivals(
        vertices=np.array(grains.vertices),
        turned=np.array(grains.vertices),
        ranges=np.column_stack([grains.vertex_offsets[:-1], grains.vertex_offsets[1:]]),
        outer=outer,
        inner=inner,
        order=np.argsort(-outer, kind="stable"),
        positions=np.zeros((n, 3)),
        quaternions=identity_quaternions(n),
        levels=levels,
        cells=cells,
        counts=counts,
        heads=np.full(1 << (2 * n).bit_length(), -1, dtype=np.int64),
        links=np.full(n, -1, dtype=np.int64),
        lower=np.array(box.lower),
        upper=np.array(box.upper),
        planes=np.array(box.planes),
        gap=float(gap),
    )


def _filled(
    arrivals: Arrivals,
    box: Domain,
    content: float,
    solid_fraction: float,
    *,
    is_bound: bool,
    rng: np.random.Generator,
    progress: Callable[[int, int], None] | None,
) -> float:
    """Give every grain its place, and return how high [m] the box is filled."""
    floor, ceiling = float(box.lower[2]), float(box.upper[2])
    # Planes are taken to leave the same share of the box at every height: where they leave less, the lid is raised.
    area = box.volume / (ceiling - floor)
    height = max(content / (solid_fraction * area), 2 * float(arrivals.outer.max()))
    n, done, tries, raises = arrivals.order.size, 0, 0, 0
    solids = as_bodies(arrivals)
    while done < n:
        if is_bound and floor + height > ceiling:
            raise InputError(_too_much(content, area, height, ceiling - floor, solid_fraction))
        arrivals.upper[2] = floor + height
        before = done
        done, tries = admit(
            arrivals, solids, done, tries, _PATIENCE, rng.random((_BATCH, 3)), random_quaternions(_BATCH, rng)
        )
        if progress is not None:
            progress(done, n)
        raises = 0 if done > before else raises
        if tries >= _PATIENCE:
            if raises >= _RAISES:
                raise InputError(
                    f"a grain that reaches {2 * arrivals.outer[arrivals.order[done]]:.4g} m finds no place between "
                    f"walls {' and '.join(f'{length:.4g}' for length in box.lengths[:2])} m apart"
                )
            height, tries, raises = height * _RAISE, 0, raises + 1
    return floor + height


def _too_much(content: float, area: float, height: float, room: float, asked: float) -> str:
    fits = min(content / (area * height), asked)
    return (
        f"the grains do not fit: loose, at a solid fraction of {fits:.3f}, they take {height:.4g} m of height, and the "
        f"domain is {room:.4g} m high, for {fits * area * room / content:.0%} of them; give fewer or higher=True"
    )
