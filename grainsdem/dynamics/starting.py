"""How a run begins: grains where they stand, poured or rained, of other materials, or as spheres of equal volume."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exporters.check import check_choice
from grainsdem.errors import InputError, name_offenders, shown
from grainsdem.gate import gated
from grainsdem.geometry.integrals import volumes
from grainsdem.measures import diameters
from grainsdem.model import Domain, Polyhedra
from grainsdem.packing import shuffle
from grainsdem.shapes import scatter

if TYPE_CHECKING:
    from grainsdem.model import Packing

Floats = NDArray[np.float64]

PerGrain: TypeAlias = float | Mapping[float, float] | Callable[[Floats], ArrayLike]
"""One number for all grains, several and their shares by number, or a function of the diameters [m]."""

Start = Literal["place", "pour", "rain", "scatter"]
"""``place``: where the grains stand, a jigsaw denser than any random pack. ``pour``: rotated, reordered, lifted apart,
and let go at once. ``rain``: the same, but let go layer by layer as they come down at a steady speed. ``scatter``:
rotated, and let go from random places just above the floor, small grains between large ones (`scatter`); in space."""

_CLEARANCE = 0.02
"""Smallest gap between grains lifted apart, relative to the largest one's circumscribed diameter."""

_ALIKE = 0.97
"""Where half of the grains reach so far, relative to the largest, they are alike: in a full lattice none has room to
stand beside the one above, and whole columns come down and stay columns, as no poured grains do."""

_VACANCIES = 0.5
"""Places that stay empty at random, relative to grains that are alike."""

_CORNERS = 64
"""Corners of the prism that stands for a disc."""

_SPLITS = 2
"""How often the faces of an icosahedron are split for a sphere: 320 triangles, corners 1 % outside the sphere."""


def begin(
    packing: Packing,
    *,
    start: Start = "place",
    spheres: bool = False,
    density: PerGrain | None = None,
    friction: PerGrain | None = None,
    drop_height: float | None = None,
    rng: np.random.Generator | int | None = None,
) -> Packing:
    """Return the grains as a run is to begin with them.

    Parameters
    ----------
    packing : Packing
        The grains.
    start : {"place", "pour", "rain", "scatter"}
        See `Start`.
    spheres : bool
        Whether each is replaced by the sphere of equal volume (`as_spheres`).
    density : float, mapping or callable, optional
        A density [kg/m³] for all; a mapping from densities to their shares by number, drawn at random; or a function of
        the diameters [m], shape (n,). Each grain's own by default.
    friction : float, mapping or callable, optional
        The same for coefficients of friction [1] of the grains' own.
    drop_height : float, optional
        How far above the bed [m] rain is to be let go: it begins higher than that.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    """
    check_choice("start", start, get_args(Start))
    if drop_height is not None:
        if start != "rain":
            raise InputError(
                f"drop_height needs start = 'rain': what is poured falls from the lattice that it is lifted to; got "
                f"start = {start!r}"
            )
        if not (np.isfinite(drop_height) and drop_height > 0):
            raise InputError(f"drop_height must be positive and finite; got {drop_height}")
    generator = np.random.default_rng(rng)
    if spheres:
        packing = as_spheres(packing)
    if start == "scatter":
        packing = scatter(packing, rng=generator)
    elif start != "place":
        vacancies = _VACANCIES if _are_alike(packing) else 0.0
        packing = shuffle(packing, rng=generator, clearance=_CLEARANCE, vacancies=vacancies)
        packing = _nudged(packing, generator) if spheres else packing
    if density is not None:
        packing = with_densities(packing, density, rng=generator)
    if friction is not None:
        packing = with_frictions(packing, friction, rng=generator)
    return _lifted(packing, drop_height or 0.0) if start == "rain" else packing


def downward(direction: ArrayLike, *, is_planar: bool) -> Floats:
    """Return the unit vector along ``direction``, or raise `InputError` unless it points toward the floor."""
    vector = np.asarray(direction, dtype=np.float64)
    up = 1 if is_planar else 2
    if vector.shape != (3,) or not np.isfinite(vector).all() or not vector[up] < 0 or (is_planar and vector[2] != 0):
        allowed = "(x, y, 0) with y below zero" if is_planar else "(x, y, z) with z below zero"
        raise InputError(f"direction must be {allowed}: there is no lid; got {np.asarray(direction).tolist()}")
    return np.asarray(vector / np.linalg.norm(vector))


