"""What a simulation by a discrete-element program is like, of a kind that puts a skin around every grain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from exporters.check import check_choice, check_positive
from grainsdem.errors import InputError
from grainsdem.packing.blunting import check_min_edge

WALLS = ("box", "floor", "none")
"""The container that a file may have: all its walls, the floor only, or nothing. There is no lid."""


def check_friction(friction: float | None) -> None:
    """Raise `InputError` unless a coefficient of friction that was given is zero or more."""
    if friction is not None:
        check_positive("friction", friction, or_zero=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class SkinOptions:
    """What the simulation is like that a file describes, of a program that puts a skin around every grain.

    Parameters
    ----------
    rounding : float
        Radius of the sphere that rounds the edges, in diameters of each grain, at most 0.2. Every face is moved inward
        by it, so that no grain becomes larger.
    min_edge : float, optional
        Shortest edge of a core, in diameters of its grain: what the faces moved inward leave shorter is merged.
    friction : float, optional
        Coefficient of friction [1], among grains and with walls; that which the grains came to rest with by default,
        else 0.5.
    restitution : float
        Velocity after over velocity before a contact, above 0 and at most 1.
    gravity : float
        Acceleration [m/s²].
    depth : float
        Deepest overlap of a grain that has fallen from the top of the bed, in rounding radii: at most 1, since
        overlaps deeper than both grains' radii are pulled through. The springs' stiffness and the time step follow.
    duration : float
        Time to simulate, in units of √(d/g), d being the median diameter.
    walls : {"box", "floor", "none"}
        Container from the packing's domain. There is no lid.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    rounding: float = 0.02
    min_edge: float | None = None
    friction: float | None = None
    restitution: float = 0.3
    gravity: float = 9.81
    depth: float = 1.0
    duration: float = 20.0
    walls: Literal["box", "floor", "none"] = "box"

    def __post_init__(self) -> None:
        for name in ("rounding", "restitution", "gravity", "depth", "duration"):
            check_positive(name, getattr(self, name))
        check_friction(self.friction)
        if self.min_edge is not None:
            check_min_edge(self.min_edge)
        for name, most in (("rounding", 0.2), ("restitution", 1.0), ("depth", 1.0)):
            if getattr(self, name) > most:
                raise InputError(f"{name} must be at most {most:g}; got {getattr(self, name)}")
        check_choice("walls", self.walls, WALLS)
