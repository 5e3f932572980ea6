"""Options that several experiments have, each said once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

from exporters.mjcf.bouncing import LEAST, MOST
from grainsdem.options import option
from grainsdem.values import ByName

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    import numpy as np

Friction = Annotated[
    float | None,
    option(
        "Coefficient of friction among all grains; by default each has its own (`Packing.frictions`), or 0.5 where "
        "there are none.",
        ge=0,
        le=1000,
    ),
]

WallFriction = Annotated[
    ByName,
    option(
        "The same with floor and walls, or with some of them by name as floor=0.6,wall_x0=0; by default, and of walls "
        "that are not named, as among grains.",
    ),
]

CompactionFriction = Annotated[
    float | None,
    option("The same while the bed is compressed: less makes a denser bed; by default as afterwards.", ge=0, le=1000),
]

InertialNumber = Annotated[
    float,
    option("Rate of strain times d √(ρ/σ): below 1e-3 loading is quasi-static, 1e-2 adds a degree or so.", gt=0, le=1),
]

NormalStress = Annotated[float, option("Load on the lid over its area.", "Pa", gt=0)]

Gravity = Annotated[float, option("Acceleration of gravity.", "m/s²", gt=0)]


Spheres = Annotated[bool, option("Replace each grain by the sphere of equal volume.")]

TimeStep = Annotated[float, option("Time step in units of t = √(d/g), or d √(ρ/P) under a pressure P.", gt=0)]

RollingFriction = Annotated[
    float,
    option(
        "Coefficient of rolling friction: a contact resists with a torque of at most this times its normal force "
        "times d/2, d being the median diameter; heaps of spheres then come to rest, and steps take longer.",
        ge=0,
        le=10,
    ),
]

Mixing = Annotated[
    Literal["max", "min"],
    option("Whether the rougher or the smoother of two grains with frictions of their own rules their contact."),
]

Restitution = Annotated[
    float | None,
    option(
        "Speed of a grain after a bounce over that before it, in all contacts; these are then softer. By default "
        "they are damped until grains hardly bounce.",
        ge=LEAST,
        le=MOST,
    ),
]


class Run(TypedDict, total=False):
    """How any experiment is run: what each of them takes besides its own options; see `NOTES`."""

    spheres: Spheres
    time_step: TimeStep
    rolling_friction: RollingFriction
    mixing: Mixing
    restitution: Restitution
    rng: np.random.Generator | int | None
    history_path: str | os.PathLike[str] | None
    resume: bool
    max_hours: float
    progress: Callable[[float, str], None] | None


DEFAULTS: dict[str, Any] = {
    "spheres": False,
    "time_step": 0.01,
    "rolling_friction": 0.0,
    "mixing": "max",
    "restitution": None,
    "rng": None,
    "history_path": None,
    "resume": False,
    "max_hours": 24.0,
    "progress": None,
}
"""What a run has where it is not told otherwise."""

SEED = (
    "Where given, grains are first turned at random, reordered and set apart or poured; it is the seed. Without it "
    "they start where they are, and cells left in place may lock like a jigsaw."
)

"""What is said of the seed."""

NOTES: dict[str, tuple[str, str]] = {
    "rng": ("numpy.random.Generator, int or None", SEED),
    "history_path": (
        "str or path-like, optional",
        "HDF5 file that the history is appended to while the run goes.",
    ),
    "resume": ("bool", "Whether to go on from the checkpoint of an interrupted run with that history."),
    "max_hours": ("float", "A run that would take longer by estimate is refused before its start."),
    "progress": ("callable, optional", "Called with the fraction done and a few words at every sample."),
}
"""Type and sentence of what is no option of the experiment, but of how it is run."""
