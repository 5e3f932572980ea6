"""Triangles of faces, and principal axes, against trimesh and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.rotations import random_quaternions, to_matrices
from grainsdem.geometry.triangles import best_apexes, best_fans, facets, triangles, vector_areas
from grainsdem.model import Polyhedra


@pytest.mark.unit
@pytest.mark.parametrize("choose", [lambda _: None, best_apexes])
def test_triangles_close_every_grain_and_keep_its_volume(fresh, choose):
    grains = fresh.grains
    cut = triangles(grains, apexes=choose(grains))
    corners = np.diff(grains.face_vertex_offsets)
    assert len(cut.indices) == (corners - 2).sum()
    exact = integrate(grains)
    for i in range(len(grains)):
        faces = cut.indices[cut.offsets[i] : cut.offsets[i + 1]]
        mesh = trimesh.Trimesh(grains.vertices_of(i), faces, process=False)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(exact.volumes[i], rel=1e-12)
        assert mesh.area == pytest.approx(exact.areas[i], rel=1e-12)


@pytest.mark.unit
def test_the_best_apex_avoids_the_flat_triangle_of_collinear_corners():
    # One face: a square with a corner more in the middle of its first side.
    square = [[0, 0, 0], [1, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0]]
    face = Polyhedra(square, [0, 5], [0, 1], [0, 1, 2, 3, 4], [0, 5])
    areas = []
    for apexes in (None, best_apexes(face)):
        corners = face.vertices[triangles(face, apexes=apexes).indices]
        areas.append(np.linalg.norm(vector_areas(corners), axis=1))
        assert np.allclose(vector_areas(corners).sum(axis=0), [0, 0, 4])
    assert areas[0].min() == 0.0
    assert areas[1].min() == pytest.approx(1.0)


@pytest.mark.unit
def test_no_polyhedra_have_no_triangles():
    cut = triangles(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]))
    assert cut.indices.shape == (0, 3)
    assert cut.offsets.tolist() == [0]


@pytest.mark.property
@given(
    moments=st.lists(st.floats(1.0, 2.0), min_size=3, max_size=3).map(sorted),
    seed=st.integers(0, 2**32 - 1),
)
def test_principal_axes_rebuild_the_tensor_and_are_right_handed(moments, seed):
    turn = to_matrices(random_quaternions(1, np.random.default_rng(seed)))
    tensor = turn @ np.diag(moments) @ turn.transpose(0, 2, 1)
    found, quaternions = principal_inertia(tensor)
    axes = to_matrices(quaternions)
    assert np.allclose(found, moments, rtol=0, atol=1e-12)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert np.allclose(axes * found[:, None, :] @ axes.transpose(0, 2, 1), tensor, rtol=0, atol=1e-12)


@pytest.mark.unit
def test_the_axes_of_a_box_along_the_world_are_the_worlds():
    moments, quaternions = principal_inertia(np.diag([1.0, 2.0, 3.0])[None])
    assert moments.tolist() == [[1.0, 2.0, 3.0]]
    assert quaternions.tolist() == [[1.0, 0.0, 0.0, 0.0]]


@pytest.mark.unit
def test_facets_are_the_triangles_of_fans_with_the_normals_of_their_areas(fresh):
    single = replace(fresh.grains, vertices=fresh.grains.vertices.astype(np.float32).astype(np.float64))
    apexes, has_flat = best_fans(single)
    assert not has_flat.any()
    assert np.array_equal(apexes, best_apexes(single))
    found, cut = facets(single, apexes), triangles(single, apexes=apexes)
    starts = np.repeat(single.vertex_offsets[:-1], np.diff(cut.offsets))
    assert np.array_equal(found.offsets, cut.offsets)
    assert np.array_equal(found.corners, single.vertices[cut.indices + starts[:, None]])
    areas = vector_areas(found.corners)
    np.testing.assert_allclose(found.normals, areas / np.linalg.norm(areas, axis=1, keepdims=True), atol=1e-12)


@pytest.mark.unit
def test_a_face_that_is_a_line_is_told_by_its_fan():
    line = Polyhedra([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0]], [0, 4], [0, 2], [0, 1, 2, 0, 1, 3], [0, 3, 6])
    _, has_flat = best_fans(line)
    assert has_flat.tolist() == [True, False]
    assert np.isnan(facets(line, np.zeros(2, dtype=np.int64)).normals[0]).all()
