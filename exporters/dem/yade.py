"""Yade: a script that builds the scene, and the grains beside it as arrays of NumPy. Yade has no file format.

In grain units (`exporters.units`) unless SI is asked for: Yade's own tolerances are lengths and areas, and blur the
normals of contacts between grains of a millimetre.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from string import Template
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.check import check_choice, check_positive, refuse
from exporters.container import world_bounds
from exporters.dem.bodies import bodies, parts, vertices_in
from exporters.dem.options import WALLS, check_friction
from exporters.dem.scene import check_word, height, walls
from exporters.rest import down, one_friction
from exporters.text import rows_of_text
from exporters.units import check_units, chosen_units, factors_of

if TYPE_CHECKING:
    from exporters.dem.bodies import Bodies
    from exporters.units import GrainUnits, Units
    from grainsdem.model import Packing

_SCRIPT = Template('''\
"""$name: $n_grains grains, body 7 is grain 7; the walls come after them.

Length 1 = $length m, mass 1 = $mass kg, time 1 = $time s.

yade $name.py               shows the scene, ready to run $steps steps
yade -n -x $name.py         builds it and ends

It may be run from any folder: $name.npz is looked for beside it.
"""
import inspect
import os

import numpy
from yade import polyhedra_utils

# In Yade __file__ is Yade's own.
folder = os.path.dirname(inspect.currentframe().f_code.co_filename)
bed = numpy.load(os.path.join(folder, "$name.npz"))$cell


def material(density):
    """Return the material of a density; a contact has half of young, a force over a volume."""
    made = PolyhedraMat()
    made.density = float(density)
    made.young = $young
    made.poisson = 0.3
    made.frictionAngle = $friction_angle
    return made


materials = {density: material(density) for density in numpy.unique(bed["densities"])}
vertices = numpy.split(bed["vertices"], bed["vertex_offsets"][1:-1])
for grain, points in enumerate(vertices):
    mass, density = bed["masses"][grain], bed["densities"][grain]
    w, x, y, z = map(float, bed["orientations"][grain])
    # Vertices stand about the centre of mass, along principal axes: below a millimetre Yade does not find those.
    body = polyhedra_utils.polyhedra(materials[density], v=[Vector3(*map(float, point)) for point in points])
    body.state.pos = Vector3(*map(float, bed["centres"][grain]))
    body.state.ori = Quaternion(w, x, y, z) * body.state.ori
    body.state.inertia = body.state.inertia * (float(mass) / body.state.mass)
    body.state.mass = float(mass)
    O.bodies.append(body)
for corners in bed["walls"]:
    points = [Vector3(*map(float, point)) for point in corners]
    stuff = materials[bed["densities"][0]]
    plate = polyhedra_utils.polyhedra(stuff, v=points, mask=3, fixed=True, color=(0.6, 0.6, 0.6))
    plate.shape.wire = True
    O.bodies.append(plate)

O.engines = [
    ForceResetter(),
    # Walls are of mask 2, and do not meet each other.
    InsertionSortCollider([Bo1_Polyhedra_Aabb()], verletDist=$reach, avoidSelfInteractionMask=2),
    InteractionLoop(
        [Ig2_Polyhedra_Polyhedra_PolyhedraGeom()],
        [Ip2_PolyhedraMat_PolyhedraMat_PolyhedraPhys()],
        [Law2_PolyhedraGeom_PolyhedraPhys_Volumetric()],
    ),
    NewtonIntegrator(damping=$damping, exactAsphericalRot=True, gravity=($gravity)),
]
O.dt = $time_step
O.stopAtIter = $steps
''')


# Yade's cell is periodic along all axes, and begins at the origin.
_CELL = "\nO.periodic = True\nO.cell.setBox({:.14g}, {:.14g}, {:.14g})"


@dataclass(frozen=True, slots=True, kw_only=True)
class YadeOptions:
    """What the simulation that the script describes is like.

    Parameters
    ----------
    units : {"grain", "si", "mm"} or float
        Grain units, where the median diameter, the density and gravity are one; SI; or the millimetre or so many
        metres for lengths, with masses in kg and times in s.
    friction : float, optional
        Coefficient of friction [1], among grains and with walls; that which the grains came to rest with by
        default, else 0.5.
    damping : float
        Part of every force that is taken away from motion, at least 0 and below 1.
    gravity : float
        Acceleration [m/s²].
    depth : float
        Overlap of a grain that has fallen from the top of the bed onto a face, in median diameters; corners go a few
        times as deep. The stiffness and the time step follow from it: a tenth of the depth takes ten times the steps.
    duration : float
        Time to simulate, in units of √(d/g), d being the median diameter.
    walls : {"box", "floor", "none"}
        Container from the packing's domain. There is no lid.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    units: Units = "grain"
    friction: float | None = None
    damping: float = 0.3
    gravity: float = 9.81
    depth: float = 0.05
    duration: float = 20.0
    walls: Literal["box", "floor", "none"] = "box"

    def __post_init__(self) -> None:
        for name in ("gravity", "depth", "duration"):
            check_positive(name, getattr(self, name))
        check_friction(self.friction)
        check_positive("damping", self.damping, or_zero=True)
        check_units(self.units)
        check_choice("walls", self.walls, WALLS)


