"""Sieve sheets as tables of two columns, and what their heads say of unit and kind."""

from __future__ import annotations

import csv
import re
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.foreign import refusing
from grainsdem.gate import gated
from grainsdem.measures.distributions.sheets.sheet import WHOLE, SieveSheet, Unit, check_unit, opening
from grainsdem.points import text

if TYPE_CHECKING:
    import os

Kind = Literal["passing", "retained"]

SUFFIXES = (".csv", ".txt", ".tsv")

_UNITS: dict[str, Unit] = {
    r"µm|μm|\bum\b|micron": "um",
    r"\bmm\b|millimet": "mm",
    r"φ|\bphi\b": "phi",
    r"astm|mesh|\bno\b|sieve number": "astm",
    r"\bm\b|\bmetres?\b|\bmeters?\b": "m",
}
_KINDS: dict[str, Kind] = {
    r"pass|finer|smaller|undersize": "passing",
    r"retain|weight|mass|\bg\b|gram|held": "retained",
}
_COARSER = r"coarser|cumulative.*retain|retain.*cumulative|oversize"


@gated
def read_sieves(path: str | os.PathLike[str], *, unit: Unit | None = None, kind: Kind | None = None) -> SieveSheet:
    """Read a sieve sheet: a column of openings, and one of what passes or is retained.

    Parameters
    ----------
    path : str or path
        A .csv, .txt or .tsv file, columns parted by commas, semicolons, tabs or blanks; decimals behind a point, or
        behind a comma where that parts nothing. Rows in either order; one may be the pan. Further columns are not read.
    unit : {"mm", "m", "um", "phi", "astm"}, optional
        What openings are in; as the head of the column says, else millimetres. Names such as ``No. 40`` speak for
        themselves.
    kind : {"passing", "retained"}, optional
        Whether the second column is per cent by mass that pass, or mass (or per cent) retained on each sieve; as its
        head says, else passing where the numbers rise with the opening to no more than 100.

    Raises
    ------
    MissingFileError, FileFormatError
        If there is no such file, or it is something else; the message names the line.
    """
    file = Path(path)
    if file.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{file}: sheets are read from {', '.join(SUFFIXES)}; got {file.suffix or 'no suffix'!r}")
    if not file.is_file():
        raise MissingFileError(f"{file}: no such file")
    with refusing(file, "not a sieve sheet"):
        return parse_sieves(text.decoded(file.read_bytes()), unit=unit, kind=kind)


def parse_sieves(content: str, *, unit: Unit | None = None, kind: Kind | None = None) -> SieveSheet:
    """Return the sheet that a text holds; errors as in `read_sieves`, without the path."""
    if unit is not None:
        check_unit(unit)
    heads, rows = _table(content)
    told: Unit = next((u for words, u in _UNITS.items() if re.search(words, heads[0])), "mm")
    sizes, values = [], []
    pan: float | None = None
    for number, (first, second) in rows:
        try:
            size, value = opening(first, unit or told), float(second.rstrip("%").replace(",", "."))
        except InputError as error:
            raise FileFormatError(f"line {number}: {error}") from error
        except ValueError:
            raise FileFormatError(f"line {number}: {second!r} is no number") from None
        if size == 0:
            pan = value
            continue
        sizes.append(size)
        values.append(value)
    if kind is None:
        kind = _kind(heads[1], sizes, values)
    if re.search(_COARSER, heads[1]):
        raise FileFormatError(
            f"{heads[1]!r} is what stays on this sieve and all wider ones: give 100 less that as per cent passing"
        )
    if kind == "passing":
        return SieveSheet.from_passing(sizes, values)
    whole = sum(values) + (pan or 0.0)
    if whole > WHOLE and re.search(r"%|per ?cent", heads[1]):
        raise FileFormatError(f"per cent retained sum to {whole:g}, at most 100")
    return SieveSheet.from_retained(sizes, values, pan=pan or 0.0)


def _kind(head: str, sizes: list[float], values: list[float]) -> Kind:
    """Return what the second column is."""
    found = next((kind for words, kind in _KINDS.items() if re.search(words, head)), None)
    if found is not None:
        return found
    rising = [value for _, value in sorted(zip(sizes, values, strict=True))]
    if all(a <= b for a, b in pairwise(rising)) and rising and rising[-1] <= 100:
        return "passing"
    raise FileFormatError(
        "is the second column per cent passing, or the mass retained on each sieve? Name it in a first line, 'passing' "
        "or 'retained'"
    )


def _table(content: str) -> tuple[tuple[str, str], list[tuple[int, tuple[str, str]]]]:
    """Return the heads of the two columns, in lower case, and the rows with the numbers of their lines."""
    lines = [
        (number, line.strip())
        for number, line in enumerate(content.splitlines(), 1)
        if line.strip() and not line.lstrip().startswith(("#!", "%", "//"))
    ]
    # '#' is a comment's sign, and that of a numbered sieve.
    lines = [(number, line) for number, line in lines if not re.match(r"#\s*[^\d\s]", line)]
    separator = next((sign for sign in ";\t," if lines and all(sign in line for _, line in lines[1:] or lines)), None)
    cut = [(number, _fields(line, separator)) for number, line in lines]
    for number, fields in cut:
        if len(fields) < 2:
            raise FileFormatError(f"line {number}: two columns are read, openings and what passes; got {fields[0]!r}")
    if not cut:
        raise FileFormatError("no line holds a sieve")
    first = cut[0][1]
    has_head = not re.search(r"\d", first[1]) or not re.search(r"\d|pan", first[0].lower())
    heads = (first[0].lower(), first[1].lower()) if has_head else ("", "")
    return heads, [(number, (fields[0], fields[1])) for number, fields in cut[has_head:]]


def _fields(line: str, separator: str | None) -> list[str]:
    if separator is None:
        *name, value = line.split()
        return [" ".join(name), value] if name else [value]
    return [field.strip() for field in next(csv.reader([line], delimiter=separator))]
