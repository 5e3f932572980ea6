"""SDFormat: a world with one model a grain, and their meshes beside it, for Drake, Gazebo and PyBullet."""

from __future__ import annotations

from dataclasses import dataclass
from string import Template
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_positive, class_texts, grain_names
from exporters.container import GRAIN_COLOURS, shades, world_bounds
from exporters.dem.bodies import bodies, parts
from exporters.dem.options import WALLS, check_friction
from exporters.dem.scene import check_word, height, springs, walls
from exporters.rest import down, one_friction
from exporters.text import rows_of_text, table_of_text
from exporters.units import check_units, chosen_units, factors_of
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.triangles import triangles

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies
    from exporters.dem.scene import Walls
    from exporters.units import GrainUnits, Units
    from grainsdem.geometry.triangles import Triangles
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

_HEADER = Template("""\
<?xml version="1.0"?>
<sdf version="1.9" xmlns:drake="http://drake.mit.edu">
  <!-- $n_grains grains, model g000007 is grain 7. Length 1 = $length m, mass 1 = $mass kg, time 1 = $time s. -->
  <world name="$name">
    <gravity>$gravity</gravity>
    <physics name="steps" type="ignored">
      <max_step_size>$time_step</max_step_size>
      <real_time_factor>0</real_time_factor>
    </physics>
""")

_WALL = """\
        <collision name="%s">
          <pose>%s</pose>
          <geometry><box><size>%s</size></box></geometry>
          %s
        </collision>
"""

_CONTAINER = """\
    <model name="container">
      <static>1</static>
      <link name="walls">
%s      </link>
    </model>
"""

# Drake takes the friction of the surface where it finds no other.
_SURFACE = (
    "<surface><friction><ode><mu>{0}</mu><mu2>{0}</mu2></ode></friction></surface>"
    "<drake:proximity_properties><drake:point_contact_stiffness>{1}</drake:point_contact_stiffness>"
    "</drake:proximity_properties>"
)

_MODEL = """\
    <model name="%s">
      <pose>%s</pose>
      <link name="grain">
        <inertial>
          <pose>%s</pose><mass>%s</mass>
          <inertia><ixx>%s</ixx><iyy>%s</iyy><izz>%s</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia>
        </inertial>
        <collision name="shape">
          <geometry><mesh><uri>%s</uri><drake:declare_convex/></mesh></geometry>
          %s
        </collision>
        <visual name="%s">
          <geometry><mesh><uri>%s</uri></mesh></geometry>
          <material><ambient>%s 1</ambient><diffuse>%s 1</diffuse></material>
        </visual>
      </link>
    </model>
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class SdfOptions:
    """What the world is like.

    Parameters
    ----------
    units : {"si", "mm", "grain"} or float
        Unit of length: the metre, the millimetre, the median diameter, or so many metres. Masses are in kg and times in
        s, but in grain units, where density and gravity are one. PyBullet puts about a thousandth of a unit around
        every shape: give it ``"grain"`` where grains are below 0.1 m.
    friction : float, optional
        Coefficient of friction [1], among grains and with walls; that which the grains came to rest with by
        default, else 0.5.
    gravity : float
        Acceleration [m/s²].
    depth : float
        Deepest overlap of a grain that has fallen from the top of the bed, in its diameter; Drake's contact stiffness
        follows from it. Drake's own lets grains sink in by a millimetre.
    time_step : float
        Time step in units of √(d/g), d being the median diameter.
    walls : {"box", "floor", "none"}
        Container from the packing's domain. There is no lid.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    units: Units = "si"
    friction: float | None = None
    gravity: float = 9.81
    depth: float = 0.01
    time_step: float = 0.01
    walls: Literal["box", "floor", "none"] = "box"

    def __post_init__(self) -> None:
        check_units(self.units)
        for name in ("gravity", "depth", "time_step"):
            check_positive(name, getattr(self, name))
        check_friction(self.friction)
        check_choice("walls", self.walls, WALLS)


Options = SdfOptions

