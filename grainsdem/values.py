"""What values options take: numbers that arithmetic bears, and one value for all or several by name or by share."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field


def coefficients(given: object) -> object:
    """Return one coefficient, or several by name, as they are given: texts are read.

    Parameters
    ----------
    given : float, mapping or str
        One for all; a mapping from names to numbers; a text for either, such as ``0.3`` or ``floor=0.6,wall_x0=0``.
        None stays.

    Raises
    ------
    ValueError
        If it is none of these, or a number is below zero or not finite.

    Examples
    --------
    >>> coefficients("0.3"), coefficients("floor=0.6,wall_x0=0")
    (0.3, {'floor': 0.6, 'wall_x0': 0.0})
    """
    read = _read(given) if isinstance(given, str) else given
    if read is None or _is_coefficient(read):
        return read
    is_table = isinstance(read, Mapping) and read and all(isinstance(name, str) and name for name in read)
    if isinstance(read, Mapping) and is_table and all(map(_is_coefficient, read.values())):
        return {name: float(value) for name, value in read.items()}
    rule = "must be zero or more and finite"
    if not is_number(given):
        rule += ", or such numbers by name as floor=0.6,wall_x0=0"
    # What is told of a mistake shows what was given, but for tables.
    raise ValueError(f"{rule}; got {dict(given)}" if isinstance(given, Mapping) else rule)


def _read(text: str) -> float | dict[str, float]:
    """Return what a text such as ``0.3`` or ``floor=0.6,wall_x0=0`` says; NaN for nothing of the kind."""
    try:
        pairs = [item.split("=") for item in text.split(",")]
        return {name.strip(): float(value) for name, value in pairs} if "=" in text else float(text)
    except ValueError:
        return math.nan


def _is_coefficient(value: object) -> bool:
    return is_number(value) and 0 <= value <= sys.float_info.max  # type: ignore[operator]


Coefficient = Annotated[float, Field(ge=0)]
"""A coefficient of friction."""

Positive = Annotated[float, Field(gt=0)]
"""A number above zero."""

ByName = Annotated[Coefficient | Mapping[str, Coefficient] | None, BeforeValidator(coefficients)]
"""One coefficient for all, or several by name; in commands, which have no tables, ``floor=0.6,wall_x0=0``."""


def shares(given: object) -> object:
    """Return one number, or several and their shares, as they are given: texts are read.

    Parameters
    ----------
    given : float, mapping or str
        One for all; a mapping from numbers, or texts of numbers, to their shares; a text for either, such as ``0.3`` or
        ``0.3:0.5,0.6:0.5``. None stays.

    Raises
    ------
    ValueError
        If it is a text that says neither, or an empty mapping.

    Examples
    --------
    >>> shares("2650"), shares("0.3:0.5,0.6:0.5"), shares({"0.3": 1.0})
    (2650.0, {0.3: 0.5, 0.6: 0.5}, {0.3: 1.0})
    """
    try:
        if isinstance(given, str) and ":" not in given:
            return float(given)
        if isinstance(given, str):
            given = dict(item.split(":") for item in given.split(","))
            given = {kind: float(share) for kind, share in given.items()}
        if not isinstance(given, Mapping):
            return given
        if given:
            return {float(kind): share for kind, share in given.items()}
    except ValueError:
        pass
    raise ValueError("must be a number, or numbers and their shares as 0.3:0.5,0.6:0.5")


Number = TypeVar("Number")

ByShare = Annotated[Number | Mapping[Number, float] | None, BeforeValidator(shares)]
"""One number for all grains, or several and their shares by number; in commands ``0.3:0.5,0.6:0.5``."""

STRICT = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
"""What models of options are: a text or a yes is no number, and no number is infinite."""


SMALLEST, LARGEST = 1e-30, 1e30
"""Of numbers that are not zero: beyond, their cubes and quotients leave what a computer can hold."""

_MOST = 2**63 - 1
"""The largest whole number that arrays, files and other programs hold."""


def held_numbers(schema: Any) -> Any:
    """Return pydantic's schema of a model whose numbers are numbers: no yes, no text, none that breaks arithmetic."""
    if isinstance(schema, list | tuple):
        return type(schema)(held_numbers(item) for item in schema)
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") in {"float", "int"}:
        check = {"type": "no-info", "function": number}
        return {"type": "function-before", "function": check, "schema": schema}
    return {key: value if key in _NO_SCHEMAS else held_numbers(value) for key, value in schema.items()}


_NO_SCHEMAS = {"metadata", "config", "default", "function", "serialization", "cls", "ref", "expected"}
"""Keys of a schema that hold no schemas."""


def number(value: Any) -> Any:
    """Return what may be a number of a file, or raise."""
    if isinstance(value, bool | str | bytes):
        raise ValueError("input should be a valid number")  # noqa: TRY004  (what pydantic tells)
    if isinstance(value, int) and abs(value) > _MOST:
        raise ValueError(f"input should be at most {_MOST} in size")
    if isinstance(value, float) and not math.isfinite(value):
        raise ValueError("input should be a finite number")
    if isinstance(value, float) and value and not SMALLEST <= abs(value) <= LARGEST:
        raise ValueError(f"input should be 0, or between {SMALLEST:g} and {LARGEST:g} in size")
    return value


class Options(BaseModel):
    """Options of a function as a model."""

    model_config = STRICT

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """Hold all numbers."""
        return held_numbers(handler(source))


def is_number(value: object) -> bool:
    """Return whether a value is a number of Python's or NumPy's, and no yes or no."""
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)
