"""Where grains come in: free places in a box above the bed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import random_quaternions
from grainsdem.model import Domain
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.start import Seed
    from grainsdem.dynamics.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

TRIES = 30
"""Random places that are tried for a grain before it waits for the next sample."""

SPARE = 1.01
"""Distance of a new grain from others, over that at which they touch however they are turned."""

LOOSEST = 0.4
"""Solid fraction of no bed: one that is fed stays lower than it would be with it."""


class Inlet:
    """A box in which grains appear, at random places and rotations, where nothing is near.

    Parameters
    ----------
    scene : Scene
        What moves.
    corners : ndarray, shape (2, 3)
        Lower and upper corner [m] of where centroids may be; see `inlet_box`.
    seed : int
        Of places and rotations.
    """

    def __init__(self, scene: Scene, corners: Floats, seed: int) -> None:
        packing, length = scene.source, scene.units.length
        self._scene, self._seed = scene, seed
        self._radii = reaches(packing) / length
        self._planes = packing.domain.scaled(1 / length).planes
        self.lower, self.upper = corners / length

    def find(self, grains: NDArray[np.int64], turn: int) -> Found:
        """Return which of these grains find a place now, and where.

        Parameters
        ----------
        grains : ndarray of int64, shape (m,)
            Those that are to come in, by number.
        turn : int
            Number of the try: the same one finds the same places.
        """
        rng = np.random.default_rng([self._seed, turn])
        engine, is_planar = self._scene.engine, self._scene.source.domain.is_planar
        positions, _ = self._scene.poses()
        near, radii = positions[engine.is_present], self._radii[engine.is_present]
        chosen: list[int] = []
        places: list[Floats] = []
        for grain in grains.tolist():
            place = self._place(rng, self._radii[grain], near, radii)
            if place is None:
                continue
            if is_planar:
                place[2] = positions[grain, 2]
            chosen.append(grain)
            places.append(place)
            near, radii = np.vstack([near, place]), np.append(radii, self._radii[grain])
        turns = random_quaternions(len(chosen), rng)
        if is_planar:
            half = rng.uniform(0.0, np.pi, len(chosen))
            turns = np.column_stack([np.cos(half), np.zeros((len(chosen), 2)), np.sin(half)])
        return Found(np.array(chosen, dtype=np.int64), np.reshape(places, (-1, 3)), turns)

    def _place(self, rng: np.random.Generator, radius: float, near: Floats, radii: Floats) -> Floats | None:
        """Return a free place [d], or nothing where none was found."""
        tried = rng.uniform(self.lower, self.upper, (TRIES, 3))
        axes = 2 if self._scene.source.domain.is_planar else 3
        gaps = np.linalg.norm(tried[:, None, :axes] - near[None, :, :axes], axis=2) - SPARE * (radius + radii)
        is_free = (gaps > 0).all(axis=1)
        for plane in self._planes:
            is_free &= tried @ plane[:3] + SPARE * radius * np.linalg.norm(plane[:3]) <= plane[3]
        first = np.flatnonzero(is_free)
        return tried[first[0]] if first.size else None


class Found(NamedTuple):
    """Grains that have found a place.

    Parameters
    ----------
    grains : ndarray of int64, shape (k,)
        Their numbers.
    positions : ndarray, shape (k, 3)
        Where [d].
    quaternions : ndarray, shape (k, 4)
        How they are turned.
    """

    grains: NDArray[np.int64]
    positions: Floats
    quaternions: Floats


def seed_of(rng: Seed) -> int:
    """Return the seed of an inlet, from that of a run."""
    return int(np.random.default_rng(0 if rng is None else rng).integers(2**31))


def reaches(packing: Packing) -> Floats:
    """Return the distance [m] of each grain's farthest corner from its centroid, in its plane in planar work."""
    corners = packing.grains.vertices[:, : 2 if packing.domain.is_planar else 3]
    farthest = np.zeros(len(packing))
    np.maximum.at(farthest, owners(packing.grains.vertex_offsets), np.einsum("ij,ij->i", corners, corners))
    return np.sqrt(farthest)


def inlet_box(packing: Packing, box: Sequence[float] | None = None, *, share: float = 1 / 3) -> Floats:
    """Return where centroids may come in, lower and upper corner [m], shape (2, 3): off the walls.

    Parameters
    ----------
    packing : Packing
        The grains, and the container.
    box : sequence of float, optional
        Lower and upper corner [m] of the inlet; by default above any bed of all grains.
    share : float
        Width of that, over the container's.

    Raises
    ------
    InputError
        If the box is none, reaches out of the container, or leaves no room for the largest grain.
    """
    up, domain, widest = 1 if packing.domain.is_planar else 2, packing.domain, float(reaches(packing).max())
    corners = _default(packing, widest, up, share) if box is None else np.reshape(box, (2, 3)).astype(np.float64)
    level = list(range(up))
    if (corners[1] < corners[0]).any():
        raise InputError(f"an inlet's upper corner must be above its lower one; got {corners.ravel().tolist()} m")
    if (corners[0] < domain.lower)[level].any() or (corners[1] > domain.upper)[level].any():
        raise InputError(
            f"an inlet must be between the walls, {domain.lower[level].tolist()} to {domain.upper[level].tolist()} m; "
            f"got {corners[:, level].tolist()} m"
        )
    corners[0, level] = np.maximum(corners[0], domain.lower + widest)[level]
    corners[1, level] = np.minimum(corners[1], domain.upper - widest)[level]
    corners[0, up] = max(corners[0, up], domain.lower[up] + widest)
    if (corners[1] < corners[0])[[*level, up]].any():
        raise InputError(f"an inlet must leave the largest grain {2 * widest:.4g} m of room between walls and floor")
    return corners


def reaching(packing: Packing, corners: Floats) -> Packing:
    """Return the packing in a container whose walls reach up to an inlet."""
    up, upper = 1 if packing.domain.is_planar else 2, packing.domain.upper.copy()
    if len(packing.domain.planes) or upper[up] >= corners[1, up]:
        return packing
    upper[up] = corners[1, up]
    return replace(packing, domain=Domain(packing.domain.lower, upper, is_planar=packing.domain.is_planar), links=None)


def _default(packing: Packing, widest: float, up: int, share: float) -> Floats:
    """Return the corners [m] of an inlet above the middle of the container, clear of any bed of its grains."""
    domain = packing.domain
    middle = 0.5 * (domain.lower + domain.upper)
    half = 0.5 * share * domain.lengths
    area = float(np.prod(domain.lengths) / domain.lengths[up])
    rise = float(volumes(packing.grains).sum()) / (LOOSEST * area)
    bottom = domain.lower[up] + (max(rise, float(domain.lengths[up])) if len(domain.planes) else rise) + 2 * widest
    corners = np.stack([middle - half, middle + half])
    corners[:, up] = bottom, bottom + 4 * widest
    return corners
