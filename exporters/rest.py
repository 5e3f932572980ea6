"""How a bed came to rest, as its provenance tells: a file that it is written to says the same unless told otherwise."""

from __future__ import annotations

import json
import logging
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import InputError, shown

if TYPE_CHECKING:
    from collections.abc import Iterable

    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

FRICTION = 0.5
"""Coefficient of friction [1] of grains that never came to rest and have none of their own."""

TIME_STEP = 0.01
"""Their time step [t]."""

_KEY = "resting"
_HARMLESS = frozenset({"rescale"})  # in grain units nothing changes


class Rest(NamedTuple):
    """What a bed is at rest under.

    Parameters
    ----------
    time_step : float
        Time step in units of √(d/g), d being the median diameter. The contacts' stiffness goes with it in MuJoCo, and
        with that how deep grains at rest overlap.
    friction : float or None
        Coefficient of friction among grains [1]; None where each had its own (`Packing.frictions`).
    wall_friction : float, dict or None
        Coefficient of friction between grains and walls [1], or those of walls by name; where there is none, as among
        grains.
    down : tuple of float
        Unit vector of gravity.
    are_spheres : bool
        Whether the grains were simulated as spheres.
    rolling_friction : float
        Coefficient of rolling friction [1].
    mixing : {"max", "min"}
        Whether the rougher or the smoother of two grains rules.
    restitution : float or None
        Speed after a bounce over that before it [1]; None where contacts were damped as well as the step can.
    """

    time_step: float
    friction: float | None
    wall_friction: float | dict[str, float] | None
    down: tuple[float, float, float]
    are_spheres: bool
    rolling_friction: float = 0.0
    mixing: str = "max"
    restitution: float | None = None


def resting(rest: Rest) -> dict[str, Any]:
    """Return the option that a step of provenance has whose end was a bed at rest."""
    return {_KEY: rest._asdict()}


def rest_of(packing: Packing) -> Rest | None:
    """Return how a packing came to rest, or nothing where it did not, or has been changed since."""
    for line in reversed(packing.provenance):
        step = json.loads(line)
        if step["step"] in _HARMLESS:
            continue
        found = step.get(_KEY)
        if found is None:
            return None
        return _rest(found)
    return None


def _rest(found: Any) -> Rest:
    """Return what a step notes of rest, or raise `InputError` where it notes something else: it may be from a file."""
    try:
        rest = Rest(**{**found, "down": tuple(map(float, found["down"]))})
        walls = rest.wall_friction if isinstance(rest.wall_friction, dict) else {"": rest.wall_friction or 0.0}
        plain = (rest.friction or 0.0, *walls.values(), rest.rolling_friction, rest.restitution or 0.0, *rest.down)
        is_sound = len(rest.down) == 3 and rest.time_step > 0 and all(map(math.isfinite, (rest.time_step, *plain)))
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        raise InputError(f"the provenance notes no rest that can be read; got {shown(found)}") from error
    if not is_sound or min(*plain[:-3]) < 0 or rest.mixing not in ("max", "min"):
        raise InputError(f"the provenance notes no rest that can be; got {shown(found)}")
    return rest


class Frictions(NamedTuple):
    """Coefficients of friction [1] of a bed.

    Parameters
    ----------
    grains : float
        Among grains; the mean of all where they have their own.
    own : ndarray, shape (n,), optional
        Each grain's own, where they have any.
    walls : float, optional
        Between grains and those walls that have no other; without it, as among grains.
    by_wall : dict of str to float
        Between grains and single walls.
    """

    grains: float
    own: Floats | None
    walls: float | None
    by_wall: dict[str, float]

    def of_wall(self, name: str) -> float | None:
        """Return the coefficient that a wall has of its own, or nothing where it is as among grains."""
        return self.by_wall.get(name, self.walls)

    def refuse_unknown(self, names: Iterable[str]) -> None:
        """Raise `InputError` where a wall is named that is none of these."""
        known = list(names)
        unknown = [name for name in self.by_wall if name not in known]
        if unknown:
            allowed = f"its walls are {', '.join(known)}" if known else "it has no walls"
            raise InputError(f"the container has no {' and no '.join(unknown)} to have a wall_friction: {allowed}")


def frictions(
    packing: Packing, friction: float | None, wall_friction: float | Mapping[str, float] | None = None
) -> Frictions:
    """Return the coefficients of friction of grains and walls.

    Parameters
    ----------
    packing : Packing
        What is written.
    friction, wall_friction : optional
        Those that were asked for. Without the first, both are those that the bed came to rest with; where it did not,
        or had none but the grains' own, these have their own, or 0.5 where there are none. Without the second, walls
        are as grains are to each other, and so are those that a mapping does not name.
    """
    own = None
    if friction is None:
        rest = rest_of(packing)
        if rest is not None:
            friction = rest.friction
            wall_friction = rest.wall_friction if wall_friction is None else wall_friction
        own = packing.frictions if friction is None else None
    if friction is None:
        friction = FRICTION if own is None or not own.size else float(own.mean())
    by_wall = dict(wall_friction) if isinstance(wall_friction, Mapping) else {}
    walls = None if isinstance(wall_friction, Mapping) else wall_friction
    return Frictions(friction, own, walls, by_wall)


def one_friction(packing: Packing, asked: float | None) -> float:
    """Return the one coefficient of friction of a format that has no others; what is lost by that is warned of."""
    found = frictions(packing, asked)
    if found.own is not None:
        LOG.warning(
            "grains have frictions of their own, from %.3g to %.3g; the file has their mean, %.3g",
            found.own.min(), found.own.max(), found.grains,
        )  # fmt: skip
    return found.grains


def rolling_friction(packing: Packing, asked: float | None) -> float:
    """Return the coefficient of rolling friction: that asked for, that of the bed at rest, or none."""
    if asked is not None:
        return asked
    rest = rest_of(packing)
    return 0.0 if rest is None else rest.rolling_friction


def mixing(packing: Packing, asked: str | None) -> str:
    """Return which of two grains rules their friction: as was asked for, as of the bed at rest, or the rougher one."""
    if asked is not None:
        return asked
    rest = rest_of(packing)
    return "max" if rest is None else rest.mixing


def restitution(packing: Packing, asked: float | None) -> float | None:
    """Return the ratio of speeds of a bounce: that asked for, that of the bed at rest, or none."""
    rest = rest_of(packing)
    return rest.restitution if asked is None and rest is not None else asked


def time_step(packing: Packing, asked: float | None) -> float:
    """Return the time step [t]: that asked for, that of the bed at rest, or 0.01."""
    if asked is not None:
        return asked
    rest = rest_of(packing)
    return TIME_STEP if rest is None else rest.time_step


def down(packing: Packing) -> Floats:
    """Return the unit vector of gravity, shape (3,): that of the bed at rest, else along -y in planar work, or -z."""
    rest = rest_of(packing)
    if rest is not None:
        return np.array(rest.down)
    return np.array([0.0, -1.0, 0.0] if packing.domain.is_planar else [0.0, 0.0, -1.0])
