from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from solids import SOLIDS, blob, centred, place, polyhedra, solid

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import face_planes, surface_areas, volumes
from grainsdem.geometry.rotations import random_quaternions, world_vertices
from grainsdem.measures import diameters
from grainsdem.model import Domain, Polyhedra
from grainsdem.packing import carve, contacts, neighbor_contacts, shrink
from grainsdem.packing.inset import inset
from grainsdem.points import poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate

BOX = np.array([[x, y, z] for x in (-1.0, 1) for y in (-1.5, 1.5) for z in (-2.0, 2)])
"""Corners of a box of edges 2, 3 and 4."""


def scattered(seed, n=6):
    """Return random grains at random poses."""
    rng = np.random.default_rng(seed)
    shapes = centred(polyhedra(*(blob(rng) for _ in range(n))))
    return place(shapes, rng.uniform(2, 8, (n, 3)), quaternions=random_quaternions(n, rng))


def in_balls(packing):
    """Return three times volume over area of each grain: above the radius of any ball inside."""
    return 3 * volumes(packing.grains) / surface_areas(packing.grains)


@pytest.mark.unit
@pytest.mark.parametrize("name", ["tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"])
@pytest.mark.parametrize("part", [1e-9, 0.1, 0.9])
def test_a_platonic_solid_stays_one_smaller_by_the_share_of_its_inner_ball(name, part):
    packing = place(solid(name), [[5.0, 5, 5]])
    smaller = inset(packing, part * in_balls(packing)[0])
    assert volumes(smaller.grains)[0] == pytest.approx((1 - part) ** 3 * volumes(packing.grains)[0], rel=1e-9)
    assert len(smaller.grains.vertices) == len(packing.grains.vertices)
    assert smaller.grains.n_faces == packing.grains.n_faces
    np.testing.assert_allclose(smaller.positions, packing.positions, atol=1e-11)


@pytest.mark.unit
@pytest.mark.parametrize("distance", [0.25, 0.875])
def test_every_edge_of_a_box_is_shorter_by_twice_the_distance(distance):
    smaller = inset(place(polyhedra(BOX), [[5.0, 5, 5]]), distance)
    np.testing.assert_allclose(np.ptp(smaller.grains.vertices, axis=0), np.array([2, 3, 4]) - 2 * distance, rtol=1e-14)
    assert np.prod(np.array([2, 3, 4]) - 2 * distance) == pytest.approx(volumes(smaller.grains)[0], rel=1e-13)


@pytest.mark.unit
def test_a_wedge_loses_its_blunt_face_and_edges_vanish_with_it():
    # A prism along y; its section is the triangle (-2, 0), (2, 0), (0, 2), the tip cut off at height 1.9.
    section = [(-2.0, 0.0), (2, 0), (0.1, 1.9), (-0.1, 1.9)]
    wedge = polyhedra(np.array([[x, y, z] for x, z in section for y in (-3.0, 3.0)]))
    packing = place(centred(wedge), [[5.0, 5, 5]])
    few, many = inset(packing, 0.01), inset(packing, 0.5)
    # The sides meet at a right angle: their edge moves by √2 t, the blunt face by t, until it is gone.
    assert few.grains.n_faces == packing.grains.n_faces == 6
    assert many.grains.n_faces == 5
    assert len(many.grains.vertices) == 6
    height = 2 - 0.5 - 0.5 * np.sqrt(2)
    assert volumes(many.grains)[0] == pytest.approx(height**2 * 5, rel=1e-12)
    # Its centroid: a third of its height above its base, which moved up by the distance.
    base = world_vertices(packing)[:, 2].min()
    assert many.positions[0, 2] == pytest.approx(base + 0.5 + height / 3, rel=1e-12)


@pytest.mark.unit
def test_a_house_becomes_a_roof_without_walls():
    # Walls of height 1 under a steep roof: the floor passes the walls' upper edges before the walls meet.
    section = [(-2.0, 0.0), (2, 0), (2, 0.2), (0, 4), (-2, 0.2)]
    house = place(centred(polyhedra(np.array([[x, y, z] for x, z in section for y in (-3.0, 3.0)]))), [[5.0, 5, 5]])
    smaller = inset(house, 0.75)
    assert (house.grains.n_faces, smaller.grains.n_faces) == (7, 5)
    vertices = world_vertices(smaller)
    assert len(vertices) == 6
    assert vertices[:, 2].min() == pytest.approx(world_vertices(house)[:, 2].min() + 0.75, rel=1e-13)


@pytest.mark.unit
def test_one_distance_a_grain_moves_each_by_its_own_and_leaves_the_still_ones_to_the_bit():
    packing = cube_packing([[2.0, 5, 5], [5, 5, 5], [8, 5, 5]])
    smaller = inset(packing, [0.5, 0.0, 0.25])
    np.testing.assert_allclose(volumes(smaller.grains), [1, 8, 3.375], rtol=1e-14)
    np.testing.assert_array_equal(smaller.grains.vertices_of(1), packing.grains.vertices_of(1))
    np.testing.assert_array_equal(smaller.grains.faces_of(1), packing.grains.faces_of(1))
    np.testing.assert_array_equal(inset(packing, 0.0).grains.vertices, packing.grains.vertices)


