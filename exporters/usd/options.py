"""What a stage says beside the grains."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from exporters.check import check_choice, check_positive, checked_coefficients
from exporters.container import check_colour
from exporters.units import check_units
from grainsdem.errors import InputError, shown

if TYPE_CHECKING:
    from collections.abc import Mapping

    from exporters.container import Colour
    from exporters.units import Units

_IDENTIFIER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class UsdOptions:
    """What the stage says beside the grains.

    Parameters
    ----------
    friction : float, optional
        Static and dynamic friction of the grains [1]; that which the bed came to rest with by default, else 0.5. Where
        grains have their own, one material has the mean, and a warning says so.
    wall_friction : float, mapping or str, optional
        Friction of the walls [1], or of some by name, each then with a material of its own; see
        `exporters.mjcf.MjcfOptions`. That of the grains by default, or with theirs that of the bed at rest. Programs
        average the two of a pair unless told.
    restitution : float, optional
        Coefficient of restitution [1], 0 to 1; that which the bed came to rest with by default, else none.
    gravity : float
        Magnitude of gravity [m/s²].
    time_step : float, optional
        Time step in units of √(d/g), d being the median diameter, that the stage asks for and that the stiffness of
        Newton's contacts is made for. That which the bed came to rest with by default, else 0.01.
    contact_gap : float
        Distance, in median diameters, at which Newton begins to look at a pair.
    walls : {"box", "floor", "none"}
        Container from the packing's domain: floor and four walls, floor only, or nothing. A wall of a periodic axis
        stands where the outermost grain ends. A planar bed is held in its plane by two smooth walls more.
    colour : {"mineral", "id", "diameter", "class"} or array_like
        Display colour of each grain: see `exporters.container`.
    units : {"si", "mm", "grain"} or float
        Units of the stage, which it says itself: metres and kilograms; a length in metres with kilograms; or median
        diameters and their masses, for programs that take grains of a few millimetres for massless. Newton gives bodies
        with moments of inertia below 1e-10, quartz under 4 mm in SI, one of 1e-6.
    scene : bool
        Whether a physics scene, with gravity and the time step, comes along: a stage that the bed becomes part of has
        its own, and nothing converts ours to its units and its axis.
    root : str
        Name of the prim that holds all, the stage's default prim.
    per_grain : bool
        Whether every grain is an asset in a file of its own, whose default prim is its one rigid body, and the stage
        refers to them: for loaders that take one body an asset. They stand in the folder ``bed.grains``.
    hulls : {"any", "physx"}
        PhysX holds at most 64 vertices and 64 faces a hull on the GPU, and simplifies what has more. Such grains are
        written like all others, and named in the log and the manifest; or they are refused.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float | None = None
    wall_friction: float | Mapping[str, float] | None = None
    restitution: float | None = None
    gravity: float = 9.81
    time_step: float | None = None
    contact_gap: float = 0.01
    walls: Literal["box", "floor", "none"] = "box"
    colour: Colour = "mineral"
    units: Units = "si"
    scene: bool = True
    root: str = "World"
    per_grain: bool = False
    hulls: Literal["any", "physx"] = "any"

    def __post_init__(self) -> None:
        object.__setattr__(self, "wall_friction", checked_coefficients("wall_friction", self.wall_friction))
        for name in ("friction", "restitution", "gravity", "contact_gap"):
            if name in {"gravity", "contact_gap"} or getattr(self, name) is not None:
                check_positive(name, getattr(self, name), or_zero=True)
        if self.time_step is not None:
            check_positive("time_step", self.time_step)
        check_choice("walls", self.walls, ("box", "floor", "none"))
        check_choice("hulls", self.hulls, ("any", "physx"))
        if not _IDENTIFIER.fullmatch(self.root):
            raise InputError(f"root must be a name of letters, digits and _, no digit first; got {shown(self.root)}")
        check_colour(self.colour)
        check_units(self.units)
