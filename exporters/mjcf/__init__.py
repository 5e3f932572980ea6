"""MuJoCo's MJCF: every grain a free body with a convex mesh, the container, and the settings that suit them.

The text is in grain units (`exporters.units`): lengths in median grain diameters, density and gravity one.
MuJoCo refuses bodies whose inertia is below 1e-15, which quartz in SI is under about 0.45 mm. The factors
back to SI stand in the file's ``<custom>`` element and in a comment.
"""

from __future__ import annotations

from dataclasses import dataclass
from string import Template
from typing import TYPE_CHECKING, Literal
from xml.sax.saxutils import quoteattr

import numpy as np

from exporters.check import check_choice, check_name, check_positive, grain_names, measured, refuse
from exporters.container import GRAIN_COLOURS, container_box, plane_frames, shades
from exporters.text import rows_of_text, table_of_text
from exporters.units import GrainUnits, units, units_of
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import triangles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Domain, Packing

    Floats = NDArray[np.float64]

__all__ = ["GrainUnits", "MjcfOptions", "files", "text", "units"]

_ITERATIONS = {"PGS": 30, "CG": 100, "Newton": 100}

_DOCUMENT = Template("""\
<mujoco model=$name>
  <!-- $n_grains grains in grain units: length 1 = $length m (median diameter of the spheres of equal volume),
       mass 1 = $mass kg, time 1 = $time s, so density 1 = $density kg/m3 and gravity 1 = $gravity m/s2. -->
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
  <statistic center="$centre" extent="$extent" meansize="1"/>
  <default>
    <geom solref="$solref 1" solimp="0.9 0.95 $width"/>
    <default class="grain">
      <geom type="mesh" condim="$condim" friction="$friction"/>
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
</mujoco>
""")

_MATERIAL = '    <material name="%s" rgba="%g %g %g 1" specular="0.18" shininess="0.25"/>'
_MESH = '    <mesh name="%s" vertex="%s" face="%s"/>'
_WALL = '      <geom name="%s" class="wall" pos="%s" quat="%s" size="%s" material="%s"/>'
_FREE = '<freejoint name="%s"/>'
_PLANAR = (
    '<joint name="%s_x" type="slide" axis="1 0 0"/><joint name="%s_y" type="slide" axis="0 1 0"/>'
    '<joint name="%s_turn" type="hinge" axis="0 0 1"/>'
)
_BODY = """\
    <body name="%s" pos="%s" quat="%s" childclass="grain">%s
      <inertial pos="%s" quat="%s" mass="%s" diaginertia="%s"/><geom name="%s" mesh="%s" material="%s"/>
    </body>"""


@dataclass(frozen=True, slots=True, kw_only=True)
class MjcfOptions:
    """What the simulation that the file describes is like.

    Parameters
    ----------
    friction : float
        Coefficient of friction among grains [1].
    wall_friction : float, optional
        Coefficient of friction between grains and walls [1]; that of the grains by default.
    gravity : float
        Acceleration [m/s²] that is one in the file.
    time_step : float
        Time step in units of √(d/g), d being the median diameter.
    solver : {"PGS", "CG", "Newton"}
        Constraint solver. PGS is the fastest for beds; CG gives more accurate forces.
    iterations : int, optional
        Most iterations of the solver a step: 30 for PGS, else 100 by default.
    tolerance : float
        Relative improvement [1] at which the solver stops.
    impratio : float
        Ratio [1] of frictional to normal stiffness; 10 keeps a bed at rest from creeping.
    noslip_iterations : int
        Iterations that take away the last creep of states to be stored; 0 for none.
    contact_width : float
        Depth, in median diameters, over which a contact reaches its full stiffness.
    walls : {"box", "floor", "none"}
        Container from the packing's domain: floor and four walls, floor only, or nothing. There is no lid. A
        wall of a periodic axis stands where the outermost grain ends: cells reach over periodic boundaries.
    memory : int, optional
        Memory [bytes] that MuJoCo sets aside for contacts; from the number of grains by default.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float = 0.5
    wall_friction: float | None = None
    gravity: float = 9.81
    time_step: float = 0.01
    solver: Literal["PGS", "CG", "Newton"] = "PGS"
    iterations: int | None = None
    tolerance: float = 1e-8
    impratio: float = 10.0
    noslip_iterations: int = 0
    contact_width: float = 1e-3
    walls: Literal["box", "floor", "none"] = "box"
    memory: int | None = None

    def __post_init__(self) -> None:
        for name in ("gravity", "time_step", "impratio", "contact_width"):
            check_positive(name, getattr(self, name))
        for name in ("friction", "tolerance", "noslip_iterations"):
            check_positive(name, getattr(self, name), or_zero=True)
        if self.wall_friction is not None:
            check_positive("wall_friction", self.wall_friction, or_zero=True)
        for name in ("iterations", "memory"):
            if getattr(self, name) is not None:
                check_positive(name, getattr(self, name))
        check_choice("solver", self.solver, _ITERATIONS)
        check_choice("walls", self.walls, ("box", "floor", "none"))


Options = MjcfOptions

LOSES = (
    "Polygons are cut into triangles; MuJoCo keeps vertices in single precision, about each grain's centre.",
    "Periodic axes become walls; MuJoCo has none.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".xml", options: MjcfOptions | None = None
) -> dict[str, bytes]:
    """Return the one file that MuJoCo reads: ``{"bed.xml": …}``; see `text`."""
    check_name(name)
    return {f"{name}{suffix}": text(packing, options, name=name).encode()}


def factors(packing: Packing, options: MjcfOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI: lengths in m, masses in kg, times in s."""
    scales = units(packing, options.gravity)
    return {"length": scales.length, "mass": scales.mass, "time": scales.time}


