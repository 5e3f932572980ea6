"""Named solids, round shapes and rocks against closed forms and trimesh."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import SOLIDS, blob, place

import grainsdem as gd
from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.hulls import convex_hull, convex_hulls
from grainsdem.model import Domain


def _mesh(shape, i=0):
    """Return one polyhedron as trimesh's, its faces as fans."""
    import trimesh

    faces = [(f[0], f[k], f[k + 1]) for f in shape.faces_of(i) for k in range(1, len(f) - 1)]
    return trimesh.Trimesh(shape.vertices_of(i), faces, process=False)


def _is_sound(shapes):
    """Return whether validation finds the shapes closed, convex and wound outward, each alone in its place."""
    n = len(shapes)
    far = 10 * np.abs(shapes.vertices).max()
    places = np.column_stack([far * (1 + np.arange(n)), np.full(n, far), np.full(n, far)])
    domain = Domain(np.zeros(3), np.array([far * (n + 1), 2 * far, 2 * far]))
    return gd.validate(place(shapes, places, domain=domain)).ok


@pytest.mark.unit
@pytest.mark.parametrize("name", gd.shapes.PLATONIC)
def test_platonic_solids_have_their_faces_and_their_surface(name):
    shape = gd.shapes.platonic(name, diameter=2.0)
    points, _, (volume, area, moment) = SOLIDS[name]
    scale = np.cbrt(np.pi / 6 * 8.0 / volume)
    n_faces = {"tetrahedron": 4, "cube": 6, "octahedron": 8, "dodecahedron": 12, "icosahedron": 20}[name]
    assert (len(shape.vertices), shape.n_faces) == (len(points), n_faces)
    assert gd.diameters(shape)[0] == pytest.approx(2.0, rel=1e-14)
    assert gd.surface_areas(shape)[0] == pytest.approx(area * scale**2, rel=1e-13)
    moments = gd.inertia_tensors(shape)[0] / gd.volumes(shape)[0]
    assert moments == pytest.approx(moment * scale**2 * np.eye(3), rel=1e-12, abs=1e-13)
    assert np.abs(gd.centroids(shape)).max() < 1e-14
    assert _is_sound(shape)


@pytest.mark.unit
def test_boxes_and_prisms_have_their_closed_forms():
    brick = gd.shapes.box(3.0, 2.0, 1.0)
    assert (gd.volumes(brick)[0], gd.surface_areas(brick)[0]) == pytest.approx((6.0, 22.0), rel=1e-14)
    assert gd.box_axes(brick)[0] == pytest.approx([3.0, 2.0, 1.0], rel=1e-14)
    for n, aspect in ((3, 1.0), (6, 4.0), (24, 0.2)):
        shape = gd.shapes.prism(n, aspect=aspect, diameter=3.0)
        assert (len(shape.vertices), shape.n_faces) == (2 * n, n + 2)
        height = np.ptp(shape.vertices[:, 2])
        base = gd.volumes(shape)[0] / height
        assert height / np.sqrt(4 * base / np.pi) == pytest.approx(aspect, rel=1e-13)
        assert gd.diameters(shape)[0] == pytest.approx(3.0, rel=1e-14)
        assert _is_sound(shape)


@pytest.mark.unit
def test_ellipsoids_have_the_volume_and_nearly_the_axes_of_their_own():
    for n, longer in ((32, 0.07), (64, 0.04), (600, 0.01)):
        shape = gd.shapes.ellipsoid(3.0, 2.0, 1.0, n_vertices=n)
        assert len(shape.vertices) == n
        assert shape.n_faces == 2 * n - 4
        assert gd.volumes(shape)[0] == pytest.approx(np.pi, rel=1e-13)
        # Corners lie on one ellipsoid, that of the axes asked for made longer.
        sizes = np.linalg.norm(shape.vertices * 2 / [3.0, 2.0, 1.0], axis=1)
        assert 1 < sizes.min() < sizes.max() < 1 + longer
        assert _is_sound(shape)
    ball = gd.shapes.ellipsoid(1.0, 1.0, 1.0, n_vertices=600)
    assert gd.sphericities(ball)[0] > 0.997


