"""Drum: grains in a drum that turns about a level axis: dynamic angle of repose, regime, torque, mixing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import units
from grainsdem.dynamics.budget import SETTLING_TIME
from grainsdem.dynamics.experiments.drums.mixing import lacey_index
from grainsdem.dynamics.experiments.drums.shell import COVER, Shell
from grainsdem.dynamics.experiments.drums.surface import surface_angle
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import Resting
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run
from grainsdem.dynamics.experiments.start import as_asked, options_of, plate_friction
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.errors import InputError
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

USUAL_FROUDE = 1e-2
"""Froude number of a drum whose period is not given: a steady surface, and not too long a run."""

FASTEST = 0.05
"""Way [d] of the shell in a time step beyond which grains would be carried by what passes through them."""

RAMP_TIME = 5.0
"""Time [t] in which a drum comes to its speed."""

N_SAMPLES = 200
"""Samples in a turn."""

STEADY_TURNS = 0.5
"""Turns, or half of them all where that is less, after which the flow counts as steady."""

CELL = 2.5
"""Width [d] of the cells in which mixing is judged: a few grains in each."""

REGIMES = ((3e-4, "slumping"), (3e-3, "rolling"), (0.1, "cascading"), (1.0, "cataracting"), (np.inf, "centrifuging"))
"""Froude numbers below which a regime is to be expected [1]_; where ranges overlap, the middle of the overlap.

.. [1] J. Mellmann, The transverse motion of solids in rotating cylinders, Powder Technol. 118, 251-270 (2001).
"""


class DrumSample(NamedTuple):
    """One look at a drum, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while the bed comes to rest, 1 while the drum turns.
    turns : float
        How often the drum has turned.
    kinetic_energy : float
        Mean of the grains [m g d]; while the bed comes to rest, of those that touch another one.
    surface_angle : float
        Slope of the surface in the middle half of its chord [rad], upward to the side that rises; that of the centre of
        mass where too few grains are there.
    mass_angle : float
        Angle of the centre of mass from straight below the axis [rad]: the slope of a flat surface.
    torque : float
        Of the grains on the drum, against its turning [m g d].
    lift_torque : float
        Weight of the grains times the distance of their centre of mass from the plane through the axis [m g d].
    mixing : float
        Lacey's index of the halves, left and right when the drum began to turn.
    """

    time: float
    stage: float
    turns: float
    kinetic_energy: float
    surface_angle: float
    mass_angle: float
    torque: float
    lift_torque: float
    mixing: float


@dataclass(frozen=True, slots=True)
class DrumReport(RunReport):
    """How grains flowed in a drum.

    Parameters
    ----------
    dynamic_angle : float
        Slope of the surface in the middle half of its chord [rad]: mean over the steady part, which begins after half a
        turn, or after half of a shorter run.
    dynamic_angle_spread : float
        Standard deviation of it in time: large where the surface fails in avalanches.
    mass_angle : float
        Mean angle of the centre of mass from straight below the axis [rad].
    torque : float
        Mean torque of the grains on the drum [N m].
    lift_torque : float
        Weight of the grains times the mean distance of their centre of mass from the plane through the axis [N m]: what
        the torque must be in a steady flow.
    froude_number : float
        ω² R / g.
    regime : str
        What is to be expected at that number: slumping (avalanches), rolling, cascading, cataracting, centrifuging.
    mixing : float
        Lacey's index of the two halves at the end: 0 apart, 1 mixed at random.
    turns : float
        How often the drum has turned.
    period, radius, length : float
        Time of a turn [s], and size of the drum [m].
    is_settled : bool
        Whether the bed was at rest when the drum began to turn.
    """

    dynamic_angle: float
    dynamic_angle_spread: float
    mass_angle: float
    torque: float
    lift_torque: float
    froude_number: float
    regime: str
    mixing: float
    turns: float
    period: float
    radius: float
    length: float
    is_settled: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return angles and mixing over the turns."""
    del profile
    turns = series["turns"]
    angles = {
        "surface": (turns, np.degrees(series["surface_angle"])),
        "centre of mass": (turns, np.degrees(series["mass_angle"])),
    }
    return [Panel("turns", "angle  [°]", angles), Panel("turns", "mixing index", {"": (turns, series["mixing"])})]


