from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import SOLIDS, blob, centred, place, polyhedra, solid

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.clipping import box_planes, clipped_volumes
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.model import Domain

seeds = st.integers(0, 2**31)


def scattered(seed, n=6):
    """Return random grains at random poses in a box of edge 3."""
    rng = np.random.default_rng(seed)
    shapes = centred(polyhedra(*(blob(rng) for _ in range(n))))
    return place(
        shapes, rng.uniform(0, 3, (n, 3)), quaternions=random_quaternions(n, rng), domain=Domain.cube(3.0)
    ), rng


@pytest.mark.unit
def test_a_cube_cut_through_its_middle_leaves_half_and_through_three_faces_an_eighth():
    packing = place(solid("cube", 2.0), [[5.0, 5.0, 5.0]])
    assert clipped_volumes(packing, [[0, 0, 1, 5.0]])[0] == pytest.approx(4, rel=1e-14)
    assert clipped_volumes(packing, box_planes([5, 5, 5], [9, 9, 9]))[0] == pytest.approx(1, rel=1e-14)


@pytest.mark.unit
def test_a_plane_across_a_corner_of_a_cube_cuts_off_a_tetrahedron():
    packing = place(solid("cube", 2.0), [[0.0, 0.0, 0.0]])
    # x + y + z <= 3 − 0.6 leaves a corner of legs 0.6 outside
    assert clipped_volumes(packing, [[1, 1, 1, 3 - 0.6]])[0] == pytest.approx(8 - 0.6**3 / 6, rel=1e-14)


@pytest.mark.unit
def test_a_plane_through_the_middle_of_a_cube_along_its_diagonal_cuts_a_regular_hexagon_and_half():
    packing = place(solid("cube", 2.0), [[0.0, 0.0, 0.0]])
    assert clipped_volumes(packing, [[1, 1, 1, 0]])[0] == pytest.approx(4, rel=1e-14)


@pytest.mark.unit
def test_a_cap_near_the_tip_of_a_tetrahedron_is_similar_to_it():
    tip = SOLIDS["tetrahedron"][0]
    packing = place(polyhedra(tip), [[0.0, 0.0, 0.0]])
    axis = tip[0] / np.linalg.norm(tip[0])
    height = 4 / np.sqrt(3)  # from the base at −1/√3 to the tip at √3
    for part in (1e-3, 0.3, 0.999):
        plane = [*(-axis), -(np.sqrt(3) - part * height)]
        assert clipped_volumes(packing, [plane])[0] == pytest.approx(part**3 * 8 / 3, rel=1e-11)


@pytest.mark.unit
def test_planes_that_touch_a_face_an_edge_or_a_corner_cut_nothing():
    packing = place(solid("cube", 2.0), [[0.1, 0.2, 0.3]])
    d = np.array([1.1, 1.2, 1.3])
    for normal in ([1, 0, 0], [1, 1, 0], [1, 1, 1]):
        inside, outside = [*normal, np.dot(normal, d)], [*np.negative(normal), -np.dot(normal, d)]
        assert clipped_volumes(packing, [inside])[0] == pytest.approx(8, rel=1e-14)
        assert clipped_volumes(packing, [outside])[0] == 0


@pytest.mark.unit
def test_the_length_of_a_normal_does_not_matter_and_no_plane_cuts_nothing():
    packing = place(solid("dodecahedron"), [[1.0, 2.0, 3.0]])
    a = clipped_volumes(packing, [[0.3, -0.2, 0.4, 1.2]])
    np.testing.assert_allclose(clipped_volumes(packing, 1e6 * np.array([[0.3, -0.2, 0.4, 1.2]])), a, rtol=1e-13)
    np.testing.assert_array_equal(clipped_volumes(packing, np.empty((0, 4))), volumes(packing.grains))


@pytest.mark.unit
def test_cells_of_a_tessellation_clipped_by_their_own_domain_are_whole(cells):
    # Faces lie in the planes to rounding: the signs of errors must not cut them.
    from grainsdem.packing import carve

    packing = carve(cells, keep="all")
    planes = box_planes(packing.domain.lower, packing.domain.upper)
    np.testing.assert_allclose(clipped_volumes(packing, planes), volumes(packing.grains), rtol=1e-11)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("planes", "error", "match"),
    [
        ([1.0, 0, 0, 1], ShapeError, r"shape \(k, 4\); got \(4,\)"),
        ([[0, 0, 0, 1.0]], InputError, "with a normal; plane 0"),
        ([[1, 0, 0, 1], [np.nan, 0, 0, 1.0]], InputError, "finite with a normal; plane 1"),
    ],
)
def test_planes_that_are_none_are_refused(cube, planes, error, match):
    with pytest.raises(error, match=match):
        clipped_volumes(cube, planes)


