"""Friction of grains and walls in a file for MuJoCo, which takes one side's of a pair: the rougher one's, by default.

The friction of two shapes that touch is the larger of the two, unless one has a higher priority: then it is that
one's. So walls with friction of their own go before all grains, and where the smoother of two grains is to rule, a
grain goes before every rougher one. A mean of the two cannot be had.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from exporters.rest import frictions, mixing, rolling_friction

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from exporters.mjcf.options import MjcfOptions
    from exporters.rest import Frictions
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


class Rough(NamedTuple):
    """What MuJoCo is told of a surface: what its contacts resist, its coefficients, and its priority."""

    condim: int
    friction: str
    priority: int


class Surfaces(NamedTuple):
    """What is written of friction.

    Parameters
    ----------
    given : Frictions
        The coefficients.
    arm : float
        Arm of the torques that resist rolling, in the file's units: MuJoCo's coefficients of torsion and of rolling.
    priorities : ndarray of int64, shape (n,), optional
        Of grains that have friction of their own; without it they have none above the others.
    """

    given: Frictions
    arm: float
    priorities: NDArray[np.int64] | None

    @property
    def top(self) -> int:
        """Priority of walls with friction of their own: above that of every grain."""
        return 1 if self.priorities is None else 1 + int(self.priorities.max(initial=0))

    def dimensions(self, friction: float) -> int:
        """Return what a contact resists: pushing; and sliding; and rolling, too."""
        # A contact without friction has no tangential rows to solve for.
        return 6 if self.arm > 0 else 3 if friction > 0 else 1

    def numbers(self, friction: float) -> str:
        """Return MuJoCo's coefficients: of sliding and, where there are any, of torsion and of rolling."""
        return f"{friction:.9g} {self.arm:.9g} {self.arm:.9g}" if self.arm > 0 else f"{friction:.9g}"

    def of_all_grains(self) -> Rough:
        """Return what grains have that are not told otherwise."""
        return Rough(self.dimensions(self.given.grains), self.numbers(self.given.grains), 0)

    def of_walls(self) -> Rough:
        """Return what walls have that are not told otherwise."""
        given = self.given
        as_grains = 0.0 if given.own is not None else given.grains  # the grain's own is larger, or goes before
        wall = as_grains if given.walls is None else given.walls
        has_own = given.walls is not None and (given.own is not None or given.walls != given.grains)
        return Rough(self.dimensions(wall), self.numbers(wall), self.top if has_own else 0)

    def of_wall(self, name: str) -> str:
        """Return the attributes that a wall has besides, where it has friction of its own."""
        if name not in self.given.by_wall:
            return ""
        return self._attributes(self.given.by_wall[name], self.top)

    def of_grains(self, first: int, last: int) -> Iterable[str]:
        """Return the attributes that grains have besides."""
        own = self.given.own
        if own is None:
            return [""] * (last - first)
        ranks = np.zeros(last, np.int64) if self.priorities is None else self.priorities
        pairs = zip(own[first:last].tolist(), ranks[first:last].tolist(), strict=True)
        return [self._attributes(friction, rank) for friction, rank in pairs]

    def _attributes(self, friction: float, priority: int) -> str:
        rank = f' priority="{priority}"' if priority else ""
        return f' condim="{self.dimensions(friction)}" friction="{self.numbers(friction)}"{rank}'


def surfaces(packing: Packing, options: MjcfOptions, diameter: float) -> Surfaces:
    """Return what is written of friction.

    Parameters
    ----------
    packing : Packing
        The grains.
    options : MjcfOptions
        What was asked for.
    diameter : float
        Median diameter in the file's units.
    """
    given = frictions(packing, options.friction, options.wall_friction)
    # MuJoCo's coefficients of torsion and of rolling are lengths: those of the torques' arms.
    arm = 0.5 * diameter * rolling_friction(packing, options.rolling_friction)
    priorities = None
    if given.own is not None and mixing(packing, options.mixing) == "min":
        # The smoother, the higher, and above walls that are as rough as the grain that touches them.
        priorities = 1 + np.unique(-given.own, return_inverse=True)[1].reshape(-1).astype(np.int64)
    return Surfaces(given, arm, priorities)
