"""Boxes around grains, and the pairs of boxes that are near one another: a grid walked in linear time.

Every box is entered into all grid cells that it covers, so that grains of very different sizes share one grid:
a large grain covers many cells, but large grains are few. A pair is taken only in the one cell that holds the
lower corner of the boxes' intersection, so no pair is found twice, whatever the number of threads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.ragged import offsets_from_counts, owners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain, Packing

    Floats = NDArray[np.float64]

MOST_CELLS_A_BOX = 64
"""The grid is coarsened until boxes cover fewer cells than this on average."""


FEW = 16
"""Partners of a box that are kept from the counting; the few boxes that have more are searched twice."""


def boxes(packing: Packing) -> tuple[Floats, Floats]:
    """Return the axis-aligned box of every grain in the world.

    Returns
    -------
    lower, upper : ndarray, shape (n, 3)
        Corners [m]; a grain without vertices has the box of its position alone.
    """
    lower, upper = packing.positions.copy(), packing.positions.copy()
    g = packing.grains
    in_blocks(_bound, len(g), g.vertices, g.vertex_offsets, to_matrices(packing.quaternions), lower, upper)
    return lower, upper


def near_pairs(lower: Floats, upper: Floats, within: float = 0.0) -> NDArray[np.int32]:
    """Return the pairs of boxes that are no farther apart than ``within``.

    Parameters
    ----------
    lower, upper : ndarray, shape (n, 3)
        Corners of the boxes [m].
    within : float
        Largest distance [m] between two boxes of a pair; at zero, boxes that touch or overlap.

    Returns
    -------
    ndarray of int32, shape (m, 2)
        Pairs i < j, sorted.

    Raises
    ------
    ShapeError
        If the corners are not two arrays of the same shape (n, 3).
    InputError
        If a corner is not finite, an upper corner lies below its lower one, or ``within`` is negative.
    """
    lower = np.require(lower, np.float64, ["C", "W"])  # one layout: another would compile the kernels again
    upper = np.require(upper, np.float64, ["C", "W"])
    if lower.ndim != 2 or lower.shape[1] != 3 or lower.shape != upper.shape:
        raise ShapeError(f"boxes must be two arrays of shape (n, 3); got {lower.shape} and {upper.shape}")
    if not (np.isfinite(within) and within >= 0):
        raise InputError(f"within must be zero or more and finite; got {within}")
    bad = np.flatnonzero(~(np.isfinite(lower) & np.isfinite(upper) & (lower <= upper)).all(axis=1))
    if bad.size:
        raise InputError(f"boxes must be finite and run upward; {bad.size} do not: {name_offenders(bad)}")
    within = float(within)
    n = len(lower)
    if n < 2:
        return np.empty((0, 2), dtype=np.int32)
    first, last = _cover(lower, upper, within)
    most = int(np.prod(last - first + 1, axis=1).sum())
    bits = most.bit_length()  # a table about as long as it has entries
    grid = Grid(lower, upper, first, last, *_fill(first, last, bits, most), bits)
    counts = np.empty(n, dtype=np.int64)
    table = np.empty((n, FEW), dtype=np.int32)
    in_blocks(_match, n, grid, within, counts, table)
    offsets = offsets_from_counts(counts)
    partners = np.empty(offsets[-1], dtype=np.int32)
    in_blocks(_gather, n, grid, within, table, offsets, partners)
    return np.stack([owners(offsets).astype(np.int32), partners], axis=1)


class Grid(NamedTuple):
    """Boxes and the buckets that the cells they cover are scattered over.

    Parameters
    ----------
    lower, upper : ndarray, shape (n, 3)
        Corners [m].
    first, last : ndarray of int64, shape (n, 3)
        First and last cell of each box.
    starts : ndarray of int64, shape (2 ** bits + 1,)
        Boxes of bucket b are ``entries[starts[b]:starts[b + 1]]``.
    entries : ndarray of int32, shape (k,)
        Boxes, each once a bucket.
    bits : int
        Logarithm of the number of buckets.
    """

    lower: Floats
    upper: Floats
    first: NDArray[np.int64]
    last: NDArray[np.int64]
    starts: NDArray[np.int64]
    entries: NDArray[np.int32]
    bits: int


class Images(NamedTuple):
    """Pairs of grains, each with the periodic image of the second that is meant.

    Parameters
    ----------
    pairs : ndarray of int32, shape (m, 2)
        Grain ids i <= j, sorted.
    shifts : ndarray of int32, shape (m, 3)
        Image of j, in whole domain lengths; zeros without periodic axes.
    """

    pairs: NDArray[np.int32]
    shifts: NDArray[np.int32]


def near_images(packing: Packing, within: float = 0.0) -> Images:
    """Return the pairs of grains whose boxes are within a distance, across periodic boundaries too.

    Parameters
    ----------
    packing : Packing
        Any packing.
    within : float
        Largest distance [m] between the boxes.

    Returns
    -------
    Images
        Each pair once for each image that is near; a grain meets itself where the domain is small.
    """
    lower, upper = boxes(packing)
    # Corners were rounded: moved outward by a few units in the last place, the boxes are certain again.
    margin = 4 * np.finfo(float).eps * np.maximum(np.abs(lower), np.abs(upper)) + 4 * np.finfo(float).tiny
    return near_in(packing.domain, lower - margin, upper + margin, within)


def near_in(domain: Domain, lower: Floats, upper: Floats, within: float = 0.0) -> Images:
    """Return the pairs of boxes within a distance [m] in a domain; boxes by their corners [m], shape (n, 3) each."""
    if not domain.periodic.any():
        pairs = near_pairs(lower, upper, within)
        return Images(pairs, np.zeros((len(pairs), 3), dtype=np.int32))
    return _wrapped(domain, lower, upper, within)


def _wrapped(domain: Domain, lower: Floats, upper: Floats, within: float) -> Images:
    """Find pairs among the boxes moved into the domain and the images of those that reach over its edge."""
    period = np.where(domain.periodic, domain.lengths, np.inf)
    home = np.where(domain.periodic, np.floor((0.5 * (lower + upper) - domain.lower) / domain.lengths), 0.0)
    span = np.where(home == 0, 0.0, home * domain.lengths)
    lower, upper = lower - span, upper - span
    # A box reaches farther than half of itself from the domain; so may the one that it meets.
    reach = (upper - lower).max(axis=0, initial=0.0) + within
    rings = np.where(domain.periodic, np.ceil(reach / period), 0).astype(int)
    ids, moves = [np.arange(len(lower))], [np.zeros((len(lower), 3), dtype=np.int64)]
    for step in np.ndindex(*(2 * rings + 1)):
        move = np.asarray(step) - rings
        if not move.any():
            continue
        offset = move * np.where(domain.periodic, domain.lengths, 0.0)
        near = (upper + offset >= domain.lower - reach) & (lower + offset <= domain.upper + reach)
        found = np.flatnonzero((near | ~domain.periodic).all(axis=1))
        ids.append(found)
        moves.append(np.broadcast_to(move, (found.size, 3)))
    image, move = np.concatenate(ids), np.concatenate(moves)
    offset = move * np.where(domain.periodic, domain.lengths, 0.0)
    pairs = near_pairs(lower[image] + offset, upper[image] + offset, within)
    pairs = pairs[pairs[:, 0] < len(lower)]  # one of the two at home: every pair has such a copy
    i, j = image[pairs[:, 0]], image[pairs[:, 1]]
    shifts = move[pairs[:, 1]] - home[j].astype(np.int64) + home[i].astype(np.int64)
    return _once(i, j, shifts)


def _once(i: NDArray[np.int64], j: NDArray[np.int64], shifts: NDArray[np.int64]) -> Images:
    """Turn every pair to i <= j and keep one of each, sorted."""
    # (j, i) at the opposite shift is the same contact; a grain and itself are turned by the shift's sign.
    leading = shifts[np.arange(len(shifts)), np.argmax(shifts != 0, axis=1)] if len(shifts) else np.empty(0)
    turn = (i > j) | ((i == j) & (leading < 0))
    rows = np.column_stack([np.where(turn, j, i), np.where(turn, i, j), np.where(turn[:, None], -shifts, shifts)])
    rows = np.unique(rows, axis=0)
    return Images(rows[:, :2].astype(np.int32), rows[:, 2:].astype(np.int32))


def _cover(lower: Floats, upper: Floats, within: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and last grid cell of each box, widened by half of ``within``."""
    origin = lower.min(axis=0) - within
    extent = upper - lower + within
    size = float(np.median(extent.max(axis=1)))
    span = float((upper.max(axis=0) - origin).max()) + within
    # 2**40 cells along an axis at most: their numbers stay exact in a float.
    size = max(size, span / 2**40, np.finfo(float).tiny)
    while True:
        first = np.floor((lower - 0.5 * within - origin) / size).astype(np.int64)
        last = np.floor((upper + 0.5 * within - origin) / size).astype(np.int64)
        if float(np.prod((last - first + 1).astype(float), axis=1).mean()) <= MOST_CELLS_A_BOX:
            return first, last
        size *= 2.0


