"""How a bed came to rest, as its provenance tells: a file that it is written to says the same unless told otherwise."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

FRICTION = 0.5
"""Coefficient of friction [1] of grains that never came to rest."""

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
    friction : float
        Coefficient of friction among grains [1].
    wall_friction : float, optional
        Coefficient of friction between grains and walls [1]; that of the grains where there is none.
    down : tuple of float
        Unit vector of gravity.
    are_spheres : bool
        Whether the grains were simulated as spheres.
    rolling_friction : float
        Coefficient of rolling friction [1].
    """

    time_step: float
    friction: float
    wall_friction: float | None
    down: tuple[float, float, float]
    are_spheres: bool
    rolling_friction: float = 0.0


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
        return Rest(**{**found, "down": tuple(found["down"])})
    return None


def frictions(packing: Packing, friction: float | None, wall_friction: float | None = None) -> tuple[float, float]:
    """Return the coefficients of friction among grains, and with walls.

    Parameters
    ----------
    packing : Packing
        What is written.
    friction, wall_friction : float, optional
        Those that were asked for. Without the first, both are those that the bed came to rest with, and 0.5 where it
        did not; without the second, walls have that of the grains.
    """
    if friction is None:
        rest = rest_of(packing)
        friction = FRICTION if rest is None else rest.friction
        if rest is not None and wall_friction is None:
            wall_friction = rest.wall_friction
    return friction, friction if wall_friction is None else wall_friction


def rolling_friction(packing: Packing, asked: float | None) -> float:
    """Return the coefficient of rolling friction: that asked for, that of the bed at rest, or none."""
    if asked is not None:
        return asked
    rest = rest_of(packing)
    return 0.0 if rest is None else rest.rolling_friction


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
