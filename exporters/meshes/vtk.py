"""VTK's XML files: polygons (``.vtp``), or one polyhedron a grain (``.vtu``), with every grain's measures on its cells.

The numbers stand behind the XML as they are in memory, so that they are read as they were written, and fast.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from exporters.check import check_choice, check_name, measured
from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import table
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

POLYHEDRON = 42
"""VTK's number of a cell that is a polyhedron."""

_KINDS = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "u1": "UInt8"}
_BLOCK = 1 << 18


@dataclass(frozen=True, slots=True, kw_only=True)
class VtkOptions:
    """What the cells carry.

    Parameters
    ----------
    measures : bool
        Whether every cell has its grain's measures, all columns of `grainsdem.table`, beside the grain's id.
    precision : {"single", "double"}
        Of the measures; points are in double precision.

    Raises
    ------
    InputError
        If the precision is not one of those allowed.
    """

    measures: bool = True
    precision: Literal["single", "double"] = "single"

    def __post_init__(self) -> None:
        check_choice("precision", self.precision, ("single", "double"))


Options = VtkOptions

LOSES = (
    "Measures are in single precision unless precision is double; the points are exact.",
    "Measures that are words, and poses, are not carried: the points are in the world.",
)
"""What the format does not carry."""


class _Array(NamedTuple):
    """One array of the file: its name, its values, and how often each row of them stands in the file."""

    name: str
    values: NDArray[Any]
    repeats: NDArray[np.int64] | None = None

    @property
    def size(self) -> int:
        """Bytes in the file."""
        width = self.values.itemsize * int(np.prod(self.values.shape[1:]))
        return width * (len(self.values) if self.repeats is None else int(self.repeats.sum()))

    def blocks(self) -> Iterator[bytes]:
        """Yield the values as they stand in the file."""
        for start in range(0, len(self.values), _BLOCK):
            block = self.values[start : start + _BLOCK]
            if self.repeats is not None:
                block = np.repeat(block, self.repeats[start : start + _BLOCK], axis=0)
            yield block.tobytes()


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".vtp", options: VtkOptions | None = None
) -> dict[str, Iterator[bytes]]:
    """Return the one file: the grains' faces as polygons, or for ``.vtu`` the grains as polyhedra.

    Each cell has its grain's ``id``. No vertex is shared between grains.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    measured(packing)
    options = options or VtkOptions()
    build = _polyhedra if suffix.lower() == ".vtu" else _polygons
    return {f"{name}{suffix}": build(packing, options)}


def series(
    packing: Packing,
    times: ArrayLike,
    positions: ArrayLike,
    quaternions: ArrayLike,
    *,
    name: str = "bed",
    options: VtkOptions | None = None,
) -> dict[str, bytes | Iterator[bytes]]:
    """Return a time series for ParaView: ``bed.pvd``, which lists the times, and a ``.vtp`` file a time.

    Parameters
    ----------
    packing : Packing
        The grains; their poses are those of each time.
    times : array_like, shape (t,)
        Times [s].
    positions : array_like, shape (t, n, 3)
        Centroids [m] at each time.
    quaternions : array_like, shape (t, n, 4)
        Rotations (w, x, y, z) at each time.
    name : str
        Name of the files without suffix.
    options : VtkOptions, optional
        Those of `files`.

    Raises
    ------
    InputError
        If there is no time, or a packing cannot be written.
    ShapeError
        If positions or quaternions are not those of the packing's grains.
    """
    check_name(name)
    moments = np.asarray(times, dtype=np.float64)
    t, n = moments.size, len(packing)
    if moments.ndim != 1 or t == 0:
        raise InputError(f"a time series needs at least one time; got times of shape {moments.shape}")
    places, turns = np.asarray(positions, dtype=np.float64), np.asarray(quaternions, dtype=np.float64)
    if (places.shape, turns.shape) != ((t, n, 3), (t, n, 4)):
        raise ShapeError(
            f"positions must be of shape ({t}, {n}, 3) and quaternions of shape ({t}, {n}, 4), for {t} times and the "
            f"packing's {n} grains; got {places.shape} and {turns.shape}"
        )
    options = options or VtkOptions()
    moved = [
        replace(packing, positions=place, quaternions=turn, links=None)
        for place, turn in zip(places, turns, strict=True)
    ]
    for state in moved:
        measured(state)
    digits = max(4, len(str(t - 1)))
    names = [f"{name}.{k:0{digits}d}.vtp" for k in range(t)]
    rows = "".join(
        f'<DataSet timestep="{time!r}" part="0" file={quoteattr(file)}/>\n'
        for time, file in zip(moments.tolist(), names, strict=True)
    )
    index = (
        '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
        f"<Collection>\n{rows}</Collection>\n</VTKFile>\n"
    )
    frames = {file: _polygons(state, options) for file, state in zip(names, moved, strict=True)}
    return {f"{name}.pvd": index.encode(), **frames}


def _polygons(packing: Packing, options: VtkOptions) -> Iterator[bytes]:
    """Return the file of one polygon a face."""
    grains = packing.grains
    pieces = {
        "Points": [_Array("Points", world_vertices(packing))],
        "Polys": [
            _Array("connectivity", _global_corners(packing)),
            _Array("offsets", grains.face_vertex_offsets[1:]),
        ],
        "CellData": _measures(packing, options, np.diff(grains.face_offsets)),
    }
    counts = f'NumberOfPoints="{len(grains.vertices)}" NumberOfPolys="{grains.n_faces}"'
    return _file("PolyData", counts, pieces)


def _polyhedra(packing: Packing, options: VtkOptions) -> Iterator[bytes]:
    """Return the file of one polyhedron a grain."""
    grains = packing.grains
    faces, face_ends = _face_stream(packing)
    pieces = {
        "Points": [_Array("Points", world_vertices(packing))],
        "Cells": [
            _Array("connectivity", np.arange(len(grains.vertices))),
            _Array("offsets", grains.vertex_offsets[1:]),
            _Array("types", np.full(len(grains), POLYHEDRON, dtype=np.uint8)),
            _Array("faces", faces),
            _Array("faceoffsets", face_ends),
        ],
        "CellData": _measures(packing, options, None),
    }
    counts = f'NumberOfPoints="{len(grains.vertices)}" NumberOfCells="{len(grains)}"'
    return _file("UnstructuredGrid", counts, pieces)


def _global_corners(packing: Packing) -> NDArray[np.int64]:
    """Return the corners of all faces as indices into all vertices, shape (n_corners,)."""
    grains = packing.grains
    corner_counts = np.diff(grains.face_vertex_offsets[grains.face_offsets])
    return grains.face_vertices.astype(np.int64) + np.repeat(grains.vertex_offsets[:-1], corner_counts)


def _face_stream(packing: Packing) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return, a grain: number of faces, then for each face the number of its corners and the corners; and its end."""
    grains = packing.grains
    n_faces = grains.n_faces
    face_counts = np.diff(grains.face_offsets)
    corner_ends = grains.face_vertex_offsets
    ends = corner_ends[grains.face_offsets[1:]] + grains.face_offsets[1:] + np.arange(1, len(grains) + 1)
    stream = np.empty(ends[-1], dtype=np.int64)
    stream[np.concatenate([[0], ends[:-1]])] = face_counts
    # Each face stands behind the corners and counts of those before it, and behind the heads of its own and earlier
    # grains.
    heads = owners(grains.face_offsets) + 1
    places = corner_ends[:-1] + np.arange(n_faces) + heads
    stream[places] = np.diff(corner_ends)
    shift = np.repeat(places + 1 - corner_ends[:-1], np.diff(corner_ends))
    stream[np.arange(corner_ends[-1]) + shift] = _global_corners(packing)
    return stream, ends