@pytest.mark.unit
def test_grains_that_would_vanish_are_named():
    packing = place(polyhedra(BOX, SOLIDS["cube"][0] * 3, BOX), [[2.0, 5, 5], [5, 5, 5], [8, 5, 5]])
    for distance in (1.0, 1.5):
        with pytest.raises(InputError, match=rf"2 of 3 would vanish by {distance:g}: 0, 2$"):
            inset(packing, distance)
    assert len(inset(packing, 1 - 1e-6)) == 3


@pytest.mark.unit
@pytest.mark.parametrize("distance", [-1.0, np.nan, np.inf, [0.1, -0.1]])
def test_a_distance_that_is_none_is_refused(distance):
    with pytest.raises(InputError, match="distance must be zero or more"):
        inset(cube_packing([[2.0, 5, 5], [8, 5, 5]]), distance)


@pytest.mark.unit
def test_as_many_distances_as_grains_are_taken_and_no_other_number():
    with pytest.raises(ShapeError, match=r"one number or 2, one a grain; got shape \(3,\)"):
        inset(cube_packing([[2.0, 5, 5], [8, 5, 5]]), [0.1, 0.1, 0.1])


@pytest.mark.unit
@pytest.mark.parametrize("flaw", ["open", "not finite"])
def test_a_grain_that_is_no_closed_body_is_named(flaw):
    packing = cube_packing([[2.0, 5, 5], [8, 5, 5]])
    g = packing.grains
    if flaw == "open":
        grains = Polyhedra(g.vertices, g.vertex_offsets, [0, 6, 11], g.face_vertices[:-4], g.face_vertex_offsets[:-1])
    else:
        vertices = np.array(g.vertices)
        vertices[8] = np.nan
        grains = replace(g, vertices=vertices)
    with pytest.raises(InputError, match=r"1 are not: 1$"):
        inset(replace(packing, grains=grains), 0.1)


@pytest.mark.unit
def test_no_grain_at_all_can_be_inset():
    packing = cube_packing([[2.0, 5, 5]])
    empty = replace(
        packing,
        grains=Polyhedra(np.empty((0, 3)), [0], [0], [], [0]),
        positions=np.empty((0, 3)),
        quaternions=np.empty((0, 4)),
        densities=[],
    )
    assert len(inset(empty, 0.1)) == 0


@pytest.mark.unit
def test_triangles_in_one_plane_become_one_face_or_stay_triangles_but_the_body_is_the_same():
    shapes = polyhedra(SOLIDS["cube"][0])
    fans = [ring for face in shapes.faces_of(0) for ring in (face[[0, 1, 2]], face[[0, 2, 3]])]
    cut = Polyhedra(shapes.vertices, [0, 8], [0, 12], np.concatenate(fans), 3 * np.arange(13))
    rng = np.random.default_rng(4)
    rough = replace(cut, vertices=np.float32(cut.vertices + 0.3 * rng.random(3)).astype(float))
    for grains in (cut, rough):
        smaller = inset(place(grains, [[5.0, 5, 5]]), 0.25)
        assert volumes(smaller.grains)[0] == pytest.approx(1.5**3, rel=1e-6)
        assert validate(smaller, shape=1e-6).ok


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-9, 0.6))
def test_the_support_of_a_grain_falls_by_the_distance_or_more_and_by_just_that_along_its_faces(seed, part):
    packing = scattered(seed)
    distances = part * 0.5 * in_balls(packing)
    try:
        smaller = inset(packing, distances)
    except InputError:
        distances = 0.1 * distances
        smaller = inset(packing, distances)
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    before, after = world_vertices(packing), world_vertices(smaller)
    for i in range(len(packing)):
        old = before[packing.grains.vertex_offsets[i] : packing.grains.vertex_offsets[i + 1]]
        new = after[smaller.grains.vertex_offsets[i] : smaller.grains.vertex_offsets[i + 1]]
        drop = (old @ directions.T).max(axis=0) - (new @ directions.T).max(axis=0)
        assert drop.min() >= distances[i] - 1e-14
        hull = ConvexHull(new)
        drops = (old @ hull.equations[:, :3].T).max(axis=0) + hull.equations[:, 3]
        np.testing.assert_allclose(drops, distances[i], atol=1e-9)