@pytest.mark.unit
def test_superellipsoids_run_from_boxes_over_ellipsoids_to_octahedra():
    from scipy.special import gamma

    for exponents in ((1.0, 1.0), (0.3, 0.3), (0.2, 1.0), (1.5, 0.7), (2.0, 2.0)):
        shape = gd.shapes.superellipsoid(3.0, 2.0, 1.0, exponents=exponents, n_vertices=40)
        assert len(shape.vertices) <= 40
        e, f = exponents
        # Jaklič, Leonardis & Solina, Segmentation and recovery of superquadrics, 2000: 2 a b c e f B B, by half-axes.
        beta = gamma(e / 2 + 1) * gamma(e) / gamma(1.5 * e + 1) * gamma(f / 2) ** 2 / gamma(f)
        assert gd.volumes(shape)[0] == pytest.approx(2 * 6 / 8 * e * f * beta, rel=1e-12)
        assert _is_sound(shape)
    assert gd.volumes(gd.shapes.superellipsoid(1, 1, 1))[0] == pytest.approx(np.pi / 6, rel=1e-12)
    octahedron = gd.shapes.superellipsoid(2.0, 2.0, 2.0, exponents=(2.0, 2.0))
    assert (len(octahedron.vertices), octahedron.n_faces) == (6, 8)
    nearly_box = gd.shapes.superellipsoid(3.0, 2.0, 1.0, exponents=(0.02, 0.02))
    assert gd.box_axes(nearly_box)[0] == pytest.approx([3.0, 2.0, 1.0], rel=0.01)


@pytest.mark.property
@settings(max_examples=15)
@given(st.floats(0.1, 1.0), st.floats(0.1, 1.0), st.integers(8, 40), st.integers(0, 2**32))
def test_rocks_have_the_proportions_asked_for(elongation, flatness, n_vertices, seed):
    rocks = gd.shapes.rock(3, elongation=elongation, flatness=flatness, n_vertices=n_vertices, rng=seed)
    a, b, c = gd.box_axes(rocks).T
    assert b / a == pytest.approx(np.full(3, elongation), rel=3e-9)
    assert c / b == pytest.approx(np.full(3, flatness), rel=3e-9)
    assert np.diff(rocks.vertex_offsets).max() <= n_vertices
    assert gd.diameters(rocks) == pytest.approx(np.ones(3), rel=1e-12)
    assert np.abs(gd.centroids(rocks)).max() < 1e-12
    assert _is_sound(rocks)


@pytest.mark.unit
def test_each_rock_is_another_with_proportions_of_its_own_and_the_same_for_the_same_rng():
    wanted = np.linspace(0.3, 1.0, 6)
    rocks = gd.shapes.rock(6, elongation=wanted, flatness=wanted[::-1], rng=3)
    a, b, c = gd.box_axes(rocks).T
    assert b / a == pytest.approx(wanted, rel=3e-9)
    assert c / b == pytest.approx(wanted[::-1], rel=3e-9)
    again = gd.shapes.rock(6, elongation=wanted, flatness=wanted[::-1], rng=3)
    assert np.array_equal(rocks.vertices, again.vertices)
    other = gd.shapes.rock(6, elongation=wanted, flatness=wanted[::-1], rng=4)
    assert not np.array_equal(rocks.vertices[:4], other.vertices[:4])


@pytest.mark.client
def test_trimesh_finds_the_same_volume_area_and_inertia():
    shapes = gd.shapes.together(
        gd.shapes.platonic("dodecahedron"),
        gd.shapes.ellipsoid(2, 1, 1),
        gd.shapes.superellipsoid(2, 1, 1, exponents=(0.5, 1.2)),
        gd.shapes.rock(3, elongation=0.5, flatness=0.4, rng=1),
    )
    for i in range(len(shapes)):
        mesh = _mesh(shapes, i)
        assert (mesh.is_watertight, mesh.is_winding_consistent, mesh.is_convex) == (True, True, True)
        assert gd.volumes(shapes)[i] == pytest.approx(mesh.volume, rel=1e-10)
        assert gd.surface_areas(shapes)[i] == pytest.approx(mesh.area, rel=1e-10)
        assert gd.inertia_tensors(shapes)[i] == pytest.approx(mesh.moment_inertia, rel=1e-8, abs=1e-10)
        assert np.abs(mesh.center_mass).max() < 1e-10


