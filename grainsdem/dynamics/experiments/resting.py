"""Beds under gravity that come to rest between their walls first, before the experiment proper begins."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.dynamics.budget import SETTLING_TIME
from grainsdem.dynamics.experiments.cells.meter import Meter
from grainsdem.dynamics.experiments.rig import Report, Trial
from grainsdem.dynamics.experiments.start import as_asked, set_apart_in_block
from grainsdem.dynamics.mechanics import contact_graph
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.shared import Run
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

REST_ENERGY = 1e-5
"""Mean kinetic energy [m g d], of the grains that touch another one, below which a bed is at rest: beds that have
been disturbed creep at a few 1e-6 for long. A grain that rolls away by itself never stops on a flat floor."""

REST_SAMPLES = 5
"""How many samples in a row must be so."""

LEAST_TIME = 2.0
"""Time [t] before which nothing counts as rest."""

POURING_LIMIT = 100.0
"""Time [t] after which the experiment begins although the bed is not at rest."""


def pour(packing: Packing, run: Run) -> Packing:
    """Return the grains, or spheres, where they are, or, with a seed, set apart above each other between walls."""
    grains = as_asked(packing, run)
    if run["rng"] is None:
        return grains
    if len(packing.domain.planes):
        raise InputError("grains are poured between the walls of a box only; settle those of another container first")
    return set_apart_in_block(grains, rng=run["rng"], lengths=packing.domain.lengths[:-1])


class Resting(Trial[Report]):
    """A run in two stages: the bed comes to rest between its walls, then something is done to it.

    Parameters
    ----------
    scene : Scene
        What moves.
    max_time : float
        Time limit [t] of the second stage.
    """

    is_driven = False

    def __init__(self, scene: Scene, max_time: float) -> None:
        super().__init__(scene, Meter(scene.engine, {}))
        self.max_time = max_time
        self.begun: dict[str, Any] | None = None
        """What is remembered of the moment when the bed was at rest."""

    def mark(self, now: Any) -> dict[str, Any]:
        """Return what to remember of the present state, as JSON values."""
        raise NotImplementedError

    def act(self) -> None:
        """Do what the second stage begins with, also where a run goes on in it."""
        raise NotImplementedError

    def arrange(self) -> None:
        """Do once, before `mark`, what the second stage begins with and the engine's state keeps: places and speeds."""

    def words(self, now: Any) -> str:
        """Return a few words on a sample of the second stage."""
        return f"{now.kinetic_energy:.0e} m g d"

    def share_done(self, now: Any) -> float:
        """Return how much of the second stage is done, 0 to 1: of its time, at least, where it may end sooner."""
        del now
        return self.since() / self.max_time

    def is_over(self) -> bool:
        """Return whether the time of the second stage is up."""
        return self.begun is not None and self.since() >= self.max_time

    def expected_time(self) -> float:
        """Return about how long [t] the run will last: the second stage as long as it may."""
        return SETTLING_TIME + self.max_time

    def since(self) -> float:
        """Return the time [t] since the present stage began."""
        return self.scene.engine.time - (self.begun["time"] if self.begun else 0.0)

    def is_at_rest(self) -> bool:
        """Return whether the last samples of the present stage were at rest."""
        last = self.samples[-REST_SAMPLES:]
        stage = float(self.begun is not None)
        return self.since() > LEAST_TIME and all(
            row.stage == stage and row.kinetic_energy < REST_ENERGY for row in last
        )

    def keep(self, now: Any) -> None:
        """Begin the second stage once the bed is at rest, and tell how far the run is."""
        if self.begun is not None:
            self.tell(self.share_done(now), self.words(now))
            return
        self.tell(0.0, f"coming to rest: {now.kinetic_energy:.0e} → {REST_ENERGY:.0e} m g d")
        at_rest = self.is_at_rest()
        if at_rest or now.time > POURING_LIMIT:
            self.arrange()
            self.begun = {"time": now.time, "is_at_rest": at_rest, **self.mark(now)}
            self.act()

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "begun": self.begun}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.begun = memory["begun"]
        if self.begun is not None:
            self.act()

    def outside(self) -> Floats:
        """Return how far [d] each centroid is below the floor, shape (n,): that is the one wall that stays."""
        positions, _ = self.scene.poses()
        up = self.scene.up
        return np.asarray(self.scene.source.domain.lower[up] / self.scene.units.length - positions[:, up])

    def touching_energy(self, now: Snapshot) -> float:
        """Return the mean kinetic energy [m g d] of the grains that touch another one; that of all where none does."""
        z = contact_graph(now).coordination()
        masses, speeds = now.masses(), np.square(now.velocities).sum(axis=1)
        turning = np.einsum("ni,nij,nj->n", now.spins, now.inertias(), now.spins)
        energies = 0.5 * (masses * speeds + turning)
        touching = z > 0
        scale = float(masses.mean()) / self.scene.units.mass * self.scene.units.energy
        return float(energies[touching].mean() if touching.any() else energies.mean()) / scale
