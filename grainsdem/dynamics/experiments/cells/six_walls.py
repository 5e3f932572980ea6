"""A cell of six smooth walls that press and move: four in planar work."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.experiments.cells.meter import Meter
from grainsdem.dynamics.experiments.start import room_taken
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus, Engine
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

LIGHT = 0.25
"""Mass [ρ d] of a wall over its area, about half a layer of grains. What the walls gain of momentum is missing from the
pressure that they are to hold, and their mass swings on the bed as on a spring; so they are lighter than the bed."""

DRIVEN = 30.0
"""How much heavier than the others driven walls are: they keep their speed, and still can gather the grains."""

DRIFT_DAMPING = 10.0
"""Pressure [P t/d] against two walls that move the same way. Normals of contacts with a wall lean by a hundredth now
and then; the wall's joint takes the force, and a sample that nothing holds would drift."""


class SixWalls:
    """Walls around a packing, each on a joint of its own along its outward normal.

    Parameters
    ----------
    packing : Packing
        What is in it: the walls begin where the grains end, or where its domain does if that is nearer.
    units : GrainUnits
        Factors to SI.
    driven : int, optional
        Axis whose two walls are driven later on, and are heavy.
    """

    def __init__(self, packing: Packing, units: GrainUnits, *, driven: int | None = None) -> None:
        self.axes = (0, 1) if packing.domain.is_planar else (0, 1, 2)
        corners = world_vertices(packing)
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        if packing.domain.is_planar:
            lower[2], upper[2] = packing.domain.lower[2], packing.domain.upper[2]
        self.lower, self.upper = lower / units.length, upper / units.length
        self.driven = driven
        self.names = tuple(f"{'xyz'[axis]}{side}" for axis in self.axes for side in (0, 1))
        light = LIGHT * self._least_area(room_taken(packing) / units.length**3)
        self.masses = {
            name: light * (DRIVEN if driven is not None and name[0] == "xyz"[driven] else 1.0) for name in self.names
        }

    def _least_area(self, room: float) -> float:
        """Return the area [d²] of the smallest wall, once grains that were set apart are gathered in a room [d³]."""
        lengths, axes = self.upper - self.lower, list(self.axes)
        lengths[axes] *= min(1.0, (room / float(np.prod(lengths))) ** (1 / len(axes)))
        return float(np.prod(lengths) / lengths[axes].max())

    def furnish(self, apparatus: Apparatus) -> None:
        """Add the walls to a model, without gravity."""
        apparatus.set_gravity((0.0, 0.0, 0.0))
        middle, reach = 0.5 * (self.lower + self.upper), float((self.upper - self.lower).max())
        for axis in self.axes:
            for side in (0, 1):
                outward = np.zeros(3)
                outward[axis] = 2 * side - 1
                position = middle.copy()
                position[axis] = (self.lower, self.upper)[side][axis]
                name = f"{'xyz'[axis]}{side}"
                body = apparatus.add_body(name, position, [(name, "slide", outward)], mass=self.masses[name])
                # Wider than the sample may ever be; walls pass through each other.
                half = np.full(3, reach)
                half[axis] = 1.0
                apparatus.add_shape(body, name, "box", half, position=outward)

    def meter(self, engine: Engine) -> Meter:
        """Return what pushes the walls."""
        return Meter(engine, self.masses)

    def lengths(self, engine: Engine) -> Floats:
        """Return the sides [d] of the sample now, shape (3,)."""
        sides = self.upper - self.lower
        for axis in self.axes:
            sides[axis] += sum(engine.axle(f"{'xyz'[axis]}{side}")[0] for side in (0, 1))
        return np.asarray(sides)

    def bounds(self, engine: Engine) -> tuple[Floats, Floats]:
        """Return the corners [d] of the sample now, each of shape (3,)."""
        lower, upper = self.lower.copy(), self.upper.copy()
        for axis in self.axes:
            lower[axis] -= engine.axle(f"{'xyz'[axis]}0")[0]
            upper[axis] += engine.axle(f"{'xyz'[axis]}1")[0]
        return lower, upper

    def hold(self, meter: Meter, engine: Engine, axes: tuple[int, ...], *, limit_speed: float = np.inf) -> None:
        """Push the walls across some axes inward with a pressure of one, less where they move."""
        lengths = self.lengths(engine)
        for axis in axes:
            area = float(np.prod(lengths) / lengths[axis])
            names = [f"{'xyz'[axis]}{side}" for side in (0, 1)]
            speeds = [engine.axle(name)[1] for name in names]
            # As if by the speed at the end of the step: light walls with a large area would swing by it otherwise.
            rate = DRIFT_DAMPING * area / self.masses[names[0]]
            drift = 0.5 * DRIFT_DAMPING * (speeds[1] - speeds[0]) / (1.0 + rate * engine.time_step)
            for name, speed, sense in zip(names, speeds, (-1.0, 1.0), strict=True):
                meter.push(name, -area * (1.0 + speed / limit_speed + sense * drift))

    def pressures(self, forces: dict[str, float], lengths: Floats) -> Floats:
        """Return the pressure [P] on the walls across each axis, the mean of the two, shape (3,); NaN for no walls."""
        result = np.full(3, np.nan)
        for axis in self.axes:
            area = float(np.prod(lengths) / lengths[axis])
            result[axis] = 0.5 * sum(forces[f"{'xyz'[axis]}{side}"] for side in (0, 1)) / area
        return result
