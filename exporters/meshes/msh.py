"""Gmsh: the surface of each grain, or of the void of a box, as MSH 4.1, and a script that fills it with tetrahedra."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_name, check_positive, grain_names, measured, stretches
from exporters.text import filled, table_of_text
from exporters.void import gmsh
from exporters.void import region as regions
from exporters.void.faces import faces
from exporters.void.solids import TREATMENTS, Frame, treat, void
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class MshOptions:
    """What is filled, and what groups there are.

    Parameters
    ----------
    region : {"grains", "void", "core", "bed"}
        The grains, or the void between them in a box. ``"core"`` and ``"bed"`` fill the grains too: they are OpenFOAM's
        words for its own option of this name, where one set of options goes to many formats.
    per_grain : bool
        A physical group ``g000000`` a grain; else one a class, ``class_2``, or ``grains`` where they have no classes.
        The void has the groups ``inlet``, ``outlet``, ``sides`` and ``grains``, and the volume ``void``.
    box : "core" or tuple of two array_like, shape (3,)
        Whose void: the inside of the bed, or the corners [m] of a box.
    axis : {"x", "y", "z"}
        Across which inlet and outlet of the void lie.
    contact : {"shrink", "cap", "bridge", "union", "none"}
        What is done first where grains are nearer than ``gap``, as in OpenFOAM's cases.
    gap : float, optional
        Gap [m]; by default a fiftieth of the mean equal-volume diameter.
    size : float
        Longest edge of the void's tetrahedra, in mean diameters; Gmsh's ``-clscale`` makes all finer or coarser.
    shortest_edge : float, optional
        Edges of the void's surface below this, in mean diameters, are merged away; the script says what it changed. By
        default a thousandth where grains stay apart and flat (``"shrink"``, ``"cap"``); else none, for where solids
        meet at small angles faces would cross.

    Raises
    ------
    InputError
        If an option is out of range.
    """

    region: Literal["grains", "void", "core", "bed"] = "grains"
    per_grain: bool = False
    box: Literal["core"] | tuple[ArrayLike, ArrayLike] = "core"
    axis: Literal["x", "y", "z"] = "z"
    contact: Literal["shrink", "cap", "bridge", "union", "none"] = "shrink"
    gap: float | None = None
    size: float = 0.15
    shortest_edge: float | None = None

    def __post_init__(self) -> None:
        # Corners too are OpenFOAM's.
        if isinstance(self.region, str):
            check_choice("region", self.region, ("grains", "void", "core", "bed"))
        check_choice("axis", self.axis, ("x", "y", "z"))
        check_choice("contact", self.contact, TREATMENTS)
        if self.gap is not None:
            check_positive("gap", self.gap)
        check_positive("size", self.size)
        if self.shortest_edge is not None:
            check_positive("shortest_edge", self.shortest_edge, or_zero=True)


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

    Grain i is surface and volume i + 1, for Gmsh counts from 1. The void's script has plane faces of its own, for which
    Gmsh makes new triangles; its surface as triangles is the void's without more corners than it needs.

    Raises
    ------
    InputError
        If the packing is empty or not finite, or the box is none, or holds no grain or no void.
    """
    check_name(name)
    options = options or MshOptions()
    integrals = measured(packing)
    if isinstance(options.region, str) and options.region == "void":
        d = float(cube_roots(integrals.volumes * 6 / np.pi).mean())
        return _void(packing, name, suffix, options, d)
    groups, group_of = _groups(packing, per_grain=options.per_grain)
    script = _script(f"{name}{suffix}", groups, group_of)
    return {f"{name}{suffix}": _content(packing, groups, group_of), f"{name}.geo": script.encode()}


def _void(
    packing: Packing, name: str, suffix: str, options: MshOptions, d: float
) -> dict[str, bytes | Iterator[bytes]]:
    axis = "xyz".index(options.axis)
    region = regions.choose(packing, options.box, axis, d)
    gap = 0.02 * d if options.gap is None else options.gap
    grains, _ = regions.gather(packing, region, regions.REACH * gap)
    frame = Frame(region.lower.copy(), d)
    solid = void(treat(grains, options.contact, gap, frame).bodies, region, frame)
    if solid.is_empty():
        raise InputError("the box holds no void; give another box, or a bed of more porosity")
    lower, upper = ((corner - frame.origin) / d for corner in (region.lower, region.upper))
    shortest = (
        (1e-3 if options.contact in ("shrink", "cap") else 0.0)
        if options.shortest_edge is None
        else options.shortest_edge
    )
    found = faces(solid, lower, upper, shortest=shortest)
    patch_of = gmsh.patches(found, lower, upper, axis)
    # The world's place, in diameters: Gmsh's tolerances are for lengths about one.
    filled_void = gmsh.Void(found._replace(points=found.points + frame.origin / d), patch_of, d, options.size)
    volume, exact = found.volume() * d**3, float(solid.volume()) * d**3
    ways = sum(gmsh.is_through(filled_void, part) for part in found.parts)
    report = [
        f"The void of {len(grains)} grains in {region.lower.tolist()} to {region.upper.tolist()} m",
        f"contacts nearer than {gap:.6g} m: {options.contact}",
        f"volume {volume:.12g} m3, porosity {volume / float(np.prod(region.upper - region.lower)):.9g}",
        f"edges below {shortest:.6g} mean diameters merged: volume {volume / exact - 1:+.3g} of it",
        f"parts from inlet to outlet: {ways}; pockets: {len(found.parts) - ways}",
    ]
    script = gmsh.script(filled_void, report)
    return {f"{name}{suffix}": gmsh.surface(filled_void).encode(), f"{name}.geo": script.encode()}


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
