from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest

from grainsdem.errors import ArgumentError, FileFormatError, MissingPackageError, WriteError
from grainsdem.measures import neighbor_table, table, to_pandas, write_csv, write_table


@pytest.mark.unit
def test_a_table_written_as_csv_reads_back_digit_for_digit(fresh, tmp_path):
    rows = table(fresh)
    path = write_csv(rows, tmp_path / "grains.csv")
    with path.open(encoding="utf-8", newline="") as file:
        header, *lines = csv.reader(file)
    assert tuple(header) == rows.dtype.names
    back = np.array([tuple(line) for line in lines], dtype=rows.dtype)
    np.testing.assert_array_equal(back, rows)
    assert [p.name for p in tmp_path.iterdir()] == ["grains.csv"]


@pytest.mark.client
def test_pyarrow_reads_the_parquet_back_with_types_units_and_every_digit(fresh, tmp_path):
    from pyarrow import parquet

    rows = table(fresh)
    path = write_table(rows, tmp_path / "grains.parquet")
    back = parquet.read_table(path)
    assert back.column_names == list(rows.dtype.names)
    for name in rows.dtype.names:
        np.testing.assert_array_equal(back[name].to_numpy(), rows[name])
    assert back.schema.field("volume").metadata == {b"unit": b"m3"}
    assert str(back.schema.field("n_faces").type) == "int32"
    assert write_table(rows, tmp_path / "again.parquet").read_bytes() == path.read_bytes()


@pytest.mark.client
def test_h5py_reads_the_hdf5_back_with_types_units_and_every_digit(fresh, tmp_path):
    import h5py

    rows = table(fresh)
    path = write_table(rows, tmp_path / "grains.h5")
    with h5py.File(path) as file:
        back, units = file["table"][()], json.loads(file["table"].attrs["units"])
    assert back.dtype.names == rows.dtype.names
    for name in rows.dtype.names:
        np.testing.assert_array_equal(back[name].astype(rows.dtype[name]), rows[name])
    assert units["sieve_diameter"] == "m"
    assert write_table(rows, tmp_path / "again.hdf5").read_bytes() == path.read_bytes()


@pytest.mark.client
def test_pandas_holds_the_table_and_can_be_grouped_by_its_classes(fresh):
    rows = table(fresh)
    frame = to_pandas(rows)
    assert list(frame.columns) == list(rows.dtype.names)
    assert frame["n_faces"].dtype == np.int32
    counts = frame.groupby("zingg").size()
    assert counts.sum() == len(fresh)
    assert counts["spheroid"] == np.count_nonzero(rows["zingg"] == "spheroid")


@pytest.mark.unit
@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_the_table_of_neighbours_is_written_too_and_so_is_one_without_rows(fresh, tmp_path, suffix):
    rows = neighbor_table(fresh)
    full, empty = write_table(rows, tmp_path / f"a{suffix}"), write_table(rows[:0], tmp_path / f"b{suffix}")
    assert full.stat().st_size > empty.stat().st_size > 0


@pytest.mark.unit
def test_what_cannot_be_written_is_refused_and_leaves_nothing(fresh, tmp_path, monkeypatch):
    rows = table(fresh)
    with pytest.raises(FileFormatError, match=r"written as \.csv, \.parquet, \.h5 or \.hdf5; got '\.xlsx'"):
        write_table(rows, tmp_path / "grains.xlsx")
    with pytest.raises(FileFormatError, match=r"written as .csv; got '.parquet'"):
        write_csv(rows, tmp_path / "grains.parquet")
    with pytest.raises(WriteError, match="cannot be written"):
        write_table(rows, tmp_path / "nowhere" / "grains.csv")
    with pytest.raises(ArgumentError, match="a table with named columns"):
        write_table(np.zeros(3), tmp_path / "grains.csv")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingPackageError, match=r'pip install "grainsdem\[tables\]"'):
        write_table(rows, tmp_path / "grains.parquet")
    with pytest.raises(MissingPackageError, match="pip install pandas"):
        to_pandas(rows)
    assert list(tmp_path.iterdir()) == []
