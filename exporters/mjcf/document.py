"""What stands around the grains in a file for MuJoCo: settings, units, light and camera, and the container."""

from __future__ import annotations

import math
from string import Template
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from exporters.container import GRAIN_COLOURS, container_box, plane_frames, wall_names, world_bounds
from exporters.mjcf.bouncing import BOUNCING_START, BOUNCING_STEPS, DAMPED_START, DAMPED_STEPS, damping_of
from exporters.mjcf.grains import PLAIN
from exporters.mjcf.options import ITERATIONS, NOSLIP_AT_REST
from exporters.rest import down, rest_of, restitution, time_step
from exporters.text import rows_of_text

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf.grains import Bed
    from exporters.mjcf.options import MjcfOptions
    from exporters.mjcf.surfaces import Surfaces
    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

_DOCUMENT = Template("""\
<mujoco model=$name>
  <!-- $n_grains grains$in_units: length 1 = $length m$is_diameter,
       mass 1 = $mass kg, time 1 = $time s, so density 1 = $density kg/m3 and acceleration 1 = $acceleration m/s2. -->
  <compiler angle="radian" autolimits="true" inertiafromgeom="auto"/>
  <size memory="$memory"/>
  <option timestep="$time_step" gravity="$down" integrator="implicitfast" cone="elliptic" impratio="$impratio"
          solver="$solver" iterations="$iterations" tolerance="$tolerance" noslip_iterations="$noslip"
          jacobian="sparse">
    <flag multiccd="enable" autoreset="disable"/>
  </option>
  <custom>
    <numeric name="grain_unit_length" data="$length"/>
    <numeric name="grain_unit_mass" data="$mass"/>
    <numeric name="grain_unit_time" data="$time"/>
    <numeric name="domain_lower" data="$domain_lower"/>
    <numeric name="domain_upper" data="$domain_upper"/>
  </custom>
  <visual>
    <global azimuth="125" elevation="-22" fovy="38" offwidth="1920" offheight="1440"/>
    <headlight ambient="0.40 0.40 0.40" diffuse="0.34 0.34 0.34" specular="0 0 0"/>
    <quality shadowsize="8192" offsamples="8"/>
    <map znear="0.01" zfar="60" shadowclip="1.2"/>
    <rgba haze="0.93 0.94 0.95 1"/>
  </visual>
  <statistic center="$centre" extent="$extent" meansize="$meansize"/>
  <default>
    <geom solref="$solref $damping" solimp="$start 0.95 $width"/>
    <default class="grain">
      <geom type="$shape" condim="$condim" friction="$friction"/>
    </default>
    <default class="wall">
      <geom type="plane" condim="$wall_condim" friction="$wall_friction" priority="$priority"/>
    </default>
  </default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.96 0.97 0.98" rgb2="0.72 0.78 0.84"
             width="256" height="1536"/>
    <material name="floor" rgba="0.78 0.78 0.76 1" specular="0.1" shininess="0.1"/>
    <material name="wall" rgba="0.55 0.65 0.72 0.16" specular="0.2" shininess="0.4"/>
$materials
$meshes
  </asset>
  <worldbody>
    <light name="sun" pos="$sun" dir="$sunlight" directional="true" diffuse="0.72 0.70 0.66"
           specular="0.12 0.12 0.12"/>
    <camera name="view" pos="$eye" xyaxes="$eye_axes" fovy="38"/>
$container
$bodies
  </worldbody>
$include$keyframe</mujoco>
""")

_MATERIAL = '    <material name="%s" rgba="%g %g %g 1" specular="0.18" shininess="0.25"/>'
_KEYFRAME = "  <keyframe>\n    <key name=%s/>\n  </keyframe>\n"
_MARK = "\0"  # where the grains go: they are written a stretch at a time
_WALL = '      <geom name="%s" class="wall" pos="%s" quat="%s" size="%s" material="%s"%s/>'


