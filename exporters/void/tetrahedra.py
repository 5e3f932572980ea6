"""What Gmsh made of a script of the void: volume and quality of its tetrahedra."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import FileFormatError, MissingFileError
from grainsdem.foreign import refusing
from grainsdem.model.arrays import LONGEST, SHORTEST

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

_REGULAR = np.array([[1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0], [0.5, np.sqrt(1 / 12), np.sqrt(2 / 3)]])
"""Three edges of the regular tetrahedron, a row each."""


@dataclass(frozen=True, slots=True)
class Quality:
    """Tetrahedra of a mesh.

    Parameters
    ----------
    n_tetrahedra : int
        How many.
    volume : float
        Of all together [m³].
    least_angle, greatest_angle : float
        Between two faces of one tetrahedron [rad].
    least_sicn, mean_sicn : float
        Gmsh's signed inverse condition number: 1 for the regular tetrahedron, 0 for a flat one, negative for one turned
        inside out.
    """

    n_tetrahedra: int
    volume: float
    least_angle: float
    greatest_angle: float
    least_sicn: float
    mean_sicn: float


def quality(path: str | os.PathLike[str]) -> Quality:
    """Return volume and quality of the tetrahedra of a mesh, as Gmsh filled it.

    Parameters
    ----------
    path : str or path-like
        MSH 2.2 as text, which the void's script asks for.

    Raises
    ------
    MissingFileError
        If the file is not there.
    FileFormatError
        If it is none of that format, or holds no tetrahedron.
    """
    corners = _corners(Path(path))
    edges = corners[:, 1:] - corners[:, :1]
    angles = _angles(corners)
    shape = _conditions(edges)
    return Quality(
        n_tetrahedra=len(corners),
        volume=float(np.linalg.det(edges).sum() / 6),
        least_angle=float(angles.min()),
        greatest_angle=float(angles.max()),
        least_sicn=float(shape.min()),
        mean_sicn=float(shape.mean()),
    )


def _conditions(edges: Floats) -> Floats:
    """Return the signed inverse condition numbers of tetrahedra, with respect to the regular one."""
    maps = np.linalg.inv(_REGULAR) @ (edges / np.abs(edges).max(axis=(1, 2), keepdims=True))
    # The inverse's norm from the cofactors: a flat one has no inverse.
    cofactors = np.stack([np.cross(maps[:, k - 2], maps[:, k - 1]) for k in range(3)], axis=1)
    norms = np.linalg.norm(maps, axis=(1, 2)) * np.linalg.norm(cofactors, axis=(1, 2))
    return np.asarray(np.divide(3 * np.linalg.det(maps), norms, out=np.zeros(len(maps)), where=norms > 0))


def _angles(corners: Floats) -> Floats:
    """Return the six angles [rad] between faces of each tetrahedron, shape (6, n)."""
    angles = []
    for first, last in combinations(range(4), 2):
        a, b = (k for k in range(4) if k not in (first, last))
        along = corners[:, last] - corners[:, first]
        along /= np.linalg.norm(along, axis=1, keepdims=True)
        sides = [corners[:, k] - corners[:, first] for k in (a, b)]
        across = [side - (side * along).sum(axis=1, keepdims=True) * along for side in sides]
        sine = (np.cross(across[0], across[1]) * along).sum(axis=1)
        angles.append(np.abs(np.arctan2(sine, (across[0] * across[1]).sum(axis=1))))
    return np.array(angles)


def _corners(path: Path) -> Floats:
    """Return the corners [m] of all tetrahedra, shape (n, 4, 3)."""
    if not path.exists():
        raise MissingFileError(f"{path}: not there; fill the void's script first: gmsh -3")
    with refusing(path, "not a mesh in MSH 2.2"):
        lines = path.read_text(encoding="utf-8").splitlines()
        if lines[1].split()[:2] != ["2.2", "0"]:
            raise FileFormatError(f"its version must be 2.2, as text; got {lines[1][:20]!r}")
        first, last = lines.index("$Nodes") + 2, lines.index("$EndNodes")
        nodes = np.array([line.split() for line in lines[first:last]], dtype=np.float64)
        first, last = lines.index("$Elements") + 2, lines.index("$EndElements")
        rows = [line.split() for line in lines[first:last]]
        # Kind 4 is the tetrahedron; its corners are the last four numbers.
        told = np.array([row[-4:] for row in rows if row[1] == "4"], dtype=np.int64)
        if len(told) == 0:
            raise FileFormatError("it holds no tetrahedron")
        order = np.argsort(nodes[:, 0])
        at = order[np.searchsorted(nodes[order, 0], told)]
        if (nodes[at, 0] != told).any():
            raise FileFormatError("a corner of a tetrahedron is no node")
        corners = np.asarray(nodes[at, 1:4])
        if not (np.isfinite(corners).all() and np.abs(corners).max() < LONGEST):
            raise FileFormatError(f"coordinates must be finite and below {LONGEST:.0e} m")
        if any(
            (np.abs(corners[:, a] - corners[:, b]).max(axis=1) < SHORTEST).any() for a, b in combinations(range(4), 2)
        ):
            raise FileFormatError("a tetrahedron has two corners in one place")
        return corners
