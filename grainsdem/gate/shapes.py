"""Shapes of arrays as a docstring tells them."""

from __future__ import annotations

import inspect
import re
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import ShapeError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Shapes = Mapping[str, Sequence[tuple[str, ...]]]

_TOLD = re.compile(
    r"^(\w+(?:, \w+)*) : (?!tuple|mapping|sequence)(.*\barray_like\b.*|ndarray.*)\bshape (\(.*)$", re.MULTILINE
)
_ONE = re.compile(r"(?:shape|or) \(((?:\w+(?: \+ \d+| or \d+)?(?:, |,(?=\))|(?=\))))*)\)")
"""Lines of a docstring that tell shapes of arguments, and one of the shapes in it."""

_SAID = re.compile(r"\b(\w+)`*(?: \[[^]]*\])?, shape (\([^)]*\)(?: or \([^)]*\))*)")
"""The same in the first lines of one that has no list of arguments: a name, its unit and its shape."""


def shapes_of(function: Callable[..., Any]) -> dict[str, list[tuple[str, ...]]]:
    """Return the shapes that the docstring allows of arrays, each a tuple of numbers and letters; one is enough."""
    head = inspect.cleandoc(function.__doc__ or "").partition("\nReturns\n")[0]
    found = {}
    first = head.partition("\n\n")[0].replace("\n", " ")
    taken = inspect.signature(function).parameters
    said = [(n, "", text) for n, text in _SAID.findall(first) if n in taken and taken[n].annotation not in ("int", int)]
    for names, before, text in [*said, *_TOLD.findall(head)]:
        shapes = [tuple(word for word in re.split(r", ?", inner) if word) for inner in _ONE.findall(f"shape {text}")]
        if "float" in before:  # one number for all, which an array of no axes is too
            shapes.insert(0, ())
        if shapes:
            found.update(dict.fromkeys(names.split(", "), shapes))
    return found


def hold_shapes(shapes: Shapes, given: Mapping[str, Any]) -> dict[str, Floats]:
    """Raise `ShapeError` where an array is of no shape that is allowed beside those before it.

    An empty list may stand for no rows: those are returned, by the names of the arguments.
    """
    empty = {}
    sizes: dict[str, tuple[int, str]] = {}
    for name, allowed in shapes.items():
        value = given.get(name)
        if not isinstance(value, np.ndarray):
            continue
        shape = value.shape
        for words in allowed:
            axes = _axes(words)
            if len(axes) == len(shape) and all(map(_fits, axes, shape)):
                break
        else:
            if shape == (0,) and all(map(_may_be_none, allowed)):
                if all(word.isdigit() for word in allowed[0][1:]):
                    empty[name] = value.reshape(0, *map(int, allowed[0][1:]))
                continue
            raise ShapeError(f"{name} must be an array of numbers of shape {_told(allowed)}; got shape {shape}")
        for (_, letter, more), size in zip(axes, shape, strict=True):
            if letter and sizes.setdefault(letter, (size - more, name))[0] != size - more:
                whose = sizes[letter][1]
                raise ShapeError(
                    f"{name} must be an array of numbers of shape {_told(allowed)}; got shape {shape} beside {whose} "
                    f"of shape {given[whose].shape}"
                )
    return empty


def _fits(axis: tuple[frozenset[int], str, int], size: int) -> bool:
    return not axis[0] or size in axis[0]


@cache
def _axes(words: tuple[str, ...]) -> tuple[tuple[frozenset[int], str, int], ...]:
    return tuple(map(_axis, words))


def _told(allowed: Sequence[tuple[str, ...]]) -> str:
    """Return shapes as an error tells them."""
    return " or ".join(f"({', '.join(shape)}{',' if len(shape) == 1 else ''})" for shape in allowed)


def _axis(word: str) -> tuple[frozenset[int], str, int]:
    """Return the sizes that a word allows of an axis, or the letter for its size and how many more there are."""
    if word[0].isdigit():
        return frozenset(map(int, word.split(" or "))), "", 0
    letter, _, more = word.partition(" + ")
    return frozenset(), letter if letter.isidentifier() else "", int(more or 0)


def _may_be_none(allowed: tuple[str, ...]) -> bool:
    """Return whether an empty list may stand for so many rows, of which the function tells how many it needs."""
    return len(allowed) > 1 and not allowed[0][0].isdigit()
