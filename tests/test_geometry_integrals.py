from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import SOLIDS, blob, polygons, polyhedra, solid

from grainsdem.geometry.integrals import centroids, face_planes, inertia_tensors, integrate, surface_areas, volumes
from grainsdem.model import Polyhedra

seeds = st.integers(0, 2**31)


def moved(shapes, matrix, shift):
    vertices = shapes.vertices @ np.asarray(matrix).T + shift
    return Polyhedra(
        vertices, shapes.vertex_offsets, shapes.face_offsets, shapes.face_vertices, shapes.face_vertex_offsets
    )


@pytest.mark.unit
@pytest.mark.parametrize("name", SOLIDS)
def test_a_named_solid_has_its_closed_form_volume_area_and_inertia(name):
    volume, area, inertia = SOLIDS[name][2]
    edge = 3.0
    measured = integrate(solid(name, edge))
    assert measured.volumes[0] == pytest.approx(volume * edge**3, rel=1e-11)
    assert measured.areas[0] == pytest.approx(area * edge**2, rel=1e-11)
    np.testing.assert_allclose(measured.centroids[0], 0, atol=1e-11)
    np.testing.assert_allclose(measured.inertias[0], inertia * volume * edge**5 * np.eye(3), rtol=1e-10, atol=1e-9)


@pytest.mark.unit
def test_a_box_off_the_origin_has_the_inertia_of_a_box_about_its_own_centre():
    sides, centre = np.array([1.0, 2.0, 3.0]), np.array([40.0, -7.0, 11.0])
    box = polyhedra(SOLIDS["cube"][0] * sides / 2 + centre)
    measured = integrate(box)
    expected = np.diag([4 + 9, 1 + 9, 1 + 4]) * 6.0 / 12
    np.testing.assert_allclose(measured.centroids[0], centre, rtol=1e-13)
    np.testing.assert_allclose(measured.inertias[0], expected, rtol=1e-11, atol=1e-10)


@pytest.mark.unit
def test_faces_wound_inward_give_a_negative_volume():
    points, faces = polygons(SOLIDS["cube"][0])
    ends = np.cumsum([0] + [len(f) for f in faces])
    inside_out = Polyhedra(points, [0, 8], [0, 6], np.concatenate([f[::-1] for f in faces]), ends)
    assert volumes(inside_out)[0] == pytest.approx(-8)


@pytest.mark.unit
def test_no_polyhedra_and_a_polyhedron_without_faces_are_measured_as_nothing():
    assert [len(a) for a in integrate(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]))] == [0, 0, 0, 0]
    bare = Polyhedra(np.empty((0, 3)), [0, 0], [0, 0], [], [0])
    assert volumes(bare)[0] == 0
    assert surface_areas(bare)[0] == 0
    np.testing.assert_array_equal(inertia_tensors(bare)[0], 0)


@pytest.mark.unit
def test_planes_of_a_cube_face_outward_at_half_its_edge():
    planes = face_planes(solid("cube", 4.0))
    np.testing.assert_allclose(planes.heights, 2.0)
    np.testing.assert_allclose(planes.areas, 16.0)
    assert {tuple(np.round(n).astype(int)) for n in planes.normals} == {
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1),
    }  # fmt: skip


