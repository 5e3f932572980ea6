"""Slightly smaller grains where soft contacts overlap: apart again, with the change written down."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.pairs.walls import measure_wall_gaps
from grainsdem.geometry.separation import bodies, measure_gaps, measure_near, offsets_between
from grainsdem.model import Packing, Polyhedra

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Bodies

    Floats = NDArray[np.float64]

STEPS = 40
"""Halvings of the interval in which the smallest inset lies: to the last digits of the scale."""


@dataclass(frozen=True)
class Healed:
    """Grains made smaller until none overlap.

    Parameters
    ----------
    packing : Packing
        The grains, each scaled about its centroid; same ids, positions and rotations.
    scales : ndarray, shape (n,)
        Linear factor of each grain.
    volume_change : float
        Change of the grains' total volume, relative to what it was: negative.
    area_change : float
        Change of their total surface, relative to what it was.
    porosity_change : float
        Change of the porosity of the whole domain: the volume lost over the domain's.
    """

    packing: Packing
    scales: Floats
    volume_change: float
    area_change: float
    porosity_change: float


def heal(packing: Packing, *, gap: float = 0.0, each: Literal["uniform", "grain"] = "grain") -> Healed:
    """Return the grains scaled about their centroids by as little as leaves ``gap`` between all, and to the walls.

    Parameters
    ----------
    packing : Packing
        Convex grains whose contacts overlap slightly, as those of a settled packing do.
    gap : float
        Gap [m] that is left everywhere.
    each : {"grain", "uniform"}
        ``"grain"`` makes only those smaller that overlap, by as much as their deepest contact needs; ``"uniform"``
        makes all grains smaller by the one smallest factor that is enough.

    Returns
    -------
    Healed
        The packing, and the exact change of volume, surface and porosity.

    Raises
    ------
    InputError
        If ``gap`` is negative or not finite, ``each`` is unknown, or grains overlap so far that no size separates them.

    Notes
    -----
    Scaling about the centroid keeps every shape, and with it each face's polygon and the directions of inertia; an
    inset by half-spaces would lose small faces. Along a contact's normal n, grain i recedes by (1 - F) hᵢ with hᵢ its
    height above its centroid, so (1 - F) (hᵢ + hⱼ) ≥ gap - g is enough for a contact of gap g. The uniform factor
    starts from the largest of these and is refined by halving, as another direction may separate a pair sooner.
    """
    if not (np.isfinite(gap) and gap >= 0):
        raise InputError(f"gap must be zero or more and finite; got {gap}")
    if each not in ("grain", "uniform"):
        raise InputError(f"each must be 'grain' or 'uniform'; got {each!r}")
    pairs, shifts = near_images(packing, gap)
    solids = bodies(packing)
    near, measured = measure_near(packing, solids, pairs, shifts, gap)
    near, measured = near[measured.gaps < gap], measured.take(measured.gaps < gap)
    pairs, between, normals = pairs[near], offsets_between(packing, pairs[near], shifts[near]), measured.normals
    heights = _heights(solids, pairs[:, 0], normals) + _heights(solids, pairs[:, 1], -normals)
    # A few units in the last place more, so that rounding leaves no overlap behind.
    needed = (gap - measured.gaps) / heights + 8 * np.finfo(float).eps
    at_walls, walls = measure_wall_gaps(solids, packing.positions, packing.domain, gap)
    reached = (gap - walls.gaps) / _heights(solids, at_walls[:, 1], -walls.normals) + 8 * np.finfo(float).eps
    reached[walls.gaps >= gap] = 0.0
    enough = max(float(needed.max(initial=0.0)), float(reached.max(initial=0.0)))
    if enough >= 1:
        raise InputError(f"grains overlap too far to be healed: a contact needs {enough:.3g} of its grains' size")
    insets = np.zeros(len(packing))
    if each == "uniform":
        insets[:] = _refine(solids, pairs, between, gap, least=float(reached.max(initial=0.0)), enough=enough)
    else:
        np.maximum.at(insets, pairs[:, 0], needed)
        np.maximum.at(insets, pairs[:, 1], needed)
        np.maximum.at(insets, at_walls[:, 1], reached)
    return _scaled(packing, 1.0 - insets, gap, each)


def _refine(
    solids: Bodies, pairs: NDArray[np.int32], between: Floats, gap: float, *, least: float, enough: float
) -> float:
    """Return the smallest uniform inset, between what the walls need and what is enough."""
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
    vertices = g.vertices * np.repeat(scales, np.diff(g.vertex_offsets))[:, None]
    grains = Polyhedra(vertices, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets)
    sizes = integrate(g)
    lost = float((sizes.volumes * (1 - scales**3)).sum())
    area_lost = float((sizes.areas * (1 - scales**2)).sum())
    return Healed(
        replace(packing, grains=grains).with_step("heal", gap=float(gap), each=each),
        scales,
        -lost / float(sizes.volumes.sum()) if len(packing) else 0.0,
        -area_lost / float(sizes.areas.sum()) if len(packing) else 0.0,
        lost / packing.domain.volume,
    )
