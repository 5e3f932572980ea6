"""Triangles of a file parted into bodies: closed surfaces, each wound outward."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import FileFormatError, name_offenders
from grainsdem.foreign import refusing
from grainsdem.geometry.soups import pieces, weld
from grainsdem.model.arrays import LONGEST

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

LOG = logging.getLogger(__name__)

_FLAT = 1e-9
"""Volume below which a body is flat, relative to the cube of its extent: single precision leaves more of any grain."""

_HEAD = 84
"""Bytes of a binary STL file before its triangles: a line of 80, and their number."""

_RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""A triangle of it."""


class Body(NamedTuple):
    """One closed surface.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        Its vertices, in the file's units.
    volume : float
        What it encloses, in the file's units.
    """

    points: Floats
    volume: float


def load(path: Path) -> tuple[Floats, Ints]:
    """Return the vertices of a file, shape (k, 3), and its triangles, shape (m, 3).

    Raises
    ------
    FileFormatError
        If it cannot be read, holds no faces, or vertices that are not finite.
    """
    with refusing(path, f"not a {path.suffix[1:].upper()} file that can be read"), np.errstate(all="ignore"):
        vertices, triangles = _stl(path) or _by_trimesh(path)
    if not len(triangles):
        raise FileFormatError(f"{path}: holds no faces")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise FileFormatError(f"{path}: faces name vertices 0 to {triangles.max()}; the file has {len(vertices)}")
    if not np.isfinite(vertices[triangles]).all():
        raise FileFormatError(f"{path}: has vertices that are not finite")
    if np.abs(vertices[triangles]).max() > LONGEST:
        raise FileFormatError(f"{path}: has vertices farther than {LONGEST:g} from the origin")
    return vertices, triangles


def _stl(path: Path) -> tuple[Floats, Ints] | None:
    """Return what a binary STL file holds; None for every other file."""
    if path.suffix.lower() != ".stl" or path.stat().st_size < _HEAD:
        return None
    with path.open("rb") as file:
        n = int.from_bytes(file.read(_HEAD)[80:], "little")
    if path.stat().st_size != _HEAD + n * _RECORD.itemsize:
        return None
    corners = np.fromfile(path, _RECORD, offset=_HEAD)["corners"]
    return corners.reshape(-1, 3).astype(np.float64), np.arange(3 * n).reshape(-1, 3)


def _by_trimesh(path: Path) -> tuple[Floats, Ints]:
    import trimesh

    # From a stream: nothing beside it is looked for.
    with path.open("rb") as stream:
        mesh: Any = trimesh.load(stream, file_type=path.suffix[1:].lower(), force="mesh", process=False)
    return np.array(mesh.vertices, np.float64).reshape(-1, 3), np.array(mesh.faces, np.int64).reshape(-1, 3)


def bodies(path: Path, vertices: Floats, triangles: Ints) -> list[Body]:
    """Return the bodies of a mesh, in the order of their first faces.

    Raises
    ------
    FileFormatError
        If a body is open, flat, wound both ways, or hollow. One that is inside out is turned, and a line logged.
    """
    # By place: STL has corners alone, and other files may give every face its own.
    corners = weld(vertices)[triangles]
    a, b, c = corners.T
    is_sound = (a != b) & (b != c) & (c != a)
    corners, triangles = corners[is_sound], triangles[is_sound]
    if not len(triangles):
        raise FileFormatError(f"{path}: flat: no triangle of it has three corners")
    found = pieces(vertices, triangles, corners)
    n = found.volumes.size
    _refuse(path, n, found.open_edges > 0, "open: edges that do not part two faces; close it first")
    _refuse(path, n, found.twisted_edges > 0, "wound both ways: faces side by side look to opposite sides")
    points = _points(vertices, corners, found.of, n)
    extents = np.array([np.ptp(own, axis=0).max() for own in points])
    _refuse(path, n, np.abs(found.volumes) <= _FLAT * extents**3, "flat: it encloses no volume")
    is_inside_out = found.volumes < 0
    _refuse(path, n, is_inside_out & _within(points), "hollow: a surface inside another, wound inward; fill it first")
    if is_inside_out.any():
        LOG.warning("%s: %sinside out, and turned", path, _named(n, np.flatnonzero(is_inside_out)))
    return [Body(own, abs(float(volume))) for own, volume in zip(points, found.volumes, strict=True)]


def _points(vertices: Floats, corners: Ints, piece_of: Ints, n: int) -> list[Floats]:
    """Return the vertices of each piece, each once."""
    if n == 1:
        is_used = np.zeros(len(vertices), dtype=bool)
        is_used[corners.ravel()] = True
        return [vertices[is_used]]
    order = np.argsort(piece_of, kind="stable")
    parted = np.split(corners[order], np.cumsum(np.bincount(piece_of, minlength=n))[:-1])
    return [vertices[np.unique(own)] for own in parted]


def _within(points: list[Floats]) -> NDArray[np.bool_]:
    """Return which clouds lie in the box of another that is larger."""
    lower, upper = (np.array([side(own, axis=0) for own in points]) for side in (np.min, np.max))
    result = np.zeros(len(points), dtype=bool)
    for k in range(len(points)):
        is_around = (lower < lower[k]).all(axis=1) & (upper > upper[k]).all(axis=1)
        result[k] = is_around.any()
    return result


def _refuse(path: Path, n: int, is_bad: NDArray[np.bool_], why: str) -> None:
    if is_bad.any():
        raise FileFormatError(f"{path}: {_named(n, np.flatnonzero(is_bad))}{why}")


def _named(n: int, rows: Ints) -> str:
    """Return which of several bodies are meant; nothing where there is one."""
    return "" if n == 1 else f"of {n} bodies {name_offenders(rows.tolist())}: "
