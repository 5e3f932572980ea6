"""Itasca 3DEC, from version 7: commands that make rigid blocks, their joints and the container."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from string import Template
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_positive, checked_coefficients, class_texts, grain_names
from exporters.container import container_box, world_bounds
from exporters.dem.bodies import bodies, parts
from exporters.dem.groups import surfaces
from exporters.dem.options import WALLS, check_friction
from exporters.dem.scene import check_word, height
from exporters.rest import down
from exporters.text import filled, rows_of_text, table_of_text
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from numpy.typing import NDArray

    from exporters.dem.bodies import Bodies
    from exporters.dem.groups import Surfaces
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

_HEADER = Template("""\
; $name: $n_grains grains in SI, block g000007 in slot 'grain' is grain 7
model new
model large-strain on
""")

_FOOTER = Template("""\
block property density $density
$densities
block contact generate-subcontacts
block contact jmodel assign mohr
block contact property $joint
block contact material-table default property $joint
${pairs}model gravity $gravity
$fixed
block mech damp local 0.8
""")

# Vertices on one line; no vertex may be parted by the end of one.
_ON_A_LINE = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class ThreedecOptions:
    """What the model that the commands make is like.

    Parameters
    ----------
    friction : float, optional
        Coefficient of friction [1] of every joint; that which the grains came to rest with by
        default, else each grain's own, or 0.5 where there are none.
    gravity : float
        Acceleration [m/s²].
    depth : float
        Overlap of a grain that has fallen from the top of the bed onto a face, in median diameters; the joints'
        stiffness follows from it.
    walls : {"box", "floor", "none"}
        Container from the packing's domain, of fixed blocks. There is no lid.
    wall_friction : float, mapping or str, optional
        Coefficient of friction between grains and walls [1], or those of some walls by name, as in
        ``{"floor": 0.6, "wall_x0": 0}`` or ``"floor=0.6,wall_x0=0"``; as the bed came to rest by default, else as among
        grains.
    mixing : {"max", "min"}, optional
        Which of two grains with frictions of their own rules where they touch: the rougher or the smoother. As the bed
        came to rest by default, else the rougher.

    Raises
    ------
    InputError
        If a number is out of range or a word is not one of those allowed.
    """

    friction: float | None = None
    gravity: float = 9.81
    depth: float = 0.01
    walls: Literal["box", "floor", "none"] = "box"
    wall_friction: float | Mapping[str, float] | str | None = None
    mixing: Literal["max", "min"] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "wall_friction", checked_coefficients("wall_friction", self.wall_friction))
        if self.mixing is not None:
            check_choice("mixing", self.mixing, ("max", "min"))
        for name in ("gravity", "depth"):
            check_positive(name, getattr(self, name))
        check_friction(self.friction)
        check_choice("walls", self.walls, WALLS)


Options = ThreedecOptions

LOSES = (
    "Vertices have twelve significant digits; 3DEC finds masses and inertias itself from the densities.",
    "Poses are those of the vertices: which way a grain was turned is lost.",
    "Periodic axes become walls, and a domain's inclined planes are left out.",
    "Where grains have more than 100 frictions, their mean stands for all.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".3ddat", options: ThreedecOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the one file of commands: ``{"bed.3ddat": …}``.

    Every face has its corners clockwise seen from outside, as 3DEC asks. The block of grain 7 is in group ``g000007``
    of the slot ``grain``, and where grains have classes in one such as ``class_2`` of the slot ``class``; the walls are
    in group ``walls``, and fixed. Where friction differs, grains are in ``friction_1`` and so on of the slot
    ``friction``, from the smoothest on, and walls in groups of their names of the slot ``wall``.

    Raises
    ------
    InputError
        If the packing is empty or not finite, a wall is named that there is not, or the name is not one word.
    """
    check_word(name)
    options = options or ThreedecOptions()
    found = surfaces(packing, options)
    return {f"{name}{suffix}": _commands(packing, bodies(packing), found, options=options, name=name)}


def _commands(
    packing: Packing, sizes: Bodies, found: Surfaces, *, options: ThreedecOptions, name: str
) -> Iterator[bytes]:
    """Yield the walls, which are made first and named by being all that there is, then the grains and the joints."""
    ends = world_bounds(packing)
    d = float(np.median(sizes.diameters))
    yield _HEADER.substitute(name=name, n_grains=len(packing)).encode()
    container = _bricks(packing, ends, options.walls, d)
    for wall, corners in container.items():
        yield f"; {wall}\nblock create brick {table_of_text(corners.T.reshape(1, 6), digits=12)[0]}\n".encode()
    if container:
        yield b"block group 'walls'\n"
    for rows, part in parts(packing):
        yield _grains(part, sizes, rows).encode()
    names = grain_names(packing)
    groups, pairs = _frictions(found, container, names)
    yield groups.encode()
    told = table_of_text(packing.densities[:, None], digits=12)
    # A force over a face of 0.2 d² that takes up what the heaviest grain gains in its fall.
    drop = height(packing, ends)
    stiffness = 2 * float(sizes.masses.max()) * options.gravity * drop / (0.2 * d**2 * (options.depth * d) ** 2)
    springs = f"stiffness-normal {stiffness:.9g} stiffness-shear {stiffness:.9g}"
    # That of most pairs.
    default = _angle(found.between(0, len(found.levels) - 1))
    yield _FOOTER.substitute(
        density=told[0],
        densities="\n".join([
            f"block property density {density} range group '{grain}' slot 'grain'"
            for grain, density in zip(names, told, strict=True)
            if density != told[0]
        ]),
        joint=f"{springs} friction {default}",
        pairs="".join([
            f"block contact property friction {angle} {pair}\n"
            f"block contact material-table add jmodel mohr property {springs} friction {angle} {pair}\n"
            for pair, angle in pairs.items()
            if angle != default
        ]),
        gravity=rows_of_text(options.gravity * down(packing), [3])[0],
        fixed="block fix range group 'walls'" if container else "",
    ).encode()  # fmt: skip


