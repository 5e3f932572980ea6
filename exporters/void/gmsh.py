"""Gmsh's script that fills the void with tetrahedra, and the void's surface as MSH 4.1."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from exporters.text import filled, rows_of_text, table_of_text
from exporters.void.faces import ON_WALL

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.void.faces import Faces

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

PATCHES = ("inlet", "outlet", "sides", "grains")
"""Physical groups of the surface, numbered from 1."""

VOID, POCKETS = 5, 6
"""Numbers of the groups of parts of the void that reach from inlet to outlet, and of those that do not."""


class Void(NamedTuple):
    """The void of a box.

    Parameters
    ----------
    faces : Faces
        Its surface, in units of ``length``.
    patch_of : ndarray of int, shape (n_faces,)
        Row of each face in `PATCHES`.
    length : float
        The unit [m].
    size : float
        Edge of the tetrahedra, in units of ``length``.
    """

    faces: Faces
    patch_of: Ints
    length: float
    size: float


def patches(faces: Faces, lower: Floats, upper: Floats, axis: int) -> Ints:
    """Return the row in `PATCHES` of each face of a box's void."""
    patch_of = np.full(len(faces.loops), PATCHES.index("grains"), dtype=np.int64)
    for row, loops in enumerate(faces.loops):
        corners = faces.points[loops[0]]
        # How far the farthest corner lies from each of the six walls.
        below, above = np.abs(corners - lower).max(axis=0), np.abs(corners - upper).max(axis=0)
        if below[axis] < ON_WALL:
            patch_of[row] = PATCHES.index("inlet")
        elif above[axis] < ON_WALL:
            patch_of[row] = PATCHES.index("outlet")
        elif np.minimum(below, above).min() < ON_WALL:
            patch_of[row] = PATCHES.index("sides")
    return patch_of


def script(void: Void, report: list[str]) -> str:
    """Return the script: points, lines, plane faces, and a volume for each part of the void."""
    faces = void.faces
    edges, rows = _edges(faces)
    lines = [
        *(f"// {line}" for line in report),
        "Mesh.MshFileVersion = 2.2;  // gmshToFoam reads no later one",
        f"Mesh.ScalingFactor = {void.length:.17g};  // from the units below to metres",
        f"Mesh.CharacteristicLengthMax = {void.size:.9g};",
        "Mesh.OptimizeThreshold = 0.5;",
        *filled("Point(%d) = {%.17g, %.17g, %.17g};", _numbered(faces.points), np.ones(len(faces.points), int)),
        *filled("Line(%d) = {%d, %d};", _numbered(edges + 1), np.ones(len(edges), int)),
    ]
    loop = 0
    for k, loops in enumerate(rows):
        bounds = []
        for signed in loops:
            loop += 1
            bounds.append(loop)
            lines.append(f"Curve Loop({loop}) = {{{_told(signed)}}};")
        lines.append(f"Plane Surface({k + 1}) = {{{_told(bounds)}}};")
    for k, name in enumerate(PATCHES):
        if len(own := np.flatnonzero(void.patch_of == k) + 1):
            lines.append(f'Physical Surface("{name}", {k + 1}) = {{{_told(own.tolist())}}};')
    return "\n".join([*lines, *_volumes(void), ""])


def is_through(void: Void, part: list[list[int]]) -> bool:
    """Return whether a part of the void reaches from the inlet to the outlet."""
    return {0, 1} <= set(void.patch_of[[face for shell in part for face in shell]].tolist())


def _volumes(void: Void) -> list[str]:
    """Return the lines that make the volumes and their groups."""
    lines: list[str] = []
    groups: dict[int, list[int]] = {VOID: [], POCKETS: []}
    shells = 0
    for number, part in enumerate(void.faces.parts, 1):
        first = shells + 1
        for shell in part:
            shells += 1
            lines.append(f"Surface Loop({shells}) = {{{_told([face + 1 for face in shell])}}};")
        lines.append(f"Volume({number}) = {{{_told(range(first, shells + 1))}}};")
        groups[VOID if is_through(void, part) else POCKETS].append(number)
    for group, name in ((VOID, "void"), (POCKETS, "pockets")):
        if groups[group]:
            lines.append(f'Physical Volume("{name}", {group}) = {{{_told(groups[group])}}};')
    return lines


def _edges(faces: Faces) -> tuple[Ints, list[list[list[int]]]]:
    """Return the ends of every edge once, and for each loop of each face its edges from 1, negative where reversed."""
    number: dict[tuple[int, int], int] = {}
    rows = []
    for loops in faces.loops:
        signed = []
        for loop in loops:
            pairs = zip(loop, [*loop[1:], loop[0]], strict=True)
            signed.append([
                number.setdefault((a, b), len(number) + 1) if a < b else -number.setdefault((b, a), len(number) + 1)
                for a, b in pairs
            ])  # fmt: skip
        rows.append(signed)
    return np.array(list(number), dtype=np.int64), rows


def _numbered(values: NDArray[np.generic]) -> NDArray[np.object_]:
    """Return rows with their numbers from 1 before them, whole numbers kept whole."""
    table = np.empty((len(values), values.shape[1] + 1), dtype=object)
    table[:, 0], table[:, 1:] = np.arange(1, len(values) + 1), values
    return table


def _told(numbers: range | list[int]) -> str:
    return ", ".join(map(str, numbers))


def surface(void: Void) -> str:
    """Return the surface as MSH 4.1, one entity and one physical group a patch."""
    faces = void.faces
    points = faces.points * void.length
    patch_of = void.patch_of[faces.face_of]
    present = np.unique(patch_of).tolist()
    names = "".join(f'2 {k + 1} "{PATCHES[k]}"\n' for k in present)
    text = [f"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n{len(present)}\n{names}$EndPhysicalNames\n"]
    text.append(f"$Entities\n0 0 {len(present)} 0\n")
    for k in present:
        corners = points[faces.triangles[patch_of == k]].reshape(-1, 3)
        [box] = table_of_text(np.concatenate([corners.min(axis=0), corners.max(axis=0)])[None], digits=16)
        text.append(f"{k + 1} {box} 1 {k + 1} 0\n")
    n = len(points)
    tags = "\n".join(map(str, range(1, n + 1)))
    places = "\n".join(table_of_text(points, digits=16))
    # All on the first surface: the patches share the points of their rims.
    text.append(f"$EndEntities\n$Nodes\n1 {n} 1 {n}\n2 {present[0] + 1} 0 {n}\n{tags}\n{places}\n$EndNodes\n")
    text.append(f"$Elements\n{len(present)} {len(patch_of)} 1 {len(patch_of)}\n")
    done = 0
    for k in present:
        rows = faces.triangles[patch_of == k] + 1
        numbered = np.column_stack([np.arange(done + 1, done + len(rows) + 1), rows])
        done += len(rows)
        body = "\n".join(rows_of_text(numbered, np.full(len(rows), 4)))
        text.append(f"2 {k + 1} 2 {len(rows)}\n{body}\n")
    return "".join([*text, "$EndElements\n"])
