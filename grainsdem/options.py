"""Options that are said once: type, range, unit and help, for signatures, commands, recipes and pages alike.

An option is a parameter of a function whose annotation carries what `option` returns. `model_of` makes of a function's
options a frozen model, and `checked` the values of a call, with one line for what is wrong.
"""

from __future__ import annotations

import inspect
import os
import re
from collections.abc import Mapping
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple, Union, get_args, get_origin

import numpy as np
from pydantic import BaseModel, Field, ValidationError, create_model

from grainsdem.errors import InputError, shown
from grainsdem.values import Options, is_number

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from pydantic.fields import FieldInfo

_KIND = re.compile(
    r"(constrained-)?(str|int|float|bool|none)|(literal|tuple|list|sequence|dict|mapping)\[.*|function-.*"
)
"""What pydantic puts behind a key that takes values of several kinds."""

_LIMITS = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
"""Words for the limits of a range."""


class Stored(NamedTuple):
    """What an option is where it stands in a file or a command, beside a type that is wider in Python.

    Parameters
    ----------
    kind : type
        Its type there.
    """

    kind: Any


class Note(NamedTuple):
    """What is said of a parameter that is no option but how something is run, such as a function: no file can hold it.

    Parameters
    ----------
    kind, words : str
        Its type as a page tells it, and what it is.
    """

    kind: str
    words: str


def option(
    help: str,  # noqa: A002  (what typer and argparse call it)
    unit: str = "",
    *,
    is_path: bool = False,
    **limits: float,
) -> Any:
    """Return what an option's annotation carries.

    Parameters
    ----------
    help : str
        What it is: one sentence, without unit, range and default, which are told beside it.
    unit : str
        Its unit, such as ``"Pa"``; none for a plain number or a word.
    is_path : bool
        Whether it is the path of a file; in a recipe, from the recipe's folder.
    **limits : float
        Its range: ``gt``, ``ge``, ``lt``, ``le``.

    Examples
    --------
    >>> from typing import Annotated
    >>> Pressure = Annotated[float, option("Pressure of the walls.", "Pa", gt=0)]
    """
    told: dict[str, Any] = dict(limits)
    extra: Any = {**({"unit": unit} if unit else {}), **({"format": "path"} if is_path else {})}
    return Field(description=help, json_schema_extra=extra or None, **told)


class Told(NamedTuple):
    """What is told of an option.

    Parameters
    ----------
    name, kind, unit, allowed, help : str
        Its name, type, unit, range and sentence; unit and range may be empty.
    default : object
        Its value where none is given.
    annotation : object
        Its type.
    """

    name: str
    kind: str
    unit: str
    allowed: str
    help: str
    default: Any
    annotation: Any

    def line(self) -> str:
        """Return unit, range, default and sentence in one line."""
        default = "" if self.default is None else f"default {self.default:g}" if is_number(self.default) else ""
        notes = "; ".join(part for part in (self.unit, self.allowed, default) if part)
        return f"{self.help} [{notes}]" if notes else self.help


def paths_of(model: type[BaseModel]) -> list[str]:
    """Return the names of a model's options that are paths of files."""
    return [
        name
        for name, field in model.model_fields.items()
        if isinstance(field.json_schema_extra, dict) and field.json_schema_extra.get("format") == "path"
    ]


def notes_of(function: Callable[..., Any]) -> dict[str, tuple[Any, Note]]:
    """Return the parameters of a function that are noted to be no options: their types, and what is said of them."""
    found = {}
    for parameter in inspect.signature(function).parameters.values():
        kind = annotation_of(function, parameter)
        for said in getattr(kind, "__metadata__", ()):
            if isinstance(said, Note):
                found[parameter.name] = kind, said
    return found


def model_of(function: Callable[..., Any], name: str, **defaults: Any) -> type[BaseModel]:
    """Return the frozen model of a function's options: of its parameters whose annotation carries an `option`.

    Parameters
    ----------
    function : callable
        The function.
    name : str
        Of the model.
    **defaults
        Those that are not the function's.
    """
    fields: dict[str, Any] = {}
    notes = notes_of(function)
    for parameter in inspect.signature(function).parameters.values():
        kind = annotation_of(function, parameter)
        if get_origin(kind) is Annotated and parameter.name not in notes:
            default = ... if parameter.default is parameter.empty else parameter.default
            fields[parameter.name] = (_stored(kind), defaults.get(parameter.name, default))
    return create_model(name, __base__=Options, **fields)


def _stored(kind: Any) -> Any:
    """Return the annotation of an option in files and commands."""
    stored = next((note for note in kind.__metadata__ if isinstance(note, Stored)), None)
    if stored is None:
        return kind
    told = [note for note in kind.__metadata__ if not isinstance(note, Stored)]
    return Annotated[(stored.kind, *told)]


