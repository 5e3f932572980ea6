"""The grains in a file for MuJoCo: a mesh and a free body each, written a stretch at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exporters.check import class_texts, grain_names, measured, refuse, stretches
from exporters.container import GRAIN_COLOURS, colours_of, shades
from exporters.mjcf.surfaces import surfaces
from exporters.rest import rest_of
from exporters.text import rows_of_text, table_of_text
from exporters.units import chosen_units
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.triangles import triangles
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from exporters.mjcf.options import MjcfOptions
    from exporters.mjcf.surfaces import Surfaces
    from exporters.units import GrainUnits
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PLAIN = "grain"
"""Material of grains that have colours of their own."""

_CLASS = """\
    <default class="%sgrain">
      <geom type="%s" condim="%d" friction="%s" %s/>
    </default>
"""
_MATERIAL = '    <material name="%s%s" rgba="%g %g %g 1" specular="0.18" shininess="0.25"/>\n'
_MESH = '    <mesh name="%s" vertex="%s" face="%s"/>'
_FREE = '<freejoint name="%s"/>'
_PLANAR = (
    '<joint name="%s_x" type="slide" axis="1 0 0"/><joint name="%s_y" type="slide" axis="0 1 0"/>'
    '<joint name="%s_turn" type="hinge" axis="0 0 1"/>'
)
_BODY = """\
    <body name="%s" pos="%s" quat="%s" childclass="%sgrain"%s>%s
      <inertial pos="%s" quat="%s" mass="%s" diaginertia="%s"/><geom name="%s" %s %s%s/>
    </body>"""


@dataclass(frozen=True, slots=True, eq=False)
class Bed:
    """Grains ready to be written.

    Parameters
    ----------
    packing : Packing
        The grains in SI.
    scales : GrainUnits
        Factors from the file's units to SI.
    diameter : float
        Median diameter of the spheres of equal volume, in the file's units.
    masses : ndarray, shape (n,)
        Masses in the file's units.
    moments, axes : ndarray, shapes (n, 3) and (n, 4)
        Principal moments of inertia in the file's units, and the rotations to their axes.
    centres : ndarray, shape (n, 3)
        Centres of mass in the grains' frames, in the file's units.
    surfaces : Surfaces
        Friction of grains and walls.
    prefix : str
        What every name begins with.
    radii : ndarray, shape (n,), optional
        Radii in the file's units, where the grains are spheres.
    colours : ndarray, shape (n, 3), optional
        Colours of the grains, where they are not those of minerals.
    """

    packing: Packing
    scales: GrainUnits
    diameter: float
    masses: Floats
    moments: Floats
    axes: Floats
    centres: Floats
    surfaces: Surfaces
    prefix: str = ""
    radii: Floats | None = None
    colours: Floats | None = None


def measure(packing: Packing, options: MjcfOptions) -> Bed:
    """Return a packing ready to be written.

    Raises
    ------
    InputError
        If the packing is empty, holds numbers that are not finite, or grains too small for MuJoCo.
    """
    integrals = measured(packing)
    scales = chosen_units(options.units, integrals.volumes, packing.densities, options.gravity)
    density = packing.densities / scales.density
    masses = density * integrals.volumes / scales.length**3
    diameter = float(np.median(cube_roots(integrals.volumes * (6.0 / np.pi)))) / scales.length
    rest = rest_of(packing)
    if options.shapes == "spheres" or (options.shapes is None and rest is not None and rest.are_spheres):
        radii = _radii(packing, integrals.volumes) / scales.length
        moments = np.repeat(((0.5 if packing.domain.is_planar else 0.4) * masses * radii**2)[:, None], 3, axis=1)
        axes = np.tile([1.0, 0.0, 0.0, 0.0], (len(packing), 1))
    else:
        radii = None
        # Principal axes, smallest first: MuJoCo has its meshes' largest first. With the full tensor it finds axes
        # within 1e-6 of a mesh's, then takes the one frame for the other and turns the grain by as much.
        moments, axes = principal_inertia(integrals.inertias * (density / scales.length**5)[:, None, None])
    _refuse_massless(masses, moments, options)
    # 12 decimals of a diameter: rounding noise around zero is not written as numbers of its own.
    centres = (integrals.centroids / (scales.length * diameter)).round(12) * diameter
    is_mineral = isinstance(options.colour, str) and options.colour == "mineral"
    colours = None if is_mineral else colours_of(packing, integrals.volumes, options.colour)
    rough = surfaces(packing, options, diameter)
    return Bed(packing, scales, diameter, masses, moments, axes, centres, rough, options.prefix, radii, colours)


def _radii(packing: Packing, volumes: Floats) -> Floats:
    """Return the radii [m] of spheres of equal volume, or in planar beds of discs of equal area, shape (n,)."""
    if packing.domain.is_planar:
        thickness = float(packing.domain.upper[2] - packing.domain.lower[2])
        return np.sqrt(volumes / (np.pi * thickness))
    return cube_roots(volumes * (0.75 / np.pi))


def _refuse_massless(masses: Floats, moments: Floats, options: MjcfOptions) -> None:
    """Raise `InputError` where a mass or moment of a moving body lies below MuJoCo's floor."""
    too_small = (masses < 1e-15) | (moments[:, 0] < 1e-15)
    if options.units == "grain":
        refuse("grains must not be so small beside the median that MuJoCo takes them for massless", too_small)
    refuse(
        f"grains must not be so small in units of {options.units} that MuJoCo takes them for massless, as they are not "
        "with units='grain'",
        too_small,
    )


