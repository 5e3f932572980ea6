"""Tilt: gravity is turned slowly, as if the box were tilted, until the bed fails."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from grainsdem.dynamics.budget import SETTLING_TIME
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import Resting, pour
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

FAR = 1.0
"""How far [d] a grain has moved that counts as gone."""

FAILED = 0.05
"""Share of the grains that are gone where a bed has failed."""

MOVING = 1e-4
"""Mean kinetic energy [m g d] of a bed that moves: it is not tilted further until it rests or has failed."""

PATIENCE = 100
"""Samples in a row after which a bed that goes on moving without failing is tilted further all the same."""


class TiltSample(NamedTuple):
    """One look at a bed that is tilted, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while level, 1 while gravity turns.
    angle : float
        Between gravity and the floor's normal [rad].
    kinetic_energy : float
        Mean of the grains that touch another one [m g d].
    displacement : float
        Mean way of the grains since the tilting began, downhill [d].
    gone_fraction : float
        Share of the grains that have moved by more than a diameter since then.
    """

    time: float
    stage: float
    angle: float
    kinetic_energy: float
    displacement: float
    gone_fraction: float


@dataclass(frozen=True, slots=True)
class TiltReport(RunReport):
    """At what angle a bed failed.

    Parameters
    ----------
    failure_angle : float
        Angle [rad] at which a twentieth of the grains had moved by more than a diameter; NaN where they had not.
    has_failed : bool
        Whether they had.
    largest_angle : float
        Angle [rad] that was reached.
    gone_fraction : float
        Share of the grains that had moved by more than a diameter at the end.
    is_settled : bool
        Whether the bed was at rest when the tilting began.
    """

    failure_angle: float
    has_failed: bool
    largest_angle: float
    gone_fraction: float
    is_settled: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return the share of the grains that have moved over the angle."""
    del profile
    gone = np.degrees(series["angle"]), 100 * series["gone_fraction"]
    return [Panel("angle  [°]", "grains that have moved  [%]", {"": gone})]


@experiment(panels=_panels)
def tilt(
    packing: Packing,
    *,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    rate: Annotated[float, option("Angle by which gravity is turned in √(d/g).", "rad", gt=0)] = 0.01,
    max_angle: Annotated[
        float, option("Angle at which a bed that stands is given up.", "rad", gt=0, le=np.pi / 2)
    ] = float(np.pi / 3),
    **run: Unpack[Run],
) -> _Tilt:
    """Turn gravity slowly towards +x, as if the box were tilted, until the bed fails.

    Parameters
    ----------
    packing : Packing
        The bed, in a container that stays around it; `settle` it first, or give ``rng``.

    Returns
    -------
    Outcome
        Packing, history, `TiltReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, or the packing is periodic or overlaps.

    Notes
    -----
    A bed has failed where a twentieth of its grains are more than a diameter from where they were before it was tilted.
    While the mean kinetic energy is above 1e-4 m g d gravity stands still, for 20 √(d/g) at most, so that an avalanche
    ends, or fails the bed, at the angle at which it began. A block slides within a degree of atan μ at a rate of 0.004.
    """
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    scene = assemble(pour(packing, run), options, spheres=run["spheres"])
    return _Tilt(scene, rate, max_angle)


class _Tilt(Resting[TiltReport]):
    """A bed that comes to rest level, and is then tilted."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "0 level, 1 tilted",
        "angle": "rad",
        "kinetic_energy": "m g d",
        "displacement": "m",
        "gone_fraction": "1",
    }

    def __init__(self, scene: Scene, rate: float, max_angle: float) -> None:
        super().__init__(scene, np.inf)
        self.rate, self.max_angle = rate, max_angle
        self.angle = 0.0
        self.held = 0
        """Samples in a row in which the bed has moved."""

    def act(self) -> None:
        """Let gravity have its present angle."""
        down = np.zeros(3)
        down[0], down[self.scene.up] = np.sin(self.angle), -np.cos(self.angle)
        self.scene.engine.set_gravity(down)

    def mark(self, now: TiltSample) -> dict[str, Any]:
        """Return where the grains are."""
        del now
        return {"positions": self.scene.poses()[0].tolist()}

    def measure(self) -> TiltSample:
        """Return the present sample."""
        now = snapshot(self.scene)
        moved = np.zeros((self.scene.n_grains, 3))
        if self.begun:
            moved = self.scene.poses()[0] - np.array(self.begun["positions"])
        return TiltSample(
            time=self.scene.engine.time,
            stage=float(self.begun is not None),
            angle=self.angle,
            kinetic_energy=self.touching_energy(now),
            displacement=float(moved[:, 0].mean()),
            gone_fraction=float(np.mean(np.linalg.norm(moved, axis=1) > FAR)),
        )

    def is_over(self) -> bool:
        """Return whether the bed has failed, or is tilted as far as it may be."""
        last = self.samples[-1]
        return self.begun is not None and (last.gone_fraction > FAILED or self.angle >= self.max_angle)

    def keep(self, now: TiltSample) -> None:
        """Turn gravity a little further where the bed does not move."""
        if self.begun is not None:
            self.held = self.held + 1 if now.kinetic_energy > MOVING else 0
            if not self.held % PATIENCE:
                self.angle += self.rate * self.sample_time
                self.act()
        super().keep(now)

    def expected_time(self) -> float:
        """Return about how long [t] the run will last: until the largest angle, as if the bed stood all the time."""
        return SETTLING_TIME + self.max_angle / self.rate

    def share_done(self, now: TiltSample) -> float:
        """Return the share of the largest angle; a bed may fail long before."""
        return now.angle / self.max_angle

    def words(self, now: TiltSample) -> str:
        """Return a few words on a sample of the tilting."""
        return f"{np.degrees(now.angle):.1f}°, {now.gone_fraction:.1%} of the grains moved"

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "angle": self.angle, "held": self.held}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        self.angle, self.held = memory["angle"], memory["held"]
        super().recall(memory)

    def report(self) -> TiltReport:
        """Return at what angle the bed failed."""
        last = self.samples[-1]
        has_failed = last.gone_fraction > FAILED
        return TiltReport(
            failure_angle=last.angle if has_failed else float("nan"),
            has_failed=has_failed,
            largest_angle=last.angle,
            gone_fraction=last.gone_fraction,
            is_settled=bool(self.begun and self.begun["is_at_rest"]),
            **self.cost(),
        )
