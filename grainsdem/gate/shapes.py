"""Shapes of arrays as a docstring tells them."""

from __future__ import annotations

import inspect
import re
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import ShapeError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_TOLD = re.compile(
    r"^(\w+(?:, \w+)*) : (?!tuple|mapping|sequence)(.*\barray_like\b.*|ndarray.*)\bshape (\(.*)$", re.MULTILINE
)
_ONE = re.compile(r"(?:shape|or) \(((?:\w+(?: \+ \d+| or \d+)?(?:, |,(?=\))|(?=\))))*)\)")
"""Lines of a docstring that tell shapes of arguments, and one of the shapes in it."""


def shapes_of(function: Callable[..., Any]) -> dict[str, list[tuple[str, ...]]]:
    """Return the shapes that the docstring allows of arrays, each a tuple of numbers and letters; one is enough."""
    head = inspect.cleandoc(function.__doc__ or "").partition("\nReturns\n")[0]
    found = {}
    for names, before, text in _TOLD.findall(head):
        shapes = [tuple(word for word in re.split(r", ?", inner) if word) for inner in _ONE.findall(f"shape {text}")]
        if "float" in before:  # one number for all, which an array of no axes is too
            shapes.insert(0, ())
        if shapes:
            found.update(dict.fromkeys(names.split(", "), shapes))
    return found


def hold_shapes(shapes: Mapping[str, list[tuple[str, ...]]], given: Mapping[str, Any]) -> None:
    """Raise `ShapeError` where an array is of no shape that is allowed beside those before it."""
    sizes: dict[str, tuple[int, str]] = {}
    for name, allowed in shapes.items():
        value = given.get(name)
        if not isinstance(value, np.ndarray) or (value.shape == (0,) and all(map(_may_be_none, allowed))):
            continue
        words = " or ".join(f"({', '.join(shape)}{',' if len(shape) == 1 else ''})" for shape in allowed)
        fit = next((shape for shape in allowed if _is_of(value.shape, shape)), None)
        if fit is None:
            raise ShapeError(f"{name} must be an array of numbers of shape {words}; got shape {value.shape}")
        for letter, size in zip(fit, value.shape, strict=True):
            base, _, more = letter.partition(" + ")
            if not base.isidentifier():
                continue
            known, whose = sizes.setdefault(base, (size - int(more or 0), name))
            if size - int(more or 0) != known:
                raise ShapeError(
                    f"{name} must be an array of numbers of shape {words}; got shape {value.shape} beside {whose} of "
                    f"shape {given[whose].shape}"
                )


def _may_be_none(allowed: tuple[str, ...]) -> bool:
    """Return whether an empty list may stand for so many rows, of which the function tells how many it needs."""
    return len(allowed) > 1 and not allowed[0][0].isdigit()


def _is_of(shape: tuple[int, ...], allowed: tuple[str, ...]) -> bool:
    return len(shape) == len(allowed) and all(
        not word[0].isdigit() or str(size) in word.split(" or ") for size, word in zip(shape, allowed, strict=True)
    )
