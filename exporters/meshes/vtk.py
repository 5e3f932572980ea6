"""VTK's XML files: polygons (``.vtp``), or one polyhedron a grain (``.vtu``), with every grain's measures on its cells.

The numbers stand behind the XML as they are in memory, so that they are read as they were written, and fast.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np

from exporters.check import check_choice, check_name, measured, stretches
from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import table
from grainsdem.packing.carve import subset
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
    by_corners : bool
        Grains with few corners first, in place of the order of their ids: meshio, which keeps polyhedra by their
        numbers of corners, does not read them in another. The cells' ``id`` says which is which.

    Raises
    ------
    InputError
        If the precision is not one of those allowed.
    """

    measures: bool = True
    precision: Literal["single", "double"] = "single"
    by_corners: bool = False

    def __post_init__(self) -> None:
        check_choice("precision", self.precision, ("single", "double"))


Options = VtkOptions

LOSES = (
    "Measures are in single precision unless precision is double; the points are exact.",
    "Measures that are words, and poses, are not carried: the points are in the world.",
)
"""What the format does not carry."""


class _Array(NamedTuple):
    """One array of the file: name, type, numbers a row, number of rows, and what makes its blocks."""

    name: str
    dtype: np.dtype[Any]
    width: int
    n_rows: int
    blocks: Callable[[], Iterator[NDArray[Any]]]

    @property
    def size(self) -> int:
        """Bytes in the file."""
        return self.dtype.itemsize * self.width * self.n_rows


def _whole(name: str, values: NDArray[Any], repeats: NDArray[np.int64] | None = None) -> _Array:
    """Return an array that is there already, each value as often in the file as ``repeats`` says."""

    def blocks() -> Iterator[NDArray[Any]]:
        for start in range(0, len(values), _BLOCK):
            block = values[start : start + _BLOCK]
            yield block if repeats is None else np.repeat(block, repeats[start : start + _BLOCK])

    return _Array(name, values.dtype, 1, len(values) if repeats is None else int(repeats.sum()), blocks)


def _made(
    packing: Packing, make: Callable[[int, Packing], NDArray[Any]], *, name: str, n_rows: int, width: int = 1
) -> _Array:
    """Return an array that is made of a stretch of grains at a time, whose first has a number."""
    kind = np.dtype(np.int64 if width == 1 else np.float64)
    return _Array(name, kind, width, n_rows, lambda: (make(first, part) for first, part in stretches(packing)))


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
    ids = np.arange(len(packing))
    if options.by_corners:
        ids = np.argsort(np.diff(packing.grains.vertex_offsets), kind="stable")
        packing = subset(packing, ids)
    return {f"{name}{suffix}": build(packing, options, ids)}


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
    moved = [_moved(packing, place, turn) for place, turn in zip(places, turns, strict=True)]
    for state in moved:
        if len(state):
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
    frames = {file: _polygons(state, options, np.arange(len(state))) for file, state in zip(names, moved, strict=True)}
    return {f"{name}.pvd": index.encode(), **frames}


def _moved(packing: Packing, positions: NDArray[np.float64], quaternions: NDArray[np.float64]) -> Packing:
    """Return the grains of a frame: those that are absent have no numbers there."""
    moved = replace(packing, positions=positions, quaternions=quaternions, links=None)
    is_absent = np.isnan(positions).all(axis=1)
    return subset(moved, np.flatnonzero(~is_absent)) if is_absent.any() else moved


def _polygons(packing: Packing, options: VtkOptions, ids: NDArray[np.int64]) -> Iterator[bytes]:
    """Return the file of one polygon a face."""
    grains = packing.grains

    def corners(first: int, part: Packing) -> NDArray[np.int64]:
        return _corners(part, int(grains.vertex_offsets[first]))

    pieces = {
        "Points": [_points(packing)],
        "Polys": [
            _made(packing, corners, name="connectivity", n_rows=len(grains.face_vertices)),
            _whole("offsets", grains.face_vertex_offsets[1:]),
        ],
        "CellData": _measures(packing, options, ids, np.diff(grains.face_offsets)),
    }
    counts = f'NumberOfPoints="{len(grains.vertices)}" NumberOfPolys="{grains.n_faces}"'
    return _file("PolyData", counts, pieces)


