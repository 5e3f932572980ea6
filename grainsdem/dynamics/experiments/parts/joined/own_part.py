"""Your own part: bodies, joints and shapes of the user's in a bed, driven, and the force on them recorded."""

from __future__ import annotations

from collections import namedtuple
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Unpack

import numpy as np

from exporters import mjcf
from grainsdem.dynamics.experiments.cells.meter import Meter
from grainsdem.dynamics.experiments.parts.gauge import Gauge, too_soft
from grainsdem.dynamics.experiments.parts.joined.carrying import carried
from grainsdem.dynamics.experiments.parts.joined.driving import (
    Control,
    Drive,
    Driver,
    PartState,
    function_driver,
    nothing,
    table_driver,
)
from grainsdem.dynamics.experiments.parts.joined.fragment import read_fragment
from grainsdem.dynamics.experiments.parts.joined.joints import Joints
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import Resting, pour
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.errors import InputError
from grainsdem.model import Packing
from grainsdem.options import Note, option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.engine import Apparatus
    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

FIXED = {
    "time": "s",
    "stage": "0 coming to rest, 1 driven",
    "kinetic_energy": "m g d",
    "force_x": "N",
    "force_y": "N",
    "force_z": "N",
    "overlap": "d",
}
"""Columns before those of the joints."""

LAST = 4
"""Samples at the end whose forces are averaged: the first of five at rest tells of the time before it, too."""

ADVICE = "; move the part (x, y, z), or settle the bed first and let it start in place (rng=None, --start place)"


