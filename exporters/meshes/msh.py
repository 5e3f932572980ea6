"""Gmsh: the triangulated surface of each grain as MSH 4.1, and a script with which Gmsh fills them with tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exporters.check import check_name, grain_names, measured
from exporters.text import filled, table_of_text
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles

if TYPE_CHECKING:
    from collections.abc import Iterator

    from grainsdem.model import Packing

# Grains made into text at once.
_BLOCK = 4096


@dataclass(frozen=True, slots=True, kw_only=True)
class MshOptions:
    """What groups there are.

    Parameters
    ----------
    per_grain : bool
        A physical group ``g000000`` a grain; else one, ``grains``.
    """

    per_grain: bool = False


Options = MshOptions

LOSES = (
    "Polygons are cut into triangles, and vertices have 16 significant digits.",
    "Masses, densities and poses are not carried.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".msh", options: MshOptions | None = None
) -> dict[str, bytes | Iterator[bytes]]:
    """Return the surfaces, in metres, and ``bed.geo``, whose volumes they bound: ``gmsh -3 bed.geo`` fills them.

    Grain i is surface and volume i + 1, for Gmsh counts from 1.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    measured(packing)
    groups = grain_names(packing) if (options or MshOptions()).per_grain else ["grains"]
    script = _script(f"{name}{suffix}", len(packing), groups)
    return {f"{name}{suffix}": _content(packing, groups), f"{name}.geo": script.encode()}


def _script(surfaces: str, n: int, groups: list[str]) -> str:
    """Return the script: one volume in each surface."""
    lines = [f'Merge "{surfaces}";', f"For i In {{1:{n}}}", "  Surface Loop(i) = {i};", "  Volume(i) = {i};", "EndFor"]
    if len(groups) == 1:
        lines.append(f'Physical Volume("{groups[0]}", 1) = {{1:{n}}};')
    else:
        lines += [f'Physical Volume("{word}", {k + 1}) = {{{k + 1}}};' for k, word in enumerate(groups)]
    return "\n".join([*lines, ""])


def _content(packing: Packing, groups: list[str]) -> Iterator[bytes]:
    grains = packing.grains
    n = len(packing)
    world = world_vertices(packing)
    yield b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    names = "".join(f'2 {k + 1} "{word}"\n' for k, word in enumerate(groups))
    yield f"$PhysicalNames\n{len(groups)}\n{names}$EndPhysicalNames\n".encode()
    boxes = table_of_text(
        np.hstack([
            np.minimum.reduceat(world, grains.vertex_offsets[:-1]),
            np.maximum.reduceat(world, grains.vertex_offsets[:-1]),
        ]),
        digits=16,
    )  # fmt: skip
    tags = [1] * n if len(groups) == 1 else range(1, n + 1)
    yield f"$Entities\n0 0 {n} 0\n".encode()
    yield "".join(f"{i + 1} {box} 1 {tag} 0\n" for i, (box, tag) in enumerate(zip(boxes, tags, strict=True))).encode()
    yield b"$EndEntities\n"
    counts = np.diff(grains.vertex_offsets)
    yield f"$Nodes\n{n} {len(world)} 1 {len(world)}\n".encode()
    for start in range(0, n, _BLOCK):
        stop = min(start + _BLOCK, n)
        first, last = grains.vertex_offsets[start], grains.vertex_offsets[stop]
        numbers = filled("%d\n", np.arange(first + 1, last + 1), counts[start:stop])
        places = filled("%.16g %.16g %.16g\n", world[first:last], counts[start:stop])
        heads = zip(range(start, stop), counts[start:stop].tolist(), numbers, places, strict=True)
        yield "".join(f"2 {i + 1} 0 {k}\n{tag}{place}" for i, k, tag, place in heads).encode()
    yield b"$EndNodes\n"
    yield from _triangles(packing)


def _triangles(packing: Packing) -> Iterator[bytes]:
    """Yield the elements: triangles, outward."""
    grains = packing.grains
    cut = triangles(grains, apexes=best_apexes(grains))
    counts = np.diff(cut.offsets)
    total = len(cut.indices)
    yield f"$Elements\n{len(packing)} {total} 1 {total}\n".encode()
    for start in range(0, len(packing), _BLOCK):
        stop = min(start + _BLOCK, len(packing))
        first, last = cut.offsets[start], cut.offsets[stop]
        shift = np.repeat(grains.vertex_offsets[start:stop], counts[start:stop])
        rows = np.column_stack([np.arange(first + 1, last + 1), cut.indices[first:last] + shift[:, None] + 1])
        body = filled("%d %d %d %d\n", rows, counts[start:stop])
        heads = zip(range(start, stop), counts[start:stop].tolist(), body, strict=True)
        yield "".join(f"2 {i + 1} 2 {k}\n{text}" for i, k, text in heads).encode()
    yield b"$EndElements\n"
