"""The ring of a ring shear test: an annulus with smooth walls between a rough floor and a rough lid."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.experiments.cells.meter import HEAVY, LIMIT_SPEED, Meter
from grainsdem.dynamics.experiments.start import n_places, pitch, room_taken, set_apart
from grainsdem.errors import InputError
from grainsdem.model import Domain

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.engine import Apparatus, Engine
    from grainsdem.dynamics.experiments.start import Seed
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

FACETS = 64
"""Planes of the outer wall."""

INNER_SHARE = 0.75
"""Inner radius over the width of the ring, where none is given."""


class Annulus:
    """A ring of grains; those of the lowest layer are glued to the floor, those of the topmost one to the lid.

    Parameters
    ----------
    packing : Packing
        The grains, which are set apart in the ring.
    inner_radius, outer_radius : float, optional
        Radii [m] of the walls; by default such that the ring is about as high as it is wide.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    """

    def __init__(self, packing: Packing, inner_radius: float | None, outer_radius: float | None, *, rng: Seed) -> None:
        inner, outer = _radii(packing, inner_radius, outer_radius)
        step = pitch(packing)
        rough = np.pi * (outer + inner) * (outer - inner) / step**2
        # Where a layer has more grains than there are it is not laid out to be counted.
        layer = _layer(inner, outer, step) if rough < 10 * len(packing) + 1000 else np.empty((0, 2))
        self.n_glued = len(layer) or round(rough)
        if len(packing) < 4 * self.n_glued:
            raise InputError(
                f"a ring of radii {inner:.4g} and {outer:.4g} m takes {self.n_glued:.6g} grains a layer and needs four "
                f"times as many, two layers of them glued; got {len(packing)}"
            )
        n_layers = 2 - (-n_places(len(packing) - 2 * self.n_glued) // self.n_glued)
        heights = (np.arange(n_layers) + 0.5) * step
        # The floor's grains come first, then the lid's.
        order = [0, n_layers - 1, *range(1, n_layers - 1)]
        places = np.concatenate([np.column_stack([layer, np.full(len(layer), heights[k])]) for k in order])
        domain = Domain.cylinder(outer, n_layers * step, sides=FACETS)
        self.packing = set_apart(packing, places, domain, rng=rng, n_fixed=2 * self.n_glued)
        self._inner, self._outer = inner, outer
        self._plates = heights[0], heights[-1]
        self._height = n_layers * step

    def furnish(self, apparatus: Apparatus, units: GrainUnits, *, friction: float | None) -> None:
        """Add inner wall, floor and lid to a model, without gravity."""
        scale = 1.0 / units.length
        self.inner, self.outer = self._inner * scale, self._outer * scale
        self.floor, self.top = (height * scale for height in self._plates)
        half, reach = self._height * scale, 1.1 * self.outer
        self.area = float(np.pi * (self.outer**2 - self.inner**2))
        apparatus.set_gravity((0.0, 0.0, 0.0))
        apparatus.add_shape(None, "inner_wall", "cylinder", (self.inner, half), position=(0.0, 0.0, 0.5 * half))
        apparatus.add_shape(
            None, "floor_plate", "box", (reach, reach, 1.0), position=(0.0, 0.0, self.floor - 1.0), friction=friction
        )
        apparatus.glue(range(self.n_glued), None)
        drive = apparatus.add_body("drive", (0.0, 0.0, 0.0), [("turn", "hinge", (0.0, 0.0, 1.0))], mass=HEAVY)
        self._plate = 0.25 * self.area
        lid = apparatus.add_body(
            "lid", (0.0, 0.0, self.top), [("lift", "slide", (0.0, 0.0, 1.0))], mass=self._plate, parent=drive
        )
        apparatus.add_shape(lid, "lid_plate", "box", (reach, reach, 1.0), position=(0.0, 0.0, 1.0), friction=friction)
        apparatus.glue(range(self.n_glued, 2 * self.n_glued), lid)

    def meter(self, engine: Engine) -> Meter:
        """Return what pushes and turns the lid."""
        glued = slice(self.n_glued, 2 * self.n_glued)
        masses = engine.masses[glued]
        arms = np.square(engine.motion().positions[glued, :2]).sum(axis=1)
        turning = HEAVY + self._plate + float(masses @ arms)
        return Meter(engine, {"lift": self._plate + float(masses.sum()), "turn": turning})

    def height(self, engine: Engine) -> float:
        """Return the distance [d] of the plates now."""
        return float(self.top - self.floor) + engine.axle("lift")[0]

    def hold(self, meter: Meter, engine: Engine, *, limit_speed: float = np.inf) -> None:
        """Push the lid down with a pressure of one, less where it moves."""
        meter.push("lift", -self.area * (1.0 + engine.axle("lift")[1] / limit_speed))

    def gather(self, meter: Meter, engine: Engine) -> None:
        """Push the lid down onto grains that are still apart, without turning it."""
        self.hold(meter, engine, limit_speed=LIMIT_SPEED)
        meter.drive("turn", 0.0)

    @property
    def mean_radius(self) -> float:
        """Mean of the two radii [d]."""
        return float(0.5 * (self.inner + self.outer))

    def shear_stress(self, torque: float) -> float:
        """Return the shear stress [P] that is the same over the whole ring and has a torque about its axis."""
        return 1.5 * torque / float(np.pi * (self.outer**3 - self.inner**3))


def _radii(packing: Packing, inner: float | None, outer: float | None) -> tuple[float, float]:
    """Return the radii [m], guessed where they are not given."""
    if packing.domain.is_planar:
        raise InputError("a ring shear test needs grains in space; a planar bed goes into the direct shear box")
    width = float(np.cbrt(room_taken(packing) / (np.pi * ((1 + INNER_SHARE) ** 2 - INNER_SHARE**2))))
    if inner is None:
        inner = INNER_SHARE * width if outer is None else outer * INNER_SHARE / (1 + INNER_SHARE)
    if outer is None:
        outer = inner + width
    if not (np.isfinite(outer) and outer > inner > 0):
        raise InputError(f"radii must be positive, the outer one larger; got {inner} and {outer}")
    return inner, outer


def _layer(inner: float, outer: float, step: float) -> Floats:
    """Return the places [m] of one layer of the ring, a step apart from each other and off the walls, shape (n, 2)."""
    circles = int((outer - inner) / step + 1e-9)
    if circles < 1:
        raise InputError(f"a ring of {outer - inner:.4g} m is narrower than the largest grain, {step:.4g} m")
    width = (outer - inner) / circles
    rows = []
    for k in range(circles):
        radius = inner + (k + 0.5) * width
        # Chords, not arcs, must be a step long.
        count = int(np.pi / np.arcsin(min(1.0, 0.5 * step / radius)) + 1e-9)
        angles = 2 * np.pi * (np.arange(count) + 0.5 * (k % 2)) / count
        rows.append(radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    return np.concatenate(rows)