@dataclass(frozen=True, slots=True)
class OwnPartReport(RunReport):
    """What a bed did to a part.

    Parameters
    ----------
    final_force_x, final_force_y, final_force_z : float
        Force on the part, mean over the last 0.8 √(d/g) [N].
    largest_force : float
        Largest size of the force while it was driven [N].
    borne_mass : float
        Downward force at the end over gravity [kg].
    carried_mass : float
        Mass of the grains that at the end hang together with the part, by contacts, and not with the floor [kg]; walls
        that some of them lean against may bear a part of it.
    carried_grains : int
        How many they are.
    largest_overlap : float
        Deepest overlap while the part was driven [d].
    at_rest : bool
        Whether the bed was at rest at the end.
    is_settled : bool
        Whether it was when the driving began.
    is_valid : bool
        Whether it was, and nothing overlapped by more than 0.05 d.
    reason : str
        Why not.
    """

    final_force_x: float
    final_force_y: float
    final_force_z: float
    largest_force: float
    borne_mass: float
    carried_mass: float
    carried_grains: int
    largest_overlap: float
    at_rest: bool
    is_settled: bool
    is_valid: bool
    reason: str


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return the force on the part and the places of its joints over time."""
    del profile
    time = series["time"]
    forces = {name[-1]: (time, series[name]) for name in ("force_x", "force_y", "force_z")}
    panels = [Panel("time  [s]", "force on the part  [N]", forces)]
    for reaction, label in (("_force", "joints  [m]"), ("_torque", "joints  [rad]")):  # what slides, and what turns
        joints = {
            name: (time, row) for name, row in series.items() if name not in FIXED and f"{name}{reaction}" in series
        }
        panels += [Panel("time  [s]", label, joints)] if joints else []
    return panels


@experiment(panels=_panels)
def own_part(
    packing: Packing,
    *,
    model: Annotated[
        str | None,
        option("The part: a file for MuJoCo in SI, with bodies, joints, shapes, and meshes beside it.", is_path=True),
    ] = None,
    motion: Annotated[
        str | None,
        option(
            "What its joints do: a table (.csv) with a column time and one for each driven joint, in SI, interpolated.",
            is_path=True,
        ),
    ] = None,
    control: Annotated[
        Control,
        option("What the numbers of table or function are; a column such as lift:speed says it for itself."),
    ] = "position",
    duration: Annotated[
        float | None, option("How long it is driven; by default as long as the table.", "s", gt=0)
    ] = None,
    rest: Annotated[float, option("How long its driven joints are then held still.", "√(d/g)", ge=0)] = 10.0,
    x: Annotated[float, option("Where the file's origin goes along x.", "m")] = 0.0,
    y: Annotated[float, option("Along y.", "m")] = 0.0,
    z: Annotated[float, option("Along z.", "m")] = 0.0,
    part_friction: Annotated[
        float | None,
        option(
            "Coefficient of friction of grains with the part; by default what its file gives each shape, MuJoCo's own "
            "default being 1.",
            ge=0,
        ),
    ] = None,
    drive: Annotated[
        Drive | None,
        Note(
            "callable, optional",
            "In place of a table: given the time [s] since the bed was at rest and a `PartState`, returns a mapping "
            "from joints to numbers. A run that goes on after a kill leads to the same bits only where it depends on "
            "time, positions and speeds alone.",
        ),
    ] = None,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    **run: Unpack[Run],
) -> _OwnPart:
    """Join a part of your own to a bed, drive its joints, and record the force on it.

    Parameters
    ----------
    packing : Packing
        The bed; `settle` it first where the part stands in the way of grains that are poured.

    Returns
    -------
    Outcome
        Packing, history, `OwnPartReport`, snapshot. The history has position, speed and force of each joint besides.

    Raises
    ------
    InputError
        If an option is out of range, a name is one of the scene's, the table drives a joint that is not there or begins
        elsewhere, or the part or the packing overlaps at the start.
    MissingFileError, FileFormatError
        If a file is not there, or MuJoCo refuses it: with MuJoCo's words, file and line.

    Notes
    -----
    The part is there from the start, its driven joints held until the bed is at rest; time then begins. Joints that are
    driven by positions or speeds keep them whatever the bed does; those that are driven by forces, and those that are
    not driven, move as springs, dampers and grains let them. Bodies of the part pass through each other, not through
    the container.
    """
    if model is None:
        raise InputError("model: missing; give the path of a file for MuJoCo with the part")
    if motion is not None and drive is not None:
        raise InputError("motion and drive both say what the joints do; give one of them")
    fragment = read_fragment(model)
    bed = pour(packing, run)
    units = mjcf.units(bed, gravity)
    joints = Joints(fragment, units)
    driver = nothing()
    if motion is not None:
        driver = table_driver(motion, control)
    elif drive is not None:
        driver = function_driver(drive, control, joints.initial())
    joints.check(driver, motion or "drive")
    length = driver.end if duration is None else duration
    if not np.isfinite(length):
        raise InputError("duration: missing; only a table says itself how long it takes")
    armatures = joints.armatures(driver)

    def furnish(apparatus: Apparatus) -> None:
        fragment.check_names(apparatus)
        elements, meshes = fragment.elements(units, (x, y, z), armatures, part_friction)
        for name, corners in meshes.items():
            apparatus.add_mesh(name, corners)
        apparatus.add_elements(elements)

    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    scene = assemble(bed, options, furnish, spheres=run["spheres"], advice=ADVICE)
    files = {"model": Path(model).name, "motion": motion and Path(motion).name, "drive": drive and driver.digest}
    return _OwnPart(scene, joints, driver, max_time=length / units.time + rest, rest=rest, files=files)


class _OwnPart(Resting[OwnPartReport]):
    """A bed that comes to rest, and a part that is driven in it."""

    is_driven = True
    columns: ClassVar[Mapping[str, str]] = FIXED

    def __init__(
        self, scene: Scene, joints: Joints, driver: Driver, *, max_time: float, rest: float, files: dict[str, Any]
    ) -> None:
        super().__init__(scene, max_time)
        self.joints, self.driver, self.rest_time, self.files = joints, driver, rest, files
        self.engine = scene.engine
        self.meter = Meter(scene.engine, joints.armatures(driver))
        self.gauge = Gauge(scene.engine, joints.fragment.parts())
        self.reactions, self.looks = dict.fromkeys(joints.kinds, 0.0), 0
        self.held = dict.fromkeys(driver.controls, 0.0)
        """Where driven joints are held [d or rad] while the part is not driven."""
        self.held |= {name: joints.initial().positions[name] / joints.ways[name] for name in self.held}
        columns = joints.columns(FIXED)
        # Its joints are known only here: each run has columns of its own.
        vars(self)["columns"] = columns
        self.kind_of_sample = namedtuple("OwnPartSample", columns)  # type: ignore[misc]  # noqa: PYI024  (as said)

    def _identity(self) -> dict[str, Any]:
        """Return what a killed run must agree with to go on: what drives it, too."""
        return {**super()._identity(), "driver": self.driver.digest}

    def mark(self, now: Any) -> dict[str, Any]:
        """Return nothing more than when driving began."""
        del now
        return {}

    def act(self) -> None:
        """Let time begin."""

    def state(self) -> PartState:
        """Return the state of the joints [SI]."""
        found = {name: self.engine.axle(name) for name in self.joints.kinds}
        return PartState(
            {name: at * self.joints.ways[name] for name, (at, _) in found.items()},
            {name: speed * self.joints.speeds[name] for name, (_, speed) in found.items()},
            {name: self.engine.reaction(name) * self.joints.forces[name] for name in found},
        )

    def drive(self) -> None:
        """Let each driven joint do what is said of it, or hold it before and after."""
        if self.gauge.step():
            self._look()
        step = self.engine.time_step
        driven = self.max_time - self.rest_time
        is_driven = self.begun is not None and self.since() < driven
        said: Mapping[str, float] = {}
        if is_driven:
            ahead = min(self.since() + step, driven) * self.scene.units.time
            said = self.driver.ask(ahead, self.state())
        for name, control in self.driver.controls.items():
            if control == "force":
                self.engine.push(name, said[name] / self.joints.forces[name] if said else 0.0)
                continue
            if control == "speed" and said:
                self.held[name] = self.engine.axle(name)[0]
                self.meter.drive(name, said[name] / self.joints.speeds[name])
                continue
            if said:
                self.held[name] = said[name] / self.joints.ways[name]
            self.meter.drive(name, (self.held[name] - self.engine.axle(name)[0]) / step)

    def _look(self) -> None:
        """Look at what contacts exert along joints."""
        for name in self.reactions:
            self.reactions[name] += self.engine.reaction(name)
        self.looks += 1

    def measure(self) -> Any:
        """Return the present sample."""
        self._look()
        load, now = self.gauge.read(), snapshot(self.scene, converged=False)
        self.meter.read()
        overlap = float(-now.gaps.min(initial=0.0)) / self.scene.units.length
        values = [self.engine.time, float(self.begun is not None), self.touching_energy(now), *load.force.tolist()]
        values.append(overlap)
        for name in self.joints.kinds:
            values += [*self.engine.axle(name), self.reactions[name] / self.looks]
        self._forget()
        return self.kind_of_sample(*values)

    def _forget(self) -> None:
        """Forget what was looked at."""
        self.reactions, self.looks = dict.fromkeys(self.joints.kinds, 0.0), 0

    def words(self, now: Any) -> str:
        """Return a few words on a sample of the second stage."""
        force = np.array([now.force_x, now.force_y, now.force_z]) * self.scene.units.force
        return f"force on the part {np.linalg.norm(force):.3g} N"

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "held": dict(self.held)}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.held = dict(memory["held"])
        self.gauge.reset()
        self._forget()

    def remarks(self) -> dict[str, Any]:
        """Return the files without their folders, and the function's name."""
        return {name: value for name, value in self.files.items() if value is not None}

    def report(self) -> OwnPartReport:
        """Return what the bed did to the part."""
        rows = [self.in_si(row) for row in self.samples if row.stage == 1.0]
        forces = np.array([[row.force_x, row.force_y, row.force_z] for row in rows]).reshape(-1, 3)
        last = forces[-LAST:].mean(axis=0) if rows else np.full(3, np.nan)
        now = snapshot(self.scene)
        held = carried(now, self.joints.fragment.parts(), self.scene.upright_walls)
        is_settled = bool(self.begun and self.begun["is_at_rest"])
        overlap = max((row.overlap for row in rows), default=np.nan)
        reason = too_soft(overlap) if is_settled else "the bed was not at rest when the driving began"
        return OwnPartReport(
            final_force_x=float(last[0]),
            final_force_y=float(last[1]),
            final_force_z=float(last[2]),
            largest_force=float(np.linalg.norm(forces, axis=1).max()) if rows else np.nan,
            borne_mass=-float(last[self.scene.up]) / self.scene.units.acceleration,
            carried_mass=float(now.masses()[held].sum()),
            carried_grains=int(held.sum()),
            largest_overlap=overlap,
            at_rest=self.is_at_rest(),
            is_settled=is_settled,
            is_valid=not reason,
            reason=reason,
            **self.cost(),
        )
