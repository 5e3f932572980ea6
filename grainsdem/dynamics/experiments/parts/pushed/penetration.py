"""Penetration: a plate, a cone, a sphere, a wheel or a mesh is pressed, dropped or rolled into a bed at rest."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Unpack

import numpy as np

from exporters import mjcf
from grainsdem.dynamics.experiments.parts.pushed.bodies import NAME, Kind, make_body, read_body
from grainsdem.dynamics.experiments.parts.pushed.course import Mode, course_of, start_of
from grainsdem.dynamics.experiments.parts.pushed.pushing import Pushing, armatures_of, joints_of
from grainsdem.dynamics.experiments.parts.pushed.told import panels_of
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import pour
from grainsdem.dynamics.experiments.rig import assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of, plate_friction
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.model import Packing
from grainsdem.options import option

if TYPE_CHECKING:
    from grainsdem.dynamics.engine import Apparatus


@experiment(panels=panels_of)
def penetration(
    packing: Packing,
    *,
    body: Annotated[Kind, option("What goes in, where no mesh is given.")] = "plate",
    mesh: Annotated[
        str | None,
        option(
            "A body of your own, .stl or .obj, z up: each connected piece is taken as its convex hull.", is_path=True
        ),
    ] = None,
    scale: Annotated[float, option("Length of the mesh's unit.", "m", gt=0)] = 1.0,
    mode: Annotated[
        Mode, option("Press it down at a constant speed, drop it, or roll it along x, which takes a wheel.")
    ] = "press",
    width: Annotated[
        float | None,
        option(
            "Side of the square plate, or diameter; by default a third of the box's shorter side, for a wheel a "
            "quarter of its length.",
            "m",
            gt=0,
        ),
    ] = None,
    thickness: Annotated[
        float | None,
        option(
            "Height of the plate or breadth of the wheel; by default the plate's width, a third of the box's breadth.",
            "m",
            gt=0,
        ),
    ] = None,
    apex_angle: Annotated[float, option("Angle between opposite sides of the cone.", "rad", gt=0, lt=np.pi)] = float(
        np.pi / 3
    ),
    depth: Annotated[
        float | None, option("Depth at which pressing ends; by default half the height of the bed.", "m", gt=0)
    ] = None,
    speed: Annotated[float | None, option("Speed of pressing; by default 0.1 √(g d).", "m/s", gt=0)] = None,
    height: Annotated[
        float | None, option("How far it falls onto the highest grain under it; by default five diameters.", "m", ge=0)
    ] = None,
    mass: Annotated[
        float | None, option("Mass of what is dropped or rolls; by default as if it were made of grain.", "kg", gt=0)
    ] = None,
    load: Annotated[
        float | None,
        option("Force that presses the wheel down, its weight included; by default its weight.", "N", gt=0),
    ] = None,
    angular_speed: Annotated[
        float | None, option("Of the wheel; by default its rim goes at 0.3 √(g d).", "rad/s", gt=0)
    ] = None,
    slip: Annotated[
        float | None,
        option("One less its forward speed over that of its rim; by default 0.2.", gt=-1, le=1),
    ] = None,
    forward_speed: Annotated[float | None, option("Instead of the slip.", "m/s", ge=0)] = None,
    travel: Annotated[
        float | None, option("How far the wheel goes; by default what the box's length leaves.", "m", gt=0)
    ] = None,
    max_time: Annotated[float | None, option("Time limit of what was dropped; 50 by default.", "√(d/g)", gt=0)] = None,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    body_friction: Annotated[
        float | None, option("Coefficient of friction of grains with the body; by default as among grains.", ge=0)
    ] = None,
    gravity: Gravity = 9.81,
    **run: Unpack[Run],
) -> Pushing:
    """Press, drop or roll a body into a bed: force, sinkage, drawbar pull.

    Parameters
    ----------
    packing : Packing
        The bed, in a box; `settle` it first, or give ``rng``.

    Returns
    -------
    Outcome
        Packing, history, `PenetrationReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range or of another mode, the body does not fit, or the packing is periodic or overlaps.
    MissingFileError, FileFormatError
        If there is no such mesh, or it is none.

    Notes
    -----
    The body waits above until the bed is at rest. It moves along the vertical, a wheel also along x and about its axis,
    and nothing else: a rod or an axle holds it upright. Where it is pressed it keeps its speed whatever the bed does.
    Forces are means over 0.2 √(d/g) of what its contacts bore. Depth counts from the highest grain under it, or in a
    wheel's track. Slip is prescribed: a wheel turns at its angular speed and goes on at its forward speed, and is free
    to sink under its load. The body does not pass through floor and walls.
    """
    if len(packing.domain.planes):
        raise InputError("penetration needs a box; a container of planes has no middle to press into")
    if mode == "roll" and mesh is None and body != "wheel":
        raise InputError(f"mode 'roll' takes a wheel, or a mesh; got body {body!r}")
    if mesh is None:
        made = make_body(body, packing.domain, width=width, thickness=thickness, apex_angle=apex_angle)
    else:
        made = read_body(mesh, packing.domain, scale=scale)
    bed = pour(packing, run)
    units = mjcf.units(bed, gravity)
    given = {
        "depth": depth, "speed": speed, "height": height, "mass": mass, "load": load, "angular_speed": angular_speed,
        "slip": slip, "forward_speed": forward_speed, "travel": travel, "max_time": max_time,
    }  # fmt: skip
    course = course_of(mode, given, made, bed, units)
    up = 1 if bed.domain.is_planar else 2
    start = start_of(course, made, bed, units, float(world_vertices(bed)[:, up].max()))

    def furnish(apparatus: Apparatus) -> None:
        part = apparatus.add_body(NAME, start, joints_of(course, up), mass=course.mass, armatures=armatures_of(course))
        own = plate_friction(bed, friction) if body_friction is None else body_friction
        made.furnish(apparatus, part, units.length, friction=own)

    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    return Pushing(assemble(bed, options, furnish, spheres=run["spheres"]), made, course, start)