def annotation_of(function: Callable[..., Any], parameter: inspect.Parameter) -> Any:
    """Return a parameter's annotation; text that cannot be read, such as of what only a type checker sees, stays."""
    if not isinstance(parameter.annotation, str):
        return parameter.annotation
    try:
        return eval(parameter.annotation, inspect.unwrap(function).__globals__)  # noqa: S307  (as `typing` does)
    except (NameError, AttributeError, TypeError):
        return parameter.annotation


def checked(model: type[BaseModel], given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of all options of a model, those that are not given by default.

    Raises
    ------
    InputError
        If an option is unknown, missing, of another type or out of range: each in one line, with what is allowed.
    """
    plain = {name: _plain(value) for name, value in given.items()}
    try:
        values = dict(model.model_validate(plain))
    except ValidationError as error:
        raise InputError(explained(error, lambda _path: model)) from error
    return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}


def _plain(value: Any) -> Any:
    """Return a number of NumPy or a path as Python's own number or text."""
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    return value.item() if isinstance(value, np.generic) else value


def told_of(field: FieldInfo, name: str) -> Told:
    """Return what is told of a field of a model."""
    extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
    allowed = [
        f"{words} {getattr(limit, key):g}"
        for key, words in _LIMITS.items()
        for limit in _limits_of(field.annotation, field.metadata)
        if hasattr(limit, key)
    ]
    return Told(
        name, kind_of(field.annotation), str(extra.get("unit", "")), ", ".join(dict.fromkeys(allowed)),
        field.description or "",
        field.default, field.annotation,
    )  # fmt: skip


def _limits_of(annotation: Any, metadata: Sequence[Any]) -> list[Any]:
    """Return what may limit a number: of a field, and of the kinds that it takes."""
    found = list(metadata)
    if get_origin(annotation) is Annotated:
        found += [limit for note in annotation.__metadata__ for limit in getattr(note, "metadata", [])]
    return found + [limit for part in get_args(annotation) if get_origin(part) for limit in _limits_of(part, [])]


def kind_of(annotation: Any) -> str:
    """Return a type as it is told: words of a choice are quoted, and what may be left out is ``optional``."""
    if get_origin(annotation) is Annotated:
        return kind_of(annotation.__origin__)
    options = [kind for kind in get_args(annotation) if kind is not type(None)]
    if get_origin(annotation) in {Union, UnionType}:
        kinds = " or ".join(kind_of(kind) for kind in options)
        return f"{kinds}, optional" if len(options) < len(get_args(annotation)) else kinds
    if get_origin(annotation) is Mapping:
        return f"table of {kind_of(options[1])}"
    if options and all(isinstance(word, str) for word in options):
        return f"{{{', '.join(repr(word) for word in options)}}}"
    if options:
        return f"{get_origin(annotation).__name__.lower()} of {kind_of(options[0])}"
    return str(getattr(annotation, "__name__", annotation))


def explained(error: ValidationError, table_at: Callable[[Sequence[Any]], type[BaseModel]]) -> str:
    """Return pydantic's errors in one line: for each key where, what was given and what is allowed.

    Parameters
    ----------
    error : pydantic.ValidationError
        The errors.
    table_at : callable
        Returns the model that keys lead to, for the names that it allows.
    """
    found: dict[tuple[Any, ...], list[Any]] = {}
    for item in error.errors():
        # A value of several kinds has an error for each kind.
        key = tuple(part for part in item["loc"] if not _KIND.fullmatch(str(part)))
        found.setdefault(key, []).append({**item, "loc": key})
    return "; ".join(_explain(items, table_at) for items in found.values())


def _explain(items: list[Any], table_at: Callable[[Sequence[Any]], type[BaseModel]]) -> str:
    """Return pydantic's errors of one key as a line that says where, what was given and what is allowed."""
    item = items[0]
    where = ".".join(str(part) for part in item["loc"]) or "recipe"
    if item["type"] == "extra_forbidden":
        return f"{where}: unknown key; allowed are {', '.join(table_at(item['loc'][:-1]).model_fields)}"
    if item["type"] == "missing":
        return f"{where}: missing"
    messages = [item["msg"].removeprefix("Value error, ").replace(" after validation", "") for item in items]
    message = ", or ".join([messages[0], *(text.removeprefix("Input should be ") for text in messages[1:])])
    given = f"; got {shown(item['input'])}" if not isinstance(item["input"], dict) else ""
    return f"{where}: {message[0].lower()}{message[1:]}{given}"