def around(bed: Bed, options: MjcfOptions, name: str, include: str = "") -> tuple[str, str, str]:
    """Return what comes before the shapes of the grains, between these and their bodies, and after both.

    Parameters
    ----------
    bed : Bed
        The grains.
    options : MjcfOptions
        Settings and container.
    name : str
        Name of the model.
    include : str
        File that holds the grains, if another does.
    """
    packing, length = bed.packing, bed.scales.length
    bounds = world_bounds(packing)
    lower, upper = (corner / length for corner in container_box(packing, bounds))
    bounds /= length
    # Planes have no end for contacts; walls are drawn as high as the grains, that they neither hide nor shade them.
    drawn = upper if packing.domain.is_planar else np.append(upper[:2], min(upper[2], bounds[1, 2]))
    materials = GRAIN_COLOURS if bed.colours is None else {PLAIN: (0.9, 0.9, 0.9)}
    text = _DOCUMENT.substitute(
        _settings(bed, options),
        **_picture(bounds[0], bounds[1], lower, bed.diameter),
        name=quoteattr(name),
        materials="\n".join([_MATERIAL % (name, *rgb) for name, rgb in materials.items()]),
        container=_container(lower, drawn, options, packing.domain.scaled(1 / length), bed),
        include=f"  <include file={quoteattr(include)}/>\n" if include else "",
        # Without numbers it is the state that the bodies are written in.
        keyframe=_KEYFRAME % quoteattr(options.keyframe) if options.keyframe else "",
        meshes=_MARK,
        bodies=_MARK,
    )
    before, between, after = text.split(f"{_MARK}\n")
    return before, between, after


def _settings(bed: Bed, options: MjcfOptions) -> dict[str, object]:
    """Return what the options and the units fill in."""
    packing, scales, n = bed.packing, bed.scales, len(bed.packing)
    is_grain = options.units == "grain"
    gravity = options.gravity / scales.acceleration
    step = time_step(packing, options.time_step) * (1.0 if is_grain else np.sqrt(bed.diameter / gravity))
    box = np.stack([packing.domain.lower, packing.domain.upper]) / scales.length
    bounce = restitution(packing, options.restitution)
    if bounce is None:
        contact_steps, damping, start = DAMPED_STEPS, 1.0, DAMPED_START
    else:
        contact_steps, damping, start = BOUNCING_STEPS, damping_of(bounce), BOUNCING_START
    noslip = options.noslip_iterations
    if noslip is None:
        noslip = NOSLIP_AT_REST if rest_of(packing) is not None and options.solver == "PGS" else 0
    return {
        "n_grains": n,
        "in_units": " in grain units" if is_grain else "",
        "is_diameter": " (median diameter of the spheres of equal volume)" if is_grain else "",
        "length": repr(scales.length),
        "mass": repr(scales.mass),
        "time": repr(scales.time),
        **dict(zip(("domain_lower", "domain_upper"), rows_of_text(box.ravel(), [3, 3], digits=12), strict=True)),
        "density": f"{scales.density:.9g}",
        "acceleration": f"{scales.acceleration:.9g}",
        "meansize": f"{bed.diameter:.9g}",
        "shape": "mesh" if bed.radii is None else "sphere",
        "memory": options.memory or _memory(n),
        "time_step": f"{step:.9g}",
        "down": rows_of_text(gravity * down(packing), [3])[0],
        "impratio": f"{options.impratio:.9g}",
        "solver": options.solver,
        "iterations": options.iterations or ITERATIONS[options.solver],
        "tolerance": f"{options.tolerance:.9g}",
        "noslip": noslip,
        "solref": f"{contact_steps * step / damping:.9g}",
        "damping": f"{damping:.9g}",
        "start": f"{start:g}",
        "width": f"{options.contact_width * bed.diameter:.9g}",
        **bed.surfaces.defaults(),
    }


