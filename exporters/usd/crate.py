"""USD's binary crate, written straight from arrays.

Through OpenUSD's own calls a bed of 128 000 grains takes about a minute, half of it to make 2.5 million specs one by
one. Grains are alike but for their values, so the tables of a crate are filled here for all of them at once, and values
follow a stretch of grains at a time.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from exporters.usd.codes import rep
from exporters.usd.prims import Attribute, Column, Prim
from exporters.usd.tables import Row, Tables, content

if TYPE_CHECKING:
    from collections.abc import Iterator

# Numbers of types, of sorts of specs and of the parts of a list operation.
_TOKEN, _TOKEN_LIST, _PATH_LIST, _TOKENS, _SPECIFIER, _VARIABILITY, _OFFSETS, _STRINGS = 11, 32, 34, 41, 42, 44, 49, 50
_ATTRIBUTE, _PRIM, _ROOT, _RELATIONSHIP = 1, 6, 7, 8
_EXPLICIT, _PREPENDED = 3, 32


def crate(root: Prim, metadata: dict[str, Any]) -> Iterator[bytes]:
    """Yield the bytes of a layer.

    Parameters
    ----------
    root : Prim
        The one prim at the top.
    metadata : dict
        What the layer says of itself: name to `Attribute` or a dictionary of those; ``subLayers`` is a list of words.
    """
    tables = Tables()
    fields = [tables.field(name, _metadatum(tables, value)) for name, value in metadata.items()]
    if "subLayers" in metadata:
        offsets = struct.pack("<Q", len(metadata["subLayers"])) + struct.pack("<2d", 0, 1) * len(metadata["subLayers"])
        fields.append(tables.field("subLayerOffsets", rep(_OFFSETS, tables.place(offsets))))
    fields.append(tables.field("primChildren", rep(_TOKENS, tables.place(tables.indices([root.name])))))
    tables.rows.append(Row(tables.token(""), -1, _ROOT, tuple(fields)))
    tables.paths["/"] = 0
    _walk(tables, root, "", False, tables.rows)
    return content(tables)


def _metadatum(tables: Tables, value: Any) -> int:
    """Return what stands for a value that a layer has about itself."""
    if isinstance(value, dict):
        return tables.dictionary(value)
    if isinstance(value, list):
        data = struct.pack(f"<Q{len(value)}I", len(value), *(tables.string(word) for word in value))
        return int(rep(_STRINGS, tables.place(data)))
    return tables.value(value)


def _walk(tables: Tables, prim: Prim, parent: str, more: bool, rows: list[Row]) -> None:
    """Add the rows of a prim and all below it; ``more`` says whether another of its kind follows."""
    path = f"{parent}/{prim.name}"
    start = len(rows)
    tables.paths[path] = start
    below = len(prim.attributes) + len(prim.targets) + len(prim.children) + (prim.many is not None)
    rows.append(Row(0, 0, 0, ()))
    for name, attribute in prim.attributes.items():
        below -= 1
        rows.append(_attribute(tables, name, attribute, below > 0))
    for name, target in prim.targets.items():
        below -= 1
        rows.append(_relationship(tables, name, target, below > 0))
    for child in prim.children:
        below -= 1
        _walk(tables, child, path, below > 0, rows)
    if prim.many is not None:
        template: list[Row] = []
        _walk(tables, prim.many.prim, path, True, template)
        tables.many = (prim.many, template)
    has_below = len(rows) > start + 1 or prim.many is not None
    jump = (len(rows) - start if has_below else 0) if more else (-1 if has_below else -2)
    rows[start] = Row(tables.token(prim.name), jump, _PRIM, _prim_fields(tables, prim))


def _prim_fields(tables: Tables, prim: Prim) -> tuple[int, ...]:
    """Return the fields of a prim: what it is, and the names of its properties and children in order."""
    is_over = not prim.kind
    fields = [tables.field("specifier", rep(_SPECIFIER, int(is_over), is_inlined=True))]
    if prim.kind:
        fields.append(_word(tables, "typeName", prim.kind))
    if prim.model:
        fields.append(_word(tables, "kind", prim.model))
    if prim.schemas:
        data = bytes([_PREPENDED]) + tables.indices(list(prim.schemas))
        fields.append(tables.field("apiSchemas", rep(_TOKEN_LIST, tables.place(data))))
    children = [child.name for child in prim.children] + (prim.many.names if prim.many else [])
    for name, words in (("properties", [*prim.attributes, *prim.targets]), ("primChildren", children)):
        if words:
            fields.append(tables.field(name, rep(_TOKENS, tables.place(tables.indices(words)))))
    return tuple(fields)


def _word(tables: Tables, name: str, word: str) -> int:
    """Return the field whose value is a word."""
    return tables.field(name, rep(_TOKEN, tables.token(word), is_inlined=True))


def _attribute(tables: Tables, name: str, attribute: Attribute, more: bool) -> Row:
    """Return the row of an attribute."""
    fields = [_word(tables, "typeName", attribute.kind)]
    if attribute.is_uniform:
        fields.append(tables.field("variability", rep(_VARIABILITY, 1, is_inlined=True)))
    if attribute.interpolation is not None:
        fields.append(_word(tables, "interpolation", attribute.interpolation))
    if isinstance(attribute.value, Column):
        return Row(-tables.token(name), 0 if more else -2, _ATTRIBUTE, tuple(fields), attribute)
    fields.append(tables.field("default", tables.value(attribute)))
    return Row(-tables.token(name), 0 if more else -2, _ATTRIBUTE, tuple(fields))


def _relationship(tables: Tables, name: str, target: str, more: bool) -> Row:
    """Return the row of a relationship with one target."""
    data = bytes([_EXPLICIT]) + struct.pack("<QI", 1, tables.paths[target])
    fields = (
        tables.field("variability", rep(_VARIABILITY, 1, is_inlined=True)),
        tables.field("targetPaths", rep(_PATH_LIST, tables.place(data))),
    )
    return Row(-tables.token(name), 0 if more else -2, _RELATIONSHIP, fields)
