from __future__ import annotations

import copy
import pickle
from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import InputError, ShapeError, ValidationError
from grainsdem.model import Check, ContactGraph, Domain, Packing, Polyhedra, Report

pytestmark = pytest.mark.unit


@pytest.mark.parametrize("remake", [lambda p: p, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p))])  # noqa: S301
def test_arrays_are_read_only_also_after_copy_and_pickle(fresh, remake):
    packing = remake(fresh)
    for array in (packing.positions, packing.grains.vertices, packing.domain.lower, packing.links.neighbors):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    assert packing.grains.vertices.tobytes() == fresh.grains.vertices.tobytes()


def test_making_a_noun_leaves_the_callers_array_writeable():
    positions = np.zeros((1, 3))
    cube_packing(positions)
    positions[0] = 1.0


@pytest.mark.parametrize("upper", [(1, 1, 0), (1, -1, 1), (1, 1, np.nan), (1, np.inf, 1)])
def test_a_domain_turned_inside_out_or_not_finite_is_refused(upper):
    with pytest.raises(InputError, match="upper corner"):
        Domain(np.zeros(3), np.array(upper, float))


def test_a_slab_is_planar_and_a_cube_is_not():
    assert Domain.slab((2.0, 3.0), 0.1).is_planar
    assert not Domain.cube().is_planar
    assert Domain.slab((2.0, 3.0), 0.1).volume == pytest.approx(0.6)


def test_faces_that_index_another_grains_vertices_are_refused(cube):
    shapes = cube.grains
    corners = shapes.face_vertices.copy()
    corners[3] = 8
    with pytest.raises(ShapeError, match="entries 3 do not"):
        Polyhedra(shapes.vertices, shapes.vertex_offsets, shapes.face_offsets, corners, shapes.face_vertex_offsets)


@pytest.mark.parametrize("field", ["positions", "quaternions", "densities"])
def test_a_packing_with_one_row_too_few_is_refused_by_name(fresh, field):
    with pytest.raises(ShapeError, match=field):
        replace(fresh, **{field: getattr(fresh, field)[:-1]})


def test_links_of_another_packing_are_refused(fresh, cube):
    with pytest.raises(ShapeError, match="one neighbour a face"):
        replace(cube, links=fresh.links)


def triangle_graph():
    """Grains 0, 1 and 2 touch one another; grain 3 touches nobody."""
    normals = np.tile([1.0, 0.0, 0.0], (3, 1))
    return ContactGraph(4, [[0, 1], [0, 2], [1, 2]], [0.1, 0.0, -0.1], normals, np.zeros((3, 3)), np.ones(3))


def test_coordination_counts_each_end_of_a_contact():
    assert triangle_graph().coordination().tolist() == [2, 2, 2, 0]


def test_the_adjacency_matrix_is_symmetric_and_has_the_coordination_as_row_sums():
    matrix = triangle_graph().to_scipy()
    assert matrix.shape == (4, 4)
    assert (matrix != matrix.T).nnz == 0
    assert matrix.sum(axis=1).tolist() == [2, 2, 2, 0]


def test_networkx_sees_the_same_graph_isolated_grains_included():
    graph = triangle_graph().to_networkx()
    assert dict(graph.degree) == {0: 2, 1: 2, 2: 2, 3: 0}
    assert graph.edges[1, 2, 0]["gap"] == pytest.approx(-0.1)


@pytest.mark.parametrize("pairs", [[[1, 0]], [[0, 4]], [[-2, -1]]])
def test_pairs_out_of_order_or_range_are_refused(pairs):
    with pytest.raises(ShapeError, match="i <= j"):
        ContactGraph(4, pairs, [0.0], np.zeros((1, 3)), np.zeros((1, 3)), [0.0])


def test_a_failed_report_names_the_check_and_its_first_offenders():
    good = Check("closed", ok=True, worst=0, threshold=0)
    bad = Check("overlaps", ok=False, worst=1e-3, threshold=1e-9, offenders=((3, 9), (4, 7)))
    assert Report((good,)).raise_if_failed().ok
    with pytest.raises(ValidationError, match=r"overlaps: worst 0\.001, allowed 1e-09 .*3–9, 4–7"):
        Report((good, bad)).raise_if_failed()
    assert Report((good, bad)).to_dict()["checks"][1]["ok"] is False


def test_provenance_grows_by_one_step_at_a_time(cube):
    stepped = cube.with_step("turn", angle=0.5).with_step("rest")
    assert len(cube.provenance) == 0
    assert stepped.provenance == ('{"angle": 0.5, "step": "turn"}', '{"step": "rest"}')
    assert isinstance(stepped, Packing)
