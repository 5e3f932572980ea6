"""Isotropic compression: six smooth walls close in on the grains until they bear a pressure, or fill a volume."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import units
from grainsdem.dynamics.experiments.cells import SixWalls
from grainsdem.dynamics.experiments.cells.meter import LIMIT_SPEED
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import (
    RunReport,
    Trial,
    assemble,
    pressure_gravity,
)
from grainsdem.dynamics.experiments.shared import CompactionFriction, Friction, Run
from grainsdem.dynamics.experiments.start import in_block, options_of
from grainsdem.dynamics.mechanics import coordination, snapshot, stress
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain, Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

REST_ENERGY = 1e-5
"""Mean kinetic energy of a grain at rest [P d³]."""

COMPACTION_TIME = 20.0
"""Time [t] in which beds are compressed and come to rest, most often, by which a run is estimated."""

STEADY = 1e-3
"""Change of porosity over ten samples, 2 t, below which walls have closed in: without friction grains move for ever."""

STEADY_SAMPLES = 10
"""Those samples."""

REST_PRESSURE = 0.03
"""How near one the pressure on walls and in contacts must be in a bed that bears it, means of the last samples."""

REST_SAMPLES = 5
"""How many samples in a row must be so."""

REST_POROSITY = 1e-4
"""How near the porosity that was asked for walls must stand."""

APPROACH = 2.0
"""Rate [1/t] at which walls approach the places that leave that porosity, once it is passed."""

DRAG = 0.5
"""Rate [1/t] at which grains lose velocity once they are compressed: without gravity rattlers would fly for ever."""


class CompactSample(NamedTuple):
    """One look at a bed that is compressed, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while walls close in, 1 while the bed comes to rest at the pressure or the porosity that was reached.
    porosity : float
        Share of the volume between the walls that is void.
    pressure : float
        Mean pressure on the walls since the last sample [P].
    pressure_contacts : float
        Mean of Love–Weber's principal stresses at the instant [P].
    coordination : float
        Mean number of grains that press on a grain.
    kinetic_energy : float
        Mean of a grain [P d³].
    """

    time: float
    stage: float
    porosity: float
    pressure: float
    pressure_contacts: float
    coordination: float
    kinetic_energy: float


@dataclass(frozen=True, slots=True)
class CompactReport(RunReport):
    """What an isotropic compression led to.

    Parameters
    ----------
    porosity : float
        Share of the volume between the walls that is void.
    pressure : float
        Pressure on the walls [Pa], mean of the last samples.
    pressure_contacts : float
        The same from the contacts.
    coordination : float
        Mean number of grains that press on a grain.
    coordination_without_rattlers : float
        The same over the grains that carry force.
    is_reached : bool
        Whether the pressure, or the porosity where that was asked for, was reached; grains jam before a porosity that
        is too low for their friction.
    at_rest : bool
        Whether the bed was at rest at the end.
    """

    porosity: float
    pressure: float
    pressure_contacts: float
    coordination: float
    coordination_without_rattlers: float
    is_reached: bool
    at_rest: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return porosity and pressures over time."""
    del profile
    pressures = {"walls": "pressure", "contacts": "pressure_contacts"}
    return [
        Panel("time  [s]", "porosity", {"": (series["time"], series["porosity"])}),
        Panel("time  [s]", "pressure  [Pa]", {who: (series["time"], series[name]) for who, name in pressures.items()}),
    ]