@experiment(panels=_panels, needs_seed=True)
def drum(
    packing: Packing,
    *,
    period: Annotated[
        float | None, option("Time of a turn; by default such that the Froude number ω² R/g is 0.01.", "s", gt=0)
    ] = None,
    turns: Annotated[float, option("How often the drum turns.", gt=0)] = 1.0,
    fill: Annotated[
        float,
        option("Share of the drum that the bed takes; what of its size is not given follows from it.", gt=0, le=0.5),
    ] = 0.35,
    radius: Annotated[float | None, option("Inner radius of the drum; by default as the fill asks.", "m", gt=0)] = None,
    length: Annotated[
        float | None,
        option("Length of the drum; by default half its radius, or a grain's width, or as the fill asks.", "m", gt=0),
    ] = None,
    lifters: Annotated[int, option("Number of radial plates on the shell that lift grains.", ge=0, le=32)] = 0,
    lifter_height: Annotated[
        float | None, option("How far they reach inward; a median diameter by default.", "m", gt=0)
    ] = None,
    friction: Friction = None,
    wall_friction: Annotated[
        float | None,
        option("Coefficient of friction with shell and lifters; by default as among grains.", ge=0),
    ] = None,
    end_friction: Annotated[
        float, option("Coefficient of friction with the two ends: smooth ones stand for a slice of a long drum.", ge=0)
    ] = 0.0,
    gravity: Gravity = 9.81,
    **run: Unpack[Run],
) -> _Drum:
    """Turn grains in a drum about a level axis: dynamic angle of repose, regime, torque, mixing of two halves.

    Parameters
    ----------
    packing : Packing
        The grains; they are turned at random, reordered and set apart in the drum, always. In planar work the drum is a
        circle.

    Returns
    -------
    Outcome
        Packing, history, `DrumReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, the grains do not fit into the drum, or it turns too fast to be simulated.

    Notes
    -----
    The bed comes to rest first; then the drum comes to its speed in 5 √(d/g). The surface is the highest centroid in
    each bin of a diameter along the chord; its slope is that of the least-squares line through the middle half.
    """
    grains = as_asked(packing, run)
    shell = Shell(grains, fill=fill, radius=radius, length=length, rng=run["rng"])
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    scales = units(shell.packing, gravity)
    scene = assemble(
        shell.packing,
        options,
        lambda apparatus: shell.furnish(
            apparatus,
            scales,
            friction=plate_friction(grains, friction) if wall_friction is None else wall_friction,
            end_friction=end_friction,
            lifters=lifters,
            lifter_height=lifter_height,
        ),
        spheres=run["spheres"],
    )
    speed = float(np.sqrt(USUAL_FROUDE / shell.radius)) if period is None else 2 * np.pi * scales.time / period
    way = speed * shell.radius * scene.engine.time_step
    if way > FASTEST:
        least = 2 * np.pi * shell.radius * scene.engine.time_step / FASTEST * scales.time
        raise InputError(
            f"a drum whose shell moves by {way:.2g} d in a time step cannot be simulated; of this radius its period "
            f"must be {least:.3g} s or more; got {2 * np.pi / speed * scales.time:.3g} s"
        )
    return _Drum(scene, shell, speed, turns)


