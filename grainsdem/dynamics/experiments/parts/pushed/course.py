"""How a body goes into a bed: pressed, dropped or rolled, in the units of the run."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from grainsdem.dynamics.experiments.parts.gauge import FASTEST
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits
    from grainsdem.dynamics.experiments.parts.pushed.bodies import Body
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

Mode = Literal["press", "drop", "roll"]

OPTIONS: dict[str, tuple[str, ...]] = {
    "press": ("depth", "speed"),
    "drop": ("height", "mass", "max_time"),
    "roll": ("mass", "load", "angular_speed", "slip", "forward_speed", "travel"),
}
"""Which options belong to which mode."""

PRESS_SPEED = 0.1
"""Speed [d/t] at which a body is pressed by default: its share in the force is ρ v², a hundredth of ρ g d."""

RIM_SPEED = 0.3
"""Speed [d/t] of a wheel's rim by default."""

SLIP = 0.2

FALL = 5.0
"""Height [d] of a fall by default."""

END = 1.0
"""Distance [d] of a wheel from the walls at both ends of its track."""

PATIENCE = 50.0
"""Time [t] after which a body that was dropped is taken as it lies, by default."""


class Course(NamedTuple):
    """What a body does, in grain units.

    Parameters
    ----------
    mode : {"press", "drop", "roll"}
        How it goes in.
    mass : float
        Its mass [m].
    depth : float
        Where pressing ends [d]; NaN for half of the bed.
    speed : float
        Downward where it is pressed, forward where it rolls [d/t].
    height : float
        How far it falls [d].
    load : float
        Force that presses a wheel down, its weight included [m g].
    spin : float
        Angular speed of a wheel [1/t].
    slip : float
        One less the forward speed over that of the rim.
    travel : float
        How far a wheel goes [d].
    max_time : float
        Time limit [t].
    """

    mode: Mode
    mass: float
    depth: float = np.nan
    speed: float = 0.0
    height: float = 0.0
    load: float = 0.0
    spin: float = 0.0
    slip: float = np.nan
    travel: float = np.nan
    max_time: float = np.inf


def course_of(mode: Mode, given: Mapping[str, float | None], body: Body, packing: Packing, units: GrainUnits) -> Course:
    """Return what a body does, from the options [SI] that were given, the others as they fit.

    Raises
    ------
    InputError
        If an option belongs to another mode, there is no room for what is asked, or it is too fast.
    """
    _refuse_others(mode, given)
    course = _course(mode, given, body, packing, units)
    for what, speed in (
        ("speed", course.speed), ("the fall's speed", np.sqrt(2 * course.height)),
        ("the rim's speed", course.spin * float(body.half[0]) / units.length),
    ):  # fmt: skip
        if speed > FASTEST:
            raise InputError(
                f"{what} is {speed * units.velocity:.4g} m/s; {FASTEST * units.velocity:.4g} m/s, {FASTEST:g} √(g d), "
                f"can be simulated"
            )
    return course


def _course(mode: Mode, given: Mapping[str, float | None], body: Body, packing: Packing, units: GrainUnits) -> Course:
    """Return what a body does, however fast."""
    up = 1 if packing.domain.is_planar else 2
    mass = (given["mass"] or body.volume * float(packing.densities.mean())) / units.mass
    if mode == "press":
        depth, speed = given["depth"], given["speed"]
        tallest = float(packing.domain.lengths[up])
        if depth is not None and depth >= tallest:
            raise InputError(f"depth must be below {tallest:.4g} m, the height of the box; got {depth:.4g} m")
        return Course(
            mode, mass, np.nan if depth is None else depth / units.length,
            PRESS_SPEED if speed is None else speed / units.velocity,
        )  # fmt: skip
    if mode == "drop":
        height = FALL if given["height"] is None else given["height"] / units.length
        return Course(mode, mass, height=height, max_time=given["max_time"] or PATIENCE)
    return _rolling(given, body, packing, units, mass)


def _rolling(given: Mapping[str, float | None], body: Body, packing: Packing, units: GrainUnits, mass: float) -> Course:
    """Return the course of a wheel."""
    up = 1 if packing.domain.is_planar else 2
    radius = float(body.half[up]) / units.length
    spin = RIM_SPEED / radius if given["angular_speed"] is None else given["angular_speed"] * units.time
    if given["slip"] is not None and given["forward_speed"] is not None:
        raise InputError("slip and forward_speed give each other by the angular speed; give one of them")
    slip = SLIP if given["slip"] is None else given["slip"]
    if given["forward_speed"] is not None:
        slip = 1 - given["forward_speed"] / units.velocity / (spin * radius)
    room = (float(packing.domain.lengths[0]) - 2 * float(body.half[0])) / units.length - 2 * END
    travel = room if given["travel"] is None else given["travel"] / units.length
    if not 0 < travel <= room + 1e-9:
        raise InputError(
            f"travel must be at most {max(room, 0.0) * units.length:.4g} m, what the box leaves to a wheel of "
            f"{2 * float(body.half[0]):.4g} m; got {travel * units.length:.4g} m: take a longer box or a smaller wheel"
        )
    load = mass if given["load"] is None else given["load"] / units.force
    return Course("roll", mass, speed=(1 - slip) * spin * radius, load=load, spin=spin, slip=slip, travel=travel)


def start_of(course: Course, body: Body, packing: Packing, units: GrainUnits, top: float) -> Floats:
    """Return where the middle of a body waits [d] until the bed is at rest, shape (3,): above its top [m].

    It is above the middle of the box, a wheel above the lower end of its track along x.
    """
    lower, upper = packing.domain.lower / units.length, packing.domain.upper / units.length
    up = 1 if packing.domain.is_planar else 2
    place = 0.5 * (lower + upper)
    half = body.half / units.length
    if course.mode == "roll":
        place[0] = lower[0] + half[0] + END
    place[up] = top / units.length + half[up] + 1.0
    return np.asarray(place)


def _refuse_others(mode: Mode, given: Mapping[str, Any]) -> None:
    """Raise `InputError` where an option of another mode was given."""
    for name, value in given.items():
        if value is not None and name not in OPTIONS[mode]:
            homes = " and ".join(repr(key) for key, names in OPTIONS.items() if name in names)
            raise InputError(f"{name} is an option of mode {homes}; got mode {mode!r}")
