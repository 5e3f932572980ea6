"""The tables of a crate, version 0.8: grown spec by spec, and for many prims alike all at once.

A crate holds values, then tables: tokens; strings; fields, a name and a value each; sets of fields; paths, a tree from
the root; and specs, a path, a set of fields and a sort each.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.usd.codes import packed, packed_ints, rep
from exporters.usd.columns import as_stored, blocks, layout, reps_of, shape_of, sizes_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from exporters.usd.columns import Shape
    from exporters.usd.prims import Attribute, Column, Many

    Ints = NDArray[np.int32]

_HEAD = 88  # bytes before the values
_END = -1  # ends a set of fields
_DICTIONARY, _DOUBLES = 31, 48


class Row(NamedTuple):
    """A spec in the order of the tree: its name, negative for a property's, how the tree goes on, and its fields."""

    element: int
    jump: int
    sort: int
    fields: tuple[int, ...]
    column: Attribute | None = None


class Tables:
    """The tables as they grow; indices into them are never changed."""

    def __init__(self) -> None:
        # Index 0 is none: a property's name is told by the sign of its index.
        self.tokens: dict[str, int] = {"": 0}
        self.strings: dict[str, int] = {}
        self.values = bytearray()
        self.fields: dict[tuple[int, int], int] = {}
        self.paths: dict[str, int] = {}
        self.rows: list[Row] = []
        self.many: tuple[Many, list[Row]] | None = None

    def token(self, word: str) -> int:
        """Return the index of a token."""
        return self.tokens.setdefault(word, len(self.tokens))

    def string(self, word: str) -> int:
        """Return the index of a string, which is a token by another index."""
        self.token(word)
        return self.strings.setdefault(word, len(self.strings))

    def place(self, data: bytes) -> int:
        """Append bytes to the values and return where they begin."""
        self.values += b"\0" * (-len(self.values) % 8)
        start = _HEAD + len(self.values)
        self.values += data
        return start

    def field(self, name: str, value: int) -> int:
        """Return the index of a field: a name, and what stands for its value."""
        return self.fields.setdefault((self.token(name), value), len(self.fields))

    def indices(self, words: list[str]) -> bytes:
        """Return a count and the indices of tokens."""
        return struct.pack(f"<Q{len(words)}I", len(words), *(self.token(word) for word in words))

    def doubles(self, numbers: NDArray[np.float64]) -> int:
        """Return what stands for a list of times."""
        data = struct.pack("<Q", numbers.size) + numbers.astype("<f8").tobytes()
        return int(rep(_DOUBLES, self.place(data)))

    def value(self, attribute: Attribute) -> int:
        """Return what stands for the value of one attribute."""
        shape = shape_of(attribute.kind)
        words = attribute.value
        index = {"token": self.token, "string": self.string}.get(attribute.kind.removesuffix("[]"))
        if index is not None:
            words = [index(word) for word in words] if shape.is_list else index(words)
        numbers = as_stored(shape, words)
        if shape.is_inlined:
            return int(rep(shape.code, int(numbers.reshape(1).view("<u4")[0]), is_inlined=True))
        data = numbers.tobytes()
        if shape.is_list:
            data = struct.pack("<Q", len(data) // shape.size) + data
        return int(rep(shape.code, self.place(data), is_list=shape.is_list))

    def dictionary(self, entries: dict[str, Any]) -> int:
        """Return what stands for a dictionary of attributes and dictionaries."""
        data = struct.pack("<Q", len(entries))
        for key, entry in entries.items():
            value = self.dictionary(entry) if isinstance(entry, dict) else self.value(entry)
            data += struct.pack("<IqQ", self.string(key), 8, value)
        return int(rep(_DICTIONARY, self.place(data)))


class _Alike(NamedTuple):
    """Many prims alike, laid out: per prim and column the size and place of its value, and what stands for it."""

    rows: list[Row]
    tokens: Ints
    columns: list[tuple[Column, Shape]]
    names: list[int]
    sizes: NDArray[np.int64]
    places: NDArray[np.int64]
    reps: NDArray[np.uint64]
    times: dict[int, int]


def content(tables: Tables) -> Iterator[bytes]:
    """Yield the file: head, values, tables, and the table of these."""
    alike = _alike(tables)
    start = _HEAD + len(tables.values) + int(alike.sizes.sum())
    sections = _sections(tables, alike)
    ends = start + np.cumsum([len(data) for data in sections.values()])
    yield struct.pack("<8s8Bq64x", b"PXR-USDC", 0, 8, 0, 0, 0, 0, 0, 0, int(ends[-1]))
    yield bytes(tables.values)
    yield from blocks(alike.columns, alike.sizes, alike.places, alike.times)
    yield from sections.values()
    yield struct.pack("<Q", len(sections))
    for (name, data), end in zip(sections.items(), ends.tolist(), strict=True):
        yield struct.pack("<16sqq", name.encode(), end - len(data), len(data))


def _alike(tables: Tables) -> _Alike:
    """Lay out the many prims behind the values that are there."""
    names, rows = ([], []) if tables.many is None else (tables.many[0].names, tables.many[1])
    n = len(names)
    attributes = [row.column for row in rows if row.column is not None]
    columns = [(attribute.value, shape_of(attribute.kind)) for attribute in attributes]
    times = {k: tables.doubles(column.times) for k, (column, _) in enumerate(columns) if column.times is not None}
    tables.values += b"\0" * (-len(tables.values) % 8)
    sizes = np.zeros((n, len(columns)), dtype=np.int64)
    for k, (column, shape) in enumerate(columns):
        sizes[:, k] = sizes_of(column, shape, n)
    places = layout(sizes, _HEAD + len(tables.values))
    reps = np.empty((n, len(columns)), dtype=np.uint64)
    for k, (column, shape) in enumerate(columns):
        reps[:, k] = reps_of(column, shape, places[:, k])
    fields = [tables.token("default" if column.times is None else "timeSamples") for column, _ in columns]
    tokens = np.array([tables.token(name) for name in names], dtype=np.int32)
    return _Alike(rows, tokens, columns, fields, sizes, places, reps, times)


def _sections(tables: Tables, alike: _Alike) -> dict[str, bytes]:
    """Return the tables by name in the order of the file, each packed before the next is made."""
    count = struct.Struct("<Q").pack
    strings = [tables.tokens[word] for word in tables.strings]
    words = "".join(f"{word}\0" for word in tables.tokens).encode()
    joined = packed(words)
    names, reps = _fields(tables, alike)
    (n_sets, sets), (_, starts) = ((len(numbers), packed_ints(numbers)) for numbers in _sets(tables, alike))
    elements, jumps, sorts = (packed_ints(numbers) for numbers in _tree(tables, alike))
    n_rows = len(tables.rows) + len(alike.rows) * len(alike.tokens)
    order = packed_ints(np.arange(n_rows, dtype=np.int32))
    return {
        "TOKENS": count(len(tables.tokens)) + count(len(words)) + count(len(joined)) + joined,
        "STRINGS": struct.pack(f"<Q{len(strings)}I", len(strings), *strings),
        "FIELDS": count(len(tables.fields) + alike.reps.size) + names + reps,
        "FIELDSETS": count(n_sets) + sets,
        "PATHS": 2 * count(n_rows) + order + elements + jumps,
        "SPECS": count(n_rows) + order + starts + sorts,
    }


def _fields(tables: Tables, alike: _Alike) -> tuple[bytes, bytes]:
    """Return the names of fields, and what stands for their values, packed."""
    fields = np.array(list(tables.fields), dtype=np.uint64).reshape(-1, 2)
    names = np.concatenate(
        [fields[:, 0].astype(np.int32), np.tile(np.array(alike.names, dtype=np.int32), len(alike.tokens))]
    )
    reps = packed(fields[:, 1].tobytes(), alike.reps.ravel().view(np.uint8).data)
    return packed_ints(names), len(reps).to_bytes(8, "little") + reps


def _sets(tables: Tables, alike: _Alike) -> Iterator[Ints]:
    """Yield the sets of fields one after another, then where the set of each spec begins."""
    shared: dict[tuple[int, ...], int] = {}
    sets: list[int] = []

    def begin(row: Row) -> int:
        if row.fields not in shared:
            shared[row.fields] = len(sets)
            sets.extend([*row.fields, _END])
        return shared[row.fields]

    singles = [begin(row) for row in tables.rows]
    firsts = [begin(row) if row.column is None else 0 for row in alike.rows]
    # What follows is one prim's own sets, again and again: fields of its kind, then the value of that column.
    own: list[int] = []
    starts, ends = [], []
    for row in alike.rows:
        if row.column is not None:
            starts.append(len(own))
            own += [*row.fields, 0, _END]
            ends.append(len(own) - 2)
    n, k = alike.reps.shape
    numbers, many = _before(sets, n, own)
    many[:, ends] = len(tables.fields) + np.arange(n * k, dtype=np.int32).reshape(n, k)
    yield numbers
    del numbers, many
    numbers, many = _before(singles, n, firsts)
    has_own = [i for i, row in enumerate(alike.rows) if row.column is not None]
    places = np.array(starts, dtype=np.int32) + np.int32(len(own)) * np.arange(n, dtype=np.int32)[:, None]
    many[:, has_own] = len(sets) + places
    yield numbers


def _before(singles: list[int], n: int, row: list[int]) -> tuple[Ints, Ints]:
    """Return some numbers with a row of others ``n`` times behind, and a view of the latter, shape (n, k)."""
    numbers = np.empty(len(singles) + n * len(row), dtype=np.int32)
    numbers[: len(singles)] = singles
    many = numbers[len(singles) :].reshape(n, len(row))
    many[:] = row
    return numbers, many


def _tree(tables: Tables, alike: _Alike) -> Iterator[Ints]:
    """Yield the name, then the jump, then the sort of each spec in the order of the tree."""
    n = len(alike.tokens)
    for k in range(3):
        singles, repeated = (
            [(row.element, row.jump, row.sort)[k] for row in rows] for rows in (tables.rows, alike.rows)
        )
        numbers, many = _before(singles, n, repeated)
        if n and k == 0:
            many[:, 0] = alike.tokens
        elif n and k == 1:
            many[-1, 0] = -1 if len(alike.rows) > 1 else -2  # no other follows the last
        yield numbers
