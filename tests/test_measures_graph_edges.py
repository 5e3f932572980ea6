from __future__ import annotations

import csv
import sys

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import FileFormatError, MissingPackageError, ShapeError
from grainsdem.measures.graph.edges import COLUMNS, SUFFIXES, write_edges
from grainsdem.packing import contacts


@pytest.fixture
def stack():
    """Two cubes on one another, the lower one on the floor and at a wall; one more far from both."""
    packing = cube_packing([[1.0, 5, 1], [1.5, 5, 3.25], [8, 8, 8]])
    return packing, contacts(packing, within=0.3, walls=True)


@pytest.mark.unit
def test_a_csv_has_a_row_for_each_contact_under_the_grains_own_ids(stack, tmp_path):
    _, graph = stack
    with write_edges(graph, tmp_path / "edges.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(r["i"], r["j"], r["kind"]) for r in rows] == [
        ("-5", "0", "face-face"),
        ("-1", "0", "face-face"),
        ("0", "1", "face-face"),
    ]
    assert [float(r["gap"]) for r in rows] == graph.gaps.tolist()
    assert float(rows[2]["area"]) == pytest.approx(3)


@pytest.mark.client
def test_networkx_reads_the_graphml_back_as_the_graph_it_has(stack, tmp_path):
    import networkx as nx

    packing, graph = stack
    read = nx.read_graphml(write_edges(graph, tmp_path / "bed.graphml", packing=packing), node_type=int)
    ours = graph.to_networkx()
    assert set(read.nodes) == set(ours.nodes) == {-5, -1, 0, 1, 2}
    assert {frozenset(e) for e in read.edges()} == {frozenset(e) for e in ours.edges()}
    assert read.edges[0, 1]["gap"] == ours.edges[0, 1, 0]["gap"]
    assert read.edges[0, 1]["kind"] == "face-face"
    assert read.nodes[1]["z"] == 3.25


@pytest.mark.client
def test_pyarrow_reads_the_parquet_back_with_types_and_every_digit(stack, tmp_path):
    from pyarrow import parquet

    _, graph = stack
    read = parquet.read_table(write_edges(graph, tmp_path / "bed.parquet"))
    assert read.column_names == list(COLUMNS)
    assert (str(read.schema.field("i").type), str(read.schema.field("gap").type)) == ("int32", "double")
    assert read["i"].to_pylist() == [-5, -1, 0]
    assert read["kind"].to_pylist() == ["face-face"] * 3
    for name, values in {
        "gap": graph.gaps,
        "area": graph.areas,
        "nz": graph.normals[:, 2],
        "x": graph.points[:, 0],
    }.items():
        np.testing.assert_array_equal(read[name].to_numpy(), values)
    assert b"walls have negative ids" in read.schema.metadata[b"units"]
    again = write_edges(graph, tmp_path / "again.parquet")
    assert again.read_bytes() == (tmp_path / "bed.parquet").read_bytes()


@pytest.mark.unit
def test_no_contact_at_all_makes_a_table_without_rows(tmp_path):
    from pyarrow import parquet

    packing = cube_packing([[5.0, 5, 5]])
    nothing = contacts(packing)
    for suffix in SUFFIXES:
        assert write_edges(nothing, tmp_path / f"bed{suffix}", packing=packing).stat().st_size > 0
    assert parquet.read_table(tmp_path / "bed.parquet").num_rows == 0
    assert (tmp_path / "bed.csv").read_text() == ",".join(COLUMNS) + "\n"


@pytest.mark.unit
def test_parquet_without_pyarrow_says_how_to_get_it_and_leaves_nothing(stack, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingPackageError, match=r'pip install "grainsdem\[tables\]"'):
        write_edges(stack[1], tmp_path / "edges.parquet")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.client
def test_pyvista_reads_lines_from_centroid_to_centroid(stack, tmp_path):
    import pyvista

    packing, graph = stack
    lines = pyvista.read(write_edges(graph, tmp_path / "bed.vtp", packing=packing))
    assert lines.n_lines == 3
    np.testing.assert_array_equal(lines.cell_data["i"], graph.pairs[:, 0])
    np.testing.assert_array_equal(lines.cell_data["gap"], graph.gaps)
    np.testing.assert_allclose(lines.get_cell(2).points[[0, 2]], packing.positions[[0, 1]], atol=1e-15)
    np.testing.assert_allclose(lines.get_cell(0).points[[0, 2]], [[1, 5, 0], [1, 5, 1]], atol=1.5)


@pytest.mark.unit
def test_what_cannot_be_written_is_refused(stack, tmp_path):
    _, graph = stack
    with pytest.raises(FileFormatError, match=r"\.csv, \.parquet, \.graphml or \.vtp; got '\.xls'"):
        write_edges(graph, tmp_path / "edges.xls")
    with pytest.raises(ShapeError, match="need packing="):
        write_edges(graph, tmp_path / "edges.vtp")
    with pytest.raises(ShapeError, match="3 grains; got 1"):
        write_edges(graph, tmp_path / "edges.csv", packing=cube_packing([[5.0, 5, 5]]))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.client
def test_more_columns_are_in_every_kind_of_file(stack, tmp_path):
    import networkx as nx
    import pyvista as pv
    from pyarrow import parquet

    packing, graph = stack
    more = {"load": [1.0, 2.0, 3.0], "chain": [-1, 0, 0], "force": np.arange(9.0).reshape(3, 3)}
    paths = [write_edges(graph, tmp_path / f"bed{suffix}", packing=packing, columns=more) for suffix in SUFFIXES]
    table, read, network, lines = (path.read_text() if path.suffix in {".csv", ".vtp"} else path for path in paths)
    assert table.splitlines()[0].endswith(",kind,load,chain,force_x,force_y,force_z")
    assert table.splitlines()[3].endswith(",3.0,0,6.0,7.0,8.0")
    assert parquet.read_table(read)["force_y"].to_pylist() == [1.0, 4.0, 7.0]
    assert nx.read_graphml(network, node_type=int).edges[0, 1]["load"] == 3.0
    shown = pv.read(paths[3])
    np.testing.assert_array_equal(shown.cell_data["force"], more["force"])
    np.testing.assert_array_equal(shown.cell_data["chain"], more["chain"])
    assert 'type="Int64" Name="chain"' in lines


@pytest.mark.unit
def test_a_column_of_another_length_is_refused(stack, tmp_path):
    packing, graph = stack
    with pytest.raises(ShapeError, match=r"load must be of shape \(3,\) or \(3, 3\); got \(2,\)"):
        write_edges(graph, tmp_path / "bed.csv", packing=packing, columns={"load": [1.0, 2.0]})
    assert list(tmp_path.iterdir()) == []
