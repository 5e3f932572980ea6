"""What one value may be: a number, a path, an array and so on. Each check returns the value, or raises."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    Check = Callable[[Any], Any]
    Known = tuple[str, Check]


class UnfitError(Exception):
    """What is given is not of a kind; the words say why where its name alone does not."""


def _number(value: Any) -> float:
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, Real | np.floating) and not _is_truth(value):
        try:
            return float(value)
        except OverflowError:
            raise UnfitError from None
    raise UnfitError


def _is_truth(value: object) -> bool:
    """Return whether it is true or false, which Python counts among whole numbers."""
    return isinstance(value, bool)


def _integer(value: Any) -> int:
    if type(value) is int:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, Integral) and not _is_truth(value):
        return int(value)
    raise UnfitError


def _whole(value: Any) -> int:
    number = _integer(value)
    if not -(1 << 63) <= number < 1 << 63:
        raise UnfitError("got one beyond 64 bits")
    return number


def _yes_or_no(value: Any) -> bool:
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise UnfitError


def nothing(value: Any) -> None:
    """Return None, of None alone."""
    if value is not None:
        raise UnfitError


def _of(*kinds: type) -> Check:
    def check(value: Any) -> Any:
        if isinstance(value, kinds):
            return value
        raise UnfitError

    return check


def sequence(value: Any) -> Any:
    """Return what has a length and an order, and is no text."""
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes):
        return value
    raise UnfitError


def _function(value: Any) -> Any:
    if callable(value):
        return value
    raise UnfitError


def _path(value: Any) -> Any:
    if not isinstance(value, str | os.PathLike):
        raise UnfitError
    if not os.fspath(value):
        raise UnfitError("got an empty one")
    if "\0" in os.fspath(value):
        raise UnfitError("got one with a zero byte in it")
    return value


def _or_none(check: Check) -> Check:
    return lambda value: None if value is None else check(value)


def _seed(value: Any) -> Any:
    if value is None or isinstance(value, np.random.Generator):
        return value
    number = _integer(value)
    if number < 0:
        raise UnfitError
    return number


def _array(value: Any) -> Any:
    """Return an array of real numbers, of the type that they have."""
    if type(value) is np.ndarray and value.dtype.kind in "biuf":
        return value
    if isinstance(value, str | bytes | Mapping) or value is None or callable(value):
        raise UnfitError
    if isinstance(value, np.ma.MaskedArray):
        raise UnfitError("got a masked array, whose masked values have no meaning here")
    try:
        made = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise UnfitError("got what has no shape: rows of unlike lengths, or other things than numbers") from None
    if made.dtype.kind in "biuf":
        return made
    if made.dtype.kind == "O" and made.size:
        raise UnfitError(f"got objects, the first of type {type(made.flat[0]).__name__}")
    if made.dtype.kind == "O":
        raise UnfitError(f"got an empty array of objects, of shape {made.shape}")
    raise UnfitError(f"got {'complex numbers' if made.dtype.kind == 'c' else f'values of type {made.dtype}'}")


def _whole_array(value: Any) -> Any:
    made = _array(value)
    if made.dtype.kind not in "iu" and made.size:
        raise UnfitError(f"got values of type {made.dtype}")
    return made.astype(np.int64) if made.dtype.kind == "f" else made


def _table(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.names:
        return value
    raise UnfitError


PLAIN: dict[str, Known] = {
    "float": ("a number", _number),
    "int": ("a whole number", _whole),
    "bool": ("true or false", _yes_or_no),
    "str": ("text", _of(str)),
    "None": ("None", nothing),
    "str | os.PathLike[str]": ("a path", _path),
    "os.PathLike[str]": ("a path", _path),
    "Path": ("a path", _path),
    "ArrayLike": ("an array of numbers", _array),
    "NDArray[np.float64]": ("an array of numbers", _array),
    "Floats": ("an array of numbers", _array),
    **dict.fromkeys(("Ints", "Offsets", "NDArray[np.int64]", "NDArray[np.int32]"), ("an array of numbers", _array)),
    **dict.fromkeys(("NDArray[np.int8]", "NDArray[np.bool_]"), ("an array of numbers", _array)),
    "NDArray[Any]": ("an array of numbers", _array),
    "NDArray[np.integer[Any]]": ("an array of whole numbers", _whole_array),
    "slice": ("a slice", _of(slice)),
    "Sequence": ("a sequence", sequence),
    "Mapping": ("a mapping", _of(Mapping)),
    "Callable": ("a function", _function),
    # As the notes of experiments say it to people.
    "numpy.random.Generator, int or None": ("a Generator, a whole number of at least 0, or None", _seed),
    "str or path-like, optional": ("a path or None", _or_none(_path)),
    "callable, optional": ("a function or None", _or_none(_function)),
    "NDArray[np.void]": ("a table with named columns", _table),
    "np.random.Generator": ("a Generator", _of(np.random.Generator)),
    "rng": ("a Generator, a whole number of at least 0, or None", _seed),
}
"""What types stand for, as signatures write them."""
