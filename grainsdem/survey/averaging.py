"""Means of a survey's cases over their repeats, with 95 % intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.ensembles import half_width
from grainsdem.errors import InputError
from grainsdem.gate import gated

if TYPE_CHECKING:
    from numpy.typing import NDArray

FIRST, LAST = "recipe", "n_seeds"
"""Columns of a survey's table that stand before and behind those that were varied."""


@gated
def means(table: NDArray[np.void]) -> NDArray[np.void]:
    """Return the mean of each case of a survey over its repeats, and how far it may be off.

    Parameters
    ----------
    table : structured ndarray, shape (n,)
        What `survey.run` returns.

    Returns
    -------
    structured ndarray, shape (k,)
        One row a case, in the order of the table: the varied columns; ``n``, the beds that could be grown; and for each
        number that was measured its mean under its own name, and, with ``_half_width`` behind it, half the width of the
        95 % confidence interval of that mean, by Student's distribution; NaN for fewer than two beds.

    Raises
    ------
    InputError
        If it is no survey's table.
    """
    names = table.dtype.names or ()
    if FIRST not in names or LAST not in names or names[-1] != "error":
        raise InputError(f"means are of what survey.run returns; got a table of columns {', '.join(names)}")
    varied = names[names.index(FIRST) + 1 : names.index(LAST)]
    measured = names[names.index(LAST) : -1]
    cases: dict[str, list[int]] = {}
    for number, row in enumerate(table):
        cases.setdefault(repr([row[name] for name in varied]), []).append(number)  # as text NaN is like NaN
    kinds = [(name, table.dtype[name]) for name in varied]
    kinds += [("n", np.dtype(np.int64)), *((f"{m}{end}", np.dtype(float)) for m in measured for end in ("", _END))]
    result = np.zeros(len(cases), dtype=kinds)
    for row, numbers in zip(result, cases.values(), strict=True):
        for name in varied:
            row[name] = table[name][numbers[0]]
        grown = [number for number in numbers if not table["error"][number]]
        row["n"] = len(grown)
        for name in measured:
            values = np.asarray(table[name][grown], dtype=np.float64)
            values = values[np.isfinite(values)]
            row[name] = values.mean() if values.size else np.nan
            row[f"{name}{_END}"] = half_width(values)
    return result


_END = "_half_width"
