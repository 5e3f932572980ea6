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
