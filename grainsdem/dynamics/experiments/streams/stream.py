"""Runs in which grains come and go: who is there, how often each has come in and left, and what that weighs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.dynamics.experiments.resting import Resting
from grainsdem.dynamics.experiments.rig import Report
from grainsdem.dynamics.mechanics import snapshot

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.streams.inlet import Inlet
    from grainsdem.dynamics.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Bools = NDArray[np.bool_]

NOBODY = 0.0
"""Kinetic energy of a container without a grain."""


class Stream(Resting[Report]):
    """A run in which grains are taken out where they leave, and put in at an inlet.

    What is taken out stays in the model, touches nothing and does not move until it is put in again.

    Parameters
    ----------
    scene : Scene
        What moves.
    max_time : float
        Time limit [t] of the second stage.
    inlet : Inlet, optional
        Where grains come in.
    speed : float
        Speed [d/t] along gravity with which they do.
    """

    comes_and_goes = True

    def __init__(self, scene: Scene, max_time: float, inlet: Inlet | None = None, speed: float = 0.0) -> None:
        super().__init__(scene, max_time)
        self.inlet, self._velocity = inlet, speed * np.asarray(scene.engine.gravity)
        self.masses = np.asarray(scene.engine.masses)
        self.n_entered = np.zeros(scene.n_grains, dtype=np.int64)
        self.n_left = np.zeros(scene.n_grains, dtype=np.int64)

    @property
    def is_present(self) -> Bools:
        """Which grains are there, shape (n,)."""
        return self.scene.engine.is_present

    def has_left(self) -> Bools:
        """Return which grains are beyond the outlet, shape (n,); of those that are absent it does not matter."""
        raise NotImplementedError

    def due(self) -> NDArray[np.int64]:
        """Return the numbers of those grains that are to come in now, the first one first."""
        return np.empty(0, dtype=np.int64)

    def prepare(self) -> None:
        """Take out the grains that have left, and put in those that are due and find a place."""
        self._take_out()
        if self.inlet is None:
            return
        waiting = self.due()
        if waiting.size:
            found = self.inlet.find(waiting, len(self.samples))
            self.n_entered[found.grains] += 1
            self._set_present(found.grains, is_present=True)
            velocities = np.tile(self._velocity, (len(found.grains), 1))
            self.scene.engine.insert(found.grains, found.positions, found.quaternions, velocities)

    def _take_out(self) -> None:
        """Take out the grains that have left."""
        gone = np.flatnonzero(self.has_left() & self.is_present)
        if gone.size:
            self.n_left[gone] += 1
            self._set_present(gone, is_present=False)
            self.scene.engine.still(gone)

    def packing(self) -> Packing:
        """Return the grains that are inside; those that have left by the last sample are taken out."""
        self._take_out()
        return self.scene.packing()

    def _set_present(self, grains: NDArray[np.int64], *, is_present: bool) -> None:
        """Say that some grains, by number, are there or are not."""
        mask = self.is_present.copy()
        mask[grains] = is_present
        self.scene.engine.set_present(mask)

    def inside(self) -> Bools:
        """Return which grains are there and have not left, shape (n,)."""
        return self.is_present & ~self.has_left()

    def counts_left(self) -> NDArray[np.int64]:
        """Return how often each grain has left, those that are about to be taken out among them, shape (n,)."""
        return self.n_left + (self.is_present & self.has_left())

    def energy(self) -> float:
        """Return the mean kinetic energy [m g d] of the grains that touch another one."""
        return self.touching_energy(snapshot(self.scene)) if self.is_present.any() else NOBODY

    def outside(self) -> Floats:
        """Return how far [d] each centroid is below the floor, shape (n,); one that has left may be anywhere."""
        return np.where(self.inside(), super().outside(), -np.inf)

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {
            **super().memory(),
            "is_present": self.is_present.tolist(),
            "n_entered": self.n_entered.tolist(),
            "n_left": self.n_left.tolist(),
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.n_entered, self.n_left = (np.array(memory[name], dtype=np.int64) for name in ("n_entered", "n_left"))
        self.scene.engine.set_present(memory["is_present"])