@pytest.mark.property
@settings(max_examples=25)
@given(st.integers(0, 2**32), st.integers(4, 80))
def test_a_hull_of_a_hull_is_the_same(seed, n):
    rng = np.random.default_rng(seed)
    cloud = rng.standard_normal((n, 3)) * rng.uniform(1e-6, 1e3)
    hull = convex_hull(cloud)
    again = convex_hull(hull.vertices)
    assert np.array_equal(hull.vertices, again.vertices)
    assert {tuple(sorted(f)) for f in hull.faces_of(0)} == {tuple(sorted(f)) for f in again.faces_of(0)}
    assert len(hull.vertices) - sum(map(len, hull.faces_of(0))) // 2 + hull.n_faces == 2
    assert _is_sound(gd.shapes.sized(hull, 1.0))


@pytest.mark.unit
def test_points_in_faces_and_on_edges_are_no_corners():
    grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 5)] * 3), axis=-1).reshape(-1, 3)
    turn = np.linalg.qr(np.random.default_rng(2).standard_normal((3, 3)))[0]
    hull = convex_hull(grid @ turn + [5.0, -3.0, 2.0])
    assert (len(hull.vertices), hull.n_faces) == (8, 6)
    assert gd.volumes(hull)[0] == pytest.approx(8.0, rel=1e-13)


@pytest.mark.unit
def test_what_is_no_shape_is_refused_in_a_line():
    shapes = gd.shapes
    cases = [
        (lambda: shapes.platonic("sphere"), "one of tetrahedron, .*got 'sphere'"),
        (lambda: shapes.box(1, -1, 1), "b must be positive and finite, 1e-30 to 1e\\+30 m; got -1"),
        (lambda: shapes.prism(2), "three sides or more; got 2"),
        (lambda: shapes.ellipsoid(1, 1, np.nan), "c must be positive"),
        (lambda: shapes.ellipsoid(1, 1, 1, n_vertices=3), "4 corners or more; got n_vertices = 3"),
        (lambda: shapes.superellipsoid(1, 1, 1, exponents=(1, 3)), r"in \(0, 2\]"),
        (lambda: shapes.rock(elongation=1.2), r"elongation must lie in \(0, 1\]; got 1.2"),
        (lambda: shapes.rock(flatness=0), r"flatness must lie in \(0, 1\]; got 0"),
        (lambda: shapes.rock(n_vertices=7), "8 corners or more"),
        (lambda: shapes.rock(0), "one or more; got n = 0"),
        (lambda: shapes.sized(shapes.box(1, 1, 1), -2.0), "positive and finite; -2.0 are not"),
        (lambda: convex_hull(np.zeros((5, 3))), "not in one plane"),
        (lambda: convex_hull(np.column_stack([np.eye(4)[:, :2], np.zeros(4)])), "not in one plane"),
        (lambda: convex_hull(np.full((5, 3), np.inf)), "finite"),
    ]
    for make, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            make()
        assert "\n" not in str(caught.value)
    with pytest.raises(ShapeError, match="one for each of 3 rocks"):
        shapes.rock(3, flatness=[0.5, 0.6])


@pytest.mark.unit
def test_sets_of_shapes_are_put_together_in_their_order():
    rng = np.random.default_rng(1)
    parts = [convex_hulls([blob(rng), blob(rng)]), convex_hull(blob(rng))]
    both = gd.shapes.together(*parts)
    assert gd.volumes(both) == pytest.approx(np.concatenate([gd.volumes(p) for p in parts]))
    assert len(gd.shapes.together()) == 0
    assert gd.diameters(gd.shapes.sized(both, [1.0, 2.0, 3.0])) == pytest.approx([1.0, 2.0, 3.0])