def text(packing: Packing, options: MjcfOptions | None = None, *, name: str = "bed") -> str:
    """Return the packing as MJCF.

    Parameters
    ----------
    packing : Packing
        Grains to write. Body ``g000007`` is grain 7, and its frame is the grain's own.
    options : MjcfOptions, optional
        Friction, solver, container and the like.
    name : str
        Name of the model.

    Returns
    -------
    str
        A file that MuJoCo 3.17 to 4.x compiles as it stands.

    Raises
    ------
    InputError
        If the packing is empty, holds numbers that are not finite, or grains too small beside the median for
        MuJoCo.
    """
    options = options or MjcfOptions()
    integrals = measured(packing)
    scales = units_of(integrals.volumes, packing.densities, options.gravity)
    world = world_vertices(packing)
    lower, upper = (corner / scales.length for corner in container_box(packing, world))
    world /= scales.length
    # Planes have no end for contacts; walls are drawn as high as the grains, that they neither hide nor shade them.
    drawn = upper if packing.domain.is_planar else np.append(upper[:2], min(upper[2], world[:, 2].max()))
    return _DOCUMENT.substitute(
        _settings(packing, options, scales),
        **_picture(world.min(axis=0), world.max(axis=0), lower),
        name=quoteattr(name),
        materials="\n".join([_MATERIAL % (name, *rgb) for name, rgb in GRAIN_COLOURS.items()]),
        meshes=_meshes(packing, scales),
        container=_container(lower, drawn, options, packing.domain.scaled(1 / scales.length)),
        bodies=_bodies(packing, integrals, scales),
    )


def _settings(packing: Packing, options: MjcfOptions, scales: GrainUnits) -> dict[str, object]:
    """Return what the options and the units fill in."""
    n = len(packing)
    box = np.stack([packing.domain.lower, packing.domain.upper]) / scales.length
    wall_friction = options.friction if options.wall_friction is None else options.wall_friction
    return {
        "n_grains": n,
        "length": repr(scales.length),
        "mass": repr(scales.mass),
        "time": repr(scales.time),
        **dict(zip(("domain_lower", "domain_upper"), rows_of_text(box.ravel(), [3, 3], digits=12), strict=True)),
        "density": f"{scales.density:.9g}",
        "gravity": f"{options.gravity:.9g}",
        "memory": options.memory or _memory(n),
        "time_step": f"{options.time_step:.9g}",
        "down": "0 -1 0" if packing.domain.is_planar else "0 0 -1",
        "impratio": f"{options.impratio:.9g}",
        "solver": options.solver,
        "iterations": options.iterations or _ITERATIONS[options.solver],
        "tolerance": f"{options.tolerance:.9g}",
        "noslip": options.noslip_iterations,
        "solref": f"{2 * options.time_step:.9g}",  # the stiffest that the step can carry
        "width": f"{options.contact_width:.9g}",
        "friction": f"{options.friction:.9g}",
        "wall_friction": f"{wall_friction:.9g}",
        # One dimension: a contact without friction has no tangential rows to solve for.
        "condim": 3 if options.friction > 0 else 1,
        "wall_condim": 3 if wall_friction > 0 else 1,
        # MuJoCo takes the larger friction of a pair unless one has priority.
        "priority": int(wall_friction != options.friction),
    }


def _memory(n_grains: int) -> int:
    """Return the arena [bytes] for a bed of so many grains."""
    # Beds that settle in place use 15 to 40 kB a grain; of what is set aside MuJoCo touches only what it
    # uses.
    return (16 << 20) + n_grains * (256 << 10)


def _picture(lower: Floats, upper: Floats, floor: Floats) -> dict[str, str]:
    """Return camera and light that show the box of the grains, standing on the floor, as a whole."""
    centre = (lower + upper) / 2
    extent = float(np.linalg.norm(upper - lower))
    azimuth, elevation, tangent = np.radians(125.0), np.radians(22.0), np.tan(np.radians(19.0))
    back = -np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), -np.sin(elevation)])
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    eye = centre + back * (0.62 * extent / tangent)
    # Steep, since walls cast shadows although one sees through them.
    sun = centre + np.array([0.2, -0.35, 1.7]) * extent
    sun[2] = max(sun[2], floor[2] + extent)
    rows = [centre, eye, np.append(right, np.cross(back, right)), sun, centre - sun]
    keys = ["centre", "eye", "eye_axes", "sun", "sunlight"]
    texts = rows_of_text(np.concatenate(rows).round(6), [row.size for row in rows])
    return {**dict(zip(keys, texts, strict=True)), "extent": f"{extent:.9g}"}


