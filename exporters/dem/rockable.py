"""Rockable and exaDEM: a configuration, and a library of sphero-polyhedra with one shape a grain."""

from __future__ import annotations

from itertools import pairwise
from string import Template
from typing import TYPE_CHECKING

import numpy as np

from exporters.check import grain_names
from exporters.container import world_bounds
from exporters.dem.bodies import (
    bodies,
    kinds_of,
    parts,
    report,
    rounded_parts,
    rounding_comment,
    skin,
    vertices_in,
)
from exporters.dem.options import SkinOptions
from exporters.dem.scene import check_word, height, springs, walls
from exporters.rest import down, one_friction
from exporters.text import filled, rows_of_text, table_of_text

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies, Rounded, Skin
    from exporters.dem.scene import Walls
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

__all__ = ["LOSES", "Options", "files", "report"]

_HEADER = Template("""\
Rockable 21-08-2022
# $name: $n_grains grains in SI, shape g000007 is grain 7. $rounding
# Run in this file's folder: the library of shapes is looked for there.
${classes}t 0
tmax $duration
dt $time_step
interVerlet $update
interConf $save
DVerlet $far
dVerlet $near
AddOrRemoveInteractions OBBtree
$densities
gravity $gravity
forceLaw Default
$contacts
nDriven $n_walls
shapeFile $name.shp
Particles $n_bodies
""")

_SHAPE = """\
<
name %s
radius %s
preCompDone y
nv %s
%sne %s
%snf %s
%sobb.extent %s
obb.e1 1 0 0
obb.e2 0 1 0
obb.e3 0 0 1
obb.center %s
volume %s
I/m %s
>
"""


Options = SkinOptions

