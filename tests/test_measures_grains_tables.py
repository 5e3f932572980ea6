from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import FileFormatError, InputError, ShapeError, WriteError
from grainsdem.measures import core_box, diameters, porosity, sphericities, summary, table, write_csv
from grainsdem.model import ContactGraph, Domain, Packing, Polyhedra


def graph(n, pairs):
    m = len(pairs)
    return ContactGraph(n, pairs, np.zeros(m), np.tile([1.0, 0, 0], (m, 1)), np.zeros((m, 3)), np.zeros(m))


@pytest.mark.unit
def test_the_table_of_a_cube_says_what_a_cube_is():
    row = table(cube_packing([[1, 2, 3]], density=2650.0))[0]
    assert row.tolist() == pytest.approx(
        (0, 1, 2, 3, 8, 24, np.cbrt(48 / np.pi), np.cbrt(np.pi / 6), 6, 8, 8 * 2650.0), rel=1e-14
    )


@pytest.mark.unit
def test_rows_follow_the_grains_and_agree_with_the_single_measures(fresh):
    rows = table(fresh)
    np.testing.assert_array_equal(rows["id"], np.arange(len(fresh)))
    np.testing.assert_array_equal(np.stack([rows[a] for a in "xyz"], axis=1), fresh.positions)
    np.testing.assert_allclose(rows["diameter"], diameters(fresh.grains), rtol=1e-15)
    np.testing.assert_allclose(rows["sphericity"], sphericities(fresh.grains), rtol=1e-15)
    # Euler's polyhedron with three faces at each vertex: V = 2 F − 4
    np.testing.assert_array_equal(rows["n_vertices"], 2 * rows["n_faces"] - 4)


@pytest.mark.unit
def test_a_summary_is_json_and_names_the_region_of_its_porosity(fresh):
    found = json.loads(json.dumps(summary(fresh)))
    assert found["porosity_region"] == "cells"
    assert found["porosity"] == pytest.approx(0.4)
    assert found["porosity_box"] is None
    assert found["mean_coordination"] is None
    assert found["n_grains"] == len(fresh)
    assert found["d10"] < found["d50"] < found["d90"]
    assert found["total_mass"] == pytest.approx(2650 * found["solid_volume"])


@pytest.mark.unit
def test_after_the_grains_left_their_cells_the_porosity_is_that_of_the_core(poured):
    found = summary(poured)
    assert found["porosity_region"] == "core"
    lower, upper = core_box(poured)
    assert found["porosity_box"] == [lower.tolist(), upper.tolist()]
    assert found["porosity"] == porosity(poured, region=(lower, upper))


@pytest.mark.unit
def test_a_bed_too_small_for_a_core_gets_no_porosity_rather_than_a_wrong_one(cube):
    found = summary(cube)
    assert (found["porosity"], found["porosity_region"], found["porosity_box"]) == (None, None, None)


@pytest.mark.unit
def test_mean_coordination_counts_both_ends_of_a_contact_and_grains_without_one():
    packing = cube_packing([[2, 2, 2], [4, 2, 2], [6, 2, 2], [2, 8, 2]])
    assert summary(packing, graph(4, [[0, 1], [1, 2]]))["mean_coordination"] == 1.0
    with pytest.raises(ShapeError, match="4 grains; got 3"):
        summary(packing, graph(3, [[0, 1]]))


@pytest.mark.unit
def test_an_empty_packing_has_a_table_without_rows_and_no_summary():
    shapes = Polyhedra(np.empty((0, 3)), [0], [0], [], [0])
    nothing = Packing(shapes, np.empty((0, 3)), np.empty((0, 4)), [], Domain())
    assert len(table(nothing)) == 0
    with pytest.raises(InputError, match="at least one grain"):
        summary(nothing)


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


@pytest.mark.unit
def test_a_table_is_written_as_csv_only_and_only_where_one_can_write(fresh, tmp_path):
    with pytest.raises(FileFormatError, match=r"written as .csv; got '.xlsx'"):
        write_csv(table(fresh), tmp_path / "grains.xlsx")
    with pytest.raises(WriteError, match="cannot be written"):
        write_csv(table(fresh), tmp_path / "nowhere" / "grains.csv")