def _container(lower: Floats, upper: Floats, options: MjcfOptions, domain: Domain) -> str:
    """Return the static body of the floor and the walls; planes have no thickness that a grain could pass."""
    centre, half = (lower + upper) / 2, (upper - lower) / 2
    # Quaternions that turn a plane's z axis inward, with its x axis along the second size.
    s = float(np.sqrt(0.5))
    walls = [
        ("floor", 2, 0, (1.0, 0.0, 0.0, 0.0), (0, 1)),
        ("wall_x0", 0, 0, (s, 0.0, s, 0.0), (2, 1)),
        ("wall_x1", 0, 1, (s, 0.0, -s, 0.0), (2, 1)),
        ("wall_y0", 1, 0, (s, -s, 0.0, 0.0), (0, 2)),
        ("wall_y1", 1, 1, (s, s, 0.0, 0.0), (0, 2)),
    ]
    if domain.is_planar:  # the floor is the lower y wall, and nothing moves along z
        walls = [walls[3], walls[1], walls[2]]
    chosen = {"box": walls, "floor": walls[:1], "none": []}[options.walls]
    lines = []
    for name, axis, side, quaternion, (a, b) in chosen:
        place = centre.copy()
        place[axis] = (lower, upper)[side][axis]
        numbers = [*place.round(9), *quaternion, half[a], half[b], 1.0]
        at, turn, size = rows_of_text(np.array(numbers), [3, 4, 3])
        lines.append(_WALL % (name, at, turn, size, "floor" if name == "floor" else "wall"))
    if options.walls == "box":
        for k, (point, rotation) in enumerate(zip(*plane_frames(domain), strict=True)):
            # Drawn a quarter of the box wide: contacts see planes without end.
            numbers = [*point.round(9), *rotation, half.max() / 4, half[2], 1.0]
            lines.append(_WALL % (f"wall_p{k}", *rows_of_text(np.array(numbers), [3, 4, 3]), "wall"))
    return "\n".join(['    <body name="container">', *lines, "    </body>"]) if lines else ""


def _meshes(packing: Packing, scales: GrainUnits) -> str:
    """Return the shapes, about each grain's own origin: MuJoCo keeps vertices in single precision."""
    grains = packing.grains
    faces = triangles(grains)
    # 12 decimals of a diameter: rounding noise around zero is not written as numbers of its own.
    vertices = rows_of_text((grains.vertices / scales.length).round(12), 3 * np.diff(grains.vertex_offsets))
    corners = rows_of_text(faces.indices, 3 * np.diff(faces.offsets))
    rows = zip(grain_names(packing), vertices, corners, strict=True)
    return "\n".join([_MESH % row for row in rows])


def _bodies(packing: Packing, integrals: Integrals, scales: GrainUnits) -> str:
    """Return the free bodies: pose, exact mass and inertia, and shape of each grain."""
    density = packing.densities / scales.density
    masses = density * integrals.volumes / scales.length**3
    tensors = integrals.inertias * (density / scales.length**5)[:, None, None]
    # Principal axes, smallest first: MuJoCo has its meshes' largest first. With the full tensor it finds axes within
    # 1e-6 of a mesh's, then takes the one frame for the other and turns the grain by as much.
    moments, axes = principal_inertia(tensors)
    # MuJoCo's floor for masses and moments of moving bodies.
    too_small = (masses < 1e-15) | (moments[:, 0] < 1e-15)
    refuse("grains must not be so small beside the median that MuJoCo takes them for massless", too_small)
    positions = packing.positions / scales.length
    # As many digits as it takes to place every grain to 1e-9 d, however wide the bed.
    digits = 9 + max(0, int(np.ceil(np.log10(max(np.abs(positions).max(), 1.0)))))
    names = grain_names(packing)
    joint = _PLANAR if packing.domain.is_planar else _FREE
    colours = list(GRAIN_COLOURS)
    rows = zip(
        names,
        table_of_text(positions.round(9), digits=min(digits, 17)),
        table_of_text(packing.quaternions, digits=12),
        [joint % ((name,) * joint.count("%s")) for name in names],
        table_of_text((integrals.centroids / scales.length).round(12)),
        table_of_text(axes.round(15), digits=12),
        table_of_text(masses[:, None]),
        table_of_text(moments),
        names,
        names,
        [colours[shade] for shade in shades(len(names))],
        strict=True,
    )
    return "\n".join([_BODY % row for row in rows])
