"""Tables that grow row by row and are read again: text of numbers, rows as CSV, and what they hold."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, MissingFileError
from grainsdem.foreign import refusing
from grainsdem.gate import gated

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from numpy.typing import NDArray


def text_of(value: Any) -> str:
    """Return a value as it stands in a table: numbers with every digit, lists and tables as JSON."""
    if isinstance(value, float):
        return repr(float(value))  # one of NumPy says its type besides
    return json.dumps(value) if isinstance(value, list | tuple | dict) else str(value)


def write_rows(path: Path, header: Sequence[str], rows: Sequence[Sequence[str] | None]) -> None:
    """Write the rows that there are, below a header; raises `WriteError` where they cannot be written."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(row for row in rows if row is not None)
    with replacing(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8", newline="")


def read_rows(path: Path) -> tuple[list[str], list[list[str]]]:
    """Return the header and the rows of a file; nothing where it is no such table."""
    try:
        header, *rows = csv.reader(io.StringIO(path.read_text(encoding="utf-8-sig")))
    except (ValueError, OSError, csv.Error):
        return [], []
    return header, rows


@gated
def load(path: str | os.PathLike[str]) -> NDArray[np.void]:
    """Return a survey's table as a structured array; numbers where a column has nothing else.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it holds no table.
    """
    path = Path(path)
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    with refusing(path, "not a survey's table"):
        header, *rows = csv.reader(io.StringIO(path.read_text(encoding="utf-8-sig")))
    if not rows or any(len(row) != len(header) for row in rows) or len(set(header)) < len(header) or "" in header:
        raise FileFormatError(f"{path}: not a survey's table")
    columns = [_numbers(list(values)) for values in zip(*rows, strict=True)]
    table = np.empty(len(rows), dtype=[(name, column.dtype) for name, column in zip(header, columns, strict=True)])
    for name, column in zip(header, columns, strict=True):
        table[name] = column
    return table


def _numbers(texts: list[str]) -> NDArray[Any]:
    for kind in (np.int64, np.float64):
        try:
            return np.array(texts).astype(kind)
        except (ValueError, OverflowError):
            continue
    return np.array(texts)
