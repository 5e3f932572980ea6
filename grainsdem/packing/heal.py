"""Slightly smaller grains where soft contacts overlap: apart again, with the change written down."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.pairs.walls import measure_wall_gaps
from grainsdem.geometry.separation import bodies, measure_gaps, measure_near, offsets_between
from grainsdem.model.arrays import check_length
from grainsdem.packing.carve import subset
from grainsdem.packing.inset import inset

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Bodies
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

STEPS = 40
"""Halvings of the interval in which the smallest factor lies: to the last digits of the scale."""

INSET_STEPS = 20
"""The same for a distance: to a millionth of itself, as every halving insets and measures anew."""

ROUNDING = 8 * np.finfo(np.float64).eps
"""Added to what is needed, relative to the grains' size: rounding must leave no overlap behind."""

_LEVEL = (-5, -6)
"""Walls below and above, which the prisms of a planar bed touch for good."""


@dataclass(frozen=True)
class Healed:
    """Grains made smaller until none overlap.

    Parameters
    ----------
    packing : Packing
        The grains, each scaled about its centroid or with its faces moved inward; same ids and rotations.
    scales : ndarray, shape (n,)
        Linear factor of each grain; one where faces were moved.
    insets : ndarray, shape (n,)
        Distance [m] that the faces of each grain were moved by; zero where grains were scaled.
    volume_change : float
        Change of the grains' total volume, relative to what it was: negative.
    area_change : float
        Change of their total surface, relative to what it was.
    porosity_change : float
        Change of the porosity of the whole domain: the volume lost over the domain's.
    """

    packing: Packing
    scales: Floats
    insets: Floats
    volume_change: float
    area_change: float
    porosity_change: float


class _Tight(NamedTuple):
    """Pairs, and grains at walls, that are nearer than the gap asked for: ids, images, gaps and normals."""

    pairs: Ints
    shifts: Ints
    gaps: Floats
    normals: Floats
    at_walls: Ints
    wall_gaps: Floats
    wall_normals: Floats


@gated
def heal(
    packing: Packing,
    *,
    gap: float = 0.0,
    each: Literal["uniform", "grain"] = "grain",
    by: Literal["scale", "inset"] = "scale",
) -> Healed:
    """Return the grains made smaller by as little as leaves ``gap`` between all, and to the walls.

    Parameters
    ----------
    packing : Packing
        Convex grains whose contacts overlap slightly, as those of a settled packing do.
    gap : float
        Gap [m] that is left everywhere.
    each : {"grain", "uniform"}
        ``"grain"`` makes only those smaller that are too near, by as much as their deepest contact needs;
        ``"uniform"`` makes all grains smaller by the one smallest amount that is enough.
    by : {"scale", "inset"}
        ``"scale"`` scales grains about their centroids, which keeps shapes and positions; ``"inset"`` moves their
        faces inward, which takes less from long grains, and may cut off small faces and move centroids.

    Returns
    -------
    Healed
        The packing, and the exact change of volume, surface and porosity.

    Raises
    ------
    InputError
        If ``gap`` is negative or not finite, ``each`` or ``by`` is unknown, or grains overlap so far that no size
        separates them.

    Notes
    -----
    Along a contact's normal n, a scaled grain i recedes by (1 - F) hᵢ with hᵢ its height above its centroid, so
    (1 - F) (hᵢ + hⱼ) ≥ gap - g is enough for a contact of gap g. An inset by t takes at least t off the support in
    every direction, so tᵢ + tⱼ ≥ gap - g is enough; each grain gives half. The uniform amount starts from the largest
    of these and is refined by halving, as another direction may separate a pair sooner. In a planar bed grains become
    smaller in the plane only.
    """
    check_length("gap", gap, or_zero=True)
    if each not in ("grain", "uniform"):
        raise InputError(f"each must be 'grain' or 'uniform'; got {each!r}")
    if by not in ("scale", "inset"):
        raise InputError(f"by must be 'scale' or 'inset'; got {by!r}")
    compiled("walls")
    solids = bodies(packing)
    tight = _find(packing, solids, gap)
    if by == "scale":
        return _scaled(packing, 1.0 - _shares(packing, solids, tight, gap, each), gap, each)
    try:
        return _inset(packing, _distances(packing, solids, tight, gap, each), gap, each)
    except InputError as error:
        raise InputError(f"grains overlap too far to be healed by an inset: {error}") from error


def _find(packing: Packing, solids: Bodies, gap: float) -> _Tight:
    """Return what is nearer than ``gap``."""
    pairs, shifts = near_images(packing, gap)
    near, measured = measure_near(packing, solids, pairs, shifts, gap)
    is_tight = measured.gaps < gap
    at_walls, walls = measure_wall_gaps(solids, packing.positions, packing.domain, gap)
    is_held = walls.gaps < gap
    if packing.domain.is_planar:
        is_held &= ~np.isin(at_walls[:, 0], _LEVEL)
    return _Tight(
        pairs[near[is_tight]],
        shifts[near[is_tight]],
        measured.gaps[is_tight],
        measured.normals[is_tight],
        at_walls[is_held],
        walls.gaps[is_held],
        walls.normals[is_held],
    )


