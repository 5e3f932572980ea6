"""What a simulation in MuJoCo is like."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from exporters.check import check_choice, check_positive, check_prefix, checked_coefficients
from exporters.container import check_colour
from exporters.mjcf.bouncing import LEAST, MOST
from exporters.units import check_units
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from exporters.container import Colour
    from exporters.units import Units

ITERATIONS = {"PGS": 30, "CG": 100, "Newton": 100}
"""Most iterations of each solver."""

IMPRATIO = 20.0
"""Ratio of frictional to normal stiffness."""

NOSLIP_AT_REST = 10
"""Iterations against slip of beds at rest: of 60 grains the farthest creeps by 5e-4 d in 5 t, without them by 2e-3."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MjcfOptions:
    """What the simulation that the file describes is like.

    Parameters
    ----------
    friction : float, optional
        Coefficient of friction among all grains [1]. By default as the bed came to rest; else each grain's own
        (`Packing.frictions`), or 0.5 where there are none.
    wall_friction : float, mapping or str, optional
        Coefficient of friction between grains and walls [1], or those of some walls by name, as in
        ``{"floor": 0.6, "wall_x0": 0}`` or ``"floor=0.6,wall_x0=0"``. Without it, and of walls that are not named, as
        among grains; or by default, with that of the grains, as the bed came to rest. Walls are ``floor``, ``wall_x0``,
        ``wall_x1``, ``wall_y0``, ``wall_y1`` and, of a domain with planes, ``wall_p0`` and so on; a planar bed has
        ``wall_y0`` for its floor, ``wall_x0`` and ``wall_x1``.
    mixing : {"max", "min"}, optional
        Which of two grains with frictions of their own rules where they touch: the rougher or the smoother. MuJoCo has
        no mean of the two. As the bed came to rest by default, else the rougher.
    rolling_friction : float, optional
        Coefficient of rolling friction [1]: a contact resists rolling, and spinning about its normal, by torques of at
        most this times half the median diameter times the normal force. A sphere of that diameter rolls down a slope
        steeper than its arctangent. That which the bed came to rest with by default, else none; with it contacts have
        six dimensions instead of three, and steps take several times as long.
    restitution : float, optional
        Speed of a grain after a bounce over that before it [1], 0.3 to 0.7, for all contacts: a sphere bounces to its
        square of the height that it falls from. Contacts are then as stiff as those of twice the time step, and grains
        rest on overlaps ten times as deep. As the bed came to rest by default, else contacts are damped
        until grains hardly bounce: 0.1, more or less by as much.
    gravity : float
        Acceleration [m/s²]; it is one in grain units.
    time_step : float, optional
        Time step in units of √(d/g), d being the median diameter. The stiffness of contacts goes with it. That which
        the bed came to rest with by default: with a larger one it sags. Else 0.01.
    solver : {"PGS", "CG", "Newton"}
        Constraint solver. PGS is the fastest for beds; CG gives more accurate forces.
    iterations : int, optional
        Most iterations of the solver a step: 30 for PGS, else 100 by default.
    tolerance : float
        Relative improvement [1] at which the solver stops.
    impratio : float
        Ratio [1] of frictional to normal stiffness; with 20 a block 2 degrees below the angle of friction creeps by
        less than 1e-5 diameters while it would fall by half of one.
    noslip_iterations : int, optional
        Iterations after the solver's that take away the last creep; 0 for none. By default 10 of a bed that came to
        rest, with PGS, which has what they need at hand; else none.
    contact_width : float
        Depth, in median diameters, over which a contact reaches its full stiffness.
    walls : {"box", "floor", "none"}
        Container from the packing's domain: floor and four walls, floor only, or nothing. There is no lid. A
        wall of a periodic axis stands where the outermost grain ends: cells reach over periodic boundaries.
    memory : int, optional
        Memory [bytes] that MuJoCo sets aside for contacts; from the number of grains by default.
    units : {"grain", "si", "mm"} or float
        Units of the file: median diameters with density and gravity one; metres, kilograms and seconds; or another
        length, in metres, with kilograms and seconds. MuJoCo refuses moments of inertia below 1e-15, which quartz in SI
        has under about 0.45 mm.
    colour : {"mineral", "id", "diameter", "class"} or array_like
        Colour of each grain: see `exporters.container`.
    shapes : {"hulls", "spheres"}, optional
        The grains, or spheres of equal volume, with the inertia of spheres (in planar beds of discs). Where grains
        fit closely, spheres overlap. By default the grains, unless they came to rest as spheres.
    keyframe : str
        Name of the state that the file begins in; none where it is empty.
    split : bool
        Whether grains and walls stand in files of their own, which the first one includes, and so can a model of
        yours: they bring all that they need and change nothing else.
    prefix : str
        What every name in the file begins with, where it is to be part of a model that has such names.
    autoreset : bool
        Whether MuJoCo begins anew where a state blows up; else it stays, to be seen.
    compiled : bool
        Whether the compiled model is written beside the text, for the version of MuJoCo that is installed: for many
        grains it loads much faster.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float | None = None
    wall_friction: float | Mapping[str, float] | None = None
    mixing: Literal["max", "min"] | None = None
    rolling_friction: float | None = None
    restitution: float | None = None
    gravity: float = 9.81
    time_step: float | None = None
    solver: Literal["PGS", "CG", "Newton"] = "PGS"
    iterations: int | None = None
    tolerance: float = 1e-8
    impratio: float = IMPRATIO
    noslip_iterations: int | None = None
    contact_width: float = 1e-3
    walls: Literal["box", "floor", "none"] = "box"
    memory: int | None = None
    units: Units = "grain"
    colour: Colour = "mineral"
    shapes: Literal["hulls", "spheres"] | None = None
    keyframe: str = "start"
    split: bool = False
    compiled: bool = False
    prefix: str = ""
    autoreset: bool = False

    def __post_init__(self) -> None:
        for name in ("gravity", "impratio", "contact_width"):
            check_positive(name, getattr(self, name))
        check_positive("tolerance", self.tolerance, or_zero=True)
        object.__setattr__(self, "wall_friction", checked_coefficients("wall_friction", self.wall_friction))
        for name in ("friction", "rolling_friction", "noslip_iterations"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name), or_zero=True)
        if self.restitution is not None and not LEAST <= self.restitution <= MOST:
            raise InputError(
                f"restitution must be {LEAST:g} to {MOST:g}, or left out for contacts that hardly bounce; "
                f"got {self.restitution!r}"
            )
        for name in ("time_step", "iterations", "memory"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name))
        check_choice("solver", self.solver, ITERATIONS)
        check_choice("walls", self.walls, ("box", "floor", "none"))
        if self.mixing is not None:
            check_choice("mixing", self.mixing, ("max", "min"))
        if self.shapes is not None:
            check_choice("shapes", self.shapes, ("hulls", "spheres"))
        check_units(self.units)
        check_colour(self.colour)
        check_prefix(self.prefix)
        if not self.keyframe.isprintable():
            raise InputError(f"keyframe must be a name that can be printed; got {self.keyframe!r}")
