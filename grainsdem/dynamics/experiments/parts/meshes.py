"""Meshes of parts, as the convex hulls that they collide with."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.foreign import refusing
from grainsdem.model.arrays import LONGEST

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

SUFFIXES = (".stl", ".obj")

HOLLOW = 1e-3
"""Share of a hull's volume that a mesh may lack and still be convex: files round corners to six digits."""


def read_hulls(path: str | os.PathLike[str]) -> list[Floats]:
    """Return the corners [of the file's unit] of the convex hull of each piece of a mesh, each of shape (n, 3).

    Parameters
    ----------
    path : str or path-like
        ``.stl`` or ``.obj``. Each connected piece is a convex body of its own; one that is not convex is taken as its
        hull, and a warning says so.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it has another suffix, or holds no solid.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: a body's mesh is .stl or .obj; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    # What overflows or is no number is refused by its result.
    with np.errstate(all="ignore"):
        pieces = _pieces(path)
        hulls = [_hull(path, piece) for piece in pieces]
        parted = enumerate(zip(pieces, hulls, strict=True))
        hollow = [number for number, (piece, hull) in parted if _is_hollow(piece, hull)]
    if hollow:
        which = "it" if len(pieces) == 1 else f"pieces {', '.join(map(str, hollow))}"
        LOG.warning("%s: not convex; %s collides as the convex hull, with its hollows filled", path, which)
    return [np.asarray(hull.vertices, dtype=np.float64) for hull in hulls]


def _pieces(path: Path) -> list[Any]:
    """Return the connected pieces of a file, as trimesh has them."""
    import trimesh

    with refusing(path, "not a mesh"):
        # From a stream: nothing beside it is looked for.
        with path.open("rb") as stream:
            mesh: Any = trimesh.load(stream, file_type=path.suffix[1:].lower(), force="mesh")
        if not (np.abs(mesh.vertices) < LONGEST).all():
            raise FileFormatError("its vertices must be finite, and within any length")
        pieces = list(mesh.split(only_watertight=False)) if len(mesh.faces) else []
    if not pieces:
        raise FileFormatError(f"{path}: no mesh: there are no faces in it")
    return pieces


def _hull(path: Path, piece: Any) -> Any:
    """Return the convex hull of a piece."""
    try:
        hull = piece.convex_hull
    except Exception as error:  # what qhull says of flat pieces
        raise FileFormatError(f"{path}: a piece of {len(piece.vertices)} corners is flat, and no solid") from error
    if not hull.volume > 0:
        raise FileFormatError(f"{path}: a piece of {len(piece.vertices)} corners has no volume")
    return hull


def _is_hollow(piece: Any, hull: Any) -> bool:
    """Return whether a piece fills less than its hull; one that is not closed has no inside at all."""
    return not piece.is_watertight or abs(float(piece.volume)) < (1 - HOLLOW) * float(hull.volume)


def check_length(name: str, value: float, limit: float, of: str) -> None:
    """Raise `InputError` where a length [m] is not below that of what it has to fit into."""
    if value >= limit:
        raise InputError(f"{name} is {value:.4g} m; it must be below {limit:.4g} m, {of}")
