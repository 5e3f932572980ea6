"""The run of a body that goes into a bed: what holds it, what drives it, and what is measured of it."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, ClassVar, get_args

import numpy as np

from grainsdem.dynamics.budget import SETTLING_TIME
from grainsdem.dynamics.experiments.cells.meter import HEAVY, Meter
from grainsdem.dynamics.experiments.parts.gauge import Gauge, too_soft
from grainsdem.dynamics.experiments.parts.pushed.bodies import NAME, Kind
from grainsdem.dynamics.experiments.parts.pushed.told import UNITS, PenetrationReport, PenetrationSample, summed
from grainsdem.dynamics.experiments.resting import REST_SAMPLES, Resting
from grainsdem.dynamics.mechanics import energies, snapshot
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.parts.pushed.bodies import Body
    from grainsdem.dynamics.experiments.parts.pushed.course import Course
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

CLEARANCE = 0.1
"""Gap [d] between the highest grain and the body where the second stage begins."""

REACH = 0.5
"""Gap [d] to the floor at which a body is pressed no further: a grain under it could not get out of its way."""

STANDING = 5.0
"""Time [t] for which a wheel stands on the bed before it turns."""

STILL = 5e-3
"""Speed [d/t] of a body that is at rest: it would take 200 t to go a diameter."""

ROUND_OFF = 1e-6

THROWN = 0.1
"""Mean kinetic energy [m g d], besides that of the body's own speed, that grains get where a jam gives way: of discs
under a plate it stayed below 0.05, of angular prisms it went to 0.5, and grains flew six diameters up."""


def joints_of(course: Course, up: int) -> list[tuple[str, str, Floats]]:
    """Return the joints of the body: up and, for a wheel, along x and about its axis, rolling towards +x."""
    axes = np.eye(3)
    if course.mode != "roll":
        return [("sink", "slide", axes[up])]
    return [("forward", "slide", axes[0]), ("sink", "slide", axes[up]), ("spin", "hinge", axis_of(up))]


def axis_of(up: int) -> Floats:
    """Return the axis about which a wheel that goes towards +x turns."""
    return np.cross(np.eye(3)[up], np.eye(3)[0])


def armatures_of(course: Course) -> dict[str, float]:
    """Return what keeps driven joints at their speed."""
    return {"press": {"sink": HEAVY}, "drop": {}, "roll": {"forward": HEAVY, "spin": HEAVY}}[course.mode]


class Pushing(Resting[PenetrationReport]):
    """A bed that comes to rest, and a body that goes into it."""

    is_driven = True
    columns: ClassVar[Mapping[str, str]] = UNITS

    def __init__(self, scene: Scene, body: Body, course: Course, start: Floats) -> None:
        super().__init__(scene, course.max_time)
        self.body, self.course, self.start = body, course, start
        self.half = body.half / scene.units.length
        self.engine = scene.engine
        masses = {joint: armature + course.mass for joint, armature in armatures_of(course).items()}
        self.meter = Meter(scene.engine, masses)
        self.gauge = Gauge(scene.engine, [NAME], self.centre, self.power)
        self.work = 0.0
        self.before: Floats | None = None
        """Speeds before the present step."""

    def centre(self) -> Floats:
        """Return the middle of the body [d], shape (3,)."""
        place = self.start.copy()
        place[self.scene.up] += self.engine.axle("sink")[0]
        if self.course.mode == "roll":
            place[0] += self.engine.axle("forward")[0]
        return place

    def speeds(self) -> Floats:
        """Return the speeds [d/t, 1/t] along up and x, and about the axle."""
        joints = ("sink", "forward", "spin") if self.course.mode == "roll" else ("sink",)
        return np.array([self.engine.axle(joint)[1] for joint in joints])

    def power(self, force: Floats, moment: Floats) -> float:
        """Return the power of what the body does in a step, given what is exerted on it."""
        before = self.before
        self.before = self.speeds()
        # What a force does in a step is its impulse times the mean of the speeds before and after.
        mean = self.before if before is None else 0.5 * (before + self.before)
        along = [force[self.scene.up], force[0], moment @ axis_of(self.scene.up)]
        return -float(mean @ along[: len(mean)])

    def bottom(self) -> float:
        """Return the level [d] of the body's lowest point."""
        return float(self.centre()[self.scene.up] - self.half[self.scene.up])

    def floor(self) -> float:
        """Return the level [d] of the floor."""
        return float(self.scene.source.domain.lower[self.scene.up] / self.scene.units.length)

    def surface(self) -> float:
        """Return the level [d] of the highest grain under the body, or in a wheel's track; the floor's if none is."""
        corners = world_vertices(self.scene.packing()) / self.scene.units.length
        low, high = self.start - self.half, self.start + self.half
        if self.course.mode == "roll":
            high[0] += self.course.travel
        level = [axis for axis in range(2) if axis != self.scene.up]
        # Corners are up to half a diameter from the surfaces between them.
        near = np.all([(corners[:, k] > low[k] - 0.5) & (corners[:, k] < high[k] + 0.5) for k in level], axis=0)
        return float(corners[near, self.scene.up].max(initial=self.floor()))

    def arrange(self) -> None:
        """Bring the body to the surface, one that is dropped with the speed of its fall."""
        level = self.surface() + CLEARANCE
        self.engine.place("sink", level + self.half[self.scene.up] - self.start[self.scene.up])
        fallen = max(self.course.height - CLEARANCE, 0.0) if self.course.mode == "drop" else 0.0
        self.engine.turn("sink", -float(np.sqrt(2 * fallen)))
        self.before = None

    def mark(self, now: PenetrationSample) -> dict[str, Any]:
        """Return the level of the surface [d], the energy of the bed [m g d], and the depth at which pressing ends."""
        del now
        surface = self.surface()
        depth = self.course.depth if np.isfinite(self.course.depth) else 0.5 * (surface - self.floor())
        return {"surface": surface, "energy": self.bed_energy(snapshot(self.scene, converged=False)), "depth": depth}

    def act(self) -> None:
        """Warn where walls are near."""
        distance, width = self.wall_distance(), self.width()
        if distance < width * (1 - ROUND_OFF):
            LOG.warning(
                "the %s is %.3g m from a wall, less than its width of %.3g m: walls bear a part of what it presses; "
                "take a wider box or a smaller body",
                self.body.name, distance, width,
            )  # fmt: skip

    def drive(self) -> None:
        """Hold the body above, or let it do what it does."""
        self.gauge.step()
        if self.before is None:
            self.before = self.speeds()
        course = self.course
        if self.begun is None:
            self.engine.push("sink", course.mass)
        elif course.mode == "press":
            self.meter.drive("sink", -course.speed)
        else:
            self.engine.push("sink", course.mass - course.load if course.mode == "roll" else 0.0)
            if course.mode == "roll":
                share = float(self.since() >= STANDING)
                self.meter.drive("forward", share * course.speed)
                self.meter.drive("spin", share * course.spin)

    def bed_energy(self, now: Snapshot) -> float:
        """Return kinetic and potential energy of the grains [m g d]."""
        return energies(now).total / self.scene.units.energy

    def measure(self) -> PenetrationSample:
        """Return the present sample."""
        load, now, begun = self.gauge.read(), snapshot(self.scene, converged=False), self.begun
        self.meter.read()
        if begun:
            self.work += load.power * (self.engine.time - self.samples[-1].time)
        is_wheel = self.course.mode == "roll"
        return PenetrationSample(
            time=self.engine.time,
            stage=float(begun is not None),
            kinetic_energy=self.touching_energy(now),
            depth=begun["surface"] - self.bottom() if begun else 0.0,
            speed=-self.engine.axle("sink")[1],
            force_x=float(load.force[0]),
            force_y=float(load.force[1]),
            force_z=float(load.force[2]),
            torque=-float(load.moment @ axis_of(self.scene.up)) if is_wheel else 0.0,
            travel=self.engine.axle("forward")[0] if is_wheel else 0.0,
            work=self.work,
            bed_energy=self.bed_energy(now) - begun["energy"] if begun else 0.0,
            overlap=float(-now.gaps.min(initial=0.0)) / self.scene.units.length,
        )

    def is_over(self) -> bool:
        """Return whether the body is as deep as it is to go, at rest, or at the end of its track."""
        if self.begun is None:
            return False
        if self.course.mode == "press":
            return self.samples[-1].depth >= self.begun["depth"] or self.bottom() - self.floor() < REACH
        if self.course.mode == "roll":
            return self.since() >= self._rolling_time()
        return self.has_stopped() or self.since() >= self.max_time

    def _rolling_time(self) -> float:
        """Return how long [t] a wheel stands and rolls."""
        return STANDING + (self.course.travel / self.course.speed if self.course.speed > 0 else STANDING)

    def expected_time(self) -> float:
        """Return about how long [t] the run will last; where no depth is given, that to half of the container."""
        if self.course.mode == "drop":
            return super().expected_time()
        if self.course.mode == "roll":
            return SETTLING_TIME + self._rolling_time()
        half = 0.5 * float(self.scene.source.domain.lengths[self.scene.up]) / self.scene.units.length
        return SETTLING_TIME + float(np.nan_to_num(self.course.depth, nan=half)) / self.course.speed

    def has_stopped(self) -> bool:
        """Return whether bed and body have been at rest."""
        last = self.samples[-REST_SAMPLES:]
        return self.is_at_rest() and all(abs(row.speed) < STILL for row in last)

    def share_done(self, now: PenetrationSample) -> float:
        """Return how much of the second stage is done."""
        if self.course.mode == "press" and self.begun:
            return max(0.0, float(now.depth / self.begun["depth"]))
        if self.course.mode == "roll":
            return float(now.travel / self.course.travel)
        return super().share_done(now)

    def words(self, now: PenetrationSample) -> str:
        """Return a few words on a sample of the second stage."""
        lift = now.force_y if self.scene.up == 1 else now.force_z
        scales = self.scene.units
        return f"{now.depth * scales.length:.3g} m deep, {lift * scales.force:.3g} N"

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "work": self.work}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.work, self.before = memory["work"], None
        self.gauge.reset()

    def width(self) -> float:
        """Return the shorter level side of the body [m]."""
        return float(2 * (self.body.half[0] if self.scene.up == 1 else self.body.half[:2].min()))

    def wall_distance(self) -> float:
        """Return how far the walls beside the body are [m]: those that a wheel does not go towards."""
        domain, level = self.scene.source.domain, [axis for axis in range(2) if axis != self.scene.up]
        beside = [axis for axis in level if not (self.course.mode == "roll" and axis == 0)]
        place = self.start * self.scene.units.length
        gaps = [min(place[k] - domain.lower[k], domain.upper[k] - place[k]) - self.body.half[k] for k in beside]
        return float(min(gaps, default=np.inf))

    def remarks(self) -> dict[str, Any]:
        """Return the body's mesh without its folder: the same run has the same provenance wherever its file lies."""
        return {} if self.body.name in get_args(Kind) else {"mesh": self.body.name}

    def report(self) -> PenetrationReport:
        """Return what the bed did to the body."""
        rows = [self.in_si(row) for row in self.samples if row.stage == 1.0]
        found = summed(rows, self.course.mode, self.scene.up)
        length = self.scene.units.length
        floor_distance = (self.bottom() - self.floor()) * length
        is_settled = bool(self.begun and self.begun["is_at_rest"])
        reason = self.reason(floor_distance, found["largest_overlap"], is_settled=is_settled)
        return PenetrationReport(
            **found,
            slip=self.course.slip,
            wall_distance=self.wall_distance(),
            floor_distance=floor_distance,
            at_rest=self.has_stopped(),
            is_settled=is_settled,
            is_valid=not reason,
            reason=reason,
            **self.cost(),
        )

    def thrown(self) -> float:
        """Return the largest mean kinetic energy of the grains [m g d] with the body, less that of its own speed."""
        most = max((row.kinetic_energy for row in self.samples if row.stage == 1.0), default=0.0)
        return float(most) - 0.5 * self.course.speed**2

    def reason(self, floor_distance: float, overlap: float, *, is_settled: bool) -> str:
        """Return why the run is no measurement, or nothing."""
        width, wall = self.width(), self.wall_distance()
        if not is_settled:
            return "the bed was not at rest when the body came"
        if self.course.mode == "press" and self.begun and self.samples[-1].depth < self.begun["depth"]:
            return f"the floor was reached before a depth of {self.begun['depth'] * self.scene.units.length:.3g} m"
        if too_soft(overlap):
            return too_soft(overlap)
        if self.course.mode != "drop" and (energy := self.thrown()) > THROWN:
            return (
                f"a jam gave way and threw grains, to a mean kinetic energy of {energy:.2g} m g d; a deeper bed, less "
                f"friction or a smaller time_step keeps less in store"
            )
        for name, distance in (("a wall", wall), ("the floor", floor_distance)):
            if distance < width * (1 - ROUND_OFF):
                return f"{name} was {distance:.3g} m from the body, less than its width of {width:.3g} m"
        return ""
