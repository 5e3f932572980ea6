"""Settling: grains fall under gravity until they are at rest."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from exporters.container import wall_names
from exporters.mjcf import MjcfOptions
from exporters.rest import frictions
from grainsdem.described import described
from grainsdem.dynamics.budget import allow, settling_budget
from grainsdem.dynamics.engine.rain import RAIN_SPEED, Rain
from grainsdem.dynamics.engine.relief import LEAST_WEIGHT, UNLOADING, are_walls_smooth, weight_share
from grainsdem.dynamics.experiments.shared import (
    NOTES,
    Gravity,
    Mixing,
    Restitution,
    RollingFriction,
    Spheres,
    WallFriction,
)
from grainsdem.dynamics.loop import Loop, Progress, Record
from grainsdem.dynamics.mechanics import SAMPLE_UNITS, Sample, contact_graph, sample, snapshot
from grainsdem.dynamics.scene import equip, refuse_overlap, scene_of
from grainsdem.dynamics.settled import Settled, SettleReport
from grainsdem.dynamics.starting import PerGrain, Start, begin, downward
from grainsdem.dynamics.watch import find_trouble, stored_energy
from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.model import Packing
from grainsdem.options import Note, Stored, option
from grainsdem.values import ByShare, Coefficient, Positive

if TYPE_CHECKING:
    from grainsdem.dynamics.scene import Scene

Floats = NDArray[np.float64]

REST_ENERGY = 1e-6
"""Mean kinetic energy of a grain at rest [m g d]."""

REST_FORCE = 0.1
"""Unbalanced force of a bed at rest. Contacts of many points flicker: it floors at 4e-3 to 3e-2."""

REST_SAMPLES = 5
"""How many samples in a row must be at rest."""

REST_OVERLAP = 5e-4
"""Deepest overlap of a bed at rest [d]. It falls with the square of the time step, so a bed that rests on deeper ones
goes on with half the step."""

REFINEMENTS = 3
"""How often the time step is halved to make the overlaps shallower."""

CALM_ENERGY = 1e-4
"""Mean kinetic energy of a grain [m g d] below which `CALM_DRAG` acts."""

CALM_DRAG = 0.5
"""Rate [1/t] at which a bed that is nearly at rest loses velocity besides all else. Contacts of points do not resist
rolling: a grain that hangs on two of them would swing for ever. What is at rest does not feel it."""

LEAST_TIME = 2.0
"""Time before which nothing counts as rest [√(d/g)]: grains that have just been let go are slow, too."""


@gated
@described(start="pour", caution="In Python grains start in place where `start` is not given.")
def settle(
    packing: Packing,
    *,
    start: Annotated[
        Start,
        option(
            "Where grains start: poured they are rotated, reordered, lifted apart and let go at once; as rain they are "
            "let go layer by layer; scattered they fall from random places just above the floor, small grains between "
            "large ones, in space; in place they settle into a jigsaw, denser than any random pack, as the "
            "tessellation remembers.",
        ),
    ] = "place",
    spheres: Spheres = False,
    friction: Annotated[
        PerGrain | None,
        Stored(ByShare[Coefficient]),
        option(
            "Coefficient of friction among all grains in this run; or several, which grains keep, and their shares by "
            "number as 0.3:0.5,0.6:0.5, or in Python a function of the diameters. By default each grain has its own "
            "(`Packing.frictions`), or 0.5 where there are none.",
        ),
    ] = None,
    wall_friction: WallFriction = None,
    mixing: Mixing = "max",
    rolling_friction: RollingFriction = 0.0,
    restitution: Restitution = None,
    gravity: Gravity = 9.81,
    direction: Annotated[
        ArrayLike | None,
        Stored(tuple[float, float, float] | None),
        option("Where gravity points, of any length: toward the floor; straight down by default."),
    ] = None,
    density: Annotated[
        PerGrain | None,
        Stored(ByShare[Positive]),
        option(
            "Density instead of the grains' own; or several and their shares by number as 2650:0.9,5200:0.1, drawn at "
            "random, or in Python a function of the diameters.",
            "kg/m³",
        ),
    ] = None,
    drop_height: Annotated[
        float | None,
        option(
            "How far above the bed below it a grain of rain is let go, so that all fall about as far; by default at "
            "half the container's height. What is poured falls from where its lattice is.",
            "m",
            gt=0,
        ),
    ] = None,
    rng: Annotated[
        np.random.Generator | int | None,
        Note("numpy.random.Generator, int or None", "Source of randomness, or a seed for one, of the start."),
    ] = None,
    time_step: Annotated[
        float,
        option(
            "Time step in units of t = √(d/g), d being the median diameter. The overlap at rest grows with its square: "
            "a bed at rest on overlaps deeper than 5e-4 d goes on with half the step until they are shallower, three "
            "times at most; its contacts get stiffer under a tenth of its weight, between walls that are smooth "
            "meanwhile.",
            gt=0,
        ),
    ] = 0.01,
    max_time: Annotated[float, option("Time limit, from when the last grain is let go.", "√(d/g)", gt=0)] = 200.0,
    max_hours: Annotated[float, Note(*NOTES["max_hours"])] = 24.0,
    history_path: Annotated[str | os.PathLike[str] | None, Note(*NOTES["history_path"])] = None,
    resume: Annotated[bool, Note(*NOTES["resume"])] = False,
    progress: Annotated[
        Callable[[Progress], None] | None,
        Note("callable, optional", "Called with a `Progress` at every sample."),
    ] = None,
) -> Settled:
    """Let grains fall under gravity in their container until they are at rest.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap. The domain's floor and side walls are the container, be it a box, a cylinder or a
        hopper; there is no lid. Planar packings move in their plane, and fall along −y.

    Returns
    -------
    Settled
        Packing, history, report and contacts.

    Raises
    ------
    InputError
        If the packing overlaps at the start, is periodic, an option is out of range, or the run does not fit.
    UnstableError
        If the run goes wrong and three smaller time steps do not help; its ``last_good`` is the last good packing.

    Notes
    -----
    At rest means: at five samples in a row, 0.2 √(d/g) apart, the mean kinetic energy of a grain is below 1e-6 m g d
    and the mean resultant force below a tenth of the mean contact force. Once the mean energy is below 1e-4 m g d, a
    drag takes velocity away at a rate of 0.5 √(g/d): see `CALM_DRAG`.
    """
    if not max_time > 0:
        raise InputError(f"max_time must be positive; got {max_time}")
    # A number is for this run; more than one are the grains' own from now on.
    own, number = (friction, None) if isinstance(friction, Mapping) or callable(friction) else (None, friction)
    options = MjcfOptions(
        friction=number, wall_friction=wall_friction, mixing=mixing, rolling_friction=rolling_friction,
        restitution=restitution, gravity=gravity, time_step=time_step,
    )  # fmt: skip
    frictions(packing, number, options.wall_friction).refuse_unknown(wall_names(packing.domain))
    first = begin(
        packing, start=start, spheres=spheres, density=density, friction=own, drop_height=drop_height, rng=rng
    )
    speed = RAIN_SPEED if start == "rain" else None
    allow(settling_budget(first, time_step=time_step, max_time=max_time, speed=speed), max_hours=max_hours)
    apparatus = equip(first, options, are_spheres=spheres)
    if direction is not None:
        apparatus.set_gravity(downward(direction, is_planar=packing.domain.is_planar))
    scene = scene_of(first, apparatus.text(), gravity, are_spheres=spheres)
    refuse_overlap(scene)
    record = Record(history_path, resume, {"max_time": max_time, "drop_height": drop_height})
    run = SettleLoop(scene, record, progress, max_time)
    run.bounces = restitution is not None
    if start == "rain":
        run.rain(None if drop_height is None else drop_height / scene.units.length)
    run.run()
    settled = scene.packing().with_step(
        "settle", start=start, spheres=spheres, friction=number, wall_friction=options.wall_friction, mixing=mixing,
        rolling_friction=rolling_friction, restitution=restitution, gravity=gravity,
        direction=None if direction is None else scene.engine.gravity.tolist(), time_step=time_step,
        drop_height=run.drop_height(), at_rest=run.at_rest,
        **scene.rest(options),
    )  # fmt: skip
    return Settled(settled, run.history(), _report(run), contact_graph(snapshot(scene)))


class SettleLoop(Loop):
    """Grains that fall until they are at rest, and then once more with half the step while they overlap too much."""

    experiment = "settle"
    columns = SAMPLE_UNITS
    bounces = False  # whether contacts give back what they hold

    def __init__(self, scene: Scene, record: Record, progress: Callable[[Progress], None] | None, limit: float) -> None:
        super().__init__(scene, record)
        self.progress = progress
        self.limit = limit
        self.refinements = 0
        self.at_rest = False
        self._rested_from = 0
        self._relief: dict[str, Any] | None = None
        self._lowest = sample(scene).total_energy
        self._first_heights = scene.poses()[0][:, scene.up].copy()
        self._rain: Rain | None = None
        self._is_calm = False

    def rain(self, drop_height: float | None) -> None:
        """Let grains come down at a steady speed, and fall from half the container's height or so far above the bed."""
        box, scale = self.scene.source.domain, self.scene.units.length
        corners = box.lower / scale, box.upper / scale
        self._rain = Rain(self.scene.engine, *corners, up=self.scene.up, drop_height=drop_height)
        self.limit += self._rain.lasts()
        self._lowest = sample(self.scene).total_energy

    def drop_height(self) -> float:
        """Return how far the grains fell [m], in the mean; those that wait when time is up have not."""
        last = self.scene.poses()[0][:, self.scene.up]
        first = self._first_heights if self._rain is None else self._rain.let_go
        return float(np.where(np.isnan(first), 0.0, first - last).mean() * self.scene.units.length)

    def prepare(self) -> None:
        """Take the weight off grains that have not been let go, and most of it off a bed that is refined."""
        if self._rain is not None and not self._rain.is_over:
            self._rain.fall()
        if self._relief is not None:
            self._relieve(**self._relief)

    def measure(self) -> Sample:
        """Return what the state of the last step says."""
        return sample(self.scene)

    def check(self, now: Sample) -> None:
        """Raise `TroubleError` where something is wrong with the present state."""
        find_trouble(self.scene, now, self.samples[-1], self._lowest)

    def is_over(self) -> bool:
        """Return whether the bed is at rest or time is up."""
        return self.at_rest or self.scene.time() >= self.limit

    def keep(self, now: Sample) -> None:
        """Tell the progress, and look whether the bed is at rest."""
        if self._relief is None:
            self._lowest = min(self._lowest, now.total_energy + self.bounces * stored_energy(self.scene))
        if self.progress is not None:
            second = self.scene.units.time
            times = now.time * second, self.limit * second
            self.progress(Progress(*times, now.kinetic_energy, REST_ENERGY, now.n_contacts))
        if not self._is_calm and now.kinetic_energy < CALM_ENERGY and now.time > LEAST_TIME:
            self._is_calm = True
            self.scene.engine.set_drag(CALM_DRAG)
        if self._rests():
            self.at_rest = now.overlap_max <= REST_OVERLAP or self.refinements == REFINEMENTS
            if not self.at_rest:
                self.refine()

    def refine(self) -> None:
        """Halve the time step of a bed at rest once little weight is on it, and wait for rest under all of it anew."""
        self.refinements += 1
        self._relief = {"begun": self.scene.time(), "is_halved": False}
        self._allow_lift()

    def halve_step(self) -> None:
        """Halve the time step; contacts get stiffer with it."""
        self._allow_lift()
        super().halve_step()

    def _relieve(self, begun: float, *, is_halved: bool) -> None:
        """Leave a bed that is refined the weight that is due now, and halve its step under the least."""
        since = round(self.scene.time() - begun, 6)  # rounding errors of the clock decide nothing
        if not is_halved and since >= UNLOADING:
            self._relief = {"begun": begun, "is_halved": True}
            self.halve_step()
        share = weight_share(since)
        self.scene.engine.hold_up(np.full(self.scene.n_grains, 1.0 - share))
        self.scene.engine.make_smooth(self.scene.upright_walls if are_walls_smooth(since) else [])
        if share == 1.0 and is_halved:
            self._relief, self._rested_from = None, len(self.samples)

    def _allow_lift(self) -> None:
        """Expect contacts that get stiffer, or bear less, to lift the bed by the overlaps that they push out."""
        last = self.samples[-1]
        floor = self.scene.source.domain.lower[self.scene.up] / self.scene.units.length
        # Under a tenth of the weight the same energy lifts a bed ten times as far.
        weight = 1.0 if self._relief is None else LEAST_WEIGHT
        # A column reaches up to twice the mean height and has no more contacts than diameters.
        self._lowest = last.total_energy + last.overlap_max * 2 * (last.height - floor) / weight
        # Contacts four times as stiff give back four times what they hold.
        self._lowest += 4 * self.bounces * stored_energy(self.scene)

    def in_si(self, row: Sample) -> Sample:
        """Return a sample with its time [s] and height [m] in SI."""
        return row._replace(time=row.time * self.scene.units.time, height=row.height * self.scene.units.length)

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples."""
        return {
            **super().memory(), "refinements": self.refinements, "at_rest": self.at_rest,
            "rested_from": self._rested_from, "relief": self._relief, "lowest": self._lowest,
            "let_go": None if self._rain is None else [None if np.isnan(z) else z for z in self._rain.let_go.tolist()],
            "is_calm": self._is_calm,
        }  # fmt: skip

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.refinements, self.at_rest = memory["refinements"], memory["at_rest"]
        self._rested_from, self._relief, self._lowest = memory["rested_from"], memory["relief"], memory["lowest"]
        self._is_calm = memory["is_calm"]
        if self._rain is not None:
            self._rain.let_go = np.array(memory["let_go"], dtype=np.float64)
        self.scene.engine.set_drag(CALM_DRAG if self._is_calm else 0.0)

    def _rests(self) -> bool:
        is_new = len(self.samples) - self._rested_from <= REST_SAMPLES
        if is_new or self._relief is not None or self.scene.time() <= LEAST_TIME:
            return False
        last = self.samples[-REST_SAMPLES:]
        return all(s.kinetic_energy < REST_ENERGY and s.unbalanced_force < REST_FORCE for s in last)


def _report(run: SettleLoop) -> SettleReport:
    last, lately, second = run.samples[-1], run.samples[-REST_SAMPLES:], run.scene.units.time
    return SettleReport(
        at_rest=run.at_rest, time=last.time * second, time_step=run.scene.engine.time_step * second,
        n_steps=run.n_steps, halvings=run.halvings, refinements=run.refinements,
        kinetic_energy=last.kinetic_energy, unbalanced_force=last.unbalanced_force,
        overlap_mean=last.overlap_mean, overlap_max=last.overlap_max,
        floor_force=float(np.mean([s.floor_force for s in lately])),
        wall_force=float(np.mean([s.wall_force for s in lately])),
        n_contacts=int(last.n_contacts),
        drop_height=run.drop_height(),
    )  # fmt: skip
