"""Rockable and exaDEM: a configuration, and a library of sphero-polyhedra with one shape a grain."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from string import Template
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from exporters.check import check_choice, checked_coefficients, grain_names, refuse
from exporters.container import world_bounds
from exporters.dem.bodies import (
    Bodies,
    bodies,
    parts,
    report,
    rounded,
    rounded_parts,
    rounding_comment,
    skin,
    vertices_in,
)
from exporters.dem.groups import groups, surfaces
from exporters.dem.options import SkinOptions
from exporters.dem.scene import check_word, height, springs, walls
from exporters.rest import down
from exporters.text import filled, rows_of_text, table_of_text
from grainsdem.packing import subset

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from numpy.typing import NDArray

    from exporters.dem.bodies import Rounded, Skin
    from exporters.dem.groups import Groups, Surfaces
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
AddOrRemoveInteractions $search
$densities
gravity $gravity
forceLaw Default
$contacts
${cell}nDriven $n_walls
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


# How far apart the boxes of two bodies are that are neighbours, in median diameters.
_FAR = 0.1

_CELL = """\
# The cell needs a Rockable that was built with ROCKABLE_ENABLE_PERIODIC: any other has neither cell nor walls.
# It is fixed, begins at the origin, and holds every centre; no gravity, since nothing would stop what falls.
usePeriodicCell 1
h %s 0 0 0 %s 0 0 0 %s
vh 0 0 0 0 0 0 0 0 0
ah 0 0 0 0 0 0 0 0 0
mh 1
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class RockableOptions(SkinOptions):
    """What the simulation is like: the options of `SkinOptions`, and those below.

    Parameters
    ----------
    wall_friction : float, mapping or str, optional
        Coefficient of friction between grains and walls [1], or those of some walls by name, as in
        ``{"floor": 0.6, "wall_x0": 0}`` or ``"floor=0.6,wall_x0=0"``; as the bed came to rest by default, else as among
        grains.
    mixing : {"max", "min"}, optional
        Which of two grains with frictions of their own rules where they touch: the rougher or the smoother. As the bed
        came to rest by default, else the rougher.
    periodic : bool
        Whether a bed that is periodic along all axes has Rockable's periodic cell, without walls and gravity; else
        its axes become walls, as those of a bed do of which only some are periodic.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    wall_friction: float | Mapping[str, float] | str | None = None
    mixing: Literal["max", "min"] | None = None
    periodic: bool = True

    def __post_init__(self) -> None:
        # The fields of a class with slots are those of another class than `super()` looks for.
        SkinOptions.__post_init__(self)
        object.__setattr__(self, "wall_friction", checked_coefficients("wall_friction", self.wall_friction))
        if self.mixing is not None:
            check_choice("mixing", self.mixing, ("max", "min"))


Options = RockableOptions

LOSES = (
    "Edges are rounded: each grain is its faces moved inward and a sphere swept over the rest, inside what it was.",
    "Beyond 100 groups of density and friction all grains have the mean friction.",
    "Beyond 100 densities one stands for all, and the volume of a shape is its mass over that.",
    "A bed that is periodic along all axes is moved to the origin, its centres into the cell; else such become walls.",
)
"""What the format does not carry."""


class _Bed(NamedTuple):
    """What the two files are made of."""

    packing: Packing
    sizes: Bodies
    found: Skin
    container: Walls
    surfaces: Surfaces
    groups: Groups
    options: RockableOptions
    wraps: bool

    @property
    def has_densities(self) -> bool:
        """Whether groups have densities of their own, or all have one."""
        return "density" in self.groups.parted_by and bool(np.ptp(self.packing.densities) > 0)

    @property
    def ahead(self) -> list[int]:
        """Shapes that come first, walls as -1, -2 and so on, where groups have densities of their own.

        Rockable looks a density up by the number of the group, exaDEM by that of the shape: here group 3 has its first
        grain as shape 3, and group 0 a wall as shape 0.
        """
        if not self.has_densities:
            return []
        firsts = self.groups.firsts.tolist()
        if self.container.names:
            return [-1, *firsts, *range(-2, -len(self.container.names) - 1, -1)]
        spare = sorted(set(range(len(self.packing))) - set(firsts))[:1]
        return [*spare, *firsts] if spare else [firsts[-1], *firsts[:-1]]


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".conf", options: RockableOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the configuration and the library of shapes beside it: ``{"bed.conf": …, "bed.shp": …}``.

    Shape ``g000007`` is grain 7, about its centre of mass and along its principal axes; masses and inertias are those
    of the sharp grains. Grains are of group 1, or of one for each class, density and friction that they have, in that
    order; walls are of group 0, and those with frictions of their own of groups after those of the grains.

    Raises
    ------
    InputError
        If the packing is empty or not finite, a grain vanishes by the rounding or is wider than half of the periodic
        cell, a wall is named that there is not, or the name is not one word.
    """
    check_word(name)
    bed = _bed(packing, options or RockableOptions())
    return {f"{name}{suffix}": _configuration(bed, name), f"{name}.shp": _library(bed)}


