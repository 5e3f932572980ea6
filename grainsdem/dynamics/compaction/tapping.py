"""Tapping: a container of grains is shaken up and down, one tap after another, and comes to rest in between."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import MjcfOptions, units
from grainsdem.dynamics.budget import SETTLING_TIME
from grainsdem.dynamics.experiments.cells.meter import Meter
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import RunReport, Trial, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of
from grainsdem.dynamics.mechanics import coordination, sample, snapshot
from grainsdem.dynamics.starting import begin
from grainsdem.dynamics.watch import distance_outside
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

REST_ENERGY = 1e-5
"""Mean kinetic energy of a grain [m g d] below which the next tap may come."""

REST_SAMPLES = 5
"""How many samples in a row must be so."""

REST_LIMIT = 60.0
"""Time [t] after which the next tap comes although the bed is not at rest."""

TAP_TIME = 10.0
"""Time [t] that a tap takes with the rest after it, most often, by which a run is estimated."""

CALM_ENERGY = 1e-3
"""Mean kinetic energy [m g d] below which `CALM_DRAG` acts between taps."""

CALM_DRAG = 0.5
"""Rate [1/t] at which grains that swing on two contacts lose their velocity between taps."""


class Shaking(NamedTuple):
    """How a bed is tapped, in grain units.

    Parameters
    ----------
    taps : int
        How often.
    amplitude : float
        Height of a tap [d].
    acceleration : float
        Its greatest acceleration [g].
    """

    taps: int
    amplitude: float
    acceleration: float

    @property
    def rate(self) -> float:
        """Angular frequency [1/t] of the period that is a tap."""
        return float(np.sqrt(2.0 * self.acceleration / self.amplitude))


class TapSample(NamedTuple):
    """One look at a bed that is tapped, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    taps : float
        Taps that have begun.
    porosity : float
        Void of the bed, from the height of its centre of volume.
    height : float
        Height of the centre of volume above the floor [d].
    kinetic_energy : float
        Mean of a grain [m g d].
    """

    time: float
    taps: float
    porosity: float
    height: float
    kinetic_energy: float


@dataclass(frozen=True, slots=True)
class TapReport(RunReport):
    """What tapping led to.

    Parameters
    ----------
    initial_porosity, final_porosity : float
        Void of the bed at rest, before the first tap and after the last.
    coordination : float
        Mean number of grains that press on a grain, at the end.
    amplitude : float
        Height of a tap [m], from its lowest point to its highest.
    acceleration : float
        Its greatest acceleration over gravity.
    frequency : float
        One over the time of a tap [Hz].
    at_rest : bool
        Whether the bed was at rest before every tap and at the end.
    """

    initial_porosity: float
    final_porosity: float
    coordination: float
    amplitude: float
    acceleration: float
    frequency: float
    at_rest: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return porosity over time, and at rest over taps."""
    return [
        Panel("time  [s]", "porosity", {"": (series["time"], series["porosity"])}),
        Panel("taps", "porosity at rest", {}, {"": (profile["taps"], profile["porosity"])}),
    ]


@experiment(panels=_panels, whole=True)
def tap(
    packing: Packing,
    *,
    taps: Annotated[int, option("How many.", ge=1)] = 50,
    amplitude: Annotated[float | None, option("Height of a tap; half a median diameter by default.", "m", gt=0)] = None,
    acceleration: Annotated[
        float, option("Its greatest acceleration over gravity; grains leave the floor above one.", gt=0)
    ] = 3.0,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    **run: Unpack[Run],
) -> _Tap:
    """Shake the container of a bed up and down, tap by tap, each time to rest: porosity against taps.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap in a container with upright walls; they come to rest before the first tap.

    Returns
    -------
    Outcome
        Packing, history, `TapReport`, snapshot, and the ``profile``: ``taps`` and the ``porosity`` at rest after each.

    Raises
    ------
    InputError
        If an option is out of range, walls are not upright, or the packing is periodic or overlaps.

    Notes
    -----
    The floor's height during a tap is A/2 (1 − cos ωt), for one period: it begins and ends at rest, with the greatest
    acceleration Γ g = A ω²/2. In the frame of the container this is a gravity of g (1 + Γ cos ωt), and that is what is
    simulated. Porosity is 1 − V/(2 h S), V being the volume of the grains, S the floor's area and h the height of the
    centre of volume: exact where the void is spread evenly over the height.
    """
    up = 1 if packing.domain.is_planar else 2
    if np.abs(packing.domain.planes[:, up]).max(initial=0.0) > 1e-9:
        raise InputError(
            "tapping needs a container with upright walls, a box or a cylinder: porosity is told from height"
        )
    first = begin(packing, start="place" if run["rng"] is None else "pour", spheres=run["spheres"], rng=run["rng"])
    height = 0.5 if amplitude is None else amplitude / units(first, gravity).length
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    scene = assemble(first, options, spheres=run["spheres"])
    return _Tap(scene, options, Shaking(taps, height, acceleration))


