"""Shapes from files: the convex hull of each body, of few corners, and what that changes."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.forms.sizes import sphere_diameters
from grainsdem.geometry.hulls import outline
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.soups import farthest
from grainsdem.model.arrays import Noun
from grainsdem.shapes.ellipsoids import N_VERTICES
from grainsdem.shapes.scans.surfaces import bodies, load
from grainsdem.shapes.simplifying import FEWEST, simplified
from grainsdem.shapes.sizing import centred, check_positive, scaled, together

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

SUFFIXES = (".stl", ".obj", ".ply")
"""What shapes are read from."""

MOST_ADDED = 0.1
"""Share of its volume that the hull of a body may add before it is not convex."""

_MOST_POINTS = 100_000
"""Vertices of a body whose hull is taken of all; of more, of the farthest in each of as many directions."""

_SIDE = 128
"""Directions along each edge of a cube's faces: neighbours are less than a degree apart."""

_LARGE = 10.0
"""Diameter [m] of no grain: the file is in other units."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Scans(Noun):
    """Convex shapes that were read from files, and what was changed.

    Parameters
    ----------
    shapes : Polyhedra
        One for each body, about its centroid, turned as in its file.
    names : tuple of str
        File of each, and the number of its body where that has several: ``"heap.stl#3"``.
    volumes : array_like, shape (n,)
        Volume [m³] of each body in its file.
    added : array_like, shape (n,)
        Share of its volume that its convex hull adds: zero for a convex body.
    cut : array_like, shape (n,)
        Share of the hull's volume that was cut off with the corners that were left out.
    """

    shapes: Polyhedra
    names: tuple[str, ...]
    volumes: Floats
    added: Floats
    cut: Floats

    def __post_init__(self) -> None:
        n = len(self.shapes)
        object.__setattr__(self, "names", tuple(self.names))
        if len(self.names) != n:
            raise ShapeError(f"names must be one for each of {n} shapes; got {len(self.names)}")
        for name in ("volumes", "added", "cut"):
            self.freeze(name, np.float64, n)

    def __len__(self) -> int:
        return len(self.shapes)


@gated
def read(
    path: str | os.PathLike[str],
    *,
    unit: float = 1.0,
    n_vertices: int = N_VERTICES,
    concave: Literal["refuse", "hull"] = "refuse",
    keep: Literal["volume", "corners"] = "volume",
) -> Scans:
    """Read convex shapes from a scan, or from a folder of scans.

    Parameters
    ----------
    path : str or path-like
        A file (.stl, .obj, .ply), or a folder of such, taken in the order of their names. Each body of a file is a
        shape: a closed surface that shares no edge with another.
    unit : float
        What length [m] is one in the files: 1e-3 for millimetres.
    n_vertices : int
        Corners of a shape at most, four or more.
    concave : {"refuse", "hull"}
        What is done with a body whose hull adds more than a tenth to its volume: it is refused, or its hull is taken.
    keep : {"volume", "corners"}
        Whether a shape is scaled about its centroid to the volume of its body, so that it is as heavy, or left with
        corners of the scan, so that it is as long and wide. A convex body of no more corners than asked for is the same
        either way.

    Returns
    -------
    Scans
        Shapes, and for each the volume of its body, the share that the hull added and the share that was cut off with
        corners. Of a body of more than 100 000 vertices the hull is that of the farthest in each direction, which
        is short of a ten-thousandth of the volume at most.

    Raises
    ------
    MissingFileError
        If there is no such file or folder.
    FileFormatError
        If a file cannot be read, is empty, or a body of it is open, flat, wound both ways or hollow. One that is
        inside out is turned, and a warning logged.
    InputError
        If a body is not convex and that is refused, or an option is out of range.
    """
    check_positive(unit=unit)
    if n_vertices < FEWEST:
        raise InputError(f"a shape has {FEWEST} corners or more; got n_vertices = {n_vertices}")
    for name, value, allowed in (("concave", concave, ("refuse", "hull")), ("keep", keep, ("volume", "corners"))):
        if value not in allowed:
            raise InputError(f"{name} must be {allowed[0]!r} or {allowed[1]!r}; got {value!r}")
    parts, names, rows = [], [], []
    for file in _files(Path(path)):
        found = bodies(file, *load(file))
        for k, body in enumerate(found):
            names.append(file.name if len(found) == 1 else f"{file.name}#{k}")
            hull = outline(_outermost(body.points))
            added = hull.volume / body.volume - 1
            if added > MOST_ADDED and concave == "refuse":
                raise InputError(
                    f"{file.with_name(names[-1])}: not convex: its hull adds {added:.0%} to its volume, and "
                    f"{MOST_ADDED:.0%} may be; concave='hull' takes the hull"
                )
            shape, cut = simplified(hull, n_vertices)
            parts.append(centred(shape))
            rows.append((body.volume * unit**3, max(added, 0.0), cut))
    own, added_, cut_ = np.array(rows).T
    shapes = together(*parts)
    own_size = np.full(len(shapes), unit) if keep == "corners" else np.cbrt(own / volumes(shapes))
    shapes = scaled(shapes, own_size)
    _tell_of_size(Path(path), shapes)
    return Scans(shapes, tuple(names), own, added_, cut_)


def _files(path: Path) -> list[Path]:
    """Return the files that are meant, or raise the error of `read`."""
    if path.is_dir():
        found = sorted(file for file in path.iterdir() if file.suffix.lower() in SUFFIXES)
        if not found:
            raise MissingFileError(f"{path}: a folder without shapes: they are read from {', '.join(SUFFIXES)}")
        return found
    if path.suffix.lower() not in SUFFIXES:
        given = path.suffix or "no suffix"
        raise FileFormatError(f"{path}: shapes are read from {', '.join(SUFFIXES)} or a folder; got {given!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    return [path]


def _outermost(points: Floats) -> Floats:
    """Return the points that a hull is taken of: all, or of very many the farthest in each of very many directions.

    A hull takes long where most points are corners of it, as on a smooth scan.
    """
    if len(points) <= _MOST_POINTS:
        return points
    return points[farthest(points, _SIDE)]


def _tell_of_size(path: Path, shapes: Polyhedra) -> None:
    """Log where shapes are so large that the unit must be another."""
    largest = float(sphere_diameters(volumes(shapes)).max())
    if largest > _LARGE:
        LOG.warning("%s: a shape %.3g m across: is the file in other units? unit=1e-3 says millimetres", path, largest)
