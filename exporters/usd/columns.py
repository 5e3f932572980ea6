"""Where the values of many prims lie in a crate, and their bytes a stretch of prims at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.check import STRETCH
from exporters.usd.codes import rep
from exporters.usd.prims import KINDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.typing import NDArray

    from exporters.usd.prims import Column

    Bytes = NDArray[np.int64]

_TIME_SAMPLES = 46


class Shape(NamedTuple):
    """What one value of a column is.

    Parameters
    ----------
    code : int
        Number of its type.
    number : str
        Type of its numbers.
    width : int
        Numbers in a value, or in an element of a list.
    is_list : bool
        Whether it is a list.
    """

    code: int
    number: str
    width: int
    is_list: bool

    @property
    def size(self) -> int:
        """Bytes of a value or an element."""
        return int(np.dtype(self.number).itemsize) * self.width

    @property
    def is_inlined(self) -> bool:
        """Whether the value stands in the table itself: one number of four bytes."""
        return not self.is_list and self.size == 4

    @property
    def is_turn(self) -> bool:
        """Whether it is a quaternion, whose real part a crate has last."""
        return self.width == 4


def shape_of(kind: str) -> Shape:
    """Return the shape of values of a type by name."""
    return Shape(*KINDS[kind.removesuffix("[]")], kind.endswith("[]"))


def as_stored(shape: Shape, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return numbers in the type and order that they are stored in."""
    numbers = np.asarray(values, dtype=shape.number)
    return np.roll(numbers, -1, axis=-1) if shape.is_turn else numbers


def padded(sizes: Any) -> Any:
    """Return sizes in bytes made up to multiples of eight, which values begin at."""
    return -(-sizes // 8) * 8


def sizes_of(column: Column, shape: Shape, n: int) -> Bytes:
    """Return the bytes that each prim's value takes, shape (n,)."""
    if shape.is_inlined and column.times is None:
        return np.zeros(n, dtype=np.int64)
    if column.times is not None:
        return np.full(n, padded(column.times.size * shape.size) + 32 + 8 * column.times.size)
    if column.counts is not None:
        sizes: Bytes = padded(8 + np.asarray(column.counts, dtype=np.int64) * shape.size)
        return sizes
    return np.full(n, padded(shape.size))


def stretches(n: int) -> Iterator[tuple[int, int]]:
    """Yield the first prim of each stretch and the one after its last."""
    for first in range(0, n, STRETCH):
        yield first, min(first + STRETCH, n)


def layout(sizes: Bytes, start: int) -> Bytes:
    """Return where each value begins, shape (n, k), given their sizes: in a stretch one column after another."""
    places = np.empty_like(sizes)
    for first, last in stretches(len(sizes)):
        inside = sizes[first:last].T.ravel()
        ends = start + np.cumsum(inside)
        places[first:last] = (ends - inside).reshape(-1, last - first).T
        start = int(ends[-1])
    return places


def reps_of(column: Column, shape: Shape, places: Bytes) -> NDArray[np.uint64]:
    """Return what stands for each value in the table of fields, shape (n,)."""
    reps: NDArray[np.uint64]
    if column.times is not None:
        reps = rep(_TIME_SAMPLES, (places + padded(column.times.size * shape.size)).astype(np.uint64))
    elif shape.is_inlined:
        bits = as_stored(shape, column.rows(0, len(places))).reshape(-1).view("<u4").astype(np.uint64)
        reps = rep(shape.code, bits, is_inlined=True)
    else:
        reps = rep(shape.code, places.astype(np.uint64), is_list=shape.is_list)
    return reps


def blocks(
    columns: Sequence[tuple[Column, Shape]], sizes: Bytes, places: Bytes, times: dict[int, int]
) -> Iterator[bytes]:
    """Yield the values of all columns, stretch by stretch.

    Parameters
    ----------
    columns : sequence of (Column, Shape)
        What is written.
    sizes, places : ndarray, shape (n, k)
        Bytes of each value and where it begins.
    times : dict of int to int
        What stands for the times of each column that has samples.
    """
    for first, last in stretches(len(sizes)):
        for k, (column, shape) in enumerate(columns):
            if not sizes[first, k]:
                continue
            values = as_stored(shape, column.rows(first, last))
            if column.times is not None:
                yield _samples(values, shape, places[first:last, k], times[k])
            elif column.counts is not None:
                yield _lists(values, column.counts[first:last], sizes[first:last, k], shape)
            else:
                out = np.zeros((last - first, int(sizes[first, k])), dtype=np.uint8)
                out[:, : shape.size] = np.ascontiguousarray(values).view(np.uint8).reshape(last - first, shape.size)
                yield out.tobytes()


def _lists(values: NDArray[np.float64], counts: Bytes, sizes: Bytes, shape: Shape) -> bytes:
    """Return lists one after another: the number of elements, the elements, and what makes the size up."""
    words = shape.size // 4
    out = np.zeros(int(sizes.sum()) // 4, dtype=np.uint32)
    starts = (np.cumsum(sizes) - sizes) // 4
    out[starts] = counts
    lengths = np.asarray(counts, dtype=np.int64) * words
    # Elements stand two words after the start of their list, behind its number of elements.
    shifts = starts + 2 - (np.cumsum(lengths) - lengths)
    out[np.repeat(shifts, lengths) + np.arange(int(lengths.sum()))] = np.ascontiguousarray(values).view("<u4").ravel()
    return out.tobytes()


def _samples(values: NDArray[np.float64], shape: Shape, places: Bytes, times: int) -> bytes:
    """Return the samples of a stretch: the values, then the table of when and where they are."""
    n, t = values.shape[:2]
    room = int(padded(t * shape.size))
    out = np.zeros((n, room + 32 + 8 * t), dtype=np.uint8)
    out[:, : t * shape.size] = np.ascontiguousarray(values).view(np.uint8).reshape(n, -1)
    table = np.empty((n, 4 + t), dtype="<u8")
    # Each part begins with the distance to itself: eight bytes, since nothing stands between.
    table[:, 0], table[:, 1], table[:, 2], table[:, 3] = 8, times, 8, t
    where = places.astype(np.uint64)[:, None] + np.arange(t, dtype=np.uint64) * np.uint64(shape.size)
    table[:, 4:] = rep(shape.code, where)
    out[:, room:] = table.view(np.uint8)
    return out.tobytes()
