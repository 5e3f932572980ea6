"""Tables of grains and graphs of contacts as formats: opened by pandas, PyArrow, networkx and VTK."""

import io

import networkx as nx
import numpy as np
import pandas as pd
import pytest
import pyvista

import exporters
from grainsdem.errors import FileFormatError, InputError
from grainsdem.measures import table
from grainsdem.packing import contacts, heal


@pytest.fixture(scope="module")
def touching(fresh):
    """The gap within which neighbours that were shrunk apart count as contacts."""
    return 0.2 * float(np.mean(table(fresh)["diameter"]))


@pytest.mark.client
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
@pytest.mark.opens("grains", "pandas", "counted")
def test_pandas_reads_a_row_a_grain_with_every_measure(fresh, tmp_path, suffix):
    [path] = exporters.write(fresh, tmp_path / f"grains{suffix}")
    frame = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
    rows = table(fresh)
    assert tuple(frame.columns) == rows.dtype.names
    for column in ("id", "mass", "volume", "x", "n_faces"):
        np.testing.assert_array_equal(frame[column], rows[column])


@pytest.mark.client
@pytest.mark.opens("contacts", "networkx", "counted")
def test_networkx_reads_the_graph_with_the_gaps_that_the_search_found(fresh, tmp_path, touching):
    [path] = exporters.write(fresh, tmp_path / "who.graphml", within=touching, walls=True)
    graph = nx.read_graphml(path)
    found = contacts(fresh, within=touching, walls=True)
    assert graph.number_of_edges() == len(found) > len(fresh)
    gaps = {(int(i), int(j)): data["gap"] for i, j, data in graph.edges(data=True)}
    for (i, j), gap in zip(found.pairs.tolist(), found.gaps.tolist(), strict=True):
        assert gaps.get((i, j), gaps.get((j, i))) == gap
    assert graph.nodes["5"]["z"] == fresh.positions[5, 2]


@pytest.mark.client
def test_a_list_of_edges_and_its_lines_go_by_the_name_of_the_format(fresh, tmp_path, touching):
    found = contacts(fresh, within=touching)
    [rows] = exporters.write(fresh, tmp_path / "who.csv", format="contacts", within=touching)
    assert pd.read_csv(rows)[["i", "j"]].to_numpy().tolist() == found.pairs.tolist()
    [lines] = exporters.write(fresh, tmp_path / "who.vtp", format="contacts", within=touching)
    assert pyvista.read(lines).n_lines == len(found)


@pytest.mark.unit
def test_tables_go_into_one_folder_with_the_other_formats_under_the_same_ids(fresh, tmp_path):
    paths = exporters.write(fresh, tmp_path / "all", formats=["stl", "grains", "contacts", "vtk", "ply"])
    assert sorted(path.name for path in paths) == [
        "bed.csv", "bed.graphml", "bed.ply", "bed.stl", "bed.triangles.csv", "bed.vtp", "manifest.json",
    ]  # fmt: skip
    frame = pd.read_csv(io.BytesIO((tmp_path / "all" / "bed.csv").read_bytes()))
    cells = pyvista.read(tmp_path / "all" / "bed.vtp").cell_data
    first = np.searchsorted(cells["id"], frame["id"])
    np.testing.assert_allclose(cells["mass"][first], frame["mass"], rtol=1e-6)


@pytest.mark.unit
def test_what_is_no_gap_or_no_table_is_refused(fresh, tmp_path):
    with pytest.raises(InputError, match=r"within must be zero or more and finite; got -1"):
        exporters.write(fresh, tmp_path / "who.graphml", within=-1.0)
    with pytest.raises(FileFormatError, match=r"contacts are written as .csv, .parquet, .graphml or .vtp; got '.txt'"):
        exporters.write(fresh, tmp_path / "who.txt", format="contacts")
    with pytest.raises(FileFormatError, match="a table is written as"):
        exporters.write(fresh, tmp_path / "who.xls", format="grains")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.unit
def test_a_bed_in_which_nothing_touches_has_a_graph_without_edges(fresh):
    apart = heal(fresh).packing
    graph = nx.read_graphml(io.BytesIO(exporters.files(apart, ".graphml", within=0.0)["bed.graphml"]))
    assert graph.number_of_edges() == 0
    assert graph.number_of_nodes() == len(fresh)