class _Drum(Resting[DrumReport]):
    """A bed that comes to rest in a drum, which then turns."""

    is_driven = True
    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "0 at rest, 1 turning",
        "turns": "1",
        "kinetic_energy": "m g d",
        "surface_angle": "rad",
        "mass_angle": "rad",
        "torque": "N m",
        "lift_torque": "N m",
        "mixing": "1",
    }

    def __init__(self, scene: Scene, shell: Shell, speed: float, turns: float) -> None:
        super().__init__(scene, np.inf)
        self.meter = shell.meter(scene.engine)
        self.shell, self.speed, self.n_turns = shell, speed, turns
        self._guides = [name for name in scene.engine.parts if name.startswith("wall") or name == "floor"]
        scene.engine.remove(COVER)

    def act(self) -> None:
        """Close the drum, which alone holds the grains now, and look less often: a turn takes long."""
        self.scene.engine.put_back(COVER)
        for wall in self._guides:
            self.scene.engine.remove(wall)
        self.sample_time = max(type(self).sample_time, 2 * np.pi / self.speed / N_SAMPLES)

    def mark(self, now: DrumSample) -> dict[str, Any]:
        """Return which grains are on the side that is to rise."""
        del now
        side, _ = self.shell.across(self.scene.poses()[0])
        return {"is_rising": (side > np.median(side)).tolist()}

    def drive(self) -> None:
        """Hold the drum, or turn it."""
        ramp = min(1.0, self.since() / RAMP_TIME) if self.begun else 0.0
        self.meter.drive("turn", ramp * self.speed)

    def measure(self) -> DrumSample:
        """Return the present sample."""
        engine, masses = self.scene.engine, self.scene.engine.masses
        positions, _ = self.scene.poses()
        side, height = self.shell.across(positions)
        mass_angle = float(np.arctan2(masses @ side, -(masses @ height)))
        found = surface_angle(side, height, mass_angle)
        now = snapshot(self.scene, converged=False)
        mixing = 0.0
        if self.begun is not None:
            points = np.column_stack([side, height])
            mixing = lacey_index(points, self.begun["is_rising"], width=CELL)
        return DrumSample(
            time=engine.time,
            stage=float(self.begun is not None),
            turns=engine.axle("turn")[0] / (2 * np.pi),
            kinetic_energy=self.touching_energy(now) if self.begun is None else self.kinetic_energy(now),
            surface_angle=mass_angle if np.isnan(found) else found,
            mass_angle=mass_angle,
            torque=-self.meter.read()["turn"],
            lift_torque=float(masses @ side),
            mixing=float(np.nan_to_num(mixing)),
        )

    def expected_time(self) -> float:
        """Return the time [t] that the bed takes to rest, and the drum for its turns."""
        return SETTLING_TIME + RAMP_TIME + 2 * np.pi * self.n_turns / self.speed

    def is_over(self) -> bool:
        """Return whether the drum has turned as often as it should."""
        return self.begun is not None and self.samples[-1].turns >= self.n_turns

    def share_done(self, now: DrumSample) -> float:
        """Return the share of the turns."""
        return now.turns / self.n_turns

    def words(self, now: DrumSample) -> str:
        """Return a few words on a sample."""
        return f"{now.turns:.2f} turns, {np.degrees(now.surface_angle):.0f}°, mixing {now.mixing:.2f}"

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside the drum, shape (n,)."""
        positions, _ = self.scene.poses()
        side, height = self.shell.across(positions)
        # Grains fall in from above.
        out = np.where((height > 0) & (self.begun is None), 0.0, np.hypot(side, height) - self.shell.radius)
        along = np.abs(positions - self.shell.middle)[:, self.shell.axis] - 0.5 * self.shell.length
        return np.asarray(np.maximum(out, along))

    def packing(self) -> Packing:
        """Return the grains where they are, in the box around the drum."""
        return self.shell.around(self.scene.packing())

    def remarks(self) -> dict[str, Any]:
        """Return the size of the drum [m] and its speed [rad/s]."""
        scales = self.scene.units
        return {
            "radius": self.shell.radius * scales.length,
            "length": self.shell.length * scales.length,
            "speed": self.speed / scales.time,
        }

    def report(self) -> DrumReport:
        """Return how grains flowed."""
        scales, shell = self.scene.units, self.shell
        begun = self.begun or {"is_at_rest": False}
        begins = min(STEADY_TURNS, 0.5 * self.n_turns)
        steady = [row for row in self.samples if row.stage == 1.0 and row.turns >= begins]
        angles = np.array([row.surface_angle for row in steady])
        leaning = np.array([row.mass_angle for row in steady])
        torque, lift = (float(np.mean([getattr(row, name) for row in steady])) for name in ("torque", "lift_torque"))
        froude = self.speed**2 * shell.radius
        last = self.samples[-1]
        return DrumReport(
            dynamic_angle=float(angles.mean()),
            dynamic_angle_spread=float(angles.std(ddof=1)) if len(angles) > 1 else float("nan"),
            mass_angle=float(leaning.mean()),
            torque=torque * scales.energy,
            lift_torque=lift * scales.energy,
            froude_number=froude,
            regime=next(name for limit, name in REGIMES if froude < limit),
            mixing=last.mixing,
            turns=last.turns,
            period=2 * np.pi / self.speed * scales.time,
            radius=shell.radius * scales.length,
            length=shell.length * scales.length,
            is_settled=begun["is_at_rest"],
            **self.cost(),
        )