@pytest.mark.property
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.01, 0.9))
def test_the_volume_is_that_which_qhull_finds_between_the_half_spaces(seed, part):
    from scipy.optimize import linprog
    from scipy.spatial import HalfspaceIntersection

    packing = scattered(seed)
    planes, faces = face_planes(packing.grains), packing.grains.face_offsets
    middles, radii = np.empty((len(packing), 3)), np.empty(len(packing))
    for i in range(len(packing)):
        mine = slice(faces[i], faces[i + 1])
        rows = np.column_stack([planes.normals[mine], np.ones(faces[i + 1] - faces[i])])
        ball = linprog([0, 0, 0, -1], A_ub=rows, b_ub=planes.heights[mine], bounds=[(None, None)] * 3 + [(0, None)])
        middles[i], radii[i] = ball.x[:3], ball.x[3]
    smaller = inset(packing, part * radii)
    found = volumes(smaller.grains)
    for i in range(len(packing)):
        mine = slice(faces[i], faces[i + 1])
        half_spaces = np.column_stack([planes.normals[mine], part * radii[i] - planes.heights[mine]])
        expected = ConvexHull(HalfspaceIntersection(half_spaces, middles[i]).intersections).volume
        assert found[i] == pytest.approx(expected, rel=1e-9)
    with pytest.raises(InputError, match=rf"{len(packing)} of {len(packing)} would vanish"):
        inset(packing, radii * 1.001)


@pytest.mark.property
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31))
def test_the_derivative_of_the_volume_is_the_area_and_that_of_the_area_the_length_of_the_edges(seed):
    # V(t) = V - A t + C t² - …, as long as no face vanishes; C sums l tan(θ/2) over the edges: Steiner, inward.
    packing = scattered(seed, 3)
    t = 1e-6
    smaller = inset(packing, t)
    v, a = volumes(packing.grains), surface_areas(packing.grains)
    np.testing.assert_allclose((v - volumes(smaller.grains)) / t, a, rtol=1e-3)
    assert (volumes(smaller.grains) >= v - a * t - 1e-15).all()
    twice = inset(smaller, t)
    at_once = inset(packing, 2 * t)
    np.testing.assert_allclose(volumes(twice.grains), volumes(at_once.grains), rtol=1e-12)


@pytest.mark.unit
def test_a_tessellation_inset_by_t_has_gaps_of_two_t_everywhere_and_keeps_its_neighbours(cells):
    grains = carve(cells, keep="all")
    d = float(diameters(grains.grains).mean())
    t = 0.01 * d
    whole = volumes(grains.grains)
    is_large = in_balls(grains) > 3 * t
    smaller = inset(grains, np.where(is_large, t, 0.0))
    report = validate(smaller)
    assert report.ok, report.failed
    assert (volumes(smaller.grains) <= whole).all()
    closed = neighbor_contacts(smaller)
    both = is_large[closed.pairs].all(axis=1)
    np.testing.assert_allclose(closed.gaps[both], 2 * t, rtol=1e-9)
    # Where a common face is gone, and between grains that had none, gaps are no smaller.
    near = contacts(smaller, within=2 * t * (1 - 1e-9))
    assert not is_large[near.pairs].all(axis=1).any()


@pytest.mark.unit
def test_links_know_how_far_the_planes_are_whose_faces_are_gone(cells):
    grains = carve(cells)
    smaller = inset(grains, 0.02 * float(diameters(grains.grains).mean()))
    assert smaller.grains.n_faces < grains.grains.n_faces
    owner = owners(smaller.grains.face_offsets)
    planes = face_planes(smaller.grains)
    arms = smaller.positions - smaller.links.sites
    slack = smaller.links.heights - np.einsum("fi,fi->f", planes.normals, arms[owner]) - planes.heights
    np.testing.assert_allclose(slack, 0.02 * float(diameters(grains.grains).mean()), rtol=1e-9)
    has_lost = np.diff(smaller.grains.face_offsets) < np.diff(grains.grains.face_offsets)
    assert np.isinf(smaller.links.rooms[~has_lost]).all()
    np.testing.assert_allclose(smaller.links.rooms[has_lost], slack[0], rtol=1e-9)


@pytest.mark.unit
def test_prisms_of_a_planar_bed_keep_their_thickness():
    domain = Domain.slab((1.0, 1.0), 0.1)
    prisms = shrink(carve(tessellate(poisson(domain, 40, rng=3), domain)), scale=0.9)
    smaller = inset(prisms, 1e-3)
    assert (volumes(smaller.grains) < volumes(prisms.grains)).all()
    np.testing.assert_allclose(np.abs(smaller.grains.vertices[:, 2]), 0.05, rtol=1e-12)


@pytest.mark.unit
def test_the_unit_of_length_changes_nothing():
    packing = scattered(3)
    small = replace(packing, grains=replace(packing.grains, vertices=packing.grains.vertices * 2.0**-30))
    here, there = inset(packing, 0.05), inset(small, 0.05 * 2.0**-30)
    np.testing.assert_array_equal(here.grains.vertices, there.grains.vertices * 2.0**30)
    np.testing.assert_array_equal(here.grains.face_vertices, there.grains.face_vertices)


@pytest.mark.unit
def test_what_was_done_is_written_down():
    step = inset(cube_packing([[2.0, 5, 5], [8, 5, 5]]), [0.25, 0.5]).provenance[-1]
    assert step == '{"largest": 0.5, "smallest": 0.25, "step": "inset"}'
