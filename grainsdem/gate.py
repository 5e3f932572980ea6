"""The door of every public function: what is given is held against what its signature says, before anything is done.

A signature says of each argument what it may be, in the words of types; `gated` reads them once, and holds each call
against them. Numbers of other kinds become those of Python, and what an array can be made of becomes one; None, text,
complex numbers, ragged lists and nouns of another kind end in one line. Shapes of arrays are those of the docstring:
``(m, 3)`` beside ``(m,)`` is as many of one as of the other. What neither can say, such as a range, is the function's
own business, which need not ask again what kind of thing it has.
"""

from __future__ import annotations

import ast
import inspect
import os
import re
from collections.abc import Callable, Container, Mapping, Sequence
from functools import wraps
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from grainsdem.errors import ArgumentError, ShapeError, shown

if TYPE_CHECKING:
    Function = TypeVar("Function", bound=Callable[..., Any])
    Check = Callable[[Any], Any]
    Known = tuple[str, Check]

NOUNS = {
    "Chords": "Chords",
    "ContactGraph": "ContactGraph",
    "Correlation": "Correlation",
    "Domain": "Domain",
    "Forms": "Forms",
    "Grading": "Grading",
    "Grains": "Packing or its Polyhedra",
    "Integrals": "Integrals of grains",
    "Layer": "Layer",
    "Lens": "Lens",
    "Metric": "Metric",
    "Packing": "Packing",
    "Planform": "Planform",
    "Polyhedra": "Polyhedra",
    "Recipe": "Recipe",
    "Scans": "Scans",
    "Section": "Section",
    "SectionKernel": "SectionKernel",
    "Shape": "Shape",
    "SieveSheet": "SieveSheet",
    "Surroundings": "Surroundings",
    "Survey": "Survey",
    "Tessellation": "Tessellation",
    "Voxels": "Voxels",
}
"""Nouns that signatures name, and how an error names what is allowed. They are known by the names of their classes: the
door stands below them all, and a module that names one for its types alone need not import it."""

METHODS = {
    "Distribution": ("cdf", "a law such as a frozen distribution of scipy.stats"),
    "Law": ("ppf", "a law such as a frozen distribution of scipy.stats"),
    "Monitor": ("stage", "a Monitor, which has stages"),
}
"""What is anything that has a certain method, and how an error names it."""

MEMBERS = {"Grains": ("Packing", "Polyhedra")}
"""Names that stand for several nouns."""


class _Unfit(Exception):  # noqa: N818  (caught here, always)
    """What is given is not of a kind; the words say why where its name alone does not."""


def gated(function: Function, *, leave: Container[str] = ()) -> Function:
    """Return a function that holds its arguments against its signature before it does anything.

    Parameters
    ----------
    function : callable
        Its types and its docstring are what counts.
    leave : container of str
        Arguments that it checks all by itself.

    Returns
    -------
    callable
        The same to whoever calls it rightly.

    Raises
    ------
    ArgumentError
        By the function that is returned, where an argument is of a kind that its signature does not have.
    ShapeError
        Where it cannot be made an array of real numbers.

    Examples
    --------
    >>> @gated
    ... def half(size: float) -> float:
    ...     return size / 2
    >>> half(np.float32(3))
    1.5
    >>> half("3")
    Traceback (most recent call last):
        ...
    grainsdem.errors.ArgumentError: size must be a number; got '3'
    """
    parameters = inspect.signature(function).parameters.values()
    names = [parameter.name for parameter in parameters]
    rest = next((parameter.name for parameter in parameters if parameter.kind is parameter.VAR_POSITIONAL), "")
    words: dict[str, str] = {}
    checks: dict[str, Check] = {}
    shapes = shapes_of(function)

    @wraps(function)
    def held(*args: Any, **kwargs: Any) -> Any:
        # Read at the first call: a room is not yet whole while its functions are made.
        if not words:
            known = {name: one for name, one in checks_of(function).items() if name not in leave}
            checks.update({name: check for name, (_, check) in known.items()})
            words.update({name: allowed for name, (allowed, _) in known.items()} or {"": ""})
        given, name = list(args), ""
        try:
            for number, value in enumerate(args):
                name = names[number] if number < len(names) else rest
                if name in checks:
                    given[number] = checks[name](value)
            for name, value in kwargs.items():
                if name in checks:
                    kwargs[name] = checks[name](value)
        except _Unfit as unfit:
            reason = unfit.args[0] if unfit.args else f"got {shown(kwargs.get(name, value))}"
        else:
            if shapes:
                _hold_shapes(shapes, {**dict(zip(names, given, strict=False)), **kwargs})
            return function(*given, **kwargs)
        kind = ShapeError if words[name].startswith("an array") else ArgumentError
        raise kind(f"{name} must be {words[name]}; {reason}")

    return held  # type: ignore[return-value]  # it takes and returns what the function does


