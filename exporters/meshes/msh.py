"""Gmsh: the triangulated surface of each grain as MSH 4.1, and a script with which Gmsh fills them with tetrahedra."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exporters.check import check_name, grain_names, measured, stretches
from exporters.text import filled, table_of_text
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class MshOptions:
    """What groups there are.

    Parameters
    ----------
    per_grain : bool
        A physical group ``g000000`` a grain; else one a class, ``class_2``, or ``grains`` where they have no classes.
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
    groups, group_of = _groups(packing, per_grain=(options or MshOptions()).per_grain)
    script = _script(f"{name}{suffix}", groups, group_of)
    return {f"{name}{suffix}": _content(packing, groups, group_of), f"{name}.geo": script.encode()}


def _groups(packing: Packing, *, per_grain: bool) -> tuple[list[str], NDArray[np.int64]]:
    """Return the names of the physical groups, and the number from 0 of that which each grain is in."""
    if per_grain:
        return grain_names(packing), np.arange(len(packing))
    if packing.classes is None:
        return ["grains"], np.zeros(len(packing), dtype=np.int64)
    numbers, group_of = np.unique(packing.classes, return_inverse=True)
    return [f"class_{number}" for number in numbers.tolist()], group_of.ravel()


def _script(surfaces: str, groups: list[str], group_of: NDArray[np.int64]) -> str:
    """Return the script: one volume in each surface."""
    n = len(group_of)
    lines = [f'Merge "{surfaces}";', f"For i In {{1:{n}}}", "  Surface Loop(i) = {i};", "  Volume(i) = {i};", "EndFor"]
    members = np.split(np.argsort(group_of, kind="stable") + 1, np.cumsum(np.bincount(group_of))[:-1])
    for k, (word, volumes) in enumerate(zip(groups, members, strict=True)):
        told = f"1:{n}" if len(groups) == 1 else ",".join(map(str, volumes.tolist()))
        lines.append(f'Physical Volume("{word}", {k + 1}) = {{{told}}};')
    return "\n".join([*lines, ""])


def _content(packing: Packing, groups: list[str], group_of: NDArray[np.int64]) -> Iterator[bytes]:
    grains = packing.grains
    n = len(packing)
    yield b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"
    names = "".join(f'2 {k + 1} "{word}"\n' for k, word in enumerate(groups))
    yield f"$PhysicalNames\n{len(groups)}\n{names}$EndPhysicalNames\n".encode()
    yield f"$Entities\n0 0 {n} 0\n".encode()
    for first, part in stretches(packing):
        tags = range(first + 1, first + len(part) + 1)
        own = (group_of[first : first + len(part)] + 1).tolist()
        rows = zip(tags, _boxes(part), own, strict=True)
        yield "".join(f"{tag} {box} 1 {group} 0\n" for tag, box, group in rows).encode()
    yield f"$EndEntities\n$Nodes\n{n} {len(grains.vertices)} 1 {len(grains.vertices)}\n".encode()
    for first, part in stretches(packing):
        counts = np.diff(part.grains.vertex_offsets)
        start = int(grains.vertex_offsets[first])
        tags_of = filled("%d\n", np.arange(start + 1, start + counts.sum() + 1), counts)
        places = filled("%.16g %.16g %.16g\n", world_vertices(part), counts)
        nodes = zip(itertools.count(first + 1), counts.tolist(), tags_of, places)
        yield "".join(f"2 {tag} 0 {k}\n{numbers}{place}" for tag, k, numbers, place in nodes).encode()
    yield b"$EndNodes\n"
    total = int(np.maximum(np.diff(grains.face_vertex_offsets) - 2, 0).sum())
    yield f"$Elements\n{n} {total} 1 {total}\n".encode()
    done = 0
    for first, part in stretches(packing):
        cut = triangles(part.grains, apexes=best_apexes(part.grains))
        counts = np.diff(cut.offsets)
        shift = np.repeat(grains.vertex_offsets[first : first + len(part)], counts) + 1
        elements = np.arange(done + 1, done + len(cut.indices) + 1)
        done += len(cut.indices)
        body = filled("%d %d %d %d\n", np.column_stack([elements, cut.indices + shift[:, None]]), counts)
        surfaces = zip(itertools.count(first + 1), counts.tolist(), body)
        yield "".join(f"2 {tag} 2 {k}\n{text}" for tag, k, text in surfaces).encode()
    yield b"$EndElements\n"


def _boxes(packing: Packing) -> list[str]:
    """Return the box of each grain: the coordinates of its lower and of its upper corner."""
    world, starts = world_vertices(packing), packing.grains.vertex_offsets[:-1]
    corners = [bound.reduceat(world, starts) for bound in (np.minimum, np.maximum)]
    return table_of_text(np.hstack(corners), digits=16)
