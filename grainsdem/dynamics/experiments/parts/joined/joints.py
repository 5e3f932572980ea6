"""The joints of a user's own part that slide or turn: their units, their start, and what drives them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.experiments.cells.meter import HEAVY
from grainsdem.dynamics.experiments.parts.gauge import FASTEST
from grainsdem.dynamics.experiments.parts.joined.driving import PartState
from grainsdem.dynamics.experiments.parts.joined.fragment import LIGHT
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.experiments.parts.joined.driving import Driver
    from grainsdem.dynamics.experiments.parts.joined.fragment import Fragment

HEAVIER = 1e2
"""How many times the inertia of the whole part is added to a driven joint: what else moves does not stop it."""

AWAY = 1e-3
"""How far [d or rad] a table may begin from where its joints are."""


class Joints:
    """The joints of a part that slide or turn, and their units.

    Parameters
    ----------
    fragment : Fragment
        The part.
    units : GrainUnits
        Factors to SI.
    """

    def __init__(self, fragment: Fragment, units: GrainUnits) -> None:
        self.fragment = fragment
        self.kinds = {
            name: fragment.kind(name) for name in fragment.joints if fragment.kind(name) in ("slide", "hinge")
        }
        self.ways = {name: units.length if kind == "slide" else 1.0 for name, kind in self.kinds.items()}
        self.speeds = {name: way / units.time for name, way in self.ways.items()}
        self.forces = {name: units.force if kind == "slide" else units.energy for name, kind in self.kinds.items()}
        self.units = units

    def initial(self) -> PartState:
        """Return the state of the joints as in the file."""
        model = self.fragment.model
        places = {name: float(model.qpos0[model.jnt_qposadr[self.fragment.joints.index(name)]]) for name in self.kinds}
        still = dict.fromkeys(self.kinds, 0.0)
        return PartState(places, still, still)

    def check(self, driver: Driver, where: str) -> None:
        """Raise `InputError` where a driver names another joint, begins elsewhere, or is too fast."""
        unknown = [name for name in driver.controls if name not in self.kinds]
        if unknown:
            raise InputError(
                f"{where}: there is no joint {unknown[0]!r} that slides or turns; there are "
                f"{', '.join(self.kinds) or 'none'}"
            )
        start = self.initial()
        first = driver.ask(0.0, start)
        for name, control in driver.controls.items():
            unit = "m" if self.kinds[name] == "slide" else "rad"
            if control == "position" and abs(first[name] - start.positions[name]) > AWAY * self.ways[name]:
                raise InputError(
                    f"{where}: {name} begins at {first[name]:.6g} {unit}, but the part is at "
                    f"{start.positions[name]:.6g} {unit}"
                )
        if np.isfinite(driver.end):
            self._check_speeds(driver, where, start)

    def _check_speeds(self, driver: Driver, where: str, state: PartState) -> None:
        """Raise `InputError` where a table moves a slide faster than can be simulated."""
        times = np.linspace(0.0, driver.end, 1001)
        said = [driver.ask(time, state) for time in times.tolist()]
        for name, control in driver.controls.items():
            if self.kinds[name] != "slide" or control == "force":
                continue
            row = np.array([values[name] for values in said])
            speeds = np.abs(np.diff(row) / np.diff(times)) if control == "position" else np.abs(row)
            limit = FASTEST * self.units.velocity
            if speeds.max() > limit:
                raise InputError(
                    f"{where}: {name} goes at {speeds.max():.3g} m/s; {limit:.3g} m/s, {FASTEST:g} √(g d), can be "
                    f"simulated"
                )

    def armatures(self, driver: Driver) -> dict[str, float]:
        """Return what is added to the inertia of joints that are driven by position or speed, in grain units."""
        model, length = self.fragment.model, self.units.length
        masses = model.body_mass / (LIGHT * self.units.mass)
        reach = max(1.0, float(np.abs(model.body_pos).sum() + np.abs(model.body_ipos).max(initial=0.0)) / length)
        heaviest = HEAVY + HEAVIER * float(masses.sum())
        return {
            name: heaviest * (1.0 if self.kinds[name] == "slide" else reach**2)
            for name, control in driver.controls.items()
            if control != "force"
        }

    def columns(self, fixed: Mapping[str, str]) -> dict[str, str]:
        """Return columns and units of a history, those of the joints behind what is fixed."""
        columns = dict(fixed)
        for name, kind in self.kinds.items():
            plain = re.sub(r"\W|^(?=\d)", "_", name).lstrip("_") or "joint"
            while plain in columns or f"{plain}_speed" in columns:
                plain += "_joint"
            units = ("m", "m/s", "N", "force") if kind == "slide" else ("rad", "rad/s", "N m", "torque")
            columns |= {plain: units[0], f"{plain}_speed": units[1], f"{plain}_{units[3]}": units[2]}
        return columns
