"""Functions that are described by their options: docstring, signature, page and schema follow from what these say."""

from __future__ import annotations

import inspect
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, TypeVar, get_origin

from grainsdem.options import annotation_of, model_of, notes_of, told_of

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from pydantic import BaseModel

    from grainsdem.options import Told

    Function = TypeVar("Function", bound=Callable[..., Any])


@dataclass(frozen=True, slots=True, kw_only=True)
class Described:
    """A function as everything that offers it sees it.

    Parameters
    ----------
    name : str
        Of the function, the recipe's table and, with dashes, the command.
    function : callable
        What users call.
    options : type of pydantic.BaseModel
        Frozen model of the options, as commands and tables have them.
    notes : dict of str to tuple of str
        Types and sentences of what is no option but how it is run: only Python has these.
    caution : str
        What is said to a person besides, or nothing.
    """

    name: str
    function: Callable[..., Any]
    options: type[BaseModel]
    notes: Mapping[str, tuple[str, str]]
    caution: str = ""

    @property
    def summary(self) -> str:
        """First sentence of its documentation."""
        return (self.function.__doc__ or "").strip().partition("\n")[0]

    @property
    def title(self) -> str:
        """Its name as a heading."""
        return self.name.replace("_", " ").capitalize()

    def told(self) -> list[Told]:
        """Return what is told of each option."""
        return [told_of(field, name) for name, field in self.options.model_fields.items()]

    def page(self) -> str:
        """Return its name, what it does and its options as a section in Markdown."""
        rows = [
            f"| `{told.name}` | {told.kind.replace('|', 'or')} | {_shown(told.default)} | {told.unit} | {told.allowed} "
            f"| {told.help} |"
            for told in self.told()
        ]
        head = (
            f"## {self.title}\n\n{self.summary} `gd.dynamics.{self.name}`, `grainsdem {self.name.replace('_', '-')}`, "
        )
        table = "| option | type | default | unit | range | what it is |\n|---|---|---|---|---|---|\n"
        below = f"\n{self.caution}\n" if self.caution else ""
        return f"{head}`[{self.name}]`.\n\n{table}" + "\n".join(rows) + f"\n{below}"

    def schema(self) -> dict[str, Any]:
        """Return the JSON schema of its options."""
        return self.options.model_json_schema()


_found: dict[str, Described] = {}
"""Functions that were described, by name."""


def described(*, caution: str = "", **elsewhere: Any) -> Callable[[Function], Function]:
    """Let a function's docstring and signature tell its options, and commands, recipes and pages find them.

    Parameters
    ----------
    caution : str
        What its page says besides; nothing by default.
    **elsewhere
        Defaults of commands and tables where they are not those of the function.

    Returns
    -------
    callable
        Decorator. The function takes a packing, its options as keywords whose annotations carry an
        `grainsdem.options.option`, and others that carry a `grainsdem.options.Note`. It checks them itself.
    """

    def decorate(function: Function) -> Function:
        name = function.__name__
        options = model_of(function, name, **elsewhere)
        notes = {key: (note.kind, note.words) for key, (_, note) in notes_of(function).items()}
        function.__doc__ = documented(function.__doc__ or "", options, notes)
        function.__signature__ = _plain_signature(function, options)  # type: ignore[attr-defined]
        _found[name] = Described(name=name, function=function, options=options, notes=notes, caution=caution)
        return function

    return decorate


def description(function: Callable[..., Any]) -> Described:
    """Return what is known of a function that was `described`."""
    return _found[function.__name__]


def documented(
    text: str, options: type[BaseModel], notes: Mapping[str, tuple[str, str]], *, raises: tuple[str, ...] = ()
) -> str:
    """Return a docstring with the options behind what its section of parameters says of the packing.

    Parameters
    ----------
    text : str
        The docstring as it was written.
    options : type of pydantic.BaseModel
        The options.
    notes : dict of str to tuple of str
        Types and sentences of what is no option.
    raises : tuple of str
        Lines that its section of errors ends with.
    """
    lines = []
    for name, entry in options.model_fields.items():
        told = told_of(entry, name)
        unit = f" [{told.unit}]" if told.unit else ""
        allowed = f" ({told.allowed})" if told.allowed else ""
        lines += [f"{name} : {told.kind}", *_wrapped(f"{told.help.removesuffix('.')}{unit}{allowed}.")]
    for name, (kind, words) in notes.items():
        lines += [f"{name} : {kind}", *_wrapped(words)]
    head, rest = _parted(inspect.cleandoc(text), "Returns")
    errors, remarks = _parted(rest, "Notes")
    if "\nParameters\n" not in head:
        head = f"{head}\n\nParameters\n----------\npacking : Packing\n    The grains."
    if raises and "Raises\n" not in errors:
        errors = f"{errors}\n\nRaises\n------".strip()
    parts = ["\n".join([head, *lines]), "\n".join([errors, *raises]), remarks]
    return "\n\n".join(part for part in parts if part)


def _plain_signature(function: Callable[..., Any], options: type[BaseModel]) -> inspect.Signature:
    """Return the signature with types as files have them, for `help` and who reads it."""
    signature = inspect.signature(function)
    plain = []
    kind: Any
    for name, parameter in signature.parameters.items():
        kind = (
            options.model_fields[name].annotation
            if name in options.model_fields
            else annotation_of(function, parameter)
        )
        plain.append(parameter.replace(annotation=kind.__origin__ if get_origin(kind) is Annotated else kind))
    return signature.replace(parameters=plain)


def _parted(text: str, section: str) -> tuple[str, str]:
    """Return a docstring before a section, and from there on."""
    head, mark, tail = text.partition(f"\n\n{section}\n")
    return head, (mark + tail).strip()


def _shown(default: object) -> str:
    """Return a default as a page shows it."""
    if default is None:
        return "–"
    return f"{default:g}" if isinstance(default, float) else str(default).lower()


def _wrapped(words: str) -> list[str]:
    return textwrap.wrap(words, 116, initial_indent="    ", subsequent_indent="    ")