LOSES = (
    "Polygons are cut into triangles, and vertices have nine significant digits.",
    "Drake takes gravity for 9.81 along -z and the time step from its caller, whatever the file says.",
    "PyBullet puts inertias of its own in place of the file's, and a margin around every shape.",
    "Periodic axes become walls.",
    "Where grains have frictions of their own, their mean stands for all, and for the walls.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".sdf", options: SdfOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the world and its meshes: ``{"bed.sdf": …, "bed-meshes/g000000.obj": …, …}``.

    Model ``g000007`` is grain 7, and its frame is the grain's own. Where grains have classes, a model's visual is
    named after its own, ``class_2``.

    Raises
    ------
    InputError
        If the packing is empty or not finite, or the name is not one word.
    """
    check_word(name)
    options = options or SdfOptions()
    sizes = bodies(packing)
    scales = chosen_units(options.units, sizes.volumes, packing.densities, options.gravity)
    cut = triangles(packing.grains)
    names = grain_names(packing)
    meshes = {f"{name}-meshes/{grain}.obj": _mesh(packing, cut, i, scales) for i, grain in enumerate(names)}
    return {f"{name}{suffix}": _world(packing, sizes, scales, options=options, name=name), **meshes}


def factors(packing: Packing, options: SdfOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI: lengths in m, masses in kg, times in s."""
    return factors_of(chosen_units(options.units, bodies(packing).volumes, packing.densities, options.gravity))


def _world(packing: Packing, sizes: Bodies, scales: GrainUnits, *, options: SdfOptions, name: str) -> Iterator[bytes]:
    """Yield the world: gravity, the container, and one model a grain."""
    ends = world_bounds(packing)
    d = float(np.median(sizes.diameters))
    law = springs(sizes, options.depth * sizes.diameters, height(packing, ends), options.gravity, steps=20)
    surface = _SURFACE.format(
        f"{one_friction(packing, options.friction):.9g}", f"{law.stiffness / scales.force * scales.length:.9g}"
    )
    yield _HEADER.substitute(
        name=name,
        n_grains=len(packing),
        length=f"{scales.length:.14g}",
        mass=f"{scales.mass:.14g}",
        time=f"{scales.time:.14g}",
        gravity=rows_of_text(options.gravity / scales.acceleration * down(packing), [3])[0],
        time_step=f"{options.time_step * np.sqrt(d / options.gravity) / scales.time:.9g}",
    ).encode()
    yield _container(walls(packing, ends, options.walls), 2 * d, scales, surface).encode()
    for rows, part in parts(packing):
        yield _models(part, sizes, scales, rows, surface=surface, folder=f"{name}-meshes").encode()
    yield b"  </world>\n</sdf>\n"


def _container(container: Walls, thickness: float, scales: GrainUnits, surface: str) -> str:
    """Return the static model of the walls: boxes behind them, since many planes beside many bodies break Drake."""
    if not container.names:
        return ""
    middles = container.centres - thickness / 2 * container.normals
    rows = zip(
        container.names,
        _poses(middles / scales.length, container.quaternions),
        table_of_text(np.pad(2 * container.halves, ((0, 0), (0, 1)), constant_values=thickness) / scales.length),
        [surface] * len(container.names),
        strict=True,
    )
    return _CONTAINER % "".join([_WALL % row for row in rows])


def _models(part: Packing, sizes: Bodies, scales: GrainUnits, rows: slice, *, surface: str, folder: str) -> str:
    """Return a stretch of grains."""
    names = [f"g{grain:06d}" for grain in range(rows.start, rows.stop)]
    paths = [f"{folder}/{name}.obj" for name in names]
    colours = [" ".join(f"{part:g}" for part in rgb) for rgb in GRAIN_COLOURS.values()]
    own = [colours[shade] for shade in shades(rows.stop)[rows]]
    # Noise around zero is not written as numbers of its own.
    centroids = (sizes.centroids[rows] / sizes.diameters[rows, None]).round(12) * sizes.diameters[rows, None]
    moments = sizes.moments[rows] / scales.inertia
    texts = zip(
        names,
        _poses(part.positions / scales.length, part.quaternions),
        _poses(centroids / scales.length, sizes.axes[rows]),
        table_of_text(sizes.masses[rows, None] / scales.mass, digits=12),
        *(table_of_text(moments[:, axis : axis + 1], digits=12) for axis in range(3)),
        paths,
        [surface] * len(names),
        # Drake warns of every element that it does not know, but tells geometries by their names.
        class_texts(part, "class_%d") if part.classes is not None else ["look"] * len(names),
        paths,
        own,
        own,
        strict=True,
    )
    return "".join([_MODEL % row for row in texts])


def _poses(places: Floats, quaternions: Floats) -> list[str]:
    """Return poses as SDFormat has them: x, y, z, then roll, pitch and yaw about fixed axes, in that order."""
    m = to_matrices(quaternions)
    level = np.hypot(m[:, 0, 0], m[:, 1, 0])
    pitch = np.arctan2(-m[:, 2, 0], level)
    # Where x points up or down, roll and yaw are about one axis: all of it is roll.
    is_upright = level < 1e-9
    yaw = np.where(is_upright, 0.0, np.arctan2(m[:, 1, 0], m[:, 0, 0]))
    roll = np.where(is_upright, np.arctan2(-m[:, 1, 2], m[:, 1, 1]), np.arctan2(m[:, 2, 1], m[:, 2, 2]))
    return table_of_text(np.column_stack([places, roll.round(15), pitch.round(15), yaw.round(15)]), digits=14)


def _mesh(packing: Packing, cut: Triangles, grain: int, scales: GrainUnits) -> Iterator[bytes]:
    """Yield the OBJ of a grain in its own frame, made when it is written."""
    # Adding zero makes minus zero zero.
    vertices = packing.grains.vertices_of(grain) / scales.length + 0.0
    faces = cut.indices[cut.offsets[grain] : cut.offsets[grain + 1]] + 1
    pattern = "v %.9g %.9g %.9g\n" * len(vertices) + "f %d %d %d\n" * len(faces)
    yield (pattern % (*vertices.ravel().tolist(), *faces.ravel().tolist())).encode()
