from __future__ import annotations

import csv

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import FileFormatError, ShapeError
from grainsdem.measures.edges import write_edges
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
    with pytest.raises(FileFormatError, match=r"\.csv, \.graphml or \.vtp"):
        write_edges(graph, tmp_path / "edges.xls")
    with pytest.raises(ShapeError, match="need packing="):
        write_edges(graph, tmp_path / "edges.vtp")
    with pytest.raises(ShapeError, match="3 grains; got 1"):
        write_edges(graph, tmp_path / "edges.csv", packing=cube_packing([[5.0, 5, 5]]))
    assert list(tmp_path.iterdir()) == []
