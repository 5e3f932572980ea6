"""What every noun does with its arrays: check them, freeze them, and stay frozen when copied."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError, ShapeError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LONGEST = 1e30
"""Length [m] above which nothing is: its fifth power, in moments of inertia, and the squares of these are numbers."""

SHORTEST = 1e-30
"""Length [m] below which nothing is, for the same reason."""


def read_only(name: str, value: ArrayLike, dtype: type, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return ``value`` as a read-only C-contiguous array of the given shape (None: any length)."""
    given = np.asarray(value)
    with np.errstate(invalid="ignore"):  # told below
        array: NDArray[Any] = np.ascontiguousarray(given, dtype=dtype)
    if array.dtype.kind in "iu" and array.dtype != given.dtype and not np.array_equal(array, given):
        held = np.iinfo(array.dtype)
        raise ShapeError(f"{name} must be whole numbers from {held.min} to {held.max}; some are not")
    if array.ndim != len(shape) or any(w is not None and g != w for g, w in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("n" if w is None else str(w) for w in shape)
        raise ShapeError(f"{name} must have shape ({wanted}); got {np.shape(value)}")
    array = array.view()
    array.flags.writeable = False
    return array


def check_length(name: str, value: float, *, or_zero: bool = False) -> None:
    """Raise `InputError` unless it is a length [m] that can be reckoned with, or zero where that is allowed."""
    if not (SHORTEST <= value <= LONGEST or (or_zero and value == 0)):
        rule = "zero, or " if or_zero else ""
        raise InputError(f"{name} must be {rule}{SHORTEST:g} to {LONGEST:g} m; got {value}")


def check_factor(factor: float) -> None:
    """Raise `InputError` unless what is scaled by a factor may still be of some size."""
    if not SHORTEST <= factor <= LONGEST:
        raise InputError(f"factor must be {SHORTEST:g} to {LONGEST:g}; got {factor}")


def check_within(name: str, values: NDArray[Any]) -> None:
    """Raise `InputError` where one of many values is no number that can be reckoned with, of either sign."""
    if values.size and not -LONGEST <= values.min() <= values.max() <= LONGEST:
        bad = np.flatnonzero(~(np.abs(values.ravel()) <= LONGEST))
        raise InputError(f"{name} must be numbers within ±{LONGEST:g}; {bad.size} of {values.size} are not")


def check_row(name: str, row: int, n: int) -> None:
    """Raise `InputError` unless a number is that of one of n things."""
    if not 0 <= row < n:
        raise InputError(f"{name} must be one of {n}, counted from 0; got {row}")


def check_rows(name: str, rows: Any, n: int) -> Any:
    """Return what chooses among n things, by number, mask or slice, or raise `InputError` where there are no such."""
    if isinstance(rows, slice):
        return rows
    chosen = rows.astype(np.int64) if rows.size == 0 else rows
    is_mask = chosen.dtype == bool and chosen.shape == (n,)
    is_number = chosen.dtype.kind in "iu" and chosen.ndim == 1
    if not is_mask and not (is_number and (not chosen.size or (chosen.min() >= -n and chosen.max() < n))):
        raise InputError(f"{name} must be some of {n}, counted from 0, or a mask of so many; got {_told(chosen)}")
    return chosen


def _told(values: NDArray[Any]) -> str:
    ends = f" from {values.min()} to {values.max()}" if values.size and values.dtype.kind in "iuf" else ""
    return f"{values.dtype} of shape {values.shape}{ends}"


class Noun:
    """Rebuilds itself through its constructor, so that copies and pickles are checked and read-only again."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.init}  # type: ignore[arg-type]
        return _rebuild, (type(self), values)

    def freeze(self, name: str, dtype: type, *shape: int | None) -> NDArray[Any]:
        """Replace a field by a read-only array of the given type and shape, and return it."""
        array = read_only(name, getattr(self, name), dtype, shape)
        object.__setattr__(self, name, array)
        return array


def _rebuild(kind: type, values: dict[str, Any]) -> Any:
    return kind(**values)
