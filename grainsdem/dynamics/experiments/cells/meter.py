"""What pushes and drives the parts of an apparatus, and tells what the grains exert on them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

    from grainsdem.dynamics.engine import Engine

HEAVY = 1e4
"""Mass [m] or inertia [m d²] of a driven part: grains change its speed by dt F / 1e4, a thousandth of a usual one."""

LIMIT_SPEED = 2.0
"""Speed [d/t] that a wall reaches against nothing; grains that were set apart are gathered no faster."""


class Meter:
    """Parts of an apparatus that are pushed or driven along joints, and the mean forces of the grains on them.

    What the grains exert over a while follows from the momentum that a part has gained and from what it was pushed
    with: exactly what the run had, whatever the solver left undone in a single step.

    Parameters
    ----------
    engine : Engine
        What moves them.
    masses : mapping of str to float
        Mass of the part on each joint, or its inertia about it.
    """

    def __init__(self, engine: Engine, masses: Mapping[str, float]) -> None:
        self._engine = engine
        self._masses = dict(masses)
        self._impulses = dict.fromkeys(masses, 0.0)
        self._since: tuple[float, dict[str, float]] | None = None
        self.last = dict.fromkeys(masses, 0.0)

    def push(self, joint: str, force: float) -> None:
        """Let a force act along a joint during the next step."""
        if self._since is None:
            self._since = self._engine.time, {name: self._engine.axle(name)[1] for name in self._masses}
        self._engine.push(joint, force)
        self._impulses[joint] += force * self._engine.time_step

    def drive(self, joint: str, speed: float) -> None:
        """Push a part so that it has a speed after the next step, where grains resist as at the last reading."""
        change = (speed - self._engine.axle(joint)[1]) / self._engine.time_step
        self.push(joint, self._masses[joint] * change - self.last[joint])

    def read(self) -> dict[str, float]:
        """Return the grains' mean force along each joint since the last reading, and begin anew."""
        if self._since is None:
            return self.last
        start, speeds = self._since
        elapsed = self._engine.time - start
        self.last = {
            name: (mass * (self._engine.axle(name)[1] - speeds[name]) - self._impulses[name]) / elapsed
            for name, mass in self._masses.items()
        }
        self.forget(self.last)
        return self.last

    def forget(self, last: Mapping[str, float]) -> None:
        """Begin anew, as after a reading of some forces."""
        self._since, self.last = None, dict(last)
        self._impulses = dict.fromkeys(self._masses, 0.0)