@njit(cache=True, nogil=True)
def _bound(
    start: int,
    stop: int,
    vertices: Floats,
    vertex_offsets: NDArray[np.int64],
    matrices: Floats,
    lower: Floats,
    upper: Floats,
) -> None:
    for i in range(start, stop):
        for c in range(3):
            low, high = np.inf, -np.inf
            for k in range(vertex_offsets[i], vertex_offsets[i + 1]):
                x = matrices[i, c, 0] * vertices[k, 0] + matrices[i, c, 1] * vertices[k, 1]
                x += matrices[i, c, 2] * vertices[k, 2]
                low, high = min(low, x), max(high, x)
            if low <= high:
                lower[i, c] += low
                upper[i, c] += high


@njit(cache=True, inline="always")
def _bucket(x: int, y: int, z: int, bits: int) -> int:
    """Scatter a cell over the table: the grid need not be stored, however empty it is."""
    key = np.uint64(x) * np.uint64(0x9E3779B97F4A7C15)
    key = (key ^ (key >> np.uint64(29)) ^ np.uint64(y)) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(32)) ^ np.uint64(z)) * np.uint64(0x94D049BB133111EB)
    return int((key ^ (key >> np.uint64(31))) >> np.uint64(64 - bits))


def _fill(
    first: NDArray[np.int64], last: NDArray[np.int64], bits: int, most: int
) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """Enter each box once into every bucket that one of its cells falls in: ``most`` entries, or fewer."""
    n = 1 << bits
    starts, ends, latest = np.zeros(n + 1, np.int64), np.zeros(n, np.int64), np.full(n, -1, np.int32)
    entries = np.empty(most, dtype=np.int32)
    _enter(first, last, bits, starts, ends, latest, entries)
    return starts, entries[: starts[-1]]


