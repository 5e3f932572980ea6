"""Tables as files for whatever reads tables: CSV, Parquet, HDF5; and as a data frame of pandas."""

from __future__ import annotations

import csv
import io
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, MissingPackageError, ShapeError
from grainsdem.gate import gated
from grainsdem.measures.grains.tables import UNITS

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from numpy.typing import NDArray


@gated
def write_table(rows: NDArray[np.void], path: str | os.PathLike[str]) -> Path:
    """Write a table, or any structured array, as CSV, Parquet or HDF5, by the suffix of the path.

    Parameters
    ----------
    rows : structured ndarray, shape (n,)
        What `table` or `neighbor_table` returns.
    path : str or path-like
        ``.csv``: a header of column names, then one line a row. ``.parquet``: the columns with their types, for
        pandas, Polars and DuckDB. ``.h5`` or ``.hdf5``: one compound dataset named ``table``. The last two know the
        columns' units.

    Returns
    -------
    pathlib.Path
        The file. Numbers keep every digit; the same rows give the same bytes.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    ShapeError
        If the array is not structured and one-dimensional.
    WriteError
        If it cannot be written.
    MissingPackageError
        If PyArrow, which writes Parquet, is not installed.
    """
    target = check_table(path)
    content = table_content(rows, target.suffix.lower())
    with replacing(target) as temporary:
        temporary.write_bytes(content)
    return target


def table_content(rows: NDArray[np.void], suffix: str) -> bytes:
    """Return what `write_table` writes under a suffix that `check_table` lets through; it raises the same errors."""
    if rows.dtype.names is None or rows.ndim != 1:
        raise ShapeError(f"a table must be a structured array of shape (n,); got {rows.dtype} of shape {rows.shape}")
    return _WRITERS[suffix](rows)


@gated
def write_csv(rows: NDArray[np.void], path: str | os.PathLike[str]) -> Path:
    """Write a table, or any structured array, as CSV: `write_table` for a path that must end in ``.csv``.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    WriteError
        If it cannot be written.
    """
    return write_table(rows, check_csv(path))


def check_csv(path: str | os.PathLike[str]) -> Path:
    """Return the path of a table, or raise `FileFormatError` where it does not end in ``.csv``."""
    target = Path(path)
    if target.suffix.lower() != ".csv":
        raise FileFormatError(f"{target}: a table is written as .csv; got {target.suffix or 'no suffix'!r}")
    return target


def check_table(path: str | os.PathLike[str]) -> Path:
    """Return the path of a table, or raise `FileFormatError` where its suffix is none that tables are written as."""
    target = Path(path)
    if target.suffix.lower() not in _WRITERS:
        *others, last = _WRITERS
        given = target.suffix or "no suffix"
        raise FileFormatError(f"{target}: a table is written as {', '.join(others)} or {last}; got {given!r}")
    return target


@gated
def to_pandas(rows: NDArray[np.void]) -> Any:
    """Return a table as a ``pandas.DataFrame``.

    Raises
    ------
    MissingPackageError
        If pandas is not installed.
    """
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingPackageError("data frames need pandas: pip install pandas") from error
    return pd.DataFrame({name: rows[name] for name in rows.dtype.names or ()})


def _csv(rows: NDArray[np.void]) -> bytes:
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(rows.dtype.names or ())
    writer.writerows(rows.tolist())
    return text.getvalue().encode()


def _parquet(rows: NDArray[np.void]) -> bytes:
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError as error:
        raise MissingPackageError('Parquet needs PyArrow: pip install "grainsdem[tables]"') from error
    arrays, fields = [], []
    for name in rows.dtype.names or ():
        values = np.ascontiguousarray(rows[name])
        array = (
            pa.array(values.tolist(), pa.string()).dictionary_encode() if values.dtype.kind == "U" else pa.array(values)
        )
        arrays.append(array)
        fields.append(pa.field(name, array.type, metadata={"unit": UNITS[name]} if name in UNITS else None))
    sink = io.BytesIO()
    parquet.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields)), sink, compression="zstd")
    return sink.getvalue()


def _hdf5(rows: NDArray[np.void]) -> bytes:
    import h5py  # noqa: PLC0415  (a tenth of a second, for one of three formats)

    # HDF5 has no UTF-32: texts are stored as bytes of UTF-8.
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    columns = {
        name: np.char.encode(values, "utf-8") if values.dtype.kind == "U" else values
        for name, values in columns.items()
    }
    # A text of no letters has no room there.
    fields = [(name, values.dtype if values.dtype.itemsize else np.dtype("S1")) for name, values in columns.items()]
    stored = np.empty(rows.shape, dtype=fields)
    for name, values in columns.items():
        stored[name] = values
    sink = io.BytesIO()
    with h5py.File(sink, "w", libver=("v110", "v110")) as file:
        dataset = file.create_dataset("table", data=stored)
        dataset.attrs["units"] = json.dumps({name: UNITS[name] for name, _ in fields if name in UNITS})
    return sink.getvalue()


_WRITERS: dict[str, Callable[[NDArray[np.void]], bytes]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".h5": _hdf5,
    ".hdf5": _hdf5,
}
