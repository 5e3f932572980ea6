"""PLY, binary: one mesh, each vertex or each face with its grain's id."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.check import check_choice, check_name, measured, stretches
from exporters.meshes.union import united, what_united
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.ragged import offsets_from_counts, owners, sum_rows

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from grainsdem.model import Packing, Polyhedra

MOST_CORNERS = 255
"""Corners of a face that its one byte can count; VTK takes no wider count."""

IDS = ("vertex", "face", "none")
"""Where the ids of grains may stand."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlyOptions:
    """What the faces are, how exact the vertices, and where ids stand.

    Parameters
    ----------
    polygons : bool
        The grains' own faces, for ParaView, MeshLab or Blender; else triangles, since some readers take no faces of
        different numbers of corners. A face of more than 255 corners, which PLY does not count, is cut into such.
    double : bool
        Vertices in double precision; in single, which is what Gmsh reads, a grain of a wide bed loses some 1e-6 of its
        volume.
    ids : {"vertex", "face", "none"}
        Whether the grain, and its class where it has one, is a property of every vertex, which most readers take or
        pass over; of every face, which meshio does not read; or left out, for Gmsh.
    merge : bool
        One surface, the union of all grains, of triangles and without ids.

    Raises
    ------
    InputError
        If ids is not one of those allowed.
    """

    polygons: bool = False
    double: bool = True
    ids: Literal["vertex", "face", "none"] = "vertex"
    merge: bool = False

    def __post_init__(self) -> None:
        check_choice("ids", self.ids, IDS)


Options = PlyOptions

LOSES = (
    "Polygons are cut into triangles, unless polygons is chosen.",
    "Masses, densities and poses are not carried.",
    "Readers may round vertices to single precision, as VTK does.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".ply", options: PlyOptions | None = None
) -> dict[str, Iterator[bytes]]:
    """Return the one file: vertices in metres, which grains do not share, with the property ``grain``, and faces.

    Where grains have classes, that of a vertex's grain is its property ``class``.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    measured(packing)
    options = options or PlyOptions()
    if options.merge:
        packing, options = united(packing), replace(options, ids="none")
    return {f"{name}{suffix}": _content(packing, options)}


def report(packing: Packing, options: PlyOptions) -> dict[str, Any]:
    """Return what merging does to the grains; nothing where they are not merged."""
    return what_united(packing) if options.merge else {}


def _content(packing: Packing, options: PlyOptions) -> Iterator[bytes]:
    grains = packing.grains
    real = "double" if options.double else "float"
    words = ["grain", *(["class"] if packing.classes is not None else [])]
    counts = np.diff(grains.face_vertex_offsets)
    n_faces = int((_n_parts(counts) if options.polygons else np.maximum(counts - 2, 0)).sum())
    marked = [f"property int {word}" for word in words]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres",
        f"element vertex {len(grains.vertices)}",
        *(f"property {real} {axis}" for axis in "xyz"),
        *(marked if options.ids == "vertex" else []),
        f"element face {n_faces}",
        "property list uchar int vertex_indices",
        *(marked if options.ids == "face" else []),
        "end_header",
    ]
    yield ("\n".join(header) + "\n").encode()
    for first, part in stretches(packing):
        marks = _marks(part, first, options.ids == "vertex")
        yield _vertices(part, marks, "<f8" if options.double else "<f4").tobytes()
    faces = _polygons if options.polygons else _triangles
    for first, part in stretches(packing):
        marks = _marks(part, first, options.ids == "face")
        yield faces(part.grains, marks, grains.vertex_offsets[first : first + len(part)]).tobytes()


def _marks(part: Packing, first: int, is_marked: bool) -> NDArray[np.int64]:
    """Return what each grain of a stretch is marked with: its number and class, or nothing, shape (n, k)."""
    numbers = np.arange(first, first + len(part))
    columns = [numbers] if part.classes is None else [numbers, part.classes.astype(np.int64)]
    return np.column_stack(columns)[:, : len(columns) * is_marked]


def _vertices(part: Packing, marks: NDArray[np.int64], real: str) -> NDArray[Any]:
    """Return the vertices in the world with their grain's marks."""
    ids = owners(part.grains.vertex_offsets)
    records = np.empty(len(ids), dtype=[("place", real, 3), ("marks", "<i4", marks.shape[1])])
    records["place"] = world_vertices(part)
    records["marks"] = marks[ids]
    return records


def _triangles(grains: Polyhedra, marks: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[Any]:
    """Return the triangles of grains with their marks, whose vertices start where it is said."""
    cut = triangles(grains, apexes=best_apexes(grains))
    ids = owners(cut.offsets)
    records = np.empty(len(ids), dtype=[("count", "u1"), ("corners", "<i4", 3), ("marks", "<i4", marks.shape[1])])
    records["count"] = 3
    records["corners"] = cut.indices + starts[ids][:, None]
    records["marks"] = marks[ids]
    return records


def _polygons(grains: Polyhedra, marks: NDArray[np.int64], starts: NDArray[np.int64]) -> NDArray[Any]:
    """Return the faces of such grains as bytes: how many corners in one, the corners and the marks in four each."""
    grains = _counted_by_a_byte(grains)
    ids = owners(grains.face_offsets)
    counts = np.diff(grains.face_vertex_offsets)
    corners = grains.face_vertices.astype(np.int64) + np.repeat(starts[ids], counts)
    besides = 1 + 4 * marks.shape[1]
    heads = 4 * grains.face_vertex_offsets[:-1] + besides * np.arange(counts.size)
    content = np.empty(4 * corners.size + besides * counts.size, dtype=np.uint8)
    content[heads] = counts
    for k, numbers in enumerate(marks.T):
        _put(content, heads + 4 * counts + 1 + 4 * k, numbers[ids])
    _put(content, 4 * np.arange(corners.size) + np.repeat(besides * np.arange(counts.size) + 1, counts), corners)
    return content


def _n_parts(counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return how many faces a byte can count faces of so many corners become; two parts share two corners."""
    parts: NDArray[np.int64] = np.maximum(-(-(counts - 2) // (MOST_CORNERS - 2)), 1)
    return parts


def _counted_by_a_byte(grains: Polyhedra) -> Polyhedra:
    """Return the grains, faces of more corners cut along chords from their first one."""
    counts = np.diff(grains.face_vertex_offsets)
    if counts.max(initial=0) <= MOST_CORNERS:
        return grains
    loops: list[NDArray[np.int32]] = []
    for f in range(counts.size):
        loop = grains.face_vertices[grains.face_vertex_offsets[f] : grains.face_vertex_offsets[f + 1]]
        starts = range(1, max(loop.size - 1, 2), MOST_CORNERS - 2)
        loops += [np.concatenate([loop[:1], loop[start : start + MOST_CORNERS - 1]]) for start in starts]
    return replace(
        grains,
        face_offsets=offsets_from_counts(sum_rows(_n_parts(counts), grains.face_offsets)),
        face_vertices=np.concatenate(loops),
        face_vertex_offsets=offsets_from_counts([loop.size for loop in loops]),
    )


def _put(content: NDArray[np.uint8], places: NDArray[np.int64], values: NDArray[np.int64]) -> None:
    """Write values as int32 at some places of the content."""
    content[places[:, None] + np.arange(4)] = values.astype("<i4").view(np.uint8).reshape(-1, 4)