LOSES = (
    "Edges are rounded: each grain is its faces moved inward and a sphere swept over the rest, inside what it was.",
    "Where densities differ, one stands for all, and the volume of a shape is its mass over that.",
    "Periodic axes become walls.",
    "Where grains have frictions of their own, their mean stands for all, and for the walls.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".conf", options: SkinOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the configuration and the library of shapes beside it: ``{"bed.conf": …, "bed.shp": …}``.

    Shape ``g000007`` is grain 7, about its centre of mass and along its principal axes; masses and inertias are those
    of the sharp grains. Walls are of group 0, grains of group 1, or of one a class, from the lowest on.

    Raises
    ------
    InputError
        If the packing is empty or not finite, a grain vanishes by the rounding, or the name is not one word.
    """
    check_word(name)
    options = options or SkinOptions()
    sizes = bodies(packing)
    found = skin(packing, sizes, options)
    container = walls(packing, world_bounds(packing), options.walls)
    return {
        f"{name}{suffix}": _configuration(packing, sizes, found, container, name=name, options=options),
        f"{name}.shp": _library(packing, sizes, found, container, options=options),
    }


def _configuration(
    packing: Packing, sizes: Bodies, found: Skin, container: Walls, *, name: str, options: SkinOptions
) -> Iterator[bytes]:
    """Yield the file of settings and poses, the driven walls first."""
    n, k = len(packing), len(container.names)
    numbers, groups = kinds_of(packing)
    n_groups = max(len(numbers), 1)
    d = float(np.median(sizes.diameters))
    drop = height(packing, world_bounds(packing))
    law = springs(sizes, options.depth * found.radii, drop, options.gravity, steps=50)
    time = float(np.sqrt(d / options.gravity))
    contact = {
        "knContact": law.stiffness,
        "en2Contact": options.restitution**2,
        "ktContact": law.stiffness,
        "muContact": one_friction(packing, options.friction),
        "krContact": 0.0,
        "murContact": 0.0,
    }
    header = _HEADER.substitute(
        name=name,
        n_grains=n,
        rounding=rounding_comment(found, sizes),
        duration=f"{options.duration * time:.9g}",
        time_step=f"{law.time_step:.9g}",
        # The neighbours' list lives for 35 steps: what a grain that fell from the top moves meanwhile is far nearer.
        update=f"{35 * law.time_step:.9g}",
        save=f"{options.duration * time / 100:.9g}",
        far=f"{0.1 * d:.9g}",
        near=f"{0.05 * d:.9g}",
        # exaDEM wants a density for every shape, Rockable for every group.
        densities="\n".join(
            f"density {shape} {packing.densities[0]:.12g}" for shape in range(max(n + k, n_groups + 1))
        ),
        gravity=rows_of_text(options.gravity * down(packing), [3])[0],
        classes=_told(numbers),
        contacts="\n".join(
            f"{key} {a} {b} {value:.9g}"
            for key, value in contact.items()
            for b in range(1, n_groups + 1)
            for a in range(b + 1)
        ),
        n_walls=k,
        n_bodies=n + k,
    )
    yield header.encode()
    # A plate's skin reaches the wall's surface.
    behind = container.centres - _plate_radius(found) * container.normals
    yield _bodies(container.names, [0] * k, behind, container.quaternions)
    names = grain_names(packing)
    for rows, _ in parts(packing):
        yield _bodies(names[rows], groups[rows], sizes.centres[rows], sizes.orientations[rows])


def _plate_radius(found: Skin) -> float:
    """Return the rounding radius [m] of the walls."""
    return float(np.median(found.radii))


def _told(numbers: list[int]) -> str:
    """Return a comment that says which group is which class, or nothing where there are no classes."""
    told = ", ".join(f"group {group} is class {number}" for group, number in enumerate(numbers, 1))
    return f"# {told}\n" if told else ""


def _bodies(names: list[str], groups: list[int], centres: Floats, quaternions: Floats) -> bytes:
    """Return one line a body: shape, group, cluster, scale, pose and derivatives of that, which are zero."""
    places, turns = table_of_text(centres, digits=14), table_of_text(quaternions.round(15), digits=12)
    rows = zip(names, groups, places, turns, strict=True)
    still = "0 0 0 0 0 0"
    return "".join([f"{name} {group} 0 1 {at} {still} {turn} {still}\n" for name, group, at, turn in rows]).encode()


def _library(
    packing: Packing, sizes: Bodies, found: Skin, container: Walls, *, options: SkinOptions
) -> Iterator[bytes]:
    """Yield the shapes: the grains, then the walls as plates with one face."""
    yield b"# sphero-polyhedra in SI, each about its centre of mass and along its principal axes\n"
    for rows, mine, one in rounded_parts(packing, sizes, options):
        yield _shapes(rows.start, mine, one, float(packing.densities[0]))
    radius = _plate_radius(found)
    for name, (a, b) in zip(container.names, container.halves.tolist(), strict=True):
        yield _plate(name, a, b, radius)


def _shapes(first: int, mine: Bodies, one: Rounded, density: float) -> bytes:
    """Return a stretch of grains as shapes; what can be said of them in one form is made in one go."""
    cores = one.cores
    seen = vertices_in(cores, mine.centroids, mine.axes, mine.diameters)
    starts = cores.vertex_offsets[:-1]
    lower, upper = np.minimum.reduceat(seen, starts), np.maximum.reduceat(seen, starts)
    counts = np.diff(cores.face_vertex_offsets)
    corners = rows_of_text(cores.face_vertices, counts)
    faces = [f"{count} {row}\n" for count, row in zip(counts.tolist(), corners, strict=True)]
    rows = zip(
        [f"g{first + grain:06d}" for grain in range(len(cores))],
        table_of_text(one.radii[:, None], digits=12),
        np.diff(cores.vertex_offsets).tolist(),
        filled("%.12g %.12g %.12g\n", seen, np.diff(cores.vertex_offsets)),
        np.diff(one.edges.offsets).tolist(),
        filled("%d %d\n", one.edges.ends, np.diff(one.edges.offsets)),
        np.diff(cores.face_offsets).tolist(),
        ["".join(faces[a:b]) for a, b in pairwise(cores.face_offsets.tolist())],
        table_of_text((upper - lower) / 2 + one.radii[:, None], digits=12),
        table_of_text((upper + lower) / 2, digits=12),
        table_of_text((mine.masses / density)[:, None], digits=14),
        table_of_text(mine.moments / mine.masses[:, None], digits=14),
        strict=True,
    )
    return "".join([_SHAPE % row for row in rows]).encode()


def _plate(name: str, a: float, b: float, radius: float) -> bytes:
    """Return a wall as a rectangle of half lengths [m] with a skin; its volume and inertia are those of a slab."""
    vertices = filled("%.12g %.12g %.12g\n", np.array([-a, -b, 0, a, -b, 0, a, b, 0, -a, b, 0.0]), [4])[0]
    moments = np.array([b * b + radius**2, a * a + radius**2, a * a + b * b]) / 3
    numbers = np.array([a + radius, b + radius, radius, 8 * a * b * radius, *moments])
    extent, volume, inertia = rows_of_text(numbers, [3, 1, 3], digits=12)
    size = f"{radius:.12g}"
    edge = "0 1\n1 2\n2 3\n3 0\n"
    return (_SHAPE % (name, size, 4, vertices, 4, edge, 1, "4 0 1 2 3\n", extent, "0 0 0", volume, inertia)).encode()