def _polyhedra(packing: Packing, options: VtkOptions, ids: NDArray[np.int64]) -> Iterator[bytes]:
    """Return the file of one polyhedron a grain."""
    grains = packing.grains
    n = len(grains)
    face_ends = grains.face_vertex_offsets[grains.face_offsets[1:]] + grains.face_offsets[1:] + np.arange(1, n + 1)

    def corners(first: int, part: Packing) -> NDArray[np.int64]:
        start = int(grains.vertex_offsets[first])
        return np.arange(start, start + len(part.grains.vertices), dtype=np.int64)

    def faces(first: int, part: Packing) -> NDArray[np.int64]:
        return _face_stream(part, int(grains.vertex_offsets[first]))

    pieces = {
        "Points": [_points(packing)],
        "Cells": [
            _made(packing, corners, name="connectivity", n_rows=len(grains.vertices)),
            _whole("offsets", grains.vertex_offsets[1:]),
            _whole("types", np.full(n, POLYHEDRON, dtype=np.uint8)),
            _made(packing, faces, name="faces", n_rows=int(face_ends[-1])),
            _whole("faceoffsets", face_ends),
        ],
        "CellData": _measures(packing, options, ids, None),
    }
    counts = f'NumberOfPoints="{len(grains.vertices)}" NumberOfCells="{n}"'
    return _file("UnstructuredGrid", counts, pieces)


def _points(packing: Packing) -> _Array:
    """Return the vertices in the world."""
    n = len(packing.grains.vertices)
    return _made(packing, lambda _, part: world_vertices(part), name="Points", n_rows=n, width=3)


def _corners(packing: Packing, first: int) -> NDArray[np.int64]:
    """Return the corners of all faces as indices into the vertices, the first of which has a number."""
    grains = packing.grains
    corner_counts = np.diff(grains.face_vertex_offsets[grains.face_offsets])
    return grains.face_vertices.astype(np.int64) + np.repeat(first + grains.vertex_offsets[:-1], corner_counts)


def _face_stream(packing: Packing, first: int) -> NDArray[np.int64]:
    """Return, a grain: number of faces, then for each face the number of its corners and the corners."""
    grains = packing.grains
    corner_ends = grains.face_vertex_offsets
    ends = corner_ends[grains.face_offsets[1:]] + grains.face_offsets[1:] + np.arange(1, len(grains) + 1)
    stream = np.empty(ends[-1], dtype=np.int64)
    stream[np.concatenate([[0], ends[:-1]])] = np.diff(grains.face_offsets)
    # Each face stands behind the corners and counts of those before it, and behind the heads of its own and earlier
    # grains.
    places = corner_ends[:-1] + np.arange(grains.n_faces) + owners(grains.face_offsets) + 1
    stream[places] = np.diff(corner_ends)
    shift = np.repeat(places + 1 - corner_ends[:-1], np.diff(corner_ends))
    stream[np.arange(corner_ends[-1]) + shift] = _corners(packing, first)
    return stream


def _measures(
    packing: Packing, options: VtkOptions, ids: NDArray[np.int64], repeats: NDArray[np.int64] | None
) -> list[_Array]:
    """Return the arrays on the cells, each grain's value as often as it has cells."""
    rows = table(packing)
    arrays = [_whole("id", ids.astype(np.int32), repeats)]
    if options.measures:
        real = np.float32 if options.precision == "single" else np.float64
        for column in rows.dtype.names or ():
            kind = rows.dtype[column].kind
            if column != "id" and kind in "fi":
                arrays.append(_whole(column, rows[column].astype(real if kind == "f" else np.int32), repeats))
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
            width = f' NumberOfComponents="{array.width}"' if array.width > 1 else ""
            lines.append(
                # Where there is one component none are told: meshio makes a column of what says 1.
                f'<DataArray type="{_KINDS[array.dtype.str[1:]]}" Name={quoteattr(array.name)}'
                f'{width} format="appended" offset="{start}"/>'
            )
            start += 8 + array.size
        lines.append(f"</{part}>")
    lines += [f"</Piece></{kind}>", '<AppendedData encoding="raw">', "_"]
    yield "\n".join(lines).encode()
    for arrays in pieces.values():
        for array in arrays:
            yield array.size.to_bytes(8, "little")
            for block in array.blocks():
                yield block.tobytes()
    yield b"\n</AppendedData>\n</VTKFile>\n"