@njit(cache=True)
def _enter(
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    bits: int,
    starts: NDArray[np.int64],
    ends: NDArray[np.int64],
    latest: NDArray[np.int32],
    entries: NDArray[np.int32],
) -> None:
    """Count the entries of each bucket in a first round, and write them in a second."""
    for writes in range(2):
        for i in range(len(first)):
            for x in range(first[i, 0], last[i, 0] + 1):
                for y in range(first[i, 1], last[i, 1] + 1):
                    for z in range(first[i, 2], last[i, 2] + 1):
                        b = _bucket(x, y, z, bits)
                        if latest[b] == i:
                            continue
                        latest[b] = i
                        if writes:
                            entries[ends[b]] = i
                        ends[b] += 1
        if writes:
            return
        for b in range(ends.size):
            starts[b + 1] = starts[b] + ends[b]
            ends[b] = starts[b]
            latest[b] = -1


@inner
def _find_partners(grid: Grid, within: float, i: int, row: NDArray[np.int32]) -> int:
    """Fill the partners j > i of a box, as many as there is room for; return how many there are."""
    lower, upper, first, last, starts, entries, bits = grid
    found = 0
    for x in range(first[i, 0], last[i, 0] + 1):
        for y in range(first[i, 1], last[i, 1] + 1):
            for z in range(first[i, 2], last[i, 2] + 1):
                b = _bucket(x, y, z, bits)
                for e in range(starts[b], starts[b + 1]):
                    j = entries[e]
                    # The cell of the intersection's lower corner; other cells of the same bucket fail here.
                    if j <= i or x != max(first[i, 0], first[j, 0]) or y != max(first[i, 1], first[j, 1]):
                        continue
                    if z != max(first[i, 2], first[j, 2]):
                        continue
                    square = 0.0
                    for k in range(3):
                        apart = max(lower[i, k] - upper[j, k], lower[j, k] - upper[i, k], 0.0)
                        square += apart * apart
                    if square > within * within:
                        continue
                    if found < row.size:
                        row[found] = j
                    found += 1
    return found


@njit(cache=True, nogil=True)
def _match(
    start: int, stop: int, grid: Grid, within: float, counts: NDArray[np.int64], table: NDArray[np.int32]
) -> None:
    for i in range(start, stop):
        counts[i] = _find_partners(grid, within, i, table[i])


@inner
def _sort(row: NDArray[np.int32]) -> None:
    """Sort a row, mostly of a few numbers (Shell 1959, with Knuth's steps): numba's own takes long to compile."""
    step = 1
    while 3 * step < row.size:
        step = 3 * step + 1
    while step > 0:
        for k in range(step, row.size):
            value, place = row[k], k
            while place >= step and row[place - step] > value:
                row[place] = row[place - step]
                place -= step
            row[place] = value
        step //= 3


@njit(cache=True, nogil=True)
def _gather(
    start: int,
    stop: int,
    grid: Grid,
    within: float,
    table: NDArray[np.int32],
    offsets: NDArray[np.int64],
    partners: NDArray[np.int32],
) -> None:
    """Put the partners of all boxes one after another, in rising order; those that the table had no room for anew."""
    for i in range(start, stop):
        row = partners[offsets[i] : offsets[i + 1]]
        if row.size <= table.shape[1]:
            for k in range(row.size):
                row[k] = table[i, k]
        else:
            _find_partners(grid, within, i, row)
        _sort(row)
