"""The shell of a drum: facets around a level axis, two ends, and lifters, that turn together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.experiments.cells.meter import HEAVY, Meter
from grainsdem.dynamics.experiments.start import pitch, set_apart_in_block
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus, Engine
    from grainsdem.dynamics.experiments.start import Seed
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

FACETS = 64
"""Plane facets of the shell, which has the circle's area."""

THICKNESS = 1.0
"""Thickness [d] of shell, ends and lifters."""

LENGTH_SHARE = 0.5
"""Length of the drum over its radius, where it is not given."""

GUIDE = 0.97
"""Half the distance, over the radius, of the walls between which grains fall in: the bed lies clear of the cover."""

COVER = "cover"
"""Name of the drum's upper half as the bed is filled in, through which grains fall."""

COVER_MASS = 1.0
"""Mass of that half, and its inertia; what is heavy is the drum."""

LEVEL = 1e-6
"""Height, over the radius, that rounding may take off a facet beside the axis."""

GUESSED_FRACTION = 0.58
"""Solid fraction of a bed in a drum, from which its fill is reckoned."""

PLANAR_FRACTION = 0.8
"""The same in planar work."""


class Shell:
    """A drum about the y axis, or about z in planar work, and the grains set apart in it.

    Parameters
    ----------
    packing : Packing
        The grains.
    fill : float
        Share of the drum that the bed takes.
    radius, length : float, optional
        Of the drum [m]; what is not given follows from the fill.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one, of where the grains start.

    Raises
    ------
    InputError
        If the grains do not fit into the drum, or its fill is not what radius and length make it.
    """

    def __init__(self, packing: Packing, *, fill: float, radius: float | None, length: float | None, rng: Seed) -> None:
        self.is_planar = packing.domain.is_planar
        self.up, self.axis = (1, 2) if self.is_planar else (2, 1)
        step = pitch(packing)
        fraction = PLANAR_FRACTION if self.is_planar else GUESSED_FRACTION
        volume = float(volumes(packing.grains).sum()) / fraction / fill
        if self.is_planar:
            length = float(packing.domain.lengths[2])
        self._radius, self._length = _sizes(volume, radius, length, step)
        if self._length < step and not self.is_planar:
            raise InputError(f"a drum {self._length:.4g} m long is shorter than the largest grain, {step:.4g} m")
        self.packing = self._above(packing, rng)

    def furnish(self, apparatus: Apparatus, units: GrainUnits, *, friction: float | None, end_friction: float,
                lifters: int, lifter_height: float | None) -> None:  # fmt: skip
        """Add the drum, which turns about its axis."""
        self.radius, self.length = self._radius / units.length, self._length / units.length
        low = self.packing.domain.lower[self.axis] / units.length
        self.middle = np.zeros(3)
        self.middle[self.axis] = low + 0.5 * self.length
        turning = np.zeros(3)
        turning[self.axis] = 1.0
        body = apparatus.add_body("drum", self.middle, [("turn", "hinge", turning)], mass=HEAVY)
        self._halves = body, apparatus.add_body(COVER, np.zeros(3), [], mass=COVER_MASS, parent=body)
        self._add_shell(apparatus, friction)
        if not self.is_planar:
            for side in (-1.0, 1.0):
                place, half = np.zeros(3), np.full(3, self.radius + 2 * THICKNESS)
                place[self.axis], half[self.axis] = side * 0.5 * (self.length + THICKNESS), 0.5 * THICKNESS
                apparatus.add_shape(body, f"end_{int(side > 0)}", "box", half, position=place, friction=end_friction)
        height = THICKNESS if lifter_height is None else lifter_height / units.length
        if lifters and height > 0.5 * self.radius:
            raise InputError(
                f"lifters must be lower than half the drum's radius, {0.5 * self._radius:.4g} m; got {lifter_height} m"
            )
        for k in range(lifters):
            self._add_facet(
                apparatus, f"lifter_{k}", 2 * np.pi * k / lifters,
                inner=self.radius - height, half=(0.5 * height, 0.5 * THICKNESS), friction=friction,
            )  # fmt: skip

    def _add_shell(self, apparatus: Apparatus, friction: float | None) -> None:
        """Add the facets."""
        turn = np.pi / FACETS
        apothem = self.radius * np.sqrt(turn / np.tan(turn))
        half = 0.5 * THICKNESS, (apothem + THICKNESS) * np.tan(turn)
        for k in range(FACETS):
            self._add_facet(apparatus, f"shell_{k}", 2 * k * turn, inner=apothem, half=half, friction=friction)

    def _add_facet(
        self, apparatus: Apparatus, name: str, angle: float, *, inner: float, half: tuple[float, float],
        friction: float | None,
    ) -> None:  # fmt: skip
        """Add a box that begins at a radius, at an angle about the axis; half sizes are radial and tangential."""
        size, place, turn = np.empty(3), np.zeros(3), np.zeros(4)
        # About y a turn from z to x, about z one from x to y: the first of the two axes is the radial one.
        first, second = (0, 1) if self.is_planar else (2, 0)
        size[first], size[second], size[self.axis] = half[0], half[1], 0.5 * self.length + THICKNESS
        middle = inner + half[0]
        place[first], place[second] = middle * np.cos(angle), middle * np.sin(angle)
        turn[0], turn[1 + self.axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
        body = self._halves[int(place[self.up] > -LEVEL * self.radius)]
        apparatus.add_shape(body, name, "box", size, position=place, quaternion=turn, friction=friction)

    def meter(self, engine: Engine) -> Meter:
        """Return what turns the drum, and tells the torque of the grains on it."""
        return Meter(engine, {"turn": HEAVY + COVER_MASS})

    def around(self, packing: Packing) -> Packing:
        """Return the grains in the box around the drum."""
        lower, upper = np.full(3, -self._radius), np.full(3, self._radius)
        lower[self.axis], upper[self.axis] = packing.domain.lower[self.axis], packing.domain.upper[self.axis]
        return replace(packing, domain=Domain(lower, upper, is_planar=self.is_planar))

    def across(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return where points are across the axis [d]: to the side that rises, and upward."""
        offset = positions - self.middle
        # A turn about y moves the lowest point to -x, one about z to +x.
        side = offset[:, 0] if self.is_planar else -offset[:, 0]
        return side, offset[:, self.up]

    def _above(self, packing: Packing, rng: Seed) -> Packing:
        """Return the grains set apart between guides above the drum; they fall into its lower half."""
        half, domain = GUIDE * self._radius, packing.domain
        lower, upper = np.full(3, -half), np.full(3, half)
        lower[self.axis], upper[self.axis] = 0.0, self._length
        lower[self.up] = self._radius + 2 * pitch(packing)
        upper[self.up] = lower[self.up] + self._radius
        if self.is_planar:
            lower[2], upper[2] = domain.lower[2], domain.upper[2]
        around = replace(packing, domain=Domain(lower, upper, is_planar=self.is_planar), links=None)
        placed = set_apart_in_block(around, rng=rng, lengths=(upper - lower)[: self.up])
        lower[self.up] = -2 * self._radius  # the container's floor is out of the way
        return replace(placed, domain=Domain(lower, placed.domain.upper, is_planar=self.is_planar))


def _sizes(volume: float, radius: float | None, length: float | None, step: float) -> tuple[float, float]:
    """Return radius and length [m] of a drum of a volume [m³]; where both are given they are what they are."""
    if radius is None and length is None:
        length = max(LENGTH_SHARE * float(np.cbrt(volume / (np.pi * LENGTH_SHARE))), step)
    if radius is None:
        radius = float(np.sqrt(volume / (np.pi * length)))  # type: ignore[operator]  # one of the two is given
    return radius, volume / (np.pi * radius**2) if length is None else length