def _bed(packing: Packing, options: RockableOptions) -> _Bed:
    """Return what the files are made of."""
    sizes = bodies(packing)
    wraps = options.periodic and bool(packing.domain.periodic.all())
    if wraps:
        _refuse_wide(packing, sizes)
    container = walls(packing, world_bounds(packing), "none" if wraps else options.walls)
    found = surfaces(packing, options)
    kinds = groups(packing, found.of)
    if "friction" not in kinds.parted_by and found.levels.size > 1:
        found = surfaces(packing, options, is_blended=True)
    return _Bed(packing, sizes, skin(packing, sizes, options), container, found, kinds, options, wraps)


def _refuse_wide(packing: Packing, sizes: Bodies) -> None:
    """Raise `InputError` where two grains could touch by more than the one image that Rockable looks at."""
    half = packing.domain.lengths.min() / 2
    far = _FAR * float(np.median(sizes.diameters))
    is_wide = np.zeros(len(packing), dtype=bool)
    for rows, part in parts(packing):
        frames = (sizes.centroids[rows], sizes.axes[rows], sizes.diameters[rows])
        squares = (vertices_in(part.grains, *frames) ** 2).sum(axis=1)
        reach = np.sqrt(np.maximum.reduceat(squares, part.grains.vertex_offsets[:-1]))
        is_wide[rows] = 2 * reach + far > half
    refuse("grains must be narrower than half of Rockable's periodic cell, or periodic=false gives it walls", is_wide)


def _configuration(bed: _Bed, name: str) -> Iterator[bytes]:
    """Yield the file of settings and poses, the driven walls first."""
    packing, sizes, options, container = bed.packing, bed.sizes, bed.options, bed.container
    n, k = len(packing), len(container.names)
    d = float(np.median(sizes.diameters))
    drop = height(packing, world_bounds(packing))
    law = springs(sizes, options.depth * bed.found.radii, drop, options.gravity, steps=50)
    time = float(np.sqrt(d / options.gravity))
    gravity = 0.0 if bed.wraps else options.gravity
    of_wall, wall_groups = _wall_groups(bed)
    header = _HEADER.substitute(
        name=name,
        n_grains=n,
        rounding=rounding_comment(bed.found, sizes),
        duration=f"{options.duration * time:.9g}",
        time_step=f"{law.time_step:.9g}",
        # The neighbours' list lives for 35 steps: what a grain that fell from the top moves meanwhile is far nearer.
        update=f"{35 * law.time_step:.9g}",
        save=f"{options.duration * time / 100:.9g}",
        far=f"{_FAR * d:.9g}",
        near=f"{_FAR / 2 * d:.9g}",
        # Trees of boxes are laid over each other where grains are, not where their images are.
        search="bruteForce" if bed.wraps else "OBBtree",
        densities=_densities(bed, len(wall_groups)),
        gravity=rows_of_text(gravity * down(packing), [3])[0],
        classes=_told(bed),
        contacts=_contacts(bed, law.stiffness, wall_groups),
        cell=_CELL % tuple(f"{length:.14g}" for length in packing.domain.lengths) if bed.wraps else "",
        n_walls=k,
        n_bodies=n + k,
    )
    yield header.encode()
    # A plate's skin reaches the wall's surface.
    behind = container.centres - _plate_radius(bed.found) * container.normals
    yield _bodies(container.names, of_wall, behind, container.quaternions)
    names, numbers = grain_names(packing), (bed.groups.of + 1).tolist()
    centres = _wrapped(packing, sizes.centres) if bed.wraps else sizes.centres
    for rows, _ in parts(packing):
        yield _bodies(names[rows], numbers[rows], centres[rows], sizes.orientations[rows])


