from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import SOLIDS, blob, polyhedra, solid

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import box_axes, diameters, ellipsoid_axes, krumbein, sphericities, zingg
from grainsdem.model import Polyhedra


@pytest.mark.unit
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # (π / 6)^(1/3) and its kin; the values of the paper's figure 14
        ("tetrahedron", (np.pi / (6 * np.sqrt(3))) ** (1 / 3)),
        ("cube", (np.pi / 6) ** (1 / 3)),
        ("octahedron", (np.pi / (3 * np.sqrt(3))) ** (1 / 3)),
        ("dodecahedron", 0.910453),
        ("icosahedron", 0.939326),
        ("truncated octahedron", 0.909918),
    ],
)
def test_named_solids_have_their_known_sphericity(name, expected):
    assert sphericities(solid(name, 0.7))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.unit
def test_sphericity_is_one_for_what_comes_near_a_sphere():
    k = np.arange(800) + 0.5  # Fibonacci's lattice on the sphere
    polar, turn = np.arccos(1 - 2 * k / 800), np.pi * (1 + np.sqrt(5)) * k
    ball = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    assert 0.99 < sphericities(polyhedra(ball))[0] < 1


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-4, 1e3))
def test_sphericity_is_below_one_and_knows_no_size_while_diameters_scale(seed, s):
    a = polyhedra(blob(np.random.default_rng(seed)))
    b = Polyhedra(a.vertices * s, a.vertex_offsets, a.face_offsets, a.face_vertices, a.face_vertex_offsets)
    assert 0 < sphericities(a)[0] < 1
    assert sphericities(b)[0] == pytest.approx(sphericities(a)[0], rel=1e-12)
    assert diameters(b)[0] == pytest.approx(s * diameters(a)[0], rel=1e-12)


@pytest.mark.unit
def test_every_named_solid_is_tested_in_its_circumscribed_order():
    # More faces, rounder: the order that the paper's figure 14 marks.
    values = [sphericities(solid(name))[0] for name in SOLIDS if not name.startswith("truncated")]
    assert values == sorted(values)


def brick(a, b, c):
    return 0.5 * np.array([a, b, c]) * SOLIDS["cube"][0]


@pytest.mark.unit
def test_a_brick_has_its_edges_for_its_box_and_their_multiple_for_its_ellipsoid_however_it_is_turned():
    turns = Rotation.random(20, rng=3).as_matrix()
    bricks = polyhedra(*(brick(3.0, 2.0, 0.5) @ turn.T for turn in turns))
    np.testing.assert_allclose(box_axes(bricks), np.tile([3.0, 2.0, 0.5], (20, 1)), rtol=1e-9)
    np.testing.assert_allclose(ellipsoid_axes(bricks), np.tile([3.0, 2.0, 0.5], (20, 1)) * np.sqrt(5 / 3), rtol=1e-9)


@pytest.mark.unit
@pytest.mark.parametrize("name", SOLIDS)
def test_named_solids_turn_alike_about_every_axis(name):
    edge, (volume, _, inertia) = 0.7, SOLIDS[name][2]
    del volume
    # A ball of diameter d has d² / 10 for its moment over mass.
    np.testing.assert_allclose(ellipsoid_axes(solid(name, edge))[0], np.sqrt(10 * inertia) * edge, rtol=1e-9)


@pytest.mark.unit
def test_boxes_on_faces_of_named_solids_are_known():
    # On a face: its height, and the smallest rectangle around its shadow.
    np.testing.assert_allclose(box_axes(solid("cube", 2.0))[0], [2, 2, 2], rtol=1e-12)
    np.testing.assert_allclose(box_axes(solid("tetrahedron"))[0], [1, np.sqrt(3) / 2, np.sqrt(2 / 3)], rtol=1e-9)
    hexagon = [2 / np.sqrt(3), 1, np.sqrt(2 / 3)]  # an octahedron's shadow on its face
    np.testing.assert_allclose(box_axes(solid("octahedron"))[0], hexagon, rtol=1e-9)


@pytest.mark.unit
def test_turning_a_grain_about_every_normal_in_small_steps_finds_the_same_box():
    from scipy.spatial import ConvexHull

    rng = np.random.default_rng(2)
    angles = np.linspace(0, np.pi / 2, 2000)
    for cloud in (blob(rng) for _ in range(5)):
        best = np.inf
        for normal in ConvexHull(cloud).equations[:, :3]:
            u, w = Rotation.align_vectors(normal[None], [[0.0, 0, 1]])[0].as_matrix()[:, :2].T
            x = np.outer(np.cos(angles), u) + np.outer(np.sin(angles), w)
            y = np.cross(normal, x)
            spans = [np.ptp(cloud @ axes.T, axis=0) for axes in (normal[None], x, y)]
            best = min(best, np.prod(np.broadcast_arrays(*spans), axis=0).min())
        found = box_axes(polyhedra(cloud))[0].prod()
        assert best * (1 - 2e-3) < found <= best * (1 + 1e-9)  # a step is 8e-4 rad, the shadow about as long as wide


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-4, 1e3))
def test_axes_scale_with_a_grain_do_not_turn_with_it_and_fall(seed, s):
    rng = np.random.default_rng(seed)
    points = blob(rng)
    a, b = polyhedra(points), polyhedra(points @ Rotation.random(rng=rng).as_matrix().T)
    grown = Polyhedra(a.vertices * s, a.vertex_offsets, a.face_offsets, a.face_vertices, a.face_vertex_offsets)
    for axes in (box_axes, ellipsoid_axes):
        np.testing.assert_allclose(axes(b), axes(a), rtol=1e-6)
        np.testing.assert_allclose(axes(grown), s * axes(a), rtol=1e-9)
        assert (np.diff(axes(a)) <= 0).all()
    # The shadow of a box on any of its sides holds the grain's: the box holds its volume.
    assert box_axes(a).prod() > np.pi / 6 * diameters(a)[0] ** 3


@pytest.mark.unit
def test_krumbeins_sphericity_and_zinggs_class_follow_from_the_axes():
    axes = [[1, 1, 1], [3, 1, 1], [3, 3, 1], [4, 2, 1], [np.nan] * 3]
    np.testing.assert_allclose(krumbein(axes), [1, 9 ** (-1 / 3), 3 ** (-1 / 3), 0.5, np.nan])
    assert zingg(axes).tolist() == ["spheroid", "rod", "disc", "blade", ""]
    with pytest.raises(InputError, match="a >= b >= c > 0; 2 rows are not: 0, 1"):
        zingg([[1, 2, 3], [1, 1, 0]])
    with pytest.raises(ShapeError, match=r"\(n, 3\); got shape \(3,\)"):
        krumbein([3.0, 2.0, 1.0])
