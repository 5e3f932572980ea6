"""A direct shear box: two halves, the upper one of which is driven sideways under a lid that is pressed down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.dynamics.experiments.cells.meter import HEAVY, LIMIT_SPEED, Meter
from grainsdem.dynamics.experiments.start import room_taken, set_apart_in_block
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus, Engine
    from grainsdem.dynamics.experiments.start import Seed
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


class ShearBox:
    """Two halves of a box, of which the upper one moves along x.

    Parameters
    ----------
    packing : Packing
        The grains; in planar work y is the height and there is no depth.
    rng : numpy.random.Generator, int or None
        Where given, grains are set apart in a box of the aspect; else they are in the box already.
    aspect : float
        Length of that box over its height, and over its depth.
    gap : float
        Distance [m] of the walls of the two halves: grains that walls meet edge to edge over are caught between them.
    """

    def __init__(self, packing: Packing, *, rng: Seed, aspect: float, gap: float) -> None:
        self.up = 1 if packing.domain.is_planar else 2
        is_apart = rng is not None
        self._gap = gap
        self.packing = _spread(packing, self.up, rng, aspect) if is_apart else packing
        corners = world_vertices(self.packing)
        self._lower, self._upper = self.packing.domain.lower.copy(), self.packing.domain.upper.copy()
        self._lower[self.up], self._upper[self.up] = corners[:, self.up].min(), corners[:, self.up].max()
        height = self._upper[self.up] - self._lower[self.up]
        if is_apart:
            sides = self._upper - self._lower
            height = room_taken(packing) * sides[self.up] / float(np.prod(sides))
        self._split = self._lower[self.up] + 0.5 * height

    def furnish(self, apparatus: Apparatus, units: GrainUnits, *, friction: float | None) -> None:
        """Add both halves and the lid to a model, without gravity."""
        self.lower, self.upper = self._lower / units.length, self._upper / units.length
        self.split = float(self._split / units.length)
        up, sides = self.up, self.upper - self.lower
        half_gap = float(0.5 * self._gap / units.length)
        self.length, self.area = float(sides[0]), float(np.prod(sides) / sides[up])
        apparatus.set_gravity((0.0, 0.0, 0.0))
        self._add(apparatus, None, "floor_plate", (up, 0, self.lower[up]), friction=friction)
        self._add_walls(apparatus, None, "lower", self.lower[up] - 1.0, self.split - half_gap)
        here, along = (0.0, 0.0, 0.0), np.eye(3)[up]
        drive = apparatus.add_body("drive", here, [("shear", "slide", (1.0, 0.0, 0.0))], mass=1.0)
        # The walls of the upper half stay at their height; their joint tells what they bear.
        walls = apparatus.add_body("upper", here, [("walls", "slide", along)], mass=HEAVY, parent=drive)
        self._add_walls(apparatus, walls, "upper", self.split + half_gap, self.upper[up] + 1.0)
        self._plate = 0.25 * self.area
        lid = apparatus.add_body("lid", here, [("lift", "slide", along)], mass=self._plate, parent=drive)
        self._add(apparatus, lid, "lid_plate", (up, 1, self.upper[up]), friction=friction)

    def _add_walls(self, apparatus: Apparatus, body: Any, name: str, bottom: float, top: float) -> None:
        """Add the walls of one half: so thick that grains of the other half that they pass under or over stay held."""
        for axis in range(2 if self.up == 2 else 1):
            for side in (0, 1):
                place = (self.lower, self.upper)[side][axis]
                shape = f"{name}_{'xyz'[axis]}{side}"
                self._add(apparatus, body, shape, (axis, side, place), span=(bottom, top))

    def _add(
        self,
        apparatus: Apparatus,
        body: Any,
        name: str,
        face: tuple[int, int, float],
        *,
        span: tuple[float, float] | None = None,
        friction: float | None = 0.0,
    ) -> None:
        """Add a slab whose face is across an axis, on one side of the grains, at a place."""
        axis, side, place = face
        sides = self.upper - self.lower
        thickness = 0.5 * self.length
        middle, half = 0.5 * (self.lower + self.upper), 0.5 * sides + 2.0 * thickness
        half[axis] = thickness
        middle[axis] = place + (2 * side - 1) * thickness
        if span is not None:
            middle[self.up], half[self.up] = 0.5 * (span[0] + span[1]), 0.5 * (span[1] - span[0])
        apparatus.add_shape(body, name, "box", half, position=middle, friction=friction)

    def meter(self, engine: Engine) -> Meter:
        """Return what drives the upper half and pushes the lid."""
        return Meter(engine, {"lift": self._plate, "walls": HEAVY, "shear": 1.0 + HEAVY + self._plate})

    def height(self, engine: Engine) -> float:
        """Return the distance [d] of floor and lid now."""
        return float(self.upper[self.up] - self.lower[self.up]) + engine.axle("lift")[0]

    def hold(self, meter: Meter, engine: Engine, *, limit_speed: float = np.inf) -> None:
        """Push the lid down with a pressure of one on the whole box, less where it moves or walls bear a part.

        Grains at the ends push on the lower faces of the upper walls, and those press on the plane between the halves
        as the lid does: what they bore lately is taken off the lid.
        """
        load = max(0.0, self.area - meter.last["walls"])
        meter.push("lift", -load - self.area * engine.axle("lift")[1] / limit_speed)
        meter.drive("walls", 0.0)

    def gather(self, meter: Meter, engine: Engine) -> None:
        """Push the lid down onto grains that are still apart, with the halves above each other."""
        self.hold(meter, engine, limit_speed=LIMIT_SPEED)
        meter.drive("shear", 0.0)


def _spread(packing: Packing, up: int, rng: Seed, aspect: float) -> Packing:
    """Return the grains set apart over the floor of a box that they fill to its height when they are compressed."""
    domain = packing.domain
    filled = room_taken(packing)
    if up == 1:
        height = float(np.sqrt(filled / domain.lengths[2] / aspect))
        return set_apart_in_block(packing, rng=rng, lengths=np.array([aspect * height]))
    height = float(np.cbrt(filled / aspect))
    return set_apart_in_block(packing, rng=rng, lengths=np.array([aspect * height, height]))