def _wrapped(packing: Packing, centres: Floats) -> Floats:
    """Return centres [m] in the cell that begins at the origin: Rockable wraps those outside after it found pairs."""
    lengths = packing.domain.lengths
    inside = (centres - packing.domain.lower) % lengths
    # What is below zero by less than a rounding is at the other end.
    return np.where(inside < lengths, inside, 0.0)


def _wall_groups(bed: _Bed) -> tuple[list[int], dict[int, float | None]]:
    """Return the group of each wall, and the friction of each such group: 0, then the numbers after the grains'."""
    own = [bed.surfaces.of_wall(name) for name in bed.container.names]
    after = len(bed.groups.firsts)
    numbers = {value: after + place if place else 0 for place, value in enumerate(dict.fromkeys(own or [None]))}
    return [numbers[value] for value in own], {number: value for value, number in numbers.items()}


def _densities(bed: _Bed, n_wall_groups: int) -> str:
    """Return the density of every group, which is that of the shape of the same number too."""
    packing, n_groups = bed.packing, len(bed.groups.firsts)
    count = max(len(packing) + len(bed.container.names), n_groups + n_wall_groups)
    told = table_of_text(packing.densities[:, None], digits=12)
    lines = [told[0]] * count
    if bed.has_densities:
        ahead = bed.ahead
        order = [*ahead, *sorted(set(range(len(packing))) - set(ahead))]
        lines = [told[0] if shape < 0 else told[shape] for shape in order]
        lines += [told[bed.groups.firsts[-1]]] * (count - len(order))
    return "\n".join([f"density {number} {line}" for number, line in enumerate(lines)])


def _contacts(bed: _Bed, stiffness: float, wall_groups: dict[int, float | None]) -> str:
    """Return the contact law of every pair of groups that can touch; two walls cannot."""
    found, level = bed.surfaces, bed.surfaces.of[bed.groups.firsts]
    frictions: dict[tuple[int, int], float] = {}
    for b, mine in enumerate(level.tolist(), 1):
        frictions |= {(min(a, b), max(a, b)): found.at(mine, own) for a, own in wall_groups.items()}
        frictions |= {(a, b): found.between(level[a - 1], mine) for a in range(1, b + 1)}
    pairs = sorted(frictions, key=lambda pair: (pair[1], pair[0]))
    same = {
        "knContact": stiffness,
        "en2Contact": bed.options.restitution**2,
        "ktContact": stiffness,
        "muContact": None,
        "krContact": 0.0,
        "murContact": 0.0,
    }
    return "\n".join(
        f"{key} {a} {b} {frictions[a, b] if value is None else value:.9g}"
        for key, value in same.items()
        for a, b in pairs
    )


def _plate_radius(found: Skin) -> float:
    """Return the rounding radius [m] of the walls."""
    return float(np.median(found.radii))


def _told(bed: _Bed) -> str:
    """Return comments that say what each group is, or nothing where all grains are alike."""
    packing = bed.packing
    level = bed.surfaces.of[bed.groups.firsts]
    told = []
    for number, (first, mine) in enumerate(zip(bed.groups.firsts.tolist(), level.tolist(), strict=True), 1):
        words = [] if packing.classes is None else [f"class {packing.classes[first]}"]
        words += [f"density {packing.densities[first]:.12g}"] if bed.has_densities else []
        words += [f"friction {bed.surfaces.levels[mine]:.9g}"] if bed.surfaces.levels.size > 1 else []
        told += [f"group {number} is {', '.join(words)}"] if words else []
    has_more = bed.has_densities or bed.surfaces.levels.size > 1
    return "".join([f"# {line}\n" for line in (told if has_more else [", ".join(told)]) if line])


