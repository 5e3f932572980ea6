"""Numbers as text, many at a time: one big format, no call a number."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

# Rows that are formatted at once: enough that the format dominates, few enough that its list of numbers stays small.
_BLOCK = 4096


def rows_of_text(
    values: NDArray[np.float64] | NDArray[np.int32], counts: ArrayLike, *, digits: int = 9
) -> list[str]:
    """Return rows of numbers, separated by blanks, as one string a row.

    Parameters
    ----------
    values : ndarray
        The numbers of all rows, one after another; any shape.
    counts : array_like of int, shape (n,)
        How many numbers each row has.
    digits : int
        Significant digits of real numbers; whole numbers have all of theirs.

    Examples
    --------
    >>> rows_of_text(np.array([0.5, -0.0, 1 / 3]), [1, 2], digits=4)
    ['0.5', '0 0.3333']
    """
    flat = values.ravel()
    is_real = flat.dtype.kind == "f"
    number = f"%.{digits}g" if is_real else "%d"
    lengths = np.asarray(counts, dtype=np.int64)
    offsets = offsets_from_counts(lengths)
    patterns = {k: " ".join([number] * k) for k in np.unique(lengths).tolist()}
    rows: list[str] = []
    for start in range(0, lengths.size, _BLOCK):
        stop = min(start + _BLOCK, lengths.size)
        block = flat[offsets[start] : offsets[stop]]
        if is_real:
            block = block + 0.0  # minus zero becomes zero
        template = "\n".join([patterns[k] for k in lengths[start:stop].tolist()])
        rows += (template % tuple(block.tolist())).split("\n")
    return rows


def table_of_text(values: NDArray[np.float64], *, digits: int = 9) -> list[str]:
    """Return one string a row of a table, shape (n, k), numbers separated by blanks."""
    return rows_of_text(values, np.full(len(values), values.shape[1]), digits=digits)
