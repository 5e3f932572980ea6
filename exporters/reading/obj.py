"""Wavefront OBJ, kept in single precision as most readers keep it.

A grain is a piece: faces that hang together by their vertices, of one ``o`` where there are any. Groups, materials,
normals and textures say nothing about that.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from exporters.reading.pieces import connected, open_objects, places, tell, within
from exporters.reading.rebuild import from_soup, unit_of, with_classes
from grainsdem.errors import FileFormatError, shown
from grainsdem.ragged import offsets_from_counts, take_indices

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import Packing

_CLASS = re.compile(r"class_(\d{1,9})")

IS_LOCAL = False
ROUNDINGS = 1

_MOST = 2**62
"""Number of a vertex that fits into what numbers are kept in."""


class _Mesh(NamedTuple):
    """What is read before it is known what is a grain."""

    vertices: NDArray[np.float32]
    corners: NDArray[np.int64]
    offsets: NDArray[np.int64]
    objects: NDArray[np.int64]
    names: list[str]
    classes: NDArray[np.int64]


def read(path: Path) -> Packing:
    """Read an OBJ file; every ``o`` begins a grain, and every further piece under it is one more.

    Pieces share vertices by number. Where such pieces are not closed, as when every face has vertices of its own, those
    of an object share them by place.
    """
    # "utf-8-sig": editors put a byte-order mark before the first word.
    text = path.read_text(encoding="utf-8-sig", errors="replace")
    mesh = _parsed(path, text)
    grain_of = _grains(mesh)
    tell(path, "objects", mesh.names, mesh.objects, grain_of)
    order = np.argsort(grain_of, kind="stable")
    rows, offsets = take_indices(mesh.offsets, order)
    head = text.partition("\n")[0]
    length = unit_of(head) if head.startswith("#") else 1.0
    packing = from_soup(path, mesh.vertices[mesh.corners[rows]], offsets, grain_of[order], length)
    _, first = np.unique(grain_of, return_index=True)
    return with_classes(packing, mesh.classes[first])


def _grains(mesh: _Mesh) -> NDArray[np.int64]:
    """Return the grain of each face."""
    by_number = within(mesh.objects, mesh.corners, mesh.offsets)
    pieces = connected(by_number, mesh.offsets)
    if pieces.max(initial=-1) == mesh.objects.max(initial=-1):
        return pieces
    is_open = open_objects(mesh.objects, mesh.corners, mesh.offsets)
    by_place = places(mesh.vertices)[mesh.corners]
    welded = np.where(np.repeat(is_open[mesh.objects], np.diff(mesh.offsets)), by_place, mesh.corners)
    return connected(within(mesh.objects, welded, mesh.offsets), mesh.offsets)


def _statements(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the number and the words of each line; a backslash at its end goes on with the next one."""
    words: list[str] = []
    begun, goes_on = 1, False
    for number, line in enumerate(text.split("\n"), 1):
        begun, words = (begun, words) if goes_on else (number, [])
        words += line.partition("#")[0].split()
        goes_on = bool(words) and words[-1].endswith("\\")
        if goes_on:
            words[-1] = words[-1][:-1]
            if not words[-1]:
                words.pop()
        elif words:
            yield begun, words
    if goes_on and words:
        yield begun, words


def _parsed(path: Path, text: str) -> _Mesh:
    """Return vertices, the faces' corners counted from 0, and the object of each face."""
    points: list[tuple[float, float, float]] = []
    corners: list[int] = []
    counts: list[int] = []
    lines: list[int] = []
    object_of: list[int] = []
    names = ["before the first"]
    own, classes = -1, []
    for line, words in _statements(text):
        if words[0] == "v":
            try:
                points.append((float(words[1]), float(words[2]), float(words[3])))
            except (ValueError, IndexError) as error:
                raise FileFormatError(
                    f"{path}, line {line}: a vertex has three numbers; got {shown(words[1:])}"
                ) from error
        elif words[0] == "f":
            loop = _loop(path, line, words[1:], len(points))
            corners += loop
            counts.append(len(loop))
            lines.append(line)
            object_of.append(len(names) - 1)
            classes.append(own)
        elif words[0] == "g":
            found = _CLASS.fullmatch(" ".join(words[1:]))
            own = int(found[1]) if found else -1
        elif words[0] == "o":
            names.append(" ".join(words[1:]) or "without a name")
    loops = np.array(corners, dtype=np.int64)
    beyond = np.flatnonzero(loops >= len(points))
    offsets = offsets_from_counts(counts)
    if beyond.size:
        line = lines[int(np.searchsorted(offsets, beyond[0], side="right")) - 1]
        raise FileFormatError(
            f"{path}, line {line}: a face names vertex {loops[beyond[0]] + 1}; the file has {len(points)}"
        )
    with np.errstate(over="ignore"):  # beyond single precision it is infinite, which validation names
        vertices = np.array(points, dtype=np.float64).reshape(-1, 3).astype(np.float32)
    used, dense = np.unique(np.array(object_of, dtype=np.int64), return_inverse=True)
    told = np.array(classes, dtype=np.int64)
    return _Mesh(vertices, loops, offsets, dense.ravel(), [names[k] for k in used], told)


def _loop(path: Path, line: int, words: list[str], n_before: int) -> list[int]:
    """Return the corners of a face counted from 0; negative ones count back from the last vertex before the face."""
    try:
        numbers = [int(word.partition("/")[0]) for word in words]
    except ValueError as error:
        raise FileFormatError(
            f"{path}, line {line}: a corner is a number of a vertex, as v, v/vt, v//vn or v/vt/vn; got {shown(words)}"
        ) from error
    if len(numbers) < 3:
        raise FileFormatError(f"{path}, line {line}: a face has three corners or more; got {len(numbers)}")
    if max(numbers) > _MOST:
        raise FileFormatError(f"{path}, line {line}: a face names vertex {shown(max(numbers))}; no file has so many")
    if 0 in numbers or min(numbers) < -n_before:
        bad = next(number for number in numbers if number == 0 or number < -n_before)
        raise FileFormatError(
            f"{path}, line {line}: a face names vertex {shown(bad)}; they count from 1, or back from -1 to -{n_before}"
        )
    return [number - 1 if number > 0 else number + n_before for number in numbers]
