"""The loop of every run: steps, samples, checks, the way back when something goes wrong, history and checkpoints."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from grainsdem.dynamics.around import bodies_of, places_of
from grainsdem.dynamics.checkpoint import (
    Checkpoint,
    checkpoint_path,
    load_checkpoint,
    open_history,
    save_checkpoint,
)
from grainsdem.dynamics.engine import EngineError
from grainsdem.dynamics.watch import TroubleError
from grainsdem.errors import InputError, UnstableError

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.scene import Scene
    from grainsdem.storage import HistoryWriter

SAMPLE_TIME = 0.2
"""Time between samples [t]."""

SAMPLES_PER_CHUNK = 16
"""Samples between checkpoints: a run that is killed loses at most so many."""

SAMPLES_PER_FRAME = 2
"""Samples between frames of the history: pictures are to move smoothly, and files to stay small."""

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
class Record:
    """What is kept of a run while it goes.

    Parameters
    ----------
    path : path-like, optional
        HDF5 file of the history; its checkpoint lies beside it until the run has ended well.
    resume : bool
        Whether to go on from that checkpoint where there is one.
    options : dict of str to JSON value
        Options of the run: one with others does not go on from its checkpoint.
    """

    path: str | os.PathLike[str] | None = None
    resume: bool = False
    options: Mapping[str, Any] | None = None

    def __post_init__(self) -> None:
        if self.resume and self.path is None:
            raise InputError("resume needs the history of the run that is to go on")


class Loop:
    """A run of one experiment; each experiment is a subclass that says what it measures and when it is over.

    Parameters
    ----------
    scene : Scene
        What moves.
    record : Record
        What is kept while it goes.
    """

    experiment: str
    columns: ClassVar[Mapping[str, str]]
    is_driven: ClassVar[bool] = False
    comes_and_goes: ClassVar[bool] = False
    """Whether grains are taken out or put in, so that the last packing need not have all that moved."""
    sample_time = SAMPLE_TIME

    def __init__(self, scene: Scene, record: Record) -> None:
        self.scene = scene
        self.record = record
        self.halvings = 0
        self.n_steps = 0
        self.n_frames = 0
        self.samples: list[Any] = []
        self._writer: HistoryWriter | None = None
        self._bodies: tuple[str, ...] = ()

    def prepare(self) -> None:
        """Act on the scene before the steps of each sample; it may depend on nothing but the state and the memory."""

    def drive(self) -> None:
        """Act on the scene before each step, where `is_driven`."""
        raise NotImplementedError

    def measure(self) -> Any:
        """Return the present sample, a named tuple of numbers in grain units."""
        raise NotImplementedError

    def check(self, now: Any) -> None:
        """Raise `TroubleError` where something is wrong with the present state."""
        raise NotImplementedError

    def is_over(self) -> bool:
        """Return whether the run has come to its end; called before each sample."""
        raise NotImplementedError

    def keep(self, now: Any) -> None:
        """Hear of a good sample, after it was appended: change stages, tell the progress."""

    def in_si(self, row: Any) -> Any:
        """Return a sample as it is stored."""
        return row

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {"halvings": self.halvings, "n_steps": self.n_steps, "time_step": self.scene.engine.time_step}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        self.halvings, self.n_steps = memory["halvings"], memory["n_steps"]
        self.scene.set_time_step(memory["time_step"])

    def run(self) -> None:
        """Go on until the experiment is over; samples are kept and, where asked for, history and checkpoints.

        Raises
        ------
        UnstableError
            If the run goes wrong and three smaller time steps do not help.
        """
        with self.scene.engine.muted(), ExitStack() as stack:
            self._begin(stack)
            try:
                self._loop()
                if (len(self.samples) - 1) % SAMPLES_PER_FRAME:
                    self._append_frame()  # the end, too
            except KeyboardInterrupt as interrupt:
                if self._writer is not None:
                    interrupt.add_note(f"the history up to {self.time_in_si():.4g} s is kept in {self._writer.path}")
                raise
        if self.record.path is not None:
            checkpoint_path(Path(self.record.path)).unlink(missing_ok=True)

    def time_in_si(self) -> float:
        """Return the time [s] of the last good sample."""
        return float(self.in_si(self.samples[-1]).time)

    def history(self) -> dict[str, NDArray[Any]]:
        """Return the samples as series, as they are stored."""
        rows = [self.in_si(row) for row in self.samples]
        return {
            name: np.array(values, dtype=np.float64)
            for name, values in zip(rows[0]._fields, zip(*rows, strict=True), strict=True)
        }

    def _begin(self, stack: ExitStack) -> None:
        """Measure the start, or take back what a checkpoint holds, and open the history."""
        self.samples = [self.measure()]
        if self.record.path is None:
            return
        path = Path(self.record.path)
        if self.record.resume and checkpoint_path(path).exists():
            found = load_checkpoint(checkpoint_path(path), self._identity())
            kind = type(self.samples[0])
            self.samples = [kind(*row) for row in found.samples.tolist()]
            self.recall(found.memory)
            self.scene.restore(found.state)
            self.n_frames = found.n_frames
        else:
            checkpoint_path(path).unlink(missing_ok=True)
        attributes = {
            "experiment": self.experiment,
            **asdict(self.scene.units),
            "provenance": list(self.scene.source.provenance),
        }
        rows = [self.in_si(row)._asdict() for row in self.samples[1:]]
        around = bodies_of(self.scene)
        self._bodies = around.names
        self._writer = stack.enter_context(
            open_history(
                path,
                self.columns,
                n_grains=self.scene.n_grains,
                attributes=attributes,
                rows=rows,
                n_frames=self.n_frames,
                grains=self.scene.source if self.comes_and_goes else None,
                around=around,
            )
        )
        if not self.n_frames:
            self._append_frame()

    def _loop(self) -> None:
        good, memory = self.scene.state(), self.memory()
        while not self.is_over():
            try:
                n_steps = self._advance()
                now = self.measure()
                if not now.time > self.samples[-1].time:  # an engine that begins anew puts its clock back
                    raise TroubleError(f"the clock went from {self.samples[-1].time:.6g} to {now.time:.6g}")  # noqa: TRY301  (one way back for all)
                self.check(now)
            except (TroubleError, EngineError) as trouble:
                self._go_back(good, memory, trouble)
                memory = self.memory()
                continue
            self.n_steps += n_steps
            self._append(now)
            good, memory = self.scene.state(), self.memory()
            if self._writer is not None and (len(self.samples) - 1) % SAMPLES_PER_CHUNK == 0:
                self._save(good, memory)

    def _advance(self) -> int:
        engine = self.scene.engine
        self.prepare()
        n_steps = max(1, round(self.sample_time / engine.time_step))
        if not self.is_driven:
            engine.step(n_steps)
            return n_steps
        for _ in range(n_steps):
            self.drive()
            engine.step(1)
        return n_steps

    def _append(self, now: Any) -> None:
        self.samples.append(now)
        if self._writer is not None:
            self._writer.append(**self.in_si(now)._asdict())
            if (len(self.samples) - 1) % SAMPLES_PER_FRAME == 0:
                self._append_frame()
        self.keep(now)

    def _append_frame(self) -> None:
        """Write where the grains are now, and what is around them."""
        if self._writer is not None:
            positions, quaternions = self.scene.frame()
            around = places_of(self.scene, self._bodies)
            self._writer.append_frame(self.time_in_si(), positions=positions, quaternions=quaternions, around=around)
            self.n_frames += 1

    def _save(self, state: NDArray[np.float64], memory: dict[str, Any]) -> None:
        """Write a checkpoint, once the history holds all that it counts on."""
        if self._writer is None:
            return
        self._writer.flush()
        samples = np.array([tuple(row) for row in self.samples], dtype=np.float64)
        checkpoint = Checkpoint(state, samples, memory, self._identity(), self.n_frames)
        save_checkpoint(checkpoint, checkpoint_path(self._writer.path))

    def _identity(self) -> dict[str, Any]:
        return {
            "experiment": self.experiment,
            "engine": self.scene.engine.name,
            "model": self.scene.fingerprint,
            **(self.record.options or {}),
        }

    def halve_step(self) -> None:
        """Halve the time step."""
        self.scene.set_time_step(self.scene.engine.time_step / 2)

    def _go_back(self, good: NDArray[np.float64], memory: Mapping[str, Any], trouble: Exception) -> None:
        """Return to the last good state with half the time step, or give up."""
        failed_at = self.scene.time() * self.scene.units.time
        self.scene.restore(good)
        self.recall(memory)
        if self.halvings == HALVINGS:
            raise UnstableError(
                f"the run went wrong at {failed_at:.6g} s: {trouble}; {HALVINGS} smaller time steps did not help. "
                f"The last good state is that at {self.scene.time() * self.scene.units.time:.6g} s",
                self.scene.packing(),
            ) from trouble
        self.halvings += 1
        self.halve_step()
