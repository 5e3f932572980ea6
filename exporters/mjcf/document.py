"""A file for MuJoCo as a whole: what stands around the grains, or the two files of grains and of walls apart."""

from __future__ import annotations

import math
from string import Template
from typing import TYPE_CHECKING
from xml.sax.saxutils import quoteattr

import numpy as np

from exporters.container import container_box, world_bounds
from exporters.mjcf.grains import bodies, grain_class, grain_materials, shapes
from exporters.mjcf.settings import settings
from exporters.mjcf.walls import container, rounded, wall_class, wall_materials
from exporters.text import rows_of_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.mjcf.grains import Bed
    from exporters.mjcf.options import MjcfOptions

    Floats = NDArray[np.float64]

_DOCUMENT = Template("""\
<mujoco model=$name>
  <!-- $n_grains grains$in_units: length 1 = $length m$is_diameter,
       mass 1 = $mass kg, time 1 = $time s, so density 1 = $density kg/m3 and acceleration 1 = $acceleration m/s2.
       Part of another model: attach this one with a prefix (MjSpec), or include the files of grains and of walls that
       split=true writes. The <option> below does not go along: its step, cone and impratio are what the stiffness of
       contacts is meant for, and the other model needs them. -->
  <compiler angle="radian" autolimits="true" inertiafromgeom="auto"/>
  <size memory="$memory"/>
$option
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
    <map znear="0.01" shadowclip="1.2"/>
    <rgba haze="0.93 0.94 0.95 1"/>
  </visual>
  <statistic center="$centre" extent="$extent" meansize="$meansize"/>
$classes  <asset>
    <texture name="${prefix}sky" type="skybox" builtin="gradient" rgb1="0.96 0.97 0.98" rgb2="0.72 0.78 0.84"
             width="256" height="1536"/>
$materials$mark  </asset>
  <worldbody>
    <light name="${prefix}sun" pos="$sun" dir="$sunlight" directional="true" diffuse="0.72 0.70 0.66"
           specular="0.12 0.12 0.12"/>
    <camera name="${prefix}view" pos="$eye" xyaxes="$eye_axes" fovy="38"/>
$container$mark  </worldbody>
$includes$keyframe</mujoco>
""")

_PART = Template("""\
<mujoco>
  <!-- To be included in a model of its own units and options: $in_units.
       What the contacts are meant for:
$option -->
$classes  <asset>
$materials$mark  </asset>
  <worldbody>
$mark  </worldbody>
</mujoco>
""")

_CLASSES = "  <default>\n%s  </default>\n"
_INCLUDE = "  <include file=%s/>\n"
_KEYFRAME = "  <keyframe>\n    <key name=%s/>\n  </keyframe>\n"
_MARK = "\0"  # where the grains go: they are written a stretch at a time


def whole(bed: Bed, options: MjcfOptions, name: str) -> Iterator[str]:
    """Yield the file as one, a stretch of grains at a time."""
    contact = settings(bed, options).contact
    bounds = world_bounds(bed.packing)
    text = _document(
        bed,
        options,
        name,
        classes=_CLASSES % (grain_class(bed, contact) + wall_class(bed, contact)),
        materials=wall_materials(bed) + grain_materials(bed),
        container=container(bed, options, bounds),
        mark=_MARK,
    )
    yield from _with_grains(bed, text)


def including(bed: Bed, options: MjcfOptions, name: str, parts: Iterable[str]) -> str:
    """Return the file that holds all but grains and walls, and includes the files that do."""
    files = "".join(_INCLUDE % quoteattr(part) for part in parts)
    return _document(bed, options, name, classes="", materials="", container="", mark="", includes=files)


def grains_alone(bed: Bed, options: MjcfOptions) -> Iterator[str]:
    """Yield the file of the grains, which stands alone: classes, materials, meshes and bodies."""
    told = settings(bed, options)
    text = _part(bed, told.option, classes=_CLASSES % grain_class(bed, told.contact), materials=grain_materials(bed))
    yield from _with_grains(bed, text)


def walls_alone(bed: Bed, options: MjcfOptions) -> str:
    """Return the file of the container, which stands alone; nothing where there are no walls."""
    told = settings(bed, options)
    walls = container(bed, options, world_bounds(bed.packing))
    if not walls:
        return ""
    before, between, after = _part(
        bed, told.option, classes=_CLASSES % wall_class(bed, told.contact), materials=wall_materials(bed)
    ).split(_MARK)
    return f"{before}{between}{walls}{after}"


def _with_grains(bed: Bed, text: str) -> Iterator[str]:
    """Yield a text with shapes and bodies of the grains at its two marks, a stretch at a time."""
    before, between, after = text.split(_MARK)
    yield before
    yield from shapes(bed)
    yield between
    yield from bodies(bed)
    yield after


def _part(bed: Bed, option: str, **filled: str) -> str:
    """Return a file to be included, with marks where shapes and bodies go."""
    told = f"length 1 = {bed.scales.length!r} m, mass 1 = {bed.scales.mass!r} kg, time 1 = {bed.scales.time!r} s"
    return _PART.substitute(filled, in_units=told, option=option, mark=_MARK)


def _document(bed: Bed, options: MjcfOptions, name: str, **filled: str) -> str:
    """Return a model with what is filled in."""
    packing, scales = bed.packing, bed.scales
    bounds = world_bounds(packing)
    floor = container_box(packing, bounds)[0] / scales.length
    box = np.stack([packing.domain.lower, packing.domain.upper]) / scales.length
    corners = rows_of_text(box.ravel(), [3, 3], digits=12)
    is_grain = options.units == "grain"
    return _DOCUMENT.substitute(
        {"includes": "", **filled},
        **_picture(bounds[0] / scales.length, bounds[1] / scales.length, floor, bed.diameter),
        name=quoteattr(name),
        n_grains=len(packing),
        in_units=" in grain units" if is_grain else "",
        is_diameter=" (median diameter of the spheres of equal volume)" if is_grain else "",
        length=repr(scales.length),
        mass=repr(scales.mass),
        time=repr(scales.time),
        domain_lower=corners[0],
        domain_upper=corners[1],
        density=f"{scales.density:.9g}",
        acceleration=f"{scales.acceleration:.9g}",
        meansize=f"{bed.diameter:.9g}",
        memory=options.memory or _memory(len(packing)),
        option=settings(bed, options).option,
        prefix=bed.prefix,
        # Without numbers it is the state that the bodies are written in.
        keyframe=_KEYFRAME % quoteattr(bed.prefix + options.keyframe) if options.keyframe else "",
    )


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
        row.round(6) if key == "eye_axes" else rounded(row, 1e3 * diameter) for key, row in zip(keys, rows, strict=True)
    ]
    texts = rows_of_text(np.concatenate(rows), [row.size for row in rows])
    return {**dict(zip(keys, texts, strict=True)), "extent": f"{extent:.9g}"}
