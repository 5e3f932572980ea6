"""The way out of a silo or a hopper: a hole in the floor, or the hopper's whole bottom, that a gate closes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.measures import diameters
from grainsdem.model import Domain

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

GATE = "gate"
"""Name of the part that closes the outlet."""

SECTORS = 32
"""Pieces that a floor with a round hole is made of."""

THICKNESS = 1.0
"""Thickness [d] of floor, walls and gate. The hole widens downward by as much: its upper rim is what grains pass."""

WIDEST = 5.0
"""Width of the hole, in median diameters, where none is given."""

SHARE = 0.5
"""The same over the width of the floor, where that is less: walls near the hole slow the flow."""


class Outlet:
    """A round hole in the middle of a box's floor, a slot in planar work, or the open bottom of a hopper.

    Parameters
    ----------
    packing : Packing
        The bed, in a box or a hopper.
    opening : float, optional
        Diameter of the hole, or width of the slot [m]; by default five median diameters, or half the floor where that
        is narrower. A hopper has its own.

    Raises
    ------
    InputError
        If no grain can pass, or the hole is wider than the floor.
    """

    def __init__(self, packing: Packing, opening: float | None) -> None:
        self.domain, self.up = packing.domain, 1 if packing.domain.is_planar else 2
        self.leaning = np.flatnonzero(self.domain.planes[:, self.up] < -1e-9)  # of unit normals: not upright ones
        sizes = diameters(packing.grains)
        largest, level = float(sizes.max()), list(range(self.up))
        if self.leaning.size:
            if opening is not None:
                raise InputError("a hopper opens its whole bottom: its width is that of the domain; leave opening out")
            self._bottom = _section(self.domain, self.up)
            sides = (self._bottom[1] - self._bottom[0])[level]
            self.width = float(np.prod(sides) ** (1 / len(sides)))
        else:
            narrowest = float(self.domain.lengths[level].min())
            usual = min(WIDEST * float(np.median(sizes)), SHARE * narrowest)
            self.width = usual if opening is None else opening
            if self.width > narrowest:
                raise InputError(f"the opening must be narrower than the floor, {narrowest:.4g} m; got {self.width} m")
        if self.width < largest:
            raise InputError(
                f"the opening must be wider than the largest grain, {largest:.4g} m of equal volume, or nothing can "
                f"leave; got {self.width:.4g} m"
            )

    def furnish(self, apparatus: Apparatus, units: GrainUnits, *, friction: Callable[[str], float | None]) -> None:
        """Replace the container's floor, and what leans, by parts with an end, and close the outlet."""
        domain = self.domain.scaled(1 / units.length)
        self.lower, self.upper, self.planes = domain.lower, domain.upper, domain.planes
        self.floor, width = float(self.lower[self.up]), self.width / units.length
        self.middle = 0.5 * (self.lower + self.upper)
        container, floor = apparatus.container, "wall_y0" if self.up == 1 else "floor"
        apparatus.remove_wall(floor)
        for k in self.leaning.tolist():
            apparatus.remove_wall(f"wall_p{k}")
            apparatus.add_hull(container, f"plate_{k}", _plate(domain, k), friction=friction(f"wall_p{k}"))
        if self.leaning.size:
            self.half = (0.5 * (self._bottom[1] - self._bottom[0]) / units.length)[: self.up]
            self.middle = 0.5 * self._bottom.sum(axis=0) / units.length
        else:
            self.half = np.full(self.up, 0.5 * width)
            pieces = self._slot(0.5 * width) if self.up == 1 else self._hole(0.5 * width)
            for k, corners in enumerate(pieces):
                apparatus.add_hull(container, f"floor_{k}", corners, friction=friction(floor))
        size, place = np.full(3, 0.5 * THICKNESS), self.middle.copy()
        size[: self.up] = self.half + (THICKNESS if self.leaning.size else 0.0)
        place[self.up] = self.floor - 0.5 * THICKNESS
        if self.up == 1:
            size[2] = self.upper[2] - self.lower[2] + 1.0
        apparatus.add_shape(container, GATE, "box", size, position=place, friction=friction(floor))

    def above(self, positions: Floats) -> NDArray[np.bool_]:
        """Return which centroids [d], shape (n, 3), are over the middle half of the opening, shape (n,).

        What leans on its rim does not count: such grains stay where nothing else is left.
        """
        offset = 2 * np.abs(positions - self.middle)[:, : self.up]
        if self.up == 1 or self.leaning.size:
            return np.asarray((offset <= self.half).all(axis=1))
        return np.asarray(np.hypot(*offset.T) <= self.half[0])

    def below(self, positions: Floats) -> NDArray[np.bool_]:
        """Return which centroids [d], shape (n, 3), have fallen through the opening, shape (n,)."""
        return np.asarray(positions[:, self.up] < self.floor - THICKNESS)

    def volume(self, low: float, high: float) -> float:
        """Return the volume [d³] of the container between two heights [d] above its floor."""
        lower, upper = self.lower.copy(), self.upper.copy()
        lower[self.up], upper[self.up] = self.floor + low, self.floor + high
        return Domain(lower, upper, is_planar=self.domain.is_planar, planes=self.planes).volume

    def _slot(self, half: float) -> list[Floats]:
        """Return the corners of the floor on both sides of a slot, bevelled below."""
        pieces = []
        for side in (-1.0, 1.0):
            far = self.middle[0] + side * (self.upper[0] - self.lower[0])
            near = self.middle[0] + side * half
            top = [(near, self.floor), (far, self.floor)]
            bottom = [(near + side * THICKNESS, self.floor - THICKNESS), (far, self.floor - THICKNESS)]
            span = (self.lower[2] - 1.0, self.upper[2] + 1.0)
            pieces.append(np.array([(x, y, z) for x, y in top + bottom for z in span]))
        return pieces

    def _hole(self, radius: float) -> list[Floats]:
        """Return the corners of the pieces around a round hole, bevelled below; together they are a box's floor."""
        half = 0.5 * (self.upper - self.lower)[:2] + THICKNESS
        corner = np.arctan2(half[1], half[0])
        even = 2 * np.pi * np.arange(SECTORS) / SECTORS
        own = np.array([corner, np.pi - corner, np.pi + corner, 2 * np.pi - corner])
        # A sector that holds a corner of the box would not be convex: the nearest edge goes there.
        for angle in own:
            even[int(np.argmin(np.abs(even - angle)))] = angle
        # A polygon of the circle's area.
        turns = np.diff(np.append(even, even[0] + 2 * np.pi))
        inner = radius * np.sqrt(2 * np.pi / np.sin(turns).sum())
        way = np.column_stack([np.cos(even), np.sin(even)])
        rim = way / np.max(np.abs(way) / half, axis=1)[:, None]
        bevel = way * np.minimum(inner + THICKNESS, 0.5 * (inner + np.linalg.norm(rim, axis=1)))[:, None]
        pieces = []
        for k in range(SECTORS):
            ends = [k, (k + 1) % SECTORS]
            top = np.concatenate([inner * way[ends], rim[ends]]) + self.middle[:2]
            bottom = np.concatenate([bevel[ends], rim[ends]]) + self.middle[:2]
            heights = np.repeat([self.floor, self.floor - THICKNESS], 4)
            pieces.append(np.column_stack([np.concatenate([top, bottom]), heights]))
        return pieces


def _section(domain: Domain, up: int) -> Floats:
    """Return the lower and the upper corner [m] of a hopper's bottom, shape (2, 3)."""
    corners = domain.corners()
    bottom = corners[corners[:, up] < domain.lower[up] + 1e-6 * domain.lengths[up]]
    if not len(bottom):
        raise InputError("the planes of the domain meet above its floor: no bottom of this hopper could be opened")
    return np.stack([bottom.min(axis=0), bottom.max(axis=0)])


def _plate(domain: Domain, k: int) -> Floats:
    """Return the corners of a plate along an inclined plane of a container, outside of it, shape (2 k, 3)."""
    corners = domain.corners()
    normal = domain.planes[k, :3] / np.linalg.norm(domain.planes[k, :3])
    offset = domain.planes[k, 3] / np.linalg.norm(domain.planes[k, :3])
    scale = float(domain.lengths.max())
    face = corners[np.abs(corners @ normal - offset) < 1e-6 * scale]
    return np.concatenate([face, face + THICKNESS * normal])
