"""Which faces of a mesh hang together: a grain is one piece, whatever objects and groups a file puts it under."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import name_offenders
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from numpy.typing import NDArray

    Ints = NDArray[np.int64]

_log = logging.getLogger(__name__)


def connected(keys: Ints, offsets: Ints) -> Ints:
    """Return the piece of each face, numbered by its first face; faces that share a corner are of one piece.

    Parameters
    ----------
    keys : ndarray of int64, shape (c,)
        What each corner is, one face after another: equal numbers are one corner.
    offsets : ndarray of int64, shape (m + 1,)
        Corners of face i are ``keys[offsets[i]:offsets[i + 1]]``.
    """
    from scipy.sparse import coo_array  # noqa: PLC0415  (a third of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  (the same)

    m = offsets.size - 1
    _, dense = np.unique(keys, return_inverse=True)
    n = int(dense.max(initial=-1)) + 1
    links = (np.ones(keys.size), (owners(offsets), m + dense.ravel()))
    _, labels = connected_components(coo_array(links, shape=(m + n, m + n)), directed=False)
    _, first, pieces = np.unique(labels[:m], return_index=True, return_inverse=True)
    ranks = np.empty(first.size, dtype=np.int64)
    ranks[np.argsort(first)] = np.arange(first.size)
    result: Ints = ranks[pieces.ravel()]
    return result


def places(points: NDArray[np.float32]) -> Ints:
    """Return a number for each point, shape (k,), equal where the points are equal to the bit."""
    # Zero has two signs; it gets one.
    bits = (points + np.float32(0.0)).view(np.int32)
    order = np.lexsort(bits.T)
    differs = (bits[order[1:]] != bits[order[:-1]]).any(axis=1)
    numbers = np.zeros(len(points), dtype=np.int64)
    numbers[order[1:]] = np.cumsum(differs)
    return numbers


def within(objects: Ints, keys: Ints, offsets: Ints) -> Ints:
    """Return keys of corners that no two objects share."""
    shared: Ints = np.repeat(objects, np.diff(offsets)) * (int(keys.max(initial=0)) + 1) + keys
    return shared


def open_objects(objects: Ints, keys: Ints, offsets: Ints) -> NDArray[np.bool_]:
    """Return which objects, shape (n,), have an edge that does not part two faces."""
    last = offsets[1:] - 1
    following = np.arange(1, keys.size + 1)
    following[last] = offsets[:-1]
    ends = np.sort(np.stack([keys, keys[following]], axis=1), axis=1)
    of_corner = np.repeat(objects, np.diff(offsets))
    edges, counts = np.unique(np.column_stack([of_corner, ends]), axis=0, return_counts=True)
    is_open = np.zeros(int(objects.max(initial=-1)) + 1, dtype=bool)
    is_open[edges[counts != 2, 0]] = True
    return is_open


def tell(path: Path, word: str, names: Sequence[str], objects: Ints, pieces: Ints) -> None:
    """Log which objects of a file hold more than one piece, since ids then no longer count objects."""
    _, first = np.unique(pieces, return_index=True)
    counts = np.bincount(objects[first], minlength=len(names))
    several = np.flatnonzero(counts > 1).tolist()
    # One object around everything names no grains.
    if several and np.count_nonzero(counts) > 1:
        listed = name_offenders([f"{names[k]} ({counts[k]})" for k in several])
        _log.warning("%s: every piece is a grain of its own; more than one have %s %s", path, word, listed)
