from __future__ import annotations

import json
from dataclasses import replace

import h5py
import numpy as np
import pytest
from conftest import cube_packing
from pyarrow import parquet
from typer.testing import CliRunner

import grainsdem
from grainsdem.cli import app

pytestmark = pytest.mark.unit


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def beds(fresh, tmp_path_factory):
    """A bed whose grains know their cells, and one whose grains were shuffled."""
    folder = tmp_path_factory.mktemp("beds")
    grainsdem.save(fresh, folder / "fresh.h5")
    grainsdem.save(grainsdem.shuffle(fresh, rng=5), folder / "shuffled.h5")
    return folder


def test_measure_writes_tables_of_grains_and_of_neighbours_by_suffix(beds, tmp_path, fresh):
    words = ["--table", tmp_path / "grains.parquet", "--neighbors", tmp_path / "neighbors.h5", "--quiet"]
    assert call("measure", beds / "fresh.h5", *words).exit_code == 0
    rows = grainsdem.table(fresh)
    read = parquet.read_table(tmp_path / "grains.parquet")
    np.testing.assert_array_equal(read["sieve_diameter"].to_numpy(), rows["sieve_diameter"])
    with h5py.File(tmp_path / "neighbors.h5") as file:
        assert len(file["table"]) == rows["n_neighbors"].sum()


def test_measure_leaves_sieve_diameters_out_of_the_table_where_asked(beds, tmp_path):
    path = tmp_path / "grains.parquet"
    assert call("measure", beds / "fresh.h5", "--table", path, "--no-sieves", "--quiet").exit_code == 0
    names = parquet.read_schema(path).names
    assert "box_c" in names
    assert "sieve_diameter" not in names


def test_measure_tells_the_distribution_in_json_beside_the_summary(beds, fresh):
    plain = json.loads(call("measure", beds / "fresh.h5", "--json").stdout)
    found = json.loads(call("measure", beds / "fresh.h5", "--distribution", "--json").stdout)
    assert found.pop("distribution") == json.loads(json.dumps(grainsdem.size_distribution(fresh)))
    assert found == plain


def test_measure_prints_the_distribution_with_the_best_family_first(beds, fresh):
    text = call("measure", beds / "fresh.h5", "--distribution").output
    fits = grainsdem.size_distribution(fresh)["fits"]
    best = min(fits, key=lambda family: fits[family]["aic"])
    lines = text[text.index("fits by number") :]
    assert "sorted" in text
    assert all(lines.index(best) <= lines.index(family) for family in fits)
    sieved = call("measure", beds / "fresh.h5", "--distribution", "--diameter", "sieve").output
    assert "square holes passed" in sieved


def test_a_grain_that_is_inside_out_is_named_by_the_checks_and_has_no_size_to_measure(tmp_path):
    bed = cube_packing([[1.0, 1, 1], [4.0, 1, 1]])
    corners = np.array(bed.grains.face_vertices).reshape(12, 4)
    corners[6:] = corners[6:, ::-1]
    turned = replace(bed.grains, face_vertices=corners.ravel())
    grainsdem.save(replace(bed, grains=turned), tmp_path / "bad.h5")
    checked = call("validate", tmp_path / "bad.h5")
    assert checked.exit_code == 1
    assert "outward" in checked.stderr
    measured = call("measure", tmp_path / "bad.h5")
    assert measured.exit_code == 2
    assert "1 of 2 have not: 1 (of the first it is -8 m3)" in " ".join(measured.stderr.split())


def test_measure_refuses_a_table_in_another_format_before_it_reads_the_bed(tmp_path):
    result = call("measure", tmp_path / "missing.h5", "--table", tmp_path / "grains.xlsx")
    assert result.exit_code == 2
    assert "a table is written as .csv, .parquet, .h5 or .hdf5; got '.xlsx'" in result.stderr


def test_grains_that_left_their_cells_have_no_neighbours_to_write_and_nothing_is_written(beds, tmp_path):
    words = ["--table", tmp_path / "grains.csv", "--neighbors", tmp_path / "neighbors.csv"]
    result = call("measure", beds / "shuffled.h5", *words)
    assert result.exit_code == 2
    assert "lost the cells" in result.stderr
    assert list(tmp_path.iterdir()) == []
