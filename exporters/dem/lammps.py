"""LAMMPS: a data file of `body/rounded/polyhedron` and an input script that drops the bed, in grain units.

Grain units (`exporters.units`) are no choice: the pair style takes lengths below 0.001 for zero, which in SI is a whole
grain of sand. The factors back to SI stand in both files.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import refuse
from exporters.container import world_bounds
from exporters.dem.bodies import (
    bodies,
    core_comment,
    kinds_of,
    parts,
    report,
    rounded_parts,
    rounding_comment,
    skin,
    vertices_in,
)
from exporters.dem.options import SkinOptions
from exporters.dem.scene import check_word, height, springs
from exporters.rest import down, one_friction
from exporters.text import rows_of_text, table_of_text
from exporters.units import factors_of, units_of
from grainsdem.geometry.rotations import to_matrices
from grainsdem.ragged import offsets_from_counts, owners

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies, Rounded, Skin
    from exporters.units import GrainUnits
    from grainsdem.model import Packing, Polyhedra

    Floats = NDArray[np.float64]

__all__ = ["LOSES", "Options", "factors", "files", "report"]

# Numbers on one line: LAMMPS reads 255 signs of one, and 31 lines of a body.
_LINES = {"reals": 12, "ends": 60, "corners": 60}
_MOST_LINES = 31

_SCRIPT = Template("""\
# $name: $n_grains grains, atom 8 is grain 7. Length 1 = $length m, mass 1 = $mass kg, time 1 = $time s.
# $rounding
# $cores
# In the folder of $name.data:
# lmp -in $name.in            lmp -var steps 100 -in $name.in
units           lj
dimension       3
atom_style      body rounded/polyhedron $fewest $most
boundary        $boundary
newton          on
comm_modify     vel yes

variable        steps index $steps
read_data       $name.data

# The style tells how far a body reaches without its skin: cutoff and list must reach over both skins.
neighbor        $reach bin
neigh_modify    every 1 delay 0 check yes
pair_style      body/rounded/polyhedron $damping $damping $friction 1.0 $cutoff
pair_coeff      * * $stiffness 0.0

timestep        $time_step
fix             motion all nve/body
fix             weight all gravity 1.0 vector $down
$walls
compute         turn all property/atom quatw quati quatj quatk
dump            grains all custom $$(ceil((v_steps+1)/100)) $name.dump id mass x y z c_turn[*]
dump_modify     grains sort id
thermo_style    custom step atoms pe ke
thermo          $$(ceil((v_steps+1)/20))
run             $${steps}
""")

_HEADER = Template("""\
$name: $n_grains rounded polyhedra in grain units, atom 8 is grain 7; 1 = $length m, $mass kg, $time s$types

# $cores
$n_grains atoms
$n_grains bodies
$n_types atom types

$box

Atoms # body

""")


Options = SkinOptions

LOSES = (
    "Edges are rounded: each grain is its faces moved inward and a sphere swept over the rest, inside what it was.",
    "Faces of more than four corners are cut; LAMMPS finds principal axes of its own.",
    "A domain's inclined planes are left out.",
    "Where grains have frictions of their own, their mean stands for all, and for the walls.",
)
"""What the format does not carry."""


@dataclass(frozen=True, slots=True)
class _Bed:
    """What both files are made of."""

    packing: Packing
    name: str
    options: SkinOptions
    sizes: Bodies
    scales: GrainUnits
    skin: Skin
    bounds: Floats

    @property
    def told(self) -> dict[str, object]:
        """What both files say of themselves."""
        factors = {key: f"{getattr(self.scales, key):.14g}" for key in ("length", "mass", "time")}
        return {"name": self.name, "n_grains": len(self.packing), **factors}


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".in", options: SkinOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the script and the data file beside it: ``{"bed.in": …, "bed.data": …}``.

    Atom 8 is grain 7, with the mass, the centre of mass and the inertia of the sharp grain; there is one type, or one a
    class, from the lowest on. Periodic axes are periodic in LAMMPS too, which wraps grains into the box.

    Raises
    ------
    InputError
        If the packing is empty or not finite, a grain vanishes by the rounding, has more corners than LAMMPS reads, or
        the name is not one word.
    """
    check_word(name)
    options = options or SkinOptions()
    sizes = bodies(packing)
    scales = units_of(sizes.volumes, packing.densities, options.gravity)
    found = skin(packing, sizes, options)
    _refuse_long(found)
    bed = _Bed(packing, name, options, sizes, scales, found, world_bounds(packing))
    return {f"{name}{suffix}": _script(bed).encode(), f"{name}.data": _data(bed)}