_TOLD = re.compile(
    r"^ {4}(\w+(?:, \w+)*) : (?!tuple|mapping|sequence)(.*\barray_like\b.*|ndarray.*)\bshape (\(.*)$", re.MULTILINE
)
_ONE = re.compile(r"(?:shape|or) \(((?:\w+(?: \+ \d+| or \d+)?(?:, |,(?=\))|(?=\))))*)\)")
"""Lines of a docstring that tell shapes of arguments, and one of the shapes in it."""


def shapes_of(function: Callable[..., Any]) -> dict[str, list[tuple[str, ...]]]:
    """Return the shapes that the docstring allows of arrays, each a tuple of numbers and letters; one is enough."""
    head = (function.__doc__ or "").partition("\n    Returns\n")[0]
    found = {}
    for names, before, text in _TOLD.findall(head):
        shapes = [tuple(word for word in re.split(r", ?", inner) if word) for inner in _ONE.findall(f"shape {text}")]
        if "float" in before:  # one number for all, which an array of no axes is too
            shapes.insert(0, ())
        if shapes:
            found.update(dict.fromkeys(names.split(", "), shapes))
    return found


def _hold_shapes(shapes: Mapping[str, list[tuple[str, ...]]], given: Mapping[str, Any]) -> None:
    """Raise `ShapeError` where an array is of no shape that is allowed beside those before it."""
    sizes: dict[str, tuple[int, str]] = {}
    for name, allowed in shapes.items():
        value = given.get(name)
        if not isinstance(value, np.ndarray) or value.shape == (0,):  # of none at all the function tells what it needs
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


def _is_of(shape: tuple[int, ...], allowed: tuple[str, ...]) -> bool:
    return len(shape) == len(allowed) and all(
        not word[0].isdigit() or str(size) in word.split(" or ") for size, word in zip(shape, allowed, strict=True)
    )


def checks_of(function: Callable[..., Any]) -> dict[str, Known]:
    """Return what is allowed of each argument in words, and the check; none where only the function can tell."""
    checks = {}
    aliases = getattr(inspect.unwrap(function), "__globals__", {})
    for name, parameter in inspect.signature(function).parameters.items():
        if parameter.kind is parameter.VAR_KEYWORD:
            continue
        known = _known(parameter.annotation, aliases)
        if known is not None:
            checks[name] = known
    return checks


def _known(annotation: Any, aliases: Mapping[str, Any]) -> Known | None:
    """Return the check of an annotation, written out or not."""
    text = annotation.__name__ if isinstance(annotation, type) else str(annotation)
    try:
        return _PLAIN.get(text) or _read(ast.parse(text, mode="eval").body, aliases)
    except SyntaxError:
        return None


