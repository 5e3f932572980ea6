"""STL, binary or ASCII, kept in single precision as every reader keeps it."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import numpy as np

from exporters.meshes.stl import RECORD
from exporters.reading.rebuild import from_soup
from grainsdem.errors import FileFormatError
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import Packing

IS_LOCAL = False
ROUNDINGS = 1


def read(path: Path) -> Packing:
    """Read an STL file; binary with the table of grains beside it, where there is one.

    Without the table, triangles that share a vertex are of one grain.
    """
    content = path.read_bytes()
    n = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + RECORD.itemsize * n:
        corners = np.frombuffer(content, RECORD, offset=84)["corners"]
        table = path.with_name(f"{path.stem}.grains.csv")
        grain_of = _from_table(table, len(corners)) if table.is_file() else _connected(corners)
        order = np.argsort(grain_of, kind="stable")
        return from_soup(path, corners[order], grain_of[order], _unit(content[:80].decode("latin-1")))
    if content[:5] != b"solid":
        raise FileFormatError(f"{path}: neither ASCII STL nor binary STL of {n} triangles; it has {len(content)} bytes")
    text = content.decode("utf-8", "replace")
    return from_soup(path, *_from_text(path, text), _unit(text.partition("\n")[0]))


def _unit(line: str) -> float:
    """Return what length [m] is one, as our writer says where it is not a metre."""
    found = re.search(r"\bunit (\S+) m\b", line)
    return float(found[1]) if found else 1.0


def _from_text(path: Path, text: str) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """Return triangles and the number of the solid of each."""
    numbers: list[list[str]] = []
    grain_of: list[int] = []
    grain = -1
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "solid":
            grain += 1
        elif words[0] == "vertex":
            numbers.append(words[1:4])
        elif words[0] == "endfacet":
            grain_of.append(grain)
    try:
        corners = np.array(numbers, dtype=np.float32).reshape(len(grain_of), 3, 3)
    except ValueError as error:
        raise FileFormatError(f"{path}: not three vertices of three numbers in every facet") from error
    _, dense = np.unique(np.array(grain_of, dtype=np.int64), return_inverse=True)
    return corners, dense


def _from_table(table: Path, n_triangles: int) -> NDArray[np.int64]:
    """Return the grain of each triangle as the side table says."""
    try:
        _, first, counts = np.loadtxt(table, delimiter=",", skiprows=1, dtype=np.int64, ndmin=2).T
    except ValueError as error:
        raise FileFormatError(f"{table}: not a table of grain, first triangle, number of triangles") from error
    offsets = np.append(first, n_triangles)
    if first[0] != 0 or (counts < 1).any() or (np.diff(offsets) != counts).any():
        raise FileFormatError(f"{table}: its grains are not those of the {n_triangles} triangles beside it")
    return owners(offsets)


def _connected(corners: NDArray[np.float32]) -> NDArray[np.int64]:
    """Return the component of each triangle, numbered by its first."""
    from scipy.sparse import coo_array  # noqa: PLC0415  (a third of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  (the same)

    m = len(corners)
    _, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    n = int(index.max(initial=-1)) + 1
    edges = (np.ones(3 * m), (np.repeat(np.arange(m), 3), m + index.ravel()))
    _, labels = connected_components(coo_array(edges, shape=(m + n, m + n)), directed=False)
    _, first, dense = np.unique(labels[:m], return_index=True, return_inverse=True)
    ranks = np.empty(len(first), dtype=np.int64)
    ranks[np.argsort(first)] = np.arange(len(first))
    result: NDArray[np.int64] = ranks[dense.ravel()]
    return result
