"""What is exerted on parts of an apparatus: the mean over a while of what their contacts bear."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.engine import Contacts, Engine

    Floats = NDArray[np.float64]

SOFT = 0.05
"""Overlap [d] beyond which grains are no longer rigid: MuJoCo's contacts are as stiff as the time step allows."""

FASTEST = 20.0
"""Speed [d/t] that is still simulated: what goes faster passes through a fifth of a grain in a step."""


class Load(NamedTuple):
    """What is exerted on parts, in grain units.

    Parameters
    ----------
    force : ndarray, shape (3,)
        Mean force [m g].
    moment : ndarray, shape (3,)
        Mean moment [m g d] about the point that it is taken about.
    power : float
        Mean power [m g d/t] that the parts give to what they touch.
    """

    force: Floats
    moment: Floats
    power: float


def exerted(contacts: Contacts, parts: Sequence[int], about: ArrayLike = (0.0, 0.0, 0.0)) -> tuple[Floats, Floats]:
    """Return force and moment, each of shape (3,), of contacts on parts, not of those among each other.

    Parameters
    ----------
    contacts : Contacts
        Those of an instant.
    parts : sequence of int
        Numbers in `Engine.parts`.
    about : array_like, shape (3,)
        Point [d] that the moment is taken about.
    """
    mine = np.isin(contacts.pairs, [-1 - number for number in parts])
    signs = mine[:, 1].astype(float) - mine[:, 0]  # a force is that on the second
    forces = signs[:, None] * contacts.forces
    moments = np.cross(contacts.points - np.asarray(about, dtype=np.float64), forces)
    return forces.sum(axis=0), moments.sum(axis=0)


def too_soft(overlap: float) -> str:
    """Return why a run in which something overlapped so deep [d] measures no rigid grains, or nothing.

    Examples
    --------
    >>> too_soft(0.01)
    ''
    """
    if not overlap > SOFT:
        return ""
    return f"grains overlapped by {overlap:.2g} d under the force; a smaller time_step makes them harder"


class Gauge:
    """The mean of what is exerted on parts, from looks at every step.

    Parameters
    ----------
    engine : Engine
        What moves them.
    parts : sequence of str
        Their names; their loads are added.
    centre : callable, optional
        Returns the point [d] that moments are taken about, shape (3,); the world's origin by default.
    power : callable, optional
        Given force and moment, returns the power of what the parts do.
    """

    def __init__(
        self,
        engine: Engine,
        parts: Sequence[str],
        centre: Callable[[], ArrayLike] = lambda: (0.0, 0.0, 0.0),
        power: Callable[[Floats, Floats], float] = lambda _force, _moment: 0.0,
    ) -> None:
        self._engine, self._centre, self._power = engine, centre, power
        self._numbers = [engine.parts.index(name) for name in parts if name in engine.parts]
        self.reset()

    def reset(self) -> None:
        """Forget what was looked at."""
        self._is_begun, self._looks, self._power_sum = False, 0, 0.0
        self._force, self._moment = np.zeros(3), np.zeros(3)

    def step(self) -> bool:
        """Hear that a step is about to be taken, and return whether the one before it was looked at."""
        # What came before the first was looked at already: a run that goes on has not solved for it. All others count:
        # the forces of single steps are off by a tenth and flicker from one to the next, their mean moved the part.
        due = self._is_begun
        self._is_begun = True
        if due:
            self.look()
        return due

    def look(self) -> None:
        """Look at the last step."""
        force, moment = exerted(self._engine.last_contacts(), self._numbers, self._centre())
        self._force += force
        self._moment += moment
        self._power_sum += self._power(force, moment)
        self._looks += 1

    def read(self) -> Load:
        """Return the means since the last reading, the last step among them, and begin anew."""
        self.look()
        n = self._looks
        load = Load(self._force / n, self._moment / n, self._power_sum / n)
        self.reset()
        return load