@pytest.mark.client
def test_trimesh_finds_the_same_volume_area_centroid_and_inertia():
    import trimesh

    clouds = [blob(np.random.default_rng(k)) + k for k in range(5)]
    shapes = polyhedra(*clouds)
    measured = integrate(shapes)
    for i in range(5):
        triangles = [[f[0], f[k], f[k + 1]] for f in shapes.faces_of(i) for k in range(1, len(f) - 1)]
        mesh = trimesh.Trimesh(shapes.vertices_of(i), triangles, process=False)
        assert mesh.is_watertight
        assert measured.volumes[i] == pytest.approx(mesh.volume, rel=1e-10)
        assert measured.areas[i] == pytest.approx(mesh.area, rel=1e-12)
        np.testing.assert_allclose(measured.centroids[i], mesh.center_mass, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(measured.inertias[i], mesh.moment_inertia, rtol=1e-6, atol=1e-9)


@pytest.mark.statistical
def test_random_points_in_a_grain_have_its_volume_centroid_and_inertia():
    rng = np.random.default_rng(3)
    shape = polyhedra(blob(rng))
    planes = face_planes(shape)
    low, high = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
    points = rng.uniform(low, high, (200_000, 3))
    inside = ((points @ planes.normals.T) <= planes.heights).all(axis=1)
    box, hits, n = np.prod(high - low), points[inside], len(points)
    share = inside.mean()
    assert volumes(shape)[0] == pytest.approx(box * share, abs=5 * box * np.sqrt(share * (1 - share) / n))
    error = 5 * hits.std(axis=0) / np.sqrt(len(hits))
    assert (np.abs(hits.mean(axis=0) - centroids(shape)[0]) < error).all()
    x = hits - centroids(shape)[0]
    moments = np.einsum("ni,ni->n", x, x)[:, None, None] * np.eye(3) - np.einsum("ni,nj->nij", x, x)
    error = 5 * moments.std(axis=0) / np.sqrt(len(hits))
    assert (np.abs(moments.mean(axis=0) - inertia_tensors(shape)[0] / volumes(shape)[0]) < error).all()


@pytest.mark.property
@settings(max_examples=25, deadline=None)
@given(seeds)
def test_a_rigid_motion_changes_no_volume_and_no_area_and_turns_the_inertia(seed):
    rng = np.random.default_rng(seed)
    shapes = polyhedra(blob(rng), blob(rng))
    turn, shift = Rotation.random(random_state=seed).as_matrix(), rng.uniform(-5, 5, 3)
    a, b = integrate(shapes), integrate(moved(shapes, turn, shift))
    np.testing.assert_allclose(b.volumes, a.volumes, rtol=1e-11)
    np.testing.assert_allclose(b.areas, a.areas, rtol=1e-11)
    np.testing.assert_allclose(b.centroids, a.centroids @ turn.T + shift, atol=1e-11)
    np.testing.assert_allclose(b.inertias, turn @ a.inertias @ turn.T, atol=1e-11)


@pytest.mark.property
@settings(max_examples=25, deadline=None)
@given(seeds, st.floats(1e-5, 1e4))
def test_scaling_by_s_scales_volume_by_s3_area_by_s2_and_inertia_by_s5(seed, s):
    shapes = polyhedra(blob(np.random.default_rng(seed)))
    a, b = integrate(shapes), integrate(moved(shapes, s * np.eye(3), 0.0))
    np.testing.assert_allclose(b.volumes, a.volumes * s**3, rtol=1e-12)
    np.testing.assert_allclose(b.areas, a.areas * s**2, rtol=1e-12)
    np.testing.assert_allclose(b.inertias, a.inertias * s**5, rtol=1e-10, atol=1e-13 * s**5)


@pytest.mark.property
@settings(max_examples=25, deadline=None)
@given(seeds)
def test_area_vectors_of_a_closed_polyhedron_sum_to_zero_and_heights_give_its_volume(seed):
    shapes = polyhedra(blob(np.random.default_rng(seed)))
    planes = face_planes(shapes)
    np.testing.assert_allclose(planes.areas @ planes.normals, 0, atol=1e-12)
    # V = 1/3 Σ A h, the divergence theorem for x
    assert planes.areas @ planes.heights / 3 == pytest.approx(volumes(shapes)[0], rel=1e-11)
    assert planes.areas.sum() == pytest.approx(surface_areas(shapes)[0], rel=1e-12)


@pytest.mark.property
@settings(max_examples=25, deadline=None)
@given(seeds)
def test_principal_moments_of_a_body_obey_the_triangle_inequality(seed):
    shapes = polyhedra(blob(np.random.default_rng(seed)))
    a, b, c = np.linalg.eigvalsh(inertia_tensors(shapes)[0])
    assert 0 < a <= b <= c < a + b
