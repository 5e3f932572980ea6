"""Grains in groups, and the friction of every pair of groups that can touch, for programs with tables of pairs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple, Protocol

import numpy as np

from exporters.container import wall_names
from exporters.rest import frictions, mixing, one_friction

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from exporters.rest import Frictions
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

MOST = 100
"""Groups of density and friction that a file has at most: every pair of them has lines of its own."""


class SurfaceOptions(Protocol):
    """The options that say what surfaces are like."""

    @property
    def friction(self) -> float | None:
        """Coefficient of friction among all grains."""

    @property
    def wall_friction(self) -> float | Mapping[str, float] | str | None:
        """That between grains and walls."""

    @property
    def mixing(self) -> Literal["max", "min"] | None:
        """Which of two grains rules."""

    @property
    def walls(self) -> Literal["box", "floor", "none"]:
        """The container."""


class Surfaces(NamedTuple):
    """Coefficients of friction [1] of grains and walls.

    Parameters
    ----------
    levels : ndarray, shape (k,)
        Those that grains have, rising.
    of : ndarray of int64, shape (n,)
        Which of them each grain has.
    given : Frictions
        Those of the walls.
    rule : {"max", "min"}
        Whether the rougher or the smoother of two grains rules.
    is_planar : bool
        Whether the floor is a wall of its own name.
    """

    levels: Floats
    of: Ints
    given: Frictions
    rule: str
    is_planar: bool

    def between(self, a: int, b: int) -> float:
        """Return the coefficient between grains of two levels."""
        return float((max if self.rule == "max" else min)(self.levels[a], self.levels[b]))

    def of_wall(self, wall: str) -> float | None:
        """Return the coefficient that a wall has of its own, or nothing where it is as among grains."""
        is_floor = wall == "wall_z0" and not self.is_planar
        return self.given.of_wall("floor" if is_floor else wall)

    def at(self, level: int, own: float | None) -> float:
        """Return the coefficient between grains of a level and a wall, which may have one of its own."""
        return float(self.levels[level]) if own is None else own


def surfaces(packing: Packing, options: SurfaceOptions, *, is_blended: bool = False) -> Surfaces:
    """Return the frictions of a bed: the mean for all grains, with a warning, where it is to be or there are too many.

    Raises
    ------
    InputError
        If a wall is named that the container does not have.
    """
    wall_friction = options.wall_friction
    # Texts were read by the options.
    given = frictions(packing, options.friction, None if isinstance(wall_friction, str) else wall_friction)
    if wall_friction is not None:
        given.refuse_unknown(wall_names(packing.domain, options.walls))
    levels, of = np.array([given.grains]), np.zeros(len(packing), dtype=np.int64)
    if given.own is not None:
        own, index = np.unique(given.own, return_inverse=True)
        if is_blended or own.size > MOST:
            one_friction(packing, options.friction)
        else:
            levels, of = own, index.ravel().astype(np.int64)
    return Surfaces(levels, of, given, mixing(packing, options.mixing), packing.domain.is_planar)


class Groups(NamedTuple):
    """Grains that share class, density and friction.

    Parameters
    ----------
    of : ndarray of int64, shape (n,)
        The group of each grain, from 0.
    firsts : ndarray of int64, shape (k,)
        The first grain of each group.
    parted_by : tuple of str
        What tells them apart: ``class``, ``density``, ``friction``; all where there is one group.
    """

    of: Ints
    firsts: Ints
    parted_by: tuple[str, ...]


def groups(packing: Packing, levels: Ints) -> Groups:
    """Return the grains in groups of class, density and level of friction, rising in that order.

    Where these are more than `MOST`, frictions part none, and where they still are, densities neither.
    """
    n = len(packing)
    classes = np.zeros(n, dtype=np.int64) if packing.classes is None else packing.classes
    densities = np.unique(packing.densities, return_inverse=True)[1].ravel()
    columns = {"class": classes, "density": densities, "friction": levels}
    found = Groups(np.zeros(n, dtype=np.int64), np.zeros(1, dtype=np.int64), ())
    for kept in (3, 2, 1):
        names = tuple(columns)[:kept]
        table = np.column_stack([columns[name] for name in names])
        _, firsts, of = np.unique(table, axis=0, return_index=True, return_inverse=True)
        found = Groups(of.ravel().astype(np.int64), firsts.astype(np.int64), names)
        if firsts.size <= MOST:
            break
    return found