def _angle(friction: float) -> str:
    """Return a coefficient of friction as the angle [°] that joints have."""
    return f"{np.degrees(np.arctan(friction)):.9g}"


def _frictions(found: Surfaces, container: dict[str, Floats], names: list[str]) -> tuple[str, dict[str, str]]:
    """Return commands that put grains and walls into groups by friction, and the angle of each pair of groups.

    There are none where all joints are alike. No two pairs have a joint in common, so that their order does not matter.
    """
    own = {wall: found.of_wall(wall) for wall in container}
    levels = range(len(found.levels))
    if len(levels) == 1 and all(found.at(0, value) == found.levels[0] for value in own.values()):
        return "", {}
    grains = zip(names, (found.of + 1).tolist(), strict=True)
    lines = [f"block group 'friction_{k}' slot 'friction' range group '{grain}' slot 'grain'\n" for grain, k in grains]
    for wall, corners in container.items():
        middle, reach = corners.mean(axis=0), 1e-3 * np.ptp(corners, axis=0)
        box = table_of_text(np.stack([middle - reach, middle + reach], axis=1).reshape(1, 6), digits=12)[0].split()
        lines.append("block group '{}' slot 'wall' range pos-x {} {} pos-y {} {} pos-z {} {}\n".format(wall, *box))
    between = {
        f"range group-intersection 'friction_{a + 1}' 'friction_{b + 1}'": _angle(found.between(a, b))
        for b in levels
        for a in range(b + 1)
    }
    at = {
        f"range group-intersection 'friction_{a + 1}' '{wall}'": _angle(found.at(a, value))
        for wall, value in own.items()
        for a in levels
    }
    return "".join(lines), between | at


def _bricks(packing: Packing, ends: Floats, choice: str, thickness: float) -> dict[str, Floats]:
    """Return the corners [m] of the walls, shape (2, 3), by name: bricks that touch but do not overlap."""
    lower, upper = container_box(packing, ends)
    top = np.maximum(upper, ends[1])
    planar = packing.domain.is_planar
    up, first, last = (1, 0, 2) if planar else (2, 0, 1)
    inside = np.stack([lower, np.where(np.arange(3) == up, top, upper)])
    # The floor is under all walls, and the first two walls cover the edges of the others.
    wide = inside + np.array([[-thickness], [thickness]]) * (np.arange(3) != up)
    cover = np.where(np.arange(3) == last, wide, inside)
    made = {}
    for axis, around, sides in ((up, wide, (0,)), (first, cover, (0, 1)), (last, inside, (0, 1))):
        for side in sides:
            brick = around.copy()
            brick[1 - side, axis] = inside[side, axis]
            brick[side, axis] = inside[side, axis] + (thickness if side else -thickness)
            made[f"wall_{'xyz'[axis]}{side}"] = brick
    return {"box": made, "floor": dict(list(made.items())[:1]), "none": {}}[choice]


def _grains(part: Packing, sizes: Bodies, rows: slice) -> str:
    """Return the commands that make a stretch of grains, and those that name them by where they are."""
    grains = part.grains
    points = filled("%.12g,%.12g,%.12g", world_vertices(part), np.ones(len(grains.vertices), dtype=np.int64))
    made = []
    for grain, start in enumerate(grains.vertex_offsets[:-1].tolist()):
        # From counter-clockwise to clockwise.
        faces = [[points[start + corner] for corner in face[::-1].tolist()] for face in grains.faces_of(grain)]
        made.append(_block(f"g{rows.start + grain:06d}", faces))
    # A box of a thousandth of a diameter around each centre of mass, which no other grain has inside.
    reach = 5e-4 * sizes.diameters[rows, None]
    bounds = np.stack([sizes.centres[rows] - reach, sizes.centres[rows] + reach], axis=2).reshape(-1, 6)
    named = filled("range pos-x %.12g %.12g pos-y %.12g %.12g pos-z %.12g %.12g", bounds, np.ones(len(bounds)))
    groups = [f"block group 'g{rows.start + i:06d}' slot 'grain' {box}\n" for i, box in enumerate(named)]
    own = class_texts(part, "block group 'class_%d' slot 'class' range group ")
    classes = [f"{text}'g{rows.start + i:06d}' slot 'grain'\n" for i, text in enumerate(own) if text]
    return "".join([*made, *groups, *classes])


def _block(name: str, faces: list[list[str]]) -> str:
    """Return the command that makes a block of faces, each a list of points."""
    lines = [f"; {name}", "block create polyhedron &"]
    for face in faces:
        cuts = [*range(0, len(face), _ON_A_LINE), len(face)]
        rows = [" ".join(face[a:b]) for a, b in pairwise(cuts)]
        lines += [f"  face {rows[0]} &", *(f"       {row} &" for row in rows[1:])]
    # The last line is not continued.
    return "\n".join([*lines[:-1], lines[-1].removesuffix(" &"), ""])
