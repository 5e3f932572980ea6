"""Numbers as text, many at a time: one big format, no call a number."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

# Rows formatted at once: enough that the format dominates, few enough that its list of numbers stays small.
_BLOCK = 4096


def filled(pattern: str, values: NDArray[Any], repeats: ArrayLike, *, separator: str = "") -> list[str]:
    """Return rows of text: a pattern repeated, filled with the next numbers.

    Parameters
    ----------
    pattern : str
        Text with %-formats.
    values : ndarray
        The numbers of all rows, one after another; any shape.
    repeats : array_like of int, shape (n,)
        How often the pattern stands in each row.
    separator : str
        What stands between the patterns of a row.

    Examples
    --------
    >>> filled("(%d, %d)", np.arange(6), [1, 2])
    ['(0, 1)', '(2, 3)(4, 5)']
    """
    flat = values.ravel()
    times = np.asarray(repeats, dtype=np.int64)
    offsets = offsets_from_counts(times * pattern.count("%"))
    patterns = {k: separator.join([pattern] * k) for k in np.unique(times).tolist()}
    rows: list[str] = []
    for start in range(0, times.size, _BLOCK):
        stop = min(start + _BLOCK, times.size)
        # Adding zero makes minus zero zero.
        block = flat[offsets[start] : offsets[stop]] + 0
        template = "\0".join([patterns[k] for k in times[start:stop].tolist()])
        rows += (template % tuple(block.tolist())).split("\0")
    return rows


def rows_of_text(values: NDArray[Any], counts: ArrayLike, *, digits: int = 9) -> list[str]:
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
    pattern = f"%.{digits}g" if values.dtype.kind == "f" else "%d"
    return filled(pattern, values, counts, separator=" ")


def table_of_text(values: NDArray[np.float64], *, digits: int = 9) -> list[str]:
    """Return one string a row of a table, shape (n, k), numbers separated by blanks."""
    return rows_of_text(values, np.full(len(values), values.shape[1]), digits=digits)