def _memory(n_grains: int) -> int:
    """Return the arena [bytes] for a bed of so many grains."""
    # Beds that settle in place use 15 to 40 kB a grain; of what is set aside MuJoCo touches only what it
    # uses.
    return (16 << 20) + n_grains * (256 << 10)


def _picture(lower: Floats, upper: Floats, floor: Floats, diameter: float) -> dict[str, str]:
    """Return camera and light that show the box of the grains, standing on the floor, as a whole."""
    centre = (lower + upper) / 2
    extent = float(np.linalg.norm(upper - lower))
    azimuth, elevation, tangent = math.radians(125.0), math.radians(22.0), math.tan(math.radians(19.0))
    level = math.cos(elevation)
    back = -np.array([math.cos(azimuth) * level, math.sin(azimuth) * level, -math.sin(elevation)])
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    eye = centre + back * (0.62 * extent / tangent)
    # Steep, since walls cast shadows although one sees through them.
    sun = centre + np.array([0.2, -0.35, 1.7]) * extent
    sun[2] = max(sun[2], floor[2] + extent)
    rows = [centre, eye, np.append(right, np.cross(back, right)), sun, centre - sun]
    keys = ["centre", "eye", "eye_axes", "sun", "sunlight"]
    rows = [
        row.round(6) if key == "eye_axes" else _rounded(row, 1e3 * diameter)
        for key, row in zip(keys, rows, strict=True)
    ]
    texts = rows_of_text(np.concatenate(rows), [row.size for row in rows])
    return {**dict(zip(keys, texts, strict=True)), "extent": f"{extent:.9g}"}


def _container(lower: Floats, upper: Floats, options: MjcfOptions, domain: Domain, bed: Bed) -> str:
    """Return the static body of the floor and the walls; planes have no thickness that a grain could pass."""
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    # Quaternions that turn a plane's z axis inward, with its x axis along the second size.
    s = float(np.sqrt(0.5))
    sides = {
        "floor": (2, 0, (1.0, 0.0, 0.0, 0.0), (0, 1)),
        "wall_x0": (0, 0, (s, 0.0, s, 0.0), (2, 1)),
        "wall_x1": (0, 1, (s, 0.0, -s, 0.0), (2, 1)),
        "wall_y0": (1, 0, (s, -s, 0.0, 0.0), (0, 2)),
        "wall_y1": (1, 1, (s, s, 0.0, 0.0), (0, 2)),
    }
    planes = {f"wall_p{k}": frame for k, frame in enumerate(zip(*plane_frames(domain), strict=True))}
    found: dict[str, Floats] = {}
    for name in wall_names(domain, options.walls):
        if name in planes:
            point, rotation = planes[name]
            # Drawn a quarter of the box wide: contacts see planes without end.
            numbers = [*_rounded(point, bed.diameter), *rotation, half.max() / 4, half[2], bed.diameter]
        else:
            axis, side, quaternion, (a, b) = sides[name]
            place = centre.copy()
            place[axis] = (lower, upper)[side][axis]
            numbers = [*_rounded(place, bed.diameter), *quaternion, half[a], half[b], bed.diameter]
        found[name] = np.array(numbers)
    return _walls(found, bed.surfaces)


def _walls(found: dict[str, Floats], surfaces: Surfaces) -> str:
    """Return the container of walls: place, rotation and size of each by name."""
    surfaces.given.refuse_unknown(found)
    lines = []
    for name, numbers in found.items():
        at, turn, size = rows_of_text(numbers, [3, 4, 3])
        looks = "floor" if name == "floor" else "wall"
        lines.append(_WALL % (name, at, turn, size, looks, surfaces.of_wall(name)))
    return "\n".join(['    <body name="container">', *lines, "    </body>"]) if lines else ""


def _rounded(place: Floats, diameter: float) -> Floats:
    """Return a place to a billionth of a diameter: noise around zero is not written as numbers of its own."""
    decimals = 9 - round(np.log10(diameter))
    return place.round(decimals)