@experiment(panels=_panels, whole=True)
def compact(
    packing: Packing,
    *,
    pressure: Annotated[
        float, option("Pressure of the walls; they close in with it also where a porosity is asked for.", "Pa", gt=0)
    ] = 1e4,
    porosity: Annotated[
        float | None,
        option("Share of void between the walls at which they stop, whatever pressure is left then.", gt=0, lt=1),
    ] = None,
    friction: Friction = None,
    compaction_friction: CompactionFriction = None,
    max_time: Annotated[float, option("Time limit.", "d √(ρ/P)", gt=0)] = 200.0,
    **run: Unpack[Run],
) -> _Compact:
    """Compress a bed from all sides by six smooth walls, to a pressure or to a porosity.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap; four walls in planar work.

    Returns
    -------
    Outcome
        Packing, history, `CompactReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, the grains are denser already, or the packing is periodic or overlaps.

    Notes
    -----
    Every wall is pushed inward with the pressure times its present area, less in proportion to its speed, up to 2 d/t.
    Walls have closed in where porosity has changed by less than 1e-3 in 2 t. From then on grains have their own
    friction, and a drag takes velocity away at a rate of 0.5/t: without gravity, rattlers would fly for ever. At rest
    means: at five samples 0.2 t apart, the mean kinetic energy of a grain is below 1e-5 P d³, and the mean pressures on
    walls and in contacts are within 3 % of that asked for, or the porosity within 1e-4.
    """
    first = in_block(packing, run)
    options = options_of(run, friction=friction, gravity=pressure_gravity(first, pressure), walls="none")
    cell = SixWalls(first, units(first, options.gravity))
    scene = assemble(first, options, cell.furnish, spheres=run["spheres"])
    found = _Compact(scene, cell, compaction_friction, porosity, max_time)
    if porosity is not None and (least := found.measure().porosity) < porosity:
        raise InputError(f"porosity must be below that of the start, {least:.4f}; got {porosity}")
    return found


