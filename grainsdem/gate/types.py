"""Checks as the types of a signature ask for them."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.gate.kinds import PLAIN, UnfitError, nothing, sequence

if TYPE_CHECKING:
    from grainsdem.gate.kinds import Check, Known

NOUNS = {
    "CellLinks": "CellLinks",
    "Check": "Check",
    "Chords": "Chords",
    "ContactGraph": "ContactGraph",
    "Correlation": "Correlation",
    "Domain": "Domain",
    "Drawn": "Drawn of Forms",
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
    "Report": "Report",
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
        return PLAIN.get(text) or _read(ast.parse(text, mode="eval").body, aliases)
    except SyntaxError:
        return None


def _read(node: ast.expr, aliases: Mapping[str, Any]) -> Known | None:
    """Return the check that a type stands for, or None where the door has none."""
    text = ast.unparse(node)
    if text in PLAIN or text in NOUNS or text in METHODS:
        return PLAIN.get(text) or _noun(text)
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
        return PLAIN[kind] if part is None else _sequence_of(part)
    if kind in ("Mapping", "Callable"):
        return PLAIN[kind]
    if kind == "tuple" and isinstance(inner, ast.Tuple):
        return _tuple(inner.elts, aliases)
    return None


def _tuple(inner: list[ast.expr], aliases: Mapping[str, Any]) -> Known | None:
    is_endless = ast.unparse(inner[-1]) == "..."
    parts = [_read(part, aliases) for part in (inner[:1] if is_endless else inner)]
    if None in parts or any(isinstance(part, ast.Constant) for part in inner[:1]):
        return None
    return _tuple_of(parts[0]) if is_endless else _together(parts)  # type: ignore[arg-type]  # none of them is None


def _either(node: ast.BinOp, aliases: Mapping[str, Any]) -> Known | None:
    parts: list[ast.expr] = []
    rest: ast.expr = node
    while isinstance(rest, ast.BinOp):
        parts.insert(0, rest.right)
        rest = rest.left
    parts.insert(0, rest)
    if any(ast.unparse(part).endswith(".Generator") for part in parts):
        return PLAIN["rng"]
    if "os.PathLike[str]" in map(ast.unparse, parts):  # a path may be text
        parts = [part for part in parts if ast.unparse(part) != "str"]
    read = [_read(part, aliases) for part in parts]
    if any(one is None for one in read):
        return None
    known = [one for one in read if one is not None]
    checks = [check for _, check in known if check is not nothing]
    has_none = len(checks) < len(known)

    def check(value: Any) -> Any:
        if value is None and has_none:
            return None
        reason = None
        for one in checks:
            try:
                return one(value)
            except UnfitError as unfit:
                reason = unfit.args[0] if unfit.args else reason
        raise UnfitError(*([] if reason is None else [reason]))

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
        raise UnfitError

    return f"an {words}" if words[0] in "AEIOU" else f"a {words}", check


def _one_of(values: list[Any]) -> Check:
    def check(value: Any) -> Any:
        if isinstance(value, str) and value in values:
            return value
        raise UnfitError

    return check


def _together(parts: list[Known]) -> Known:
    def check(value: Any) -> Any:
        items = list(value) if isinstance(value, Sequence | np.ndarray) and not isinstance(value, str) else None
        if items is None or len(items) != len(parts):
            raise UnfitError
        return tuple(one(item) for (_, one), item in zip(parts, items, strict=True))

    kinds = list(dict.fromkeys(words for words, _ in parts))
    return f"{len(parts)} values, each {kinds[0]}" if len(kinds) == 1 else f"values: {', '.join(kinds)}", check


def _sequence_of(part: Known) -> Known:
    words, one = part

    def check(value: Any) -> Any:
        return [one(item) for item in sequence(value)] if type(value) is not tuple else tuple(map(one, value))

    return f"a sequence, each of {words}", check


def _tuple_of(part: Known) -> Known:
    words, one = part

    def check(value: Any) -> Any:
        return tuple(map(one, sequence(value)))

    return f"a sequence, each of {words}", check


def _has(method: str) -> Check:
    def check(value: Any) -> Any:
        if callable(getattr(value, method, None)):
            return value
        raise UnfitError

    return check