def factors(packing: Packing, options: SkinOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI: lengths in m, masses in kg, times in s."""
    return factors_of(units_of(bodies(packing).volumes, packing.densities, options.gravity))


def quads(shapes: Polyhedra) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the faces cut into pieces of three or four corners, shape (m, 4), and the offsets of each grain's.

    The fourth of three is -1.
    """
    counts = np.diff(shapes.face_vertex_offsets)
    pieces = (counts - 1) // 2
    offsets = offsets_from_counts(pieces)
    face = owners(offsets)
    step = 2 * (np.arange(offsets[-1]) - offsets[face])
    starts = shapes.face_vertex_offsets[face]
    corners = shapes.face_vertices.astype(np.int64)
    last = np.minimum(step + 3, counts[face] - 1)
    fourth = np.where(step + 3 < counts[face], corners[starts + last], -1)
    columns = [corners[starts], corners[starts + step + 1], corners[starts + step + 2], fourth]
    return np.column_stack(columns), offsets[shapes.face_offsets]


def _refuse_long(found: Skin) -> None:
    """Raise `InputError` where a body takes more lines than LAMMPS reads."""
    lines = np.full(found.radii.size, 4)
    for counts, kind in ((3 * found.n_vertices, "reals"), (2 * found.n_edges, "ends"), (4 * found.n_quads, "corners")):
        lines += -(-counts // _LINES[kind])
    rule = f"grains must not have so many corners that LAMMPS would have to read more than {_MOST_LINES} lines of one"
    refuse(rule, lines > _MOST_LINES)


def _script(bed: _Bed) -> str:
    """Return the commands that read the data and let the grains fall."""
    sizes, found, scales, options = bed.sizes, bed.skin, bed.scales, bed.options
    law = springs(sizes, options.depth * found.radii, height(bed.packing, bed.bounds), options.gravity, steps=20)
    stiffness = law.stiffness / scales.force * scales.length
    time_step = law.time_step / scales.time
    # A pair of median grains: half the mass of one.
    reduced = float(np.median(sizes.masses)) / scales.mass / 2
    decay = -np.log(options.restitution)
    damping = 2 * decay / np.hypot(np.pi, decay) * np.sqrt(reduced * stiffness)
    # What LAMMPS sets aside for a body of so many vertices, edges and faces.
    numbers = 3 * found.n_vertices + 2 * found.n_edges + 4 * found.n_quads
    room = np.maximum(found.n_vertices, -(-numbers // 9))
    cutoff = 2 * float(found.radii.max()) / scales.length
    return _SCRIPT.substitute(
        bed.told,
        rounding=rounding_comment(found, sizes),
        cores=core_comment(found, sizes),
        # Without a period, a box that grows with the bed and is never smaller than it was.
        boundary=" ".join("p" if wraps else "m" for wraps in bed.packing.domain.periodic),
        fewest=int(room.min()),
        most=int(room.max()),
        steps=round(options.duration / time_step),
        reach=f"{cutoff + 0.1:.9g}",
        cutoff=f"{cutoff:.9g}",
        damping=f"{damping:.9g}",
        friction=f"{one_friction(bed.packing, options.friction):.9g}",
        stiffness=f"{stiffness:.9g}",
        time_step=f"{time_step:.9g}",
        down=rows_of_text(down(bed.packing), [3])[0],
        walls=_walls(bed, f"{stiffness:.9g} {damping:.9g} {damping:.9g}"),
    )


def _walls(bed: _Bed, law: str) -> str:
    """Return one command an axis; a wall that is not there is NULL."""
    lower, upper = (corner / bed.scales.length for corner in (bed.packing.domain.lower, bed.packing.domain.upper))
    planar, choice = bed.packing.domain.is_planar, bed.options.walls
    floor = 1 if planar else 2
    closed = {"box": [0, 2] if planar else [0, 1], "floor": [], "none": []}[choice]
    rows = []
    for axis, letter in enumerate("xyz"):
        is_walled = axis in closed or (axis == floor and choice != "none")
        if is_walled and not bed.packing.domain.periodic[axis]:
            top = f"{upper[axis]:.12g}" if axis in closed else "NULL"
            between = f"{letter}plane {lower[axis]:.12g} {top}"
            rows.append(f"fix             wall_{letter} all wall/body/polyhedron {law} {between}")
    return "\n".join(rows)


def _data(bed: _Bed) -> Iterator[bytes]:
    """Yield the box, where the atoms are, and what bodies they have."""
    sizes, length = bed.sizes, bed.scales.length
    domain = bed.packing.domain
    # Along periodic axes the domain, else around all grains too.
    lower = np.where(domain.periodic, domain.lower, np.minimum(domain.lower, bed.bounds[0]))
    upper = np.where(domain.periodic, domain.upper, np.maximum(domain.upper, bed.bounds[1]))
    edges = zip(table_of_text(np.column_stack([lower, upper]) / length, digits=12), "xyz", strict=True)
    numbers, kinds = kinds_of(bed.packing)
    yield _HEADER.substitute(
        bed.told,
        n_types=max(len(numbers), 1),
        types=_types(numbers),
        cores=core_comment(bed.skin, sizes),
        box="\n".join(f"{row} {axis}lo {axis}hi" for row, axis in edges),
    ).encode()
    for rows, _ in parts(bed.packing):
        masses = table_of_text(sizes.masses[rows, None] / bed.scales.mass, digits=14)
        places = table_of_text(sizes.centres[rows] / length, digits=14)
        atoms = zip(range(rows.start + 1, rows.stop + 1), kinds[rows], masses, places, strict=True)
        yield "".join([f"{atom} {kind} 1 {mass} {place}\n" for atom, kind, mass, place in atoms]).encode()
    yield b"\nBodies\n\n"
    for rows, mine, one in rounded_parts(bed.packing, sizes, bed.options):
        yield _bodies(bed, rows, mine, one)


def _types(numbers: list[int]) -> str:
    """Return the words of the first line, which is a comment, that say which type is which class."""
    # LAMMPS reads 255 signs of a line.
    told = "".join(f"; type {kind} is class {number}" for kind, number in enumerate(numbers, 1))
    return told if len(told) < 100 else f"; types 1 to {len(numbers)} are the classes, rising"


def _bodies(bed: _Bed, rows: slice, mine: Bodies, one: Rounded) -> bytes:
    """Return a stretch of bodies, in the axes of the box and about their centres of mass."""
    cores, length = one.cores, bed.scales.length
    vertices = vertices_in(cores, mine.centroids, bed.packing.quaternions[rows] * [1, -1, -1, -1], mine.diameters)
    pieces, piece_offsets = quads(cores)
    turns = to_matrices(mine.orientations)
    moments = mine.moments / bed.scales.inertia
    six = np.einsum("nik,nk,njk->nij", turns, moments, turns)[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    texts = zip(
        range(rows.start + 1, rows.stop + 1),
        # Noise around zero is not written as numbers of its own.
        table_of_text((six / moments[:, 2:]).round(15) * moments[:, 2:], digits=14),
        _lines(vertices / length, cores.vertex_offsets, "reals"),
        _lines(one.edges.ends, one.edges.offsets, "ends"),
        _lines(pieces, piece_offsets, "corners"),
        table_of_text(2 * one.radii[:, None] / length, digits=12),
        np.diff(cores.vertex_offsets).tolist(),
        np.diff(one.edges.offsets).tolist(),
        np.diff(piece_offsets).tolist(),
        strict=True,
    )
    return "".join([
        f"{atom} 3 {6 + 3 * v + 2 * e + 4 * f + 1}\n{v} {e} {f}\n{inertia}\n{points}{ends}{corners}{diameter}\n"
        for atom, inertia, points, ends, corners, diameter, v, e, f in texts
    ]).encode()  # fmt: skip


def _lines(values: NDArray[Any], offsets: NDArray[np.int64], kind: str) -> list[str]:
    """Return one text a body, so many numbers a line as LAMMPS reads."""
    width, most = values.shape[1], _LINES[kind]
    counts = width * np.diff(offsets)
    lines = -(-counts // most)
    # Full lines of a body, then what is left.
    line = owners(offsets_from_counts(lines))
    first = np.arange(line.size) - offsets_from_counts(lines)[line]
    sizes = np.minimum(counts[line] - first * most, most)
    rows = rows_of_text(values, sizes, digits=12)
    cuts = offsets_from_counts(lines).tolist()
    return ["\n".join([*rows[a:b], ""]) for a, b in pairwise(cuts)]