def _read(node: ast.expr, aliases: Mapping[str, Any]) -> Known | None:
    """Return the check that a type stands for, or None where the door has none."""
    text = ast.unparse(node)
    if text in _PLAIN or text in NOUNS or text in METHODS:
        return _PLAIN.get(text) or _noun(text)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        return _either(node, aliases)
    if isinstance(node, ast.Subscript):
        return _generic(ast.unparse(node.value).rpartition(".")[2], node.slice, aliases)
    if isinstance(node, ast.Name) and node.id in aliases and not isinstance(aliases[node.id], type):
        alias = aliases[node.id]
        return _read(ast.parse(alias if isinstance(alias, str) else str(alias), mode="eval").body, {})
    return None


def _generic(kind: str, inner: ast.expr, aliases: Mapping[str, Any]) -> Known | None:
    if kind == "Literal":
        values = [part.value for part in (inner.elts if isinstance(inner, ast.Tuple) else [inner])]  # type: ignore[attr-defined]
        allowed = ", ".join(map(repr, values[:-1])) + f" or {values[-1]!r}" if len(values) > 1 else repr(values[0])
        return allowed, _one_of(values)
    if kind == "Sequence":
        part = _read(inner, aliases)
        return _PLAIN[kind] if part is None else _sequence_of(part)
    if kind in ("Mapping", "Callable"):
        return _PLAIN[kind]
    if kind == "tuple" and isinstance(inner, ast.Tuple):
        parts = [_read(part, aliases) for part in inner.elts]
        if None not in parts and not any(isinstance(part, ast.Constant) for part in inner.elts):
            return _together(parts)  # type: ignore[arg-type]  # none of them is None
    return None


def _either(node: ast.BinOp, aliases: Mapping[str, Any]) -> Known | None:
    parts: list[ast.expr] = []
    rest: ast.expr = node
    while isinstance(rest, ast.BinOp):
        parts.insert(0, rest.right)
        rest = rest.left
    parts.insert(0, rest)
    if any(ast.unparse(part).endswith(".Generator") for part in parts):
        return _PLAIN["rng"]
    if "os.PathLike[str]" in map(ast.unparse, parts):  # a path may be text
        parts = [part for part in parts if ast.unparse(part) != "str"]
    read = [_read(part, aliases) for part in parts]
    if any(one is None for one in read):
        return None
    known = [one for one in read if one is not None]
    checks = [check for _, check in known if check is not _nothing]
    has_none = len(checks) < len(known)

    def check(value: Any) -> Any:
        if value is None and has_none:
            return None
        reason = None
        for one in checks:
            try:
                return one(value)
            except _Unfit as unfit:
                reason = unfit.args[0] if unfit.args else reason
        raise _Unfit(*([] if reason is None else [reason]))

    return " or ".join(dict.fromkeys(words for words, _ in known)), check


def _noun(name: str) -> Known:
    if name in METHODS:
        method, allowed = METHODS[name]
        return allowed, _has(method)
    members = MEMBERS.get(name, (name,))
    words = NOUNS[name]

    def check(value: Any) -> Any:
        if type(value).__name__ in members or any(kind.__name__ in members for kind in type(value).__mro__):
            return value
        raise _Unfit

    return f"an {words}" if words[0] in "AEIOU" else f"a {words}", check


def _one_of(values: list[Any]) -> Check:
    def check(value: Any) -> Any:
        if isinstance(value, str) and value in values:
            return value
        raise _Unfit

    return check


def _together(parts: list[Known]) -> Known:
    def check(value: Any) -> Any:
        items = list(value) if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str) else None
        if items is None or len(items) != len(parts):
            raise _Unfit
        return tuple(one(item) for (_, one), item in zip(parts, items, strict=True))

    kinds = list(dict.fromkeys(words for words, _ in parts))
    return f"{len(parts)} values, each {kinds[0]}" if len(kinds) == 1 else f"values: {', '.join(kinds)}", check


def _number(value: Any) -> float:
    if type(value) is float:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, Real | np.floating) and not _is_truth(value):
        try:
            return float(value)
        except OverflowError:
            raise _Unfit from None
    raise _Unfit


def _is_truth(value: object) -> bool:
    """Return whether it is true or false, which Python counts among whole numbers."""
    return isinstance(value, bool)