def shapes(bed: Bed) -> Iterator[str]:
    """Yield the meshes, about each grain's own origin: MuJoCo keeps vertices in single precision."""
    if bed.radii is not None:
        return
    names = _names(bed)
    for first, part in stretches(bed.packing):
        grains, faces = part.grains, triangles(part.grains)
        vertices = (grains.vertices / (bed.scales.length * bed.diameter)).round(12) * bed.diameter
        rows = zip(
            names[first : first + len(part)],
            rows_of_text(vertices, 3 * np.diff(grains.vertex_offsets)),
            rows_of_text(faces.indices, 3 * np.diff(faces.offsets)),
            strict=True,
        )
        yield "".join([f"{_MESH}\n" % row for row in rows])


def bodies(bed: Bed) -> Iterator[str]:
    """Yield the free bodies: pose, exact mass and inertia, and shape of each grain."""
    packing, length = bed.packing, bed.scales.length
    # As many digits as it takes to place every grain to 1e-9 d, however wide the bed.
    widest = max(np.abs(packing.positions).max() / (length * bed.diameter), 1.0)
    digits = min(9 + max(0, int(np.ceil(np.log10(widest)))), 17)
    joint = _PLANAR if packing.domain.is_planar else _FREE
    all_names, looks = _names(bed), _looks(bed)
    for first, part in stretches(packing):
        last = first + len(part)
        names = all_names[first:last]
        positions = (part.positions / (length * bed.diameter)).round(9) * bed.diameter
        rows = zip(
            names,
            table_of_text(positions, digits=digits),
            table_of_text(part.quaternions, digits=12),
            [bed.prefix] * len(part),
            class_texts(part, ' user="%d"'),
            [joint % ((name,) * joint.count("%s")) for name in names],
            table_of_text(bed.centres[first:last]),
            table_of_text(bed.axes[first:last].round(15), digits=12),
            table_of_text(bed.masses[first:last, None]),
            table_of_text(bed.moments[first:last]),
            names,
            _kinds(bed, names, first, last),
            looks[first:last],
            bed.surfaces.of_grains(first, last),
            strict=True,
        )
        yield "".join([f"{_BODY}\n" % row for row in rows])


def grain_class(bed: Bed, contact: str) -> str:
    """Return the class of the grains' shapes, with the stiffness and damping of their contacts."""
    shape = "mesh" if bed.radii is None else "sphere"
    rough = bed.surfaces.of_all_grains()
    return _CLASS % (bed.prefix, shape, rough.condim, rough.friction, contact)


def grain_materials(bed: Bed) -> str:
    """Return how grains look."""
    materials = GRAIN_COLOURS if bed.colours is None else {PLAIN: (0.9, 0.9, 0.9)}
    return "".join(_MATERIAL % (bed.prefix, name, *rgb) for name, rgb in materials.items())


def _names(bed: Bed) -> list[str]:
    """Return the names of the grains."""
    return [bed.prefix + name for name in grain_names(bed.packing)]


def _kinds(bed: Bed, names: list[str], first: int, last: int) -> list[str]:
    """Return the attributes that say what shape each grain has."""
    if bed.radii is None:
        return [f'mesh="{name}"' for name in names]
    rows = zip(table_of_text(bed.radii[first:last, None]), table_of_text(bed.centres[first:last]), strict=True)
    return [f'size="{radius}" pos="{centre}"' for radius, centre in rows]


def _looks(bed: Bed) -> list[str]:
    """Return the attributes that say how each grain looks."""
    if bed.colours is None:
        minerals = [f'material="{bed.prefix}{name}"' for name in GRAIN_COLOURS]
        return [minerals[shade] for shade in shades(len(bed.packing)).tolist()]
    return [f'material="{bed.prefix}{PLAIN}" rgba="{rgb} 1"' for rgb in table_of_text(bed.colours, digits=4)]