class _Tap(Trial[TapReport]):
    """A bed that comes to rest, and is tapped whenever it has."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "taps": "1",
        "porosity": "1",
        "height": "m",
        "kinetic_energy": "m g d",
    }

    def __init__(self, scene: Scene, options: MjcfOptions, shaking: Shaking) -> None:
        super().__init__(scene, Meter(scene.engine, {}))
        self.options, self.shaking = options, shaking
        self.rests: list[float] = []
        """Porosity at rest before the first tap, and after each."""
        self.all_at_rest = True
        self.begun: float | None = None
        """When [t] the present tap began; nothing before the first."""
        domain, up = scene.source.domain, scene.up
        self._gravity = scene.engine.gravity
        self._floor = float(domain.lower[up] / scene.units.length)
        area = domain.volume / domain.lengths[up] / scene.units.length**2
        self._content = float(volumes(scene.source.grains).sum()) / scene.units.length**3 / area

    def drive(self) -> None:
        """Give gravity the strength that it has in the frame of the container."""
        # In the middle of the step that comes.
        phase = self._phase() + 0.5 * self.shaking.rate * self.scene.engine.time_step
        strength = 1.0 + self.shaking.acceleration * np.cos(phase) if phase < 2 * np.pi else 1.0
        self.scene.engine.set_gravity(self._gravity * strength)

    def prepare(self) -> None:
        """Calm swinging grains between taps."""
        is_calm = self._phase() >= 2 * np.pi and self.samples[-1].kinetic_energy < CALM_ENERGY
        self.scene.engine.set_drag(CALM_DRAG if is_calm else 0.0)

    def measure(self) -> TapSample:
        """Return the present sample."""
        # The centre of volume, which is not that of mass where densities differ.
        share = volumes(self.scene.source.grains)
        positions, _ = self.scene.poses()
        height = float(positions[:, self.scene.up] @ share / share.sum()) - self._floor
        return TapSample(
            time=self.scene.engine.time,
            taps=float(len(self.rests)),
            porosity=float(1.0 - self._content / (2.0 * height)),
            height=height,
            kinetic_energy=sample(self.scene).kinetic_energy,
        )

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside the container, shape (n,)."""
        return distance_outside(self.scene)

    def is_over(self) -> bool:
        """Return whether the bed is at rest after the last tap."""
        return len(self.rests) > self.shaking.taps

    def keep(self, now: TapSample) -> None:
        """Tap again where the bed is at rest, and tell how far the run is."""
        self.tell(len(self.rests) / (self.shaking.taps + 1), f"tap {now.taps:.0f}, porosity {now.porosity:.4f}")
        at_rest = self._rests()
        if at_rest or self._since() > REST_LIMIT:
            self.all_at_rest &= at_rest
            self.rests.append(now.porosity)
            self.begun = now.time

    def expected_time(self) -> float:
        """Return about how long [t] the run will last."""
        return SETTLING_TIME + TAP_TIME * self.shaking.taps

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "begun": self.begun, "rests": list(self.rests), "all_at_rest": self.all_at_rest}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.begun, self.rests = memory["begun"], list(memory["rests"])
        self.all_at_rest = memory["all_at_rest"]

    def profile(self) -> dict[str, Floats]:
        """Return the porosity at rest before the first tap and after each."""
        return {"taps": np.arange(len(self.rests), dtype=np.float64), "porosity": np.array(self.rests)}

    def remarks(self) -> dict[str, Any]:
        """Return the height of a tap [m], and how the bed came to rest."""
        return {"amplitude": self.shaking.amplitude * self.scene.units.length, **self.scene.rest(self.options)}

    def report(self) -> TapReport:
        """Return what tapping led to."""
        scales = self.scene.units
        return TapReport(
            initial_porosity=self.rests[0],
            final_porosity=self.rests[-1],
            coordination=coordination(snapshot(self.scene)),
            amplitude=self.shaking.amplitude * scales.length,
            acceleration=self.shaking.acceleration,
            frequency=self.shaking.rate / (2 * np.pi * scales.time),
            at_rest=self.all_at_rest,
            **self.cost(),
        )

    def _since(self) -> float:
        return self.scene.engine.time - (self.begun or 0.0)

    def _phase(self) -> float:
        """Return how far the present tap has gone, 2π or more where it is over or none has begun."""
        return np.inf if self.begun is None else self.shaking.rate * self._since()

    def _rests(self) -> bool:
        """Return whether the tap is over and the last samples since it were at rest."""
        calm_since = (self.begun or 0.0) + (2 * np.pi / self.shaking.rate if self.begun is not None else 2.0)
        rows = self.samples[-REST_SAMPLES:]
        return len(self.samples) > REST_SAMPLES and all(
            row.time > calm_since and row.kinetic_energy < REST_ENERGY for row in rows
        )