def _shares(packing: Packing, solids: Bodies, tight: _Tight, gap: float, each: str) -> Floats:
    """Return the share of its size that each grain loses, shape (n,)."""
    pairs, at_walls = tight.pairs, tight.at_walls
    heights = _heights(solids, pairs[:, 0], tight.normals) + _heights(solids, pairs[:, 1], -tight.normals)
    needed = (gap - tight.gaps) / heights + ROUNDING
    reached = (gap - tight.wall_gaps) / _heights(solids, at_walls[:, 1], -tight.wall_normals) + ROUNDING
    least = float(reached.max(initial=0.0))
    enough = max(float(needed.max(initial=0.0)), least)
    if enough >= 1:
        raise InputError(f"grains overlap too far to be healed: a contact needs {enough:.3g} of its grains' size")
    if each == "uniform":
        between = offsets_between(packing, pairs, tight.shifts)
        return np.full(len(packing), _refine(solids, pairs, between, gap, least=least, enough=enough))
    return _most(len(packing), tight, needed, reached)


def _distances(packing: Packing, solids: Bodies, tight: _Tight, gap: float, each: str) -> Floats:
    """Return the distance [m] that the faces of each grain move by, shape (n,)."""
    # Centroids move, and are rounded where they lie.
    slack = ROUNDING * (float(solids.radii.max(initial=0.0)) + float(np.abs(packing.positions).max(initial=0.0)))
    needed = 0.5 * (gap - tight.gaps) + slack
    reached = gap - tight.wall_gaps + slack
    if each == "uniform":
        enough = max(float(needed.max(initial=0.0)), float(reached.max(initial=0.0)))
        return np.full(len(packing), _refine_inset(packing, tight, gap, enough=enough))
    return _most(len(packing), tight, needed, reached)


def _most(n: int, tight: _Tight, needed: Floats, reached: Floats) -> Floats:
    """Return the most that any contact or wall asks of each grain."""
    most = np.zeros(n)
    np.maximum.at(most, tight.pairs[:, 0], needed)
    np.maximum.at(most, tight.pairs[:, 1], needed)
    np.maximum.at(most, tight.at_walls[:, 1], reached)
    return most


def _refine(solids: Bodies, pairs: Ints, between: Floats, gap: float, *, least: float, enough: float) -> float:
    """Return the smallest uniform share, between what the walls need and what is enough."""
    low, high = least, enough
    for _ in range(STEPS):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        f = 1.0 - middle
        smaller = solids._replace(
            vertices=solids.vertices * f, heights=solids.heights * f, radii=solids.radii * f, areas=solids.areas * f * f
        )
        if len(pairs) and measure_gaps(smaller, pairs, between).gaps.min() < gap:
            low = middle
        else:
            high = middle
    return high


def _refine_inset(packing: Packing, tight: _Tight, gap: float, *, enough: float) -> float:
    """Return the smallest uniform inset [m], no larger than what is enough."""
    ids = np.unique(np.concatenate([tight.pairs.ravel(), tight.at_walls[:, 1]])).astype(np.int64)
    if not ids.size:
        return 0.0
    concerned = subset(packing, ids)
    pairs = np.searchsorted(ids, tight.pairs).astype(np.int32)
    low, high = 0.0, enough
    for _ in range(INSET_STEPS):
        middle = 0.5 * (low + high)
        smaller = inset(concerned, middle)
        solids = bodies(smaller)
        gaps = measure_gaps(solids, pairs, offsets_between(smaller, pairs, tight.shifts)).gaps
        at_walls, walls = measure_wall_gaps(solids, smaller.positions, smaller.domain, gap)
        is_held = ~np.isin(at_walls[:, 0], _LEVEL if packing.domain.is_planar else ())
        if min(gaps.min(initial=gap), walls.gaps[is_held].min(initial=gap)) < gap:
            low = middle
        else:
            high = middle
    return high


def _heights(solids: Bodies, grains: NDArray[np.int32], directions: Floats) -> Floats:
    """Return how far each grain reaches from its position along a direction."""
    return np.array(
        [
            (solids.vertices[solids.vertex_ranges[i, 0] : solids.vertex_ranges[i, 1]] @ n).max()
            for i, n in zip(grains.tolist(), directions, strict=True)
        ]
    )


def _scaled(packing: Packing, scales: Floats, gap: float, each: str) -> Healed:
    """Return the packing with scaled grains, and what that changed."""
    g = packing.grains
    factors = np.repeat(scales[:, None], 3, axis=1)
    if packing.domain.is_planar:
        factors[:, 2] = 1.0
    smaller = replace(
        packing, grains=replace(g, vertices=g.vertices * np.repeat(factors, np.diff(g.vertex_offsets), 0))
    )
    return _compared(packing, smaller, scales, np.zeros(len(packing)), gap=float(gap), each=each, by="scale")


def _inset(packing: Packing, insets: Floats, gap: float, each: str) -> Healed:
    """Return the packing with inset grains, and what that changed."""
    smaller = replace(inset(packing, insets), provenance=packing.provenance)
    return _compared(packing, smaller, np.ones(len(packing)), insets, gap=float(gap), each=each, by="inset")


def _compared(before: Packing, after: Packing, scales: Floats, insets: Floats, **options: float | str) -> Healed:
    """Return a healed packing with the change of its sizes, summed over the grains that changed."""
    old, new = integrate(before.grains), integrate(after.grains)
    lost, area_lost = float((old.volumes - new.volumes).sum()), float((old.areas - new.areas).sum())
    return Healed(
        after.with_step("heal", **options),
        scales,
        insets,
        0.0 - lost / float(old.volumes.sum()) if len(before) else 0.0,
        0.0 - area_lost / float(old.areas.sum()) if len(before) else 0.0,
        lost / before.domain.volume,
    )