def _bodies(names: list[str], groups: list[int], centres: Floats, quaternions: Floats) -> bytes:
    """Return one line a body: shape, group, cluster, scale, pose and derivatives of that, which are zero."""
    places, turns = table_of_text(centres, digits=14), table_of_text(quaternions.round(15), digits=12)
    rows = zip(names, groups, places, turns, strict=True)
    still = "0 0 0 0 0 0"
    return "".join([f"{name} {group} 0 1 {at} {still} {turn} {still}\n" for name, group, at, turn in rows]).encode()


def _library(bed: _Bed) -> Iterator[bytes]:
    """Yield the shapes: those that have to be ahead, the grains, then the walls as plates with one face."""
    yield b"# sphero-polyhedra in SI, each about its centre of mass and along its principal axes\n"
    radius = _plate_radius(bed.found)
    plates = [_plate(*wall, radius) for wall in zip(bed.container.names, bed.container.halves.tolist(), strict=True)]
    ahead = bed.ahead
    grains = [shape for shape in ahead if shape >= 0]
    done = frozenset(grains)
    if grains:
        part, mine = subset(bed.packing, grains), Bodies(*(values[grains] for values in bed.sizes))
        one = rounded(part, mine, bed.options.rounding, min_edge=bed.options.min_edge)
        made = dict(zip(grains, _shapes(grains, mine, one, part.densities), strict=True))
        yield "".join([made[shape] if shape >= 0 else plates[-shape - 1] for shape in ahead]).encode()
    for rows, mine, one in rounded_parts(bed.packing, bed.sizes, bed.options):
        numbers = range(rows.start, rows.stop)
        densities = bed.packing.densities[rows] if bed.has_densities else bed.packing.densities[:1]
        texts = _shapes(numbers, mine, one, densities)
        yield "".join([text for number, text in zip(numbers, texts, strict=True) if number not in done]).encode()
    yield "".join([] if grains else plates).encode()


def _shapes(numbers: Sequence[int], mine: Bodies, one: Rounded, densities: Floats) -> list[str]:
    """Return grains as shapes; what can be said of them in one form is made in one go."""
    cores = one.cores
    seen = vertices_in(cores, mine.centroids, mine.axes, mine.diameters)
    starts = cores.vertex_offsets[:-1]
    lower, upper = np.minimum.reduceat(seen, starts), np.maximum.reduceat(seen, starts)
    counts = np.diff(cores.face_vertex_offsets)
    corners = rows_of_text(cores.face_vertices, counts)
    faces = [f"{count} {row}\n" for count, row in zip(counts.tolist(), corners, strict=True)]
    rows = zip(
        [f"g{number:06d}" for number in numbers],
        table_of_text(one.radii[:, None], digits=12),
        np.diff(cores.vertex_offsets).tolist(),
        filled("%.12g %.12g %.12g\n", seen, np.diff(cores.vertex_offsets)),
        np.diff(one.edges.offsets).tolist(),
        filled("%d %d\n", one.edges.ends, np.diff(one.edges.offsets)),
        np.diff(cores.face_offsets).tolist(),
        ["".join(faces[a:b]) for a, b in pairwise(cores.face_offsets.tolist())],
        table_of_text((upper - lower) / 2 + one.radii[:, None], digits=12),
        table_of_text((upper + lower) / 2, digits=12),
        table_of_text((mine.masses / densities)[:, None], digits=14),
        table_of_text(mine.moments / mine.masses[:, None], digits=14),
        strict=True,
    )
    return [_SHAPE % row for row in rows]


def _plate(name: str, halves: list[float], radius: float) -> str:
    """Return a wall as a rectangle of half lengths [m] with a skin; its volume and inertia are those of a slab."""
    a, b = halves
    vertices = filled("%.12g %.12g %.12g\n", np.array([-a, -b, 0, a, -b, 0, a, b, 0, -a, b, 0.0]), [4])[0]
    moments = np.array([b * b + radius**2, a * a + radius**2, a * a + b * b]) / 3
    numbers = np.array([a + radius, b + radius, radius, 8 * a * b * radius, *moments])
    extent, volume, inertia = rows_of_text(numbers, [3, 1, 3], digits=12)
    size = f"{radius:.12g}"
    edge = "0 1\n1 2\n2 3\n3 0\n"
    return _SHAPE % (name, size, 4, vertices, 4, edge, 1, "4 0 1 2 3\n", extent, "0 0 0", volume, inertia)