def sphere_radii(packing: Packing) -> Floats:
    """Return the radius [m] of each grain's sphere of equal volume, shape (n,); in planar work, of its disc."""
    content = volumes(packing.grains)
    if not packing.domain.is_planar:
        return np.asarray(np.cbrt(0.75 / np.pi * content))
    heights = packing.grains.vertices[:, 2]
    first = packing.grains.vertex_offsets[:-1]
    thickness = np.maximum.reduceat(heights, first) - np.minimum.reduceat(heights, first)
    return np.asarray(np.sqrt(content / (np.pi * thickness)))


def as_spheres(packing: Packing) -> Packing:
    """Return the packing with each grain replaced by a sphere of equal volume, as a polyhedron of 320 faces.

    In planar work it is a disc, as a prism of 64 sides. Spheres reach farther than the flat faces of the grains that
    they replace: grains in place overlap as spheres, and must be poured. Where two spheres touch, corners of their
    polyhedra may overlap by 2 % of a diameter.
    """
    n, planar = len(packing), packing.domain.is_planar
    unit, faces = _disc() if planar else _ball()
    corners = np.tile(unit, (n, 1, 1))
    single = Polyhedra(unit, [0, len(unit)], [0, len(faces)], np.concatenate(faces), _offsets(faces))  # type: ignore[arg-type]
    if planar:
        radii = sphere_radii(packing) * np.sqrt(np.pi / volumes(single))
        heights = packing.grains.vertices[:, 2]
        corners[:, :, 2] *= np.maximum.reduceat(heights, packing.grains.vertex_offsets[:-1])[:, None] * 2
        corners[:, :, :2] *= radii[:, None, None]
    else:
        corners *= np.cbrt(volumes(packing.grains) / volumes(single))[:, None, None]
    sizes = np.array([len(face) for face in faces])
    shapes = Polyhedra(
        corners.reshape(-1, 3),
        len(unit) * np.arange(n + 1),
        len(faces) * np.arange(n + 1),
        np.tile(np.concatenate(faces), n),
        np.concatenate([[0], np.cumsum(np.tile(sizes, n))]),
    )
    return replace(packing, grains=shapes, links=None).with_step("as_spheres")


@gated
def with_frictions(
    packing: Packing, friction: PerGrain | None, *, rng: np.random.Generator | int | None = None
) -> Packing:
    """Return the packing with coefficients of friction of the grains' own.

    Where two grains touch, one rules: the rougher, or the smoother with ``mixing="min"``.

    Parameters
    ----------
    packing : Packing
        The grains.
    friction : float, mapping or callable, or None
        A coefficient [1] for each; a mapping from coefficients to their shares by number, drawn at random; or a
        function of the diameters [m], shape (n,). None takes away those that grains have.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Raises
    ------
    InputError
        If a coefficient or a share is below zero or not finite.

    Examples
    --------
    Two materials, half of the grains of each: ``with_frictions(packing, {0.3: 0.5, 0.6: 0.5}, rng=1)``.
    """
    values = None
    if friction is not None:
        values = _each(packing, friction, np.random.default_rng(rng), "frictions")
        _refuse(~(np.isfinite(values) & (values >= 0)), "frictions must be zero or more and finite")
    return replace(packing, frictions=values).with_step("frictions")


@gated
def with_densities(packing: Packing, density: PerGrain, *, rng: np.random.Generator | int | None = None) -> Packing:
    """Return the packing with other densities [kg/m³], given as in `with_frictions`.

    Raises
    ------
    InputError
        If a density is not positive and finite, or a share below zero.
    """
    values = _each(packing, density, np.random.default_rng(rng), "densities")
    _refuse(~(np.isfinite(values) & (values > 0)), "densities must be positive and finite")
    return replace(packing, densities=values).with_step("densities")