class _Compact(Trial[CompactReport]):
    """Walls that close in, and then a bed that comes to rest between them."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "0 closing in, 1 coming to rest",
        "porosity": "1",
        "pressure": "Pa",
        "pressure_contacts": "Pa",
        "coordination": "1",
        "kinetic_energy": "P d3",
    }

    def __init__(
        self,
        scene: Scene,
        cell: SixWalls,
        compaction_friction: float | None,
        target: float | None,
        max_time: float,
    ) -> None:
        super().__init__(scene, cell.meter(scene.engine))
        self.cell, self.target, self.max_time = cell, target, max_time
        self.begun: float | None = None
        """When [t] the bed was compressed."""
        self.aim: list[float] | None = None
        """Sides [d] that leave the porosity that was asked for, once walls are as near."""
        self._compaction_friction = compaction_friction
        self._volume = float(volumes(scene.source.grains).sum()) / scene.units.length**3
        self._enter()

    def drive(self) -> None:
        """Push the walls, or bring them to where they leave the porosity that was asked for."""
        engine, cell = self.scene.engine, self.cell
        lengths = cell.lengths(engine)
        if self.aim is None and self.target is not None and self._porosity(lengths) <= self.target:
            self.aim = self._sides(lengths)
        if self.aim is None:
            cell.hold(self.meter, engine, cell.axes, limit_speed=LIMIT_SPEED)
            return
        for axis in cell.axes:
            speed = 0.5 * APPROACH * (self.aim[axis] - float(lengths[axis]))
            for side in (0, 1):
                self.meter.drive(f"{'xyz'[axis]}{side}", speed)

    def measure(self) -> CompactSample:
        """Return the present sample."""
        lengths, now = self.cell.lengths(self.scene.engine), snapshot(self.scene)
        pressures = self.cell.pressures(self.meter.read(), lengths)
        axes, scales = list(self.cell.axes), self.scene.units
        inner = np.diag(stress(now, volume=float(np.prod(lengths)) * scales.length**3)) / scales.stress
        return CompactSample(
            time=self.scene.engine.time,
            stage=float(self.begun is not None),
            porosity=self._porosity(lengths),
            pressure=float(pressures[axes].mean()),
            pressure_contacts=float(inner[axes].mean()),
            coordination=coordination(now),
            kinetic_energy=self.kinetic_energy(now),
        )

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside the walls, shape (n,)."""
        positions, _ = self.scene.poses()
        lower, upper = self.cell.bounds(self.scene.engine)
        return np.asarray(np.maximum(lower - positions, positions - upper)[:, self.cell.axes].max(axis=1))

    def is_over(self) -> bool:
        """Return whether the bed is at rest, or time is up."""
        return self.is_at_rest() or self.scene.time() >= self.max_time

    def is_at_rest(self) -> bool:
        """Return whether the last samples after the compression were at rest."""
        rows = self.samples[-REST_SAMPLES:]
        if self.begun is None or rows[0].time < self.begun:
            return False
        return self._is_there(rows) and all(row.kinetic_energy < REST_ENERGY for row in rows)

    def keep(self, now: CompactSample) -> None:
        """Go over to the second stage once the bed is compressed, and tell how far the run is."""
        self.tell(now.time / self.max_time, f"porosity {now.porosity:.4f}, {now.kinetic_energy:.0e} P d³")
        if self.begun is None and (self.aim is not None or self._has_closed_in()):
            self.begun = now.time
            self._enter()

    def expected_time(self) -> float:
        """Return about how long [t] the run will last."""
        return min(COMPACTION_TIME, self.max_time)

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "begun": self.begun, "aim": self.aim}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.begun, self.aim = memory["begun"], memory["aim"]
        self._enter()

    def packing(self) -> Packing:
        """Return the grains where they are, in a domain between the walls."""
        lower, upper = (corner * self.scene.units.length for corner in self.cell.bounds(self.scene.engine))
        found = self.scene.packing()
        return replace(found, domain=Domain(lower, upper, is_planar=found.domain.is_planar))

    def report(self) -> CompactReport:
        """Return what the compression led to."""
        last, stress_unit = self.samples[-REST_SAMPLES:], self.scene.units.stress
        now = snapshot(self.scene)
        at_rest = self.is_at_rest()
        return CompactReport(
            porosity=last[-1].porosity,
            pressure=float(np.mean([row.pressure for row in last])) * stress_unit,
            pressure_contacts=float(np.mean([row.pressure_contacts for row in last])) * stress_unit,
            coordination=coordination(now),
            coordination_without_rattlers=coordination(now, without_rattlers=True),
            is_reached=at_rest if self.target is None else self.aim is not None,
            at_rest=at_rest,
            **self.cost(),
        )

    def _porosity(self, lengths: Floats) -> float:
        return 1.0 - self._volume / float(np.prod(lengths))

    def _sides(self, lengths: Floats) -> list[float]:
        """Return sides of the same proportions that leave the porosity that was asked for."""
        assert self.target is not None  # noqa: S101  (for the type checker: called with a target only)
        room = self._volume / (1.0 - self.target) / float(np.prod(lengths))
        aim = lengths.copy()
        aim[list(self.cell.axes)] *= room ** (1.0 / len(self.cell.axes))
        return [float(side) for side in aim]

    def _has_closed_in(self) -> bool:
        """Return whether the walls bear the pressure and hardly move."""
        rows = self.samples[-STEADY_SAMPLES:]
        moved = rows[0].porosity - rows[-1].porosity
        return len(rows) == STEADY_SAMPLES and abs(moved) < STEADY and self._is_there(rows)

    def _is_there(self, rows: list[CompactSample]) -> bool:
        """Return whether a bed bears the pressure, or has the porosity that was asked for."""
        if self.aim is not None and self.target is not None:
            return all(abs(row.porosity - self.target) < REST_POROSITY for row in rows)
        means = np.mean([(row.pressure, row.pressure_contacts) for row in rows], axis=0)
        return bool((np.abs(means - 1.0) < REST_PRESSURE).all())

    def _enter(self) -> None:
        """Give the grains the friction and the drag of the present stage."""
        is_first = self.begun is None
        self.scene.engine.set_friction(self._compaction_friction if is_first else None)
        self.scene.engine.set_drag(0.0 if is_first else DRAG)
