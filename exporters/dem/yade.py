"""Yade: a script that builds the scene, and the grains beside it as arrays of NumPy. Yade has no file format."""

from __future__ import annotations

import io
from dataclasses import dataclass
from string import Template
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_positive
from exporters.dem.bodies import bodies
from exporters.dem.scene import WALLS, check_word, down, height, walls
from exporters.text import rows_of_text
from grainsdem.geometry.rotations import to_matrices, world_vertices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies
    from grainsdem.model import Packing

_SCRIPT = Template('''\
"""$name: $n_grains grains in SI, body 7 is grain 7; the walls come after them.

yade $name.py               shows the scene, ready to run $steps steps
yade -n -x $name.py         builds it and ends

Run it in its own folder: $name.npz is looked for there.
"""
import numpy
from yade import polyhedra_utils

bed = numpy.load("$name.npz")


def material(density):
    """Return the material of a density; kn is half of young and in N/m3."""
    made = PolyhedraMat()
    made.density = float(density)
    made.young = $young
    made.poisson = 0.3
    made.frictionAngle = $friction_angle
    return made


materials = {density: material(density) for density in numpy.unique(bed["densities"])}
vertices = numpy.split(bed["vertices"], bed["vertex_offsets"][1:-1])
for points, centre, mass, density in zip(vertices, bed["centres"], bed["masses"], bed["densities"]):
    # Vertices stand about the centre of mass, along the world's axes.
    body = polyhedra_utils.polyhedra(materials[density], v=[Vector3(*map(float, point)) for point in points])
    body.state.pos = Vector3(*map(float, centre))
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


@dataclass(frozen=True, slots=True, kw_only=True)
class YadeOptions:
    """What the simulation that the script describes is like.

    Parameters
    ----------
    friction : float
        Coefficient of friction [1], among grains and with walls.
    damping : float
        Part of every force that is taken away from motion, at least 0 and below 1.
    gravity : float
        Acceleration [m/s²].
    depth : float
        Overlap of a grain that has fallen from the top of the bed onto a face, in median diameters. The stiffness and
        the time step follow from it: a tenth of the depth takes three times the steps.
    duration : float
        Time to simulate, in units of √(d/g), d being the median diameter.
    walls : {"box", "floor", "none"}
        Container from the packing's domain. There is no lid.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float = 0.5
    damping: float = 0.3
    gravity: float = 9.81
    depth: float = 0.05
    duration: float = 20.0
    walls: Literal["box", "floor", "none"] = "box"

    def __post_init__(self) -> None:
        for name in ("gravity", "depth", "duration"):
            check_positive(name, getattr(self, name))
        for name in ("friction", "damping"):
            check_positive(name, getattr(self, name), or_zero=True)
        check_choice("walls", self.walls, WALLS)


Options = YadeOptions

LOSES = (
    "Faces are those of the vertices' convex hull, which Yade finds itself, as it does principal axes.",
    "Periodic axes become walls.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".py", options: YadeOptions | None = None
) -> dict[str, bytes]:
    """Return the script and its arrays: ``{"bed.py": …, "bed.npz": …}``.

    Body 7 is grain 7, with its own mass and inertia. The arrays also hold ids, and each grain's pose in the packing.

    Raises
    ------
    InputError
        If the packing is empty or not finite, or the name is not one word.
    """
    check_word(name)
    options = options or YadeOptions()
    sizes = bodies(packing)
    return {
        f"{name}{suffix}": _script(packing, sizes, options, name).encode(),
        f"{name}.npz": _arrays(packing, sizes, options),
    }


def _script(packing: Packing, sizes: Bodies, options: YadeOptions, name: str) -> str:
    """Return the script."""
    d = float(np.median(sizes.diameters))
    drop = height(packing, world_vertices(packing))
    # Force is half of young times the volume of the overlap: on a face of 0.2 d², a grain that falls loses m g h over
    # the depth. The step is a tenth of √(m/k) of the lightest grain, with all of a median grain's section in contact.
    face = 0.2 * d**2
    young = 4 * float(sizes.masses.max()) * options.gravity * drop / (face * (options.depth * d) ** 2)
    time_step = 0.1 * float(np.sqrt(sizes.masses.min() / (young / 2 * np.pi / 4 * d**2)))
    return _SCRIPT.substitute(
        name=name,
        n_grains=len(packing),
        steps=round(options.duration * np.sqrt(d / options.gravity) / time_step),
        young=f"{young:.9g}",
        friction_angle=f"{np.arctan(options.friction):.9g}",
        reach=f"{0.05 * d:.9g}",
        damping=f"{options.damping:.9g}",
        gravity=rows_of_text(options.gravity * down(packing), [3])[0].replace(" ", ", "),
        time_step=f"{time_step:.9g}",
    )


def _arrays(packing: Packing, sizes: Bodies, options: YadeOptions) -> bytes:
    """Return the grains and the walls as one file of arrays; NumPy writes the same bytes for the same arrays."""
    grains = packing.grains
    counts = np.diff(grains.vertex_offsets)
    about = grains.vertices - np.repeat(sizes.centroids, counts, axis=0)
    turned: NDArray[np.float64] = np.einsum(
        "nij,nj->ni", np.repeat(to_matrices(packing.quaternions), counts, axis=0), about
    )
    container = walls(packing, world_vertices(packing), options.walls)
    file = io.BytesIO()
    np.savez(
        file,
        ids=np.arange(len(packing)),
        vertices=turned,
        vertex_offsets=grains.vertex_offsets,
        centres=sizes.centres,
        masses=sizes.masses,
        densities=packing.densities,
        positions=packing.positions,
        quaternions=packing.quaternions,
        walls=container.plates(float(np.median(sizes.diameters))),
        wall_names=np.array(container.names, dtype="U16"),
    )
    return file.getvalue()