def _each(packing: Packing, given: PerGrain, generator: np.random.Generator, what: str) -> Floats:
    """Return a number for each grain: one for all, drawn by shares, or by its diameter."""
    n = len(packing)
    if isinstance(given, Mapping):
        kinds, shares = _numbers(list(given), what), _numbers(list(given.values()), f"shares of {what}")
        if not (shares.size and (shares >= 0).all() and shares.sum() > 0):
            raise InputError(f"shares of {what} must be zero or more, and one above it; got {dict(given)}")
        return np.asarray(generator.choice(kinds, n, p=shares / shares.sum()))
    if callable(given):
        made = _numbers(given(diameters(packing.grains)), what)
        if made.shape not in ((), (1,), (n,)):
            raise InputError(f"{what} must be one number a grain, {n}; the function gave shape {made.shape}")
        return np.broadcast_to(made, n)
    return np.full(n, float(given))


def _numbers(values: Any, what: str) -> Floats:
    try:
        return np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be numbers; got {shown(values)}") from None


def _refuse(bad: NDArray[np.bool_], rule: str) -> None:
    if bad.any():
        raise InputError(f"{rule}; those of grains {name_offenders(np.flatnonzero(bad))} are not")


def _reaches(packing: Packing) -> Floats:
    """Return how far each grain reaches from its centroid [m], shape (n,); in planar work, in its plane."""
    corners, first = packing.grains.vertices, packing.grains.vertex_offsets[:-1]
    flat = corners[:, :2] if packing.domain.is_planar else corners
    return np.asarray(np.sqrt(np.maximum.reduceat(np.einsum("ij,ij->i", flat, flat), first)))


def _are_alike(packing: Packing) -> bool:
    """Return whether half of the grains reach nearly as far as the largest."""
    reaches = _reaches(packing)
    return bool(np.median(reaches) > _ALIKE * reaches.max())


def _nudged(packing: Packing, generator: np.random.Generator) -> Packing:
    """Return the spheres moved sideways on their lattice, within its gaps: they would stand on each other's tops."""
    reach = _reaches(packing)
    gaps = (reach.max() * (1 + _CLEARANCE) - reach) / np.sqrt(2)
    axes = 1 if packing.domain.is_planar else 2
    positions = packing.positions.copy()
    positions[:, :axes] += generator.uniform(-1.0, 1.0, (len(packing), axes)) * gaps[:, None]
    return replace(packing, positions=positions)


def _lifted(packing: Packing, drop_height: float) -> Packing:
    """Return the grains as high above the floor again as their lattice reaches: a bed is less than half as high."""
    domain, up = packing.domain, 1 if packing.domain.is_planar else 2
    rise = np.zeros(3)
    rise[up] = max(domain.lengths[up], drop_height)
    taller = Domain(domain.lower, domain.upper + rise, is_planar=domain.is_planar, planes=domain.planes)
    return replace(packing, positions=packing.positions + rise, domain=taller).with_step("rain")


def _ball() -> tuple[Floats, list[NDArray[np.int64]]]:
    """Return corners on the unit sphere, shape (162, 3), and triangles wound outward."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415  (half a second, and only for spheres)

    golden = (1 + np.sqrt(5)) / 2
    base = np.array([[0, a, b] for a in (-1, 1) for b in (-golden, golden)])
    corners = np.concatenate([np.roll(base, k, axis=1) for k in range(3)])
    for _ in range(_SPLITS):
        faces = ConvexHull(corners).simplices
        edges = np.unique(
            np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0
        )
        corners /= np.linalg.norm(corners, axis=1, keepdims=True)
        middles = corners[edges].sum(axis=1)
        corners = np.concatenate([corners, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
    faces = ConvexHull(corners).simplices.astype(np.int64)
    a, b, c = np.moveaxis(corners[faces], 1, 0)
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a) < 0
    faces[inward] = faces[inward][:, ::-1]
    return corners, list(faces)


def _disc() -> tuple[Floats, list[NDArray[np.int64]]]:
    """Return the corners of a prism around the z axis, of unit radius and from −1/2 to 1/2, and its faces."""
    angles = 2 * np.pi / _CORNERS * np.arange(_CORNERS)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    corners = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-0.5, 0.5)])
    one = np.arange(_CORNERS)
    two = (one + 1) % _CORNERS
    sides = np.column_stack([one, two, two + _CORNERS, one + _CORNERS])
    return corners, [one[::-1], one + _CORNERS, *sides]


def _offsets(faces: list[NDArray[np.int64]]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum([len(face) for face in faces])])