Options = YadeOptions

LOSES = (
    "Faces are those of the vertices' convex hull, which Yade finds itself.",
    "A bed that is periodic along all axes is moved to the origin; where only some are, they become walls.",
    "Where grains have frictions of their own, their mean stands for all, and for the walls.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".py", options: YadeOptions | None = None
) -> dict[str, bytes]:
    """Return the script and its arrays: ``{"bed.py": …, "bed.npz": …}``.

    Body 7 is grain 7, with its own mass and inertia. The arrays also hold ids, each grain's pose in the packing, and
    its class where grains have classes: ``bed["classes"][body.id]``.

    Raises
    ------
    InputError
        If the packing is empty or not finite, a grain is wider than half the domain where all axes are periodic, or the
        name is not one word.
    """
    check_word(name)
    options = options or YadeOptions()
    sizes = bodies(packing)
    scales = chosen_units(options.units, sizes.volumes, packing.densities, options.gravity)
    return {
        f"{name}{suffix}": _script(packing, sizes, scales, options, name).encode(),
        f"{name}.npz": _arrays(packing, sizes, scales, options),
    }


def factors(packing: Packing, options: YadeOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI: lengths in m, masses in kg, times in s."""
    return factors_of(chosen_units(options.units, bodies(packing).volumes, packing.densities, options.gravity))


def _script(packing: Packing, sizes: Bodies, scales: GrainUnits, options: YadeOptions, name: str) -> str:
    """Return the script."""
    d = float(np.median(sizes.diameters))
    drop = height(packing, world_bounds(packing))
    # Force is half of young times the volume of the overlap: on a face of 0.2 d², a grain that falls loses m g h over
    # the depth. The step is a tenth of √(m/k) of the lightest grain, with all of a median grain's section in contact.
    face = 0.2 * d**2
    young = 4 * float(sizes.masses.max()) * options.gravity * drop / (face * (options.depth * d) ** 2)
    time_step = 0.1 * float(np.sqrt(sizes.masses.min() / (young / 2 * np.pi / 4 * d**2)))
    return _SCRIPT.substitute(
        {key: f"{getattr(scales, key):.14g}" for key in ("length", "mass", "time")},
        name=name,
        n_grains=len(packing),
        steps=round(options.duration * np.sqrt(d / options.gravity) / time_step),
        young=f"{young / scales.force * scales.length**3:.9g}",
        friction_angle=f"{np.arctan(one_friction(packing, options.friction)):.9g}",
        reach=f"{0.05 * d / scales.length:.9g}",
        damping=f"{options.damping:.9g}",
        gravity=rows_of_text(options.gravity / scales.acceleration * down(packing), [3])[0].replace(" ", ", "),
        time_step=f"{time_step / scales.time:.9g}",
        cell=_CELL.format(*(packing.domain.lengths / scales.length).tolist()) if packing.domain.periodic.all() else "",
    )


def _arrays(packing: Packing, sizes: Bodies, scales: GrainUnits, options: YadeOptions) -> bytes:
    """Return the grains and the walls as one file of arrays; NumPy writes the same bytes for the same arrays."""
    vertices, offsets = np.empty_like(packing.grains.vertices), packing.grains.vertex_offsets
    for rows, part in parts(packing):
        frames = (sizes.centroids[rows], sizes.axes[rows], sizes.diameters[rows])
        vertices[offsets[rows.start] : offsets[rows.stop]] = vertices_in(part.grains, *frames)
    wraps = bool(packing.domain.periodic.all())
    if wraps:
        reach = np.sqrt(np.maximum.reduceat((vertices**2).sum(axis=1), offsets[:-1]))
        half = packing.domain.lengths.min() / 2
        refuse("grains must be narrower than half the periodic domain, or Yade stops", 2.1 * reach > half)
    container = walls(packing, world_bounds(packing), "none" if wraps else options.walls)
    vertices /= scales.length
    arrays: dict[str, Any] = {
        "ids": np.arange(len(packing)),
        "vertices": vertices,
        "vertex_offsets": offsets,
        "centres": (sizes.centres - packing.domain.lower * wraps) / scales.length,
        "orientations": sizes.orientations,
        "masses": sizes.masses / scales.mass,
        "densities": packing.densities / scales.density,
        "positions": packing.positions / scales.length,
        "quaternions": packing.quaternions,
        "walls": container.plates(2 * float(np.median(sizes.diameters))) / scales.length,
        "wall_names": np.array(container.names, dtype="U16"),
        "units": np.array([scales.length, scales.mass, scales.time]),
    }
    if packing.classes is not None:
        arrays["classes"] = packing.classes
    file = io.BytesIO()
    np.savez(file, **arrays)
    return file.getvalue()