@pytest.mark.unit
def test_a_box_that_is_none_is_refused():
    with pytest.raises(InputError, match="upper corner must lie above"):
        box_planes([0, 0, 0], [1, 1, 0])
    with pytest.raises(ShapeError, match="shape"):
        box_planes([0, 0], [1, 1])


@pytest.mark.client
def test_manifold3d_finds_the_same_volumes():
    import manifold3d

    packing, rng = scattered(5, 12)
    vertices, grains = world_vertices(packing), packing.grains
    for _ in range(4):
        planes = np.column_stack([rng.standard_normal((3, 3)), rng.uniform(-1, 4, 3)])
        found = clipped_volumes(packing, planes)
        for i in range(len(packing)):
            points = vertices[grains.vertex_offsets[i] : grains.vertex_offsets[i + 1]]
            triangles = [[f[0], f[k], f[k + 1]] for f in grains.faces_of(i) for k in range(1, len(f) - 1)]
            body = manifold3d.Manifold(manifold3d.Mesh64(points, np.array(triangles, np.uint64)))
            for *normal, d in planes:
                # It keeps the side that the normal points to.
                norm = np.linalg.norm(normal)
                body = body.trim_by_plane(list(-np.array(normal) / norm), -d / norm)
            assert found[i] == pytest.approx(body.volume(), abs=1e-11)


@pytest.mark.statistical
def test_random_points_find_the_same_solid_volume_in_a_box():
    packing, rng = scattered(2)
    lower, upper, n = np.array([0.4, 0.8, 0.2]), np.array([2.1, 2.6, 2.2]), 40_000
    exact = clipped_volumes(packing, box_planes(lower, upper))
    from scipy.spatial import Delaunay

    points = rng.uniform(lower, upper, (n, 3))
    size = np.prod(upper - lower)
    for i in range(len(packing)):
        rows = slice(packing.grains.vertex_offsets[i], packing.grains.vertex_offsets[i + 1])
        share = (Delaunay(world_vertices(packing)[rows]).find_simplex(points) >= 0).mean()
        assert abs(size * share - exact[i]) <= 5 * size * np.sqrt(max(share, 1 / n) / n)
    assert exact.sum() > 0.1  # the box does hold grains


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(seeds)
def test_the_two_sides_of_a_plane_make_the_whole(seed):
    packing, rng = scattered(seed)
    plane = np.append(rng.standard_normal(3), rng.uniform(0, 3))
    both = clipped_volumes(packing, [plane]) + clipped_volumes(packing, [-plane])
    np.testing.assert_allclose(both, volumes(packing.grains), rtol=1e-11)


@pytest.mark.property
@settings(max_examples=12, deadline=None)
@given(seeds)
def test_the_boxes_of_a_grid_make_the_whole_and_the_order_of_planes_does_not_matter(seed):
    packing, rng = scattered(seed, 3)
    cuts = [np.array([-9.0, *np.sort(rng.uniform(0, 3, 2)), 9.0]) for _ in range(3)]
    total = np.zeros(len(packing))
    for i, j, k in np.ndindex(3, 3, 3):
        lower, upper = (np.array([cuts[0][i + s], cuts[1][j + s], cuts[2][k + s]]) for s in (0, 1))
        planes = box_planes(lower, upper)
        part = clipped_volumes(packing, planes)
        np.testing.assert_allclose(clipped_volumes(packing, planes[::-1]), part, atol=1e-13)
        total += part
    np.testing.assert_allclose(total, volumes(packing.grains), rtol=1e-11)


@pytest.mark.property
@settings(max_examples=12, deadline=None)
@given(seeds)
def test_grains_far_from_the_origin_are_cut_as_near_it(seed):
    from dataclasses import replace

    packing, rng = scattered(seed)
    plane = np.append(rng.standard_normal(3), rng.uniform(0, 3))
    shift = np.array([1e4, -2e4, 3e4])
    far = replace(packing, positions=packing.positions + shift)
    moved = [*plane[:3], plane[3] + plane[:3] @ shift]
    # 1e-11: the planes themselves are known to 1e-16 of 3e4
    np.testing.assert_allclose(clipped_volumes(far, [moved]), clipped_volumes(packing, [plane]), atol=1e-10)
