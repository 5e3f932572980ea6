"""STL, binary or ASCII, kept in single precision as every reader keeps it."""

from __future__ import annotations

import re
import warnings
from typing import TYPE_CHECKING

import numpy as np

from exporters.meshes.stl import RECORD, TABLE
from exporters.reading.pieces import connected, places, tell, within
from exporters.reading.rebuild import from_soup, unit_of, with_classes
from grainsdem.errors import FileFormatError, shown
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import Packing

_CLASS = r"\bclass (\d{1,9})\b"

IS_LOCAL = False
ROUNDINGS = 1


def read(path: Path) -> Packing:
    """Read an STL file; binary with the table of triangles beside it, where there is one.

    Without the table triangles that share a vertex are of one grain, in ASCII those of one ``solid``.
    """
    content = path.read_bytes()
    n = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + RECORD.itemsize * n:
        corners = np.frombuffer(content, RECORD, offset=84)["corners"]
        table, head = path.with_name(path.stem + TABLE), content[:80].decode("latin-1")
        if not table.is_file():
            packing = _gathered(path, corners, _pieces(corners, np.zeros(n, dtype=np.int64)), head)
            of_all = re.search(_CLASS, head)
            return packing if of_all is None else with_classes(packing, [int(of_all[1])])
        grain_of, classes = _from_table(table, len(corners))
        packing = _gathered(path, corners, grain_of, head)
        return packing if classes is None else with_classes(packing, classes)
    text = content.decode("utf-8-sig", "replace")
    if not text.lstrip().lower().startswith("solid"):
        raise FileFormatError(f"{path}: neither ASCII STL nor binary STL of {n} triangles; it has {len(content)} bytes")
    corners, solids, names = _from_text(path, text)
    grain_of = _pieces(corners, solids)
    tell(path, "solids", names, solids, grain_of)
    packing = _gathered(path, corners, grain_of, text.lstrip().partition("\n")[0])
    told = [re.search(_CLASS, name) for name in names]
    _, first = np.unique(grain_of, return_index=True)
    own = [told[solid] for solid in solids[first].tolist()]
    return packing if None in own else with_classes(packing, [int(found[1]) for found in own if found])


def _gathered(path: Path, corners: NDArray[np.float32], grain_of: NDArray[np.int64], head: str) -> Packing:
    """Return triangles as a packing, those of a grain brought together."""
    order = np.argsort(grain_of, kind="stable")
    offsets = 3 * np.arange(len(corners) + 1)
    return from_soup(path, corners[order].reshape(-1, 3), offsets, grain_of[order], unit_of(head))


def _pieces(corners: NDArray[np.float32], solids: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the piece of each triangle, none in two solids."""
    offsets = 3 * np.arange(len(corners) + 1)
    return connected(within(solids, places(corners.reshape(-1, 3)), offsets), offsets)


def _from_text(path: Path, text: str) -> tuple[NDArray[np.float32], NDArray[np.int64], list[str]]:
    """Return triangles, the number of the solid of each, and the names of the solids."""
    points: list[tuple[float, float, float]] = []
    solid_of: list[int] = []
    names: list[str] = []
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split()
        # Words may be in capitals, names keep theirs.
        word = words[0].lower() if words else ""
        if word == "solid":
            names.append(" ".join(words[1:]) or "without a name")
        elif word == "vertex":
            try:
                points.append((float(words[1]), float(words[2]), float(words[3])))
            except (ValueError, IndexError) as error:
                raise FileFormatError(
                    f"{path}, line {number}: a vertex has three numbers; got {shown(words[1:])}"
                ) from error
        elif word == "endfacet":
            if not names:
                raise FileFormatError(f"{path}, line {number}: a facet before the first solid")
            solid_of.append(len(names) - 1)
            if len(points) != 3 * len(solid_of):
                raise FileFormatError(f"{path}, line {number}: a facet has three vertices")
    if len(points) != 3 * len(solid_of):
        raise FileFormatError(f"{path}: ends within a facet: it has {len(points)} vertices, and {len(solid_of)} facets")
    with np.errstate(over="ignore"):  # beyond single precision it is infinite, which validation names
        corners = np.array(points, dtype=np.float64).astype(np.float32).reshape(len(solid_of), 3, 3)
    used, dense = np.unique(np.array(solid_of, dtype=np.int64), return_inverse=True)
    return corners, dense.ravel(), [names[k] for k in used]


def _from_table(table: Path, n_triangles: int) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """Return the grain of each triangle as the side table says, and each grain's class where it tells them."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a table without rows
            _, first, counts, *classes = np.loadtxt(table, delimiter=",", skiprows=1, dtype=np.int64, ndmin=2).T
    except (ValueError, OverflowError) as error:
        raise FileFormatError(f"{table}: not a table of grain, first triangle, number of triangles") from error
    offsets = np.append(first, n_triangles)
    if not first.size or first[0] != 0 or (counts < 1).any() or (np.diff(offsets) != counts).any():
        raise FileFormatError(f"{table}: its grains are not those of the {n_triangles} triangles beside it")
    return owners(offsets), classes[0] if classes else None