def _measures(packing: Packing, options: VtkOptions, repeats: NDArray[np.int64] | None) -> list[_Array]:
    """Return the arrays on the cells, each grain's value as often as it has cells."""
    rows = table(packing)
    arrays = [_Array("id", np.arange(len(packing), dtype=np.int32), repeats)]
    if options.measures:
        real = np.float32 if options.precision == "single" else np.float64
        for column in rows.dtype.names or ():
            kind = rows.dtype[column].kind
            if column != "id" and kind in "fi":
                arrays.append(_Array(column, rows[column].astype(real if kind == "f" else np.int32), repeats))
    return arrays


def _file(kind: str, counts: str, pieces: dict[str, list[_Array]]) -> Iterator[bytes]:
    """Yield a file: its XML, then the arrays one after another, each behind its size."""
    lines = [
        '<?xml version="1.0"?>',
        f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        f"<{kind}><Piece {counts}>",
    ]
    start = 0
    for part, arrays in pieces.items():
        lines.append(f"<{part}>")
        for array in arrays:
            width = array.values.shape[1] if array.values.ndim > 1 else 1
            lines.append(
                f'<DataArray type="{_KINDS[array.values.dtype.str[1:]]}" Name={quoteattr(array.name)} '
                f'NumberOfComponents="{width}" format="appended" offset="{start}"/>'
            )
            start += 8 + array.size
        lines.append(f"</{part}>")
    lines += [f"</Piece></{kind}>", '<AppendedData encoding="raw">', "_"]
    yield "\n".join(lines).encode()
    for arrays in pieces.values():
        for array in arrays:
            yield array.size.to_bytes(8, "little")
            yield from array.blocks()
    yield b"\n</AppendedData>\n</VTKFile>\n"