def _whole(value: Any) -> int:
    if type(value) is int:
        return value
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    if isinstance(value, Integral) and not _is_truth(value):
        return int(value)
    raise _Unfit


def _yes_or_no(value: Any) -> bool:
    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise _Unfit


def _nothing(value: Any) -> None:
    if value is not None:
        raise _Unfit


def _of(*kinds: type) -> Check:
    def check(value: Any) -> Any:
        if isinstance(value, kinds):
            return value
        raise _Unfit

    return check


def _sequence(value: Any) -> Any:
    if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes):
        return value
    raise _Unfit


def _sequence_of(part: Known) -> Known:
    words, one = part

    def check(value: Any) -> Any:
        return [one(item) for item in _sequence(value)] if type(value) is not tuple else tuple(map(one, value))

    return f"a sequence, each of {words}", check


def _has(method: str) -> Check:
    def check(value: Any) -> Any:
        if callable(getattr(value, method, None)):
            return value
        raise _Unfit

    return check


def _function(value: Any) -> Any:
    if callable(value):
        return value
    raise _Unfit


def _path(value: Any) -> Any:
    if not isinstance(value, str | os.PathLike):
        raise _Unfit
    if "\0" in os.fspath(value):
        raise _Unfit("got one with a zero byte in it")
    return value


def _or_none(check: Check) -> Check:
    return lambda value: None if value is None else check(value)


def _seed(value: Any) -> Any:
    if value is None or isinstance(value, np.random.Generator):
        return value
    number = _whole(value)
    if number < 0:
        raise _Unfit
    return number


def _array(value: Any) -> Any:
    """Return an array of real numbers, of the type that they have."""
    if type(value) is np.ndarray and value.dtype.kind in "biuf":
        return value
    if isinstance(value, str | bytes | Mapping) or value is None or callable(value):
        raise _Unfit
    if isinstance(value, np.ma.MaskedArray):
        raise _Unfit("got a masked array, whose masked values have no meaning here")
    try:
        made = np.asarray(value)
    except (TypeError, ValueError, OverflowError):
        raise _Unfit("got what has no shape: its rows differ in length, or hold other things than numbers") from None
    if made.dtype.kind in "biuf":
        return made
    if made.dtype.kind == "O" and made.size:
        raise _Unfit(f"got objects, the first of type {type(made.flat[0]).__name__}")
    if made.dtype.kind == "O":
        raise _Unfit(f"got an empty array of objects, of shape {made.shape}")
    raise _Unfit(f"got {'complex numbers' if made.dtype.kind == 'c' else f'values of type {made.dtype}'}")


def _table(value: Any) -> Any:
    if isinstance(value, np.ndarray) and value.dtype.names:
        return value
    raise _Unfit


_PLAIN: dict[str, Known] = {
    "float": ("a number", _number),
    "int": ("a whole number", _whole),
    "bool": ("true or false", _yes_or_no),
    "str": ("text", _of(str)),
    "None": ("None", _nothing),
    "str | os.PathLike[str]": ("a path", _path),
    "os.PathLike[str]": ("a path", _path),
    "Path": ("a path", _path),
    "ArrayLike": ("an array of numbers", _array),
    "NDArray[np.float64]": ("an array of numbers", _array),
    "Floats": ("an array of numbers", _array),
    "Sequence": ("a sequence", _sequence),
    "Mapping": ("a mapping", _of(Mapping)),
    "Callable": ("a function", _function),
    # As the notes of experiments say it to people.
    "numpy.random.Generator, int or None": ("a Generator, a whole number of at least 0, or None", _seed),
    "str or path-like, optional": ("a path or None", _or_none(_path)),
    "callable, optional": ("a function or None", _or_none(_function)),
    "NDArray[np.void]": ("a table with named columns", _table),
    "rng": ("a Generator, a whole number of at least 0, or None", _seed),
}
"""What types stand for, as signatures write them."""
