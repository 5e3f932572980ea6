"""Settling: grains fall under gravity until they are at rest."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.mjcf import MjcfOptions
from exporters.mujoco_log import quiet
from grainsdem.dynamics.mechanics import SAMPLE_UNITS, Sample, sample
from grainsdem.dynamics.scene import Scene, build
from grainsdem.dynamics.watch import TroubleError, find_trouble
from grainsdem.errors import InputError, UnstableError
from grainsdem.storage import HistoryWriter

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import ContactGraph, Packing

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

SAMPLE_TIME = 0.2
"""Time between samples [√(d/g)]."""

LEAST_TIME = 2.0
"""Time before which nothing counts as rest [√(d/g)]: grains that have just been let go are slow, too."""

START_OVERLAP = 1e-2
"""Deepest overlap at the start [d]; a deeper one explodes."""

HALVINGS = 3
"""How often the time step is halved before a run is given up."""


class Progress(NamedTuple):
    """What a long run is waiting for.

    Parameters
    ----------
    time : float
        Simulated time [s].
    limit : float
        Time [s] at which it stops in any case.
    energy : float
        Mean kinetic energy of a grain [m g d].
    goal : float
        Energy that it is waiting for.
    n_contacts : int
        Contact points that carry force.
    """

    time: float
    limit: float
    energy: float
    goal: float
    n_contacts: int


@dataclass(frozen=True, slots=True)
class SettleReport:
    """How a settling run went.

    Parameters
    ----------
    at_rest : bool
        Whether the criterion of rest was met before the time limit.
    time : float
        Simulated time [s].
    time_step : float
        Last time step [s].
    n_steps : int
        Steps taken, those of abandoned tries not counted.
    halvings : int
        How often the time step was halved to keep the run stable.
    refinements : int
        How often it was halved at rest to make the overlaps shallower.
    kinetic_energy : float
        Mean kinetic energy of a grain at the end [m g d].
    unbalanced_force : float
        Mean resultant force over mean contact force at the end.
    overlap_mean, overlap_max : float
        Depth of overlapping contacts at the end, relative to the median diameter.
    floor_force : float
        Force on the container along gravity over the weight of the grains, mean of the last samples: a single step's
        forces are known to a few percent only.
    n_contacts : int
        Contact points that carry force at the end.
    """

    at_rest: bool
    time: float
    time_step: float
    n_steps: int
    halvings: int
    refinements: int
    kinetic_energy: float
    unbalanced_force: float
    overlap_mean: float
    overlap_max: float
    floor_force: float
    n_contacts: int

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """What `settle` returns.

    Parameters
    ----------
    packing : Packing
        The grains where they came to rest.
    history : dict of ndarray
        Series over time: ``time`` [s], ``kinetic_energy`` and ``total_energy`` [m g d a grain],
        ``unbalanced_force``, ``n_contacts``, ``overlap_mean`` and ``overlap_max`` [d], ``floor_force`` [weight],
        ``height`` [m].
    report : SettleReport
        How the run went.
    contacts : ContactGraph
        Pairs that press on each other at the end, as MuJoCo found them.
    """

    packing: Packing
    history: dict[str, NDArray[Any]]
    report: SettleReport
    contacts: ContactGraph


def settle(
    packing: Packing,
    *,
    friction: float = 0.5,
    wall_friction: float | None = None,
    gravity: float = 9.81,
    time_step: float = 0.01,
    max_time: float = 200.0,
    history_path: str | os.PathLike[str] | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> Settled:
    """Let the grains fall under gravity in their container until they are at rest.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap. Grains in place settle into a jigsaw, denser than any random pack: `shuffle` them first
        for a bed as poured. The domain's floor and side walls are the container; there is no lid.
    friction : float
        Coefficient of friction among grains [1].
    wall_friction : float, optional
        Coefficient of friction with the walls [1]; that of the grains by default.
    gravity : float
        Acceleration [m/s²], along −z.
    time_step : float
        Time step in units of √(d/g), d being the median diameter. The overlap at rest grows with its square, so a bed
        at rest on overlaps deeper than 5e-4 d goes on with half the step until they are shallower, three times at most.
    max_time : float
        Time limit in units of √(d/g).
    history_path : str or path-like, optional
        HDF5 file that the history is appended to while the run goes, so that an interrupted run keeps what it had.
    progress : callable, optional
        Called with a `Progress` at every sample.

    Returns
    -------
    Settled
        Packing, history, report and contacts.

    Raises
    ------
    InputError
        If the packing overlaps at the start, is periodic or planar, or an option is out of range.
    UnstableError
        If the run goes wrong and three smaller time steps do not help; its ``last_good`` is the last good packing.

    Notes
    -----
    At rest means: at five samples in a row, 0.2 √(d/g) apart, the mean kinetic energy of a grain is below 1e-6 m g d
    and the mean resultant force below a tenth of the mean contact force.
    """
    if not max_time > 0:
        raise InputError(f"max_time must be positive; got {max_time}")
    options = MjcfOptions(friction=friction, wall_friction=wall_friction, gravity=gravity, time_step=time_step)
    scene = build(packing, options)
    _refuse_overlap(scene)
    with quiet(), ExitStack() as stack:
        writer = None
        if history_path is not None:
            attributes = {
                "experiment": "settle",
                **asdict(scene.units),
                "provenance": list(packing.provenance),
            }
            writer = stack.enter_context(HistoryWriter(history_path, SAMPLE_UNITS, attributes=attributes))
        run = _Run(scene, writer, progress, max_time)
        try:
            at_rest = run.until_rest()
        except KeyboardInterrupt as interrupt:
            if writer is not None:
                interrupt.add_note(f"the history up to {run.time_in_si():.4g} s is kept in {writer.path}")
            raise
    report = _report(scene, run, at_rest=at_rest)
    settled = scene.packing().with_step(
        "settle",
        friction=friction,
        wall_friction=wall_friction,
        gravity=gravity,
        time_step=time_step,
        at_rest=at_rest,
    )
    return Settled(settled, run.history(), report, scene.contacts())


def _refuse_overlap(scene: Scene) -> None:
    distances = np.asarray(scene.data.contact.dist)
    if distances.size and distances.min() < -START_OVERLAP:
        worst = int(np.argmin(distances))
        names = [scene.model.body(b).name for b in scene.model.geom_bodyid[scene.data.contact.geom[worst]]]
        raise InputError(
            f"the packing must not overlap by more than {START_OVERLAP:g} d at the start; "
            f"{' and '.join(names)} overlap by {-distances[worst]:.3g} d"
        )


class _Run:
    """The loop of one run: steps, samples, and the way back when something goes wrong."""

    def __init__(
        self,
        scene: Scene,
        writer: HistoryWriter | None,
        progress: Callable[[Progress], None] | None,
        max_time: float,
    ) -> None:
        self.scene = scene
        self.writer = writer
        self.progress = progress
        self.max_time = max_time
        self.samples = [sample(scene)]
        self._lowest = self.samples[0].total_energy
        self.halvings = 0
        self.refinements = 0
        self.n_steps = 0
        self._rested_from = 0

    def until_rest(self) -> bool:
        """Step until the bed is at rest or time is up; return which."""
        good = self.scene.state()
        while self.scene.time() < self.max_time:
            try:
                n_steps = self._advance()
                now = sample(self.scene)
                find_trouble(self.scene, now, self.samples[-1], self._lowest)
            except (TroubleError, _fatal_error()) as trouble:
                self._go_back(good, trouble)
                continue
            good = self.scene.state()
            self.n_steps += n_steps
            self._keep(now)
            if self._is_at_rest():
                if now.overlap_max <= REST_OVERLAP or self.refinements == REFINEMENTS:
                    return True
                self._refine()
        return False

    def time_in_si(self) -> float:
        """Return the time [s] of the last good sample."""
        return self.samples[-1].time * self.scene.units.time

    def history(self) -> dict[str, NDArray[Any]]:
        """Return the samples as series in SI where they have a unit."""
        return {
            name: np.array(values)
            for name, values in zip(Sample._fields, zip(*map(self._in_si, self.samples), strict=True), strict=True)
        }

    def _advance(self) -> int:
        import mujoco

        n_steps = max(1, round(SAMPLE_TIME / float(self.scene.model.opt.timestep)))
        # Short calls: an interrupt is answered between them.
        for _ in range(n_steps):
            mujoco.mj_step(self.scene.model, self.scene.data)
        return n_steps

    def _keep(self, now: Sample) -> None:
        self.samples.append(now)
        self._lowest = min(self._lowest, now.total_energy)
        if self.writer is not None:
            self.writer.append(**self._in_si(now)._asdict())
        if self.progress is not None:
            second = self.scene.units.time
            self.progress(
                Progress(now.time * second, self.max_time * second, now.kinetic_energy, REST_ENERGY, now.n_contacts)
            )

    def _in_si(self, now: Sample) -> Sample:
        return now._replace(time=now.time * self.scene.units.time, height=now.height * self.scene.units.length)

    def _is_at_rest(self) -> bool:
        if self.scene.time() <= LEAST_TIME or len(self.samples) - self._rested_from <= REST_SAMPLES:
            return False
        last = self.samples[-REST_SAMPLES:]
        return all(s.kinetic_energy < REST_ENERGY and s.unbalanced_force < REST_FORCE for s in last)

    def _refine(self) -> None:
        """Halve the time step of a bed at rest, and wait for rest anew."""
        self.refinements += 1
        self._rested_from = len(self.samples)
        self._halve_step()

    def _halve_step(self) -> None:
        """Halve the time step; the contacts that get stiffer with it may lift the bed by the overlaps they push out."""
        last = self.samples[-1]
        floor = self.scene.source.domain.lower[2] / self.scene.units.length
        # A column reaches up to twice the mean height and has no more contacts than diameters.
        self._lowest = last.total_energy + last.overlap_max * 2 * (last.height - floor)
        self.scene.set_time_step(self.scene.model.opt.timestep / 2)

    def _go_back(self, good: NDArray[np.float64], trouble: Exception) -> None:
        """Return to the last good state with half the time step, or give up."""
        failed_at = self.scene.time() * self.scene.units.time
        self.scene.restore(good)
        if self.halvings == HALVINGS:
            raise UnstableError(
                f"the run went wrong at {failed_at:.6g} s: {trouble}; {HALVINGS} smaller time steps did not help. "
                f"The last good state is that at {self.scene.time() * self.scene.units.time:.6g} s",
                self.scene.packing(),
            ) from trouble
        self.halvings += 1
        self._halve_step()


def _fatal_error() -> type[Exception]:
    """Return what MuJoCo raises where it cannot go on, for want of memory as a rule."""
    import mujoco

    kind: type[Exception] = mujoco.FatalError
    return kind


def _report(scene: Scene, run: _Run, *, at_rest: bool) -> SettleReport:
    last = run.samples[-1]
    return SettleReport(
        at_rest=at_rest,
        time=last.time * scene.units.time,
        time_step=scene.model.opt.timestep * scene.units.time,
        n_steps=run.n_steps,
        halvings=run.halvings,
        refinements=run.refinements,
        kinetic_energy=last.kinetic_energy,
        unbalanced_force=last.unbalanced_force,
        overlap_mean=last.overlap_mean,
        overlap_max=last.overlap_max,
        floor_force=float(np.mean([s.floor_force for s in run.samples[-REST_SAMPLES:]])),
        n_contacts=last.n_contacts,
    )
