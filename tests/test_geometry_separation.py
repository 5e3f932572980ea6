from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from solids import SOLIDS, blob, place, polyhedra

from grainsdem.geometry.separation import bodies, certify, measure_gaps, offsets_between

PAIR = np.array([[0, 1]], dtype=np.int32)
PLAIN = Rotation.identity()
EIGHTH_X, EIGHTH_Y = (Rotation.from_euler(axis, 45, degrees=True) for axis in "xy")
CUBE, OCTAHEDRON = SOLIDS["cube"][0], SOLIDS["octahedron"][0]

# Two solids on the z axis, the first about the origin; the height between their centres at which they touch, and what
# each touches with.
TOUCHING = {
    "face-face": (CUBE, PLAIN, CUBE, PLAIN, 2.0, (2, 2)),
    "edge-face": (CUBE, PLAIN, CUBE, EIGHTH_X, 1 + np.sqrt(2), (2, 1)),
    "vertex-face": (CUBE, PLAIN, OCTAHEDRON, PLAIN, 2.0, (2, 0)),
    "face-vertex": (OCTAHEDRON, PLAIN, CUBE, PLAIN, 2.0, (0, 2)),
    "edge-edge": (CUBE, EIGHTH_X, CUBE, EIGHTH_Y, 2 * np.sqrt(2), (1, 1)),
    "vertex-edge": (CUBE, EIGHTH_X, OCTAHEDRON, PLAIN, 1 + np.sqrt(2), (1, 0)),
    "vertex-vertex": (OCTAHEDRON, PLAIN, OCTAHEDRON, PLAIN, 2.0, (0, 0)),
}
SHALLOW = [kind for kind in TOUCHING if kind not in ("vertex-edge", "vertex-vertex")]


GAPS = st.floats(-1e-2, 0.5) | st.builds(
    lambda sign, power: sign * 10.0**power, st.sampled_from([-1, 1]), st.floats(-12, -2)
)
"""Gaps of any size, and small ones as often as large ones."""


def two(first, second, offset, turns=(PLAIN, PLAIN)):
    quaternions = np.array([np.roll(turn.as_quat(), 1) for turn in turns])
    packing = place(polyhedra(first, second), np.array([[0.0, 0, 0], offset]), quaternions=quaternions)
    return bodies(packing), offsets_between(packing, PAIR)


def gap_of(first, second, offset, turns=(PLAIN, PLAIN)):
    solids, offsets = two(first, second, offset, turns)
    return measure_gaps(solids, PAIR, offsets)


def standing(solids, i):
    """The vertices of a body as it stands."""
    return solids.vertices[slice(*solids.vertex_ranges[i])]


def minkowski_depth(first, second):
    """The depth of an overlap by Qhull: the plane of the hull of all differences nearest to the origin."""
    return ConvexHull((second[:, None] - first).reshape(-1, 3)).equations[:, 3].max()


def fcl_distance(first, second):
    import fcl

    solids = []
    for points in (first, second):
        hull = ConvexHull(points)
        faces = np.concatenate([[3, *face] for face in hull.simplices])
        solids.append(fcl.CollisionObject(fcl.Convex(points, len(hull.simplices), faces), fcl.Transform()))
    return fcl.distance(*solids, fcl.DistanceRequest(), fcl.DistanceResult())


@pytest.mark.unit
@pytest.mark.parametrize("gap", [0.3, 1e-3, 1e-6, 1e-9, 1e-12, 0.0])
@pytest.mark.parametrize("kind", TOUCHING)
def test_named_solids_in_every_kind_of_contact_have_their_known_gap(kind, gap):
    first, turn, second, other, height, features = TOUCHING[kind]
    found = gap_of(first, second, [0, 0, height + gap], (turn, other))
    assert found.gaps[0] == pytest.approx(gap, abs=2e-15)
    assert tuple(found.features[0]) == features or gap < 1e-9
    if gap > 1e-9:
        np.testing.assert_allclose(found.normals[0], [0, 0, 1], atol=1e-9)


@pytest.mark.unit
@pytest.mark.parametrize("depth", [1e-2, 1e-3, 1e-6, 1e-9, 1e-12])
@pytest.mark.parametrize("kind", SHALLOW)
def test_named_solids_pressed_into_one_another_have_their_known_depth(kind, depth):
    first, turn, second, other, height, features = TOUCHING[kind]
    found = gap_of(first, second, [0, 0, height - depth], (turn, other))
    assert found.gaps[0] == pytest.approx(-depth, abs=2e-15)
    assert tuple(found.features[0]) == features
    np.testing.assert_allclose(found.normals[0], [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(found.seconds[0] - found.firsts[0], [0, 0, -depth], atol=1e-12)


@pytest.mark.unit
def test_faces_that_lie_on_one_another_share_the_area_of_their_overlap_about_its_centre():
    found = gap_of(CUBE, CUBE, [0.5, -1.2, 2.25])
    assert found.areas[0] == pytest.approx(1.5 * 0.8, rel=1e-13)
    np.testing.assert_allclose(found.centres[0], [0.25, -0.6, 1.125], rtol=1e-13)


@pytest.mark.unit
def test_an_octahedron_on_a_cubes_face_shares_its_own_face_with_it():
    down = Rotation.align_vectors([[0, 0, -1]], [[1, 1, 1]])[0]
    found = gap_of(3 * CUBE, OCTAHEDRON, [0.3, 0.2, 3 + 1 / np.sqrt(3)], (PLAIN, down))
    assert found.gaps[0] == pytest.approx(0, abs=1e-15)
    assert found.areas[0] == pytest.approx(np.sqrt(3) / 4 * 2, rel=1e-12)


@pytest.mark.unit
def test_an_edge_on_a_face_touches_about_the_middle_of_what_lies_on_it():
    found = gap_of(CUBE, CUBE, [1.5, 0.25, 1.5 + np.sqrt(2)], (PLAIN, EIGHTH_X))
    assert found.gaps[0] == pytest.approx(0.5, rel=1e-14)
    assert found.areas[0] == 0
    np.testing.assert_allclose(found.centres[0], [0.75, 0.25, 1.25], rtol=1e-12)


@pytest.mark.unit
def test_a_cube_inside_another_is_as_deep_as_the_nearest_wall_is_far():
    found = gap_of(3 * CUBE, CUBE, [0.5, 0.25, -1.25])
    assert found.gaps[0] == pytest.approx(-(3 + 1 - 1.25), rel=1e-14)
    np.testing.assert_allclose(found.normals[0], [0, 0, -1], atol=1e-12)


@pytest.mark.unit
def test_two_equal_cubes_in_one_place_are_as_deep_as_their_edge():
    assert gap_of(CUBE, CUBE, [0.0, 0, 0]).gaps[0] == pytest.approx(-2, rel=1e-14)


@pytest.mark.property
@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.05, 1.4))
def test_random_grains_have_the_gap_of_the_oracles_whichever_comes_first(seed, distance):
    rng = np.random.default_rng(seed)
    first, second = blob(rng), blob(rng)
    direction = rng.standard_normal(3)
    offset = distance * direction / np.linalg.norm(direction)
    turns = Rotation.random(2, rng=rng)
    solids, offsets = two(first, second, offset, turns)
    found = measure_gaps(solids, PAIR, offsets)
    a, b = standing(solids, 0), standing(solids, 1) + offset
    depth = minkowski_depth(a, b)
    wanted = depth if depth < 0 else fcl_distance(a, b)
    # fcl stops at a relative 1e-6 of the distance's square; its own bound from below is within that.
    assert found.gaps[0] == pytest.approx(wanted, abs=1e-9 if depth < 0 else 1e-6)
    # What makes it exact: the plane at the normal separates by the gap, and the points are as far apart.
    assert ((b @ found.normals[0]).min() - (a @ found.normals[0]).max()) == pytest.approx(found.gaps[0], abs=1e-13)
    assert (found.seconds[0] - found.firsts[0]) @ found.normals[0] == pytest.approx(found.gaps[0], abs=1e-13)
    swapped = gap_of(second, first, -offset, turns[[1, 0]])
    assert swapped.gaps[0] == pytest.approx(found.gaps[0], abs=1e-13)
    assert swapped.areas[0] == pytest.approx(found.areas[0], abs=1e-12)


@pytest.mark.property
@settings(max_examples=40, deadline=None)
@given(st.sampled_from(sorted(TOUCHING)), GAPS, st.integers(0, 2**31))
@example("edge-edge", 1.192092896e-07, 0)
@example("edge-edge", 3.248e-08, 1)
@example("vertex-edge", 3.039e-08, 2)
def test_a_rigid_motion_of_both_changes_nothing_but_the_frame(kind, gap, seed):
    first, turn, second, other, height, _ = TOUCHING[kind]
    gap = gap if kind in SHALLOW else abs(gap)
    motion = Rotation.random(rng=np.random.default_rng(seed))
    found = gap_of(first, second, motion.apply([0, 0, height + gap]), (motion * turn, motion * other))
    plain = gap_of(first, second, [0, 0, height + gap], (turn, other))
    assert found.gaps[0] == pytest.approx(gap, abs=1e-14)
    assert found.areas[0] == pytest.approx(plain.areas[0], rel=1e-10)
    assert (found.seconds[0] - found.firsts[0]) @ found.normals[0] == pytest.approx(gap, abs=1e-14)
    if abs(gap) > 1e-8:
        np.testing.assert_allclose(found.normals[0], motion.apply([0, 0, 1]), atol=1e-7)


@pytest.mark.property
def test_grains_moved_together_along_their_normal_come_as_near_as_they_were_moved():
    # Where the closest points were they stay, so each of the new gaps is known; 4000 random pairs, a tenth a decade.
    rng = np.random.default_rng(1)
    shapes = polyhedra(*[blob(rng) for _ in range(100)])
    turns = np.roll(Rotation.random(100, rng=rng).as_quat(), 1, axis=1)
    solids = bodies(place(shapes, np.zeros((100, 3)), quaternions=turns))
    pairs = rng.permuted(np.tile(np.arange(100, dtype=np.int32), (4000, 1)), axis=1)[:, :2]
    directions = rng.standard_normal((4000, 3))
    offsets = 2 * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    before = measure_gaps(solids, pairs, offsets)
    gaps = 10 ** rng.uniform(-12, -1, 4000)
    found = measure_gaps(solids, pairs, offsets + (gaps - before.gaps)[:, None] * before.normals)
    # Some ten roundings of numbers near one.
    np.testing.assert_allclose(found.gaps, gaps, rtol=0, atol=3e-15)
    between = found.seconds - found.firsts
    np.testing.assert_allclose(between, found.gaps[:, None] * found.normals, rtol=0, atol=1e-13)


@pytest.mark.unit
@pytest.mark.parametrize("gap", [1e-3, 1e-6, 2.0**-30, 0.0, -1e-6, -1e-3])
def test_the_answers_are_the_same_a_million_diameters_from_the_origin(gap):
    # Multiples of 2⁻³⁰: the far positions hold them exactly, so the two pairs are the same pair.
    height = np.round((2 + gap) * 2.0**30) / 2.0**30
    near = place(polyhedra(CUBE, OCTAHEDRON), np.array([[0.0, 0, 0], [0, 0, height]]))
    far = place(polyhedra(CUBE, OCTAHEDRON), np.array([[0.0, 0, 0], [0, 0, height]]) + 2.0**21)
    here, there = (measure_gaps(bodies(p), PAIR, offsets_between(p, PAIR)) for p in (near, far))
    for one, other in zip(here, there, strict=True):
        assert one.tobytes() == other.tobytes()


@pytest.mark.unit
def test_pairs_beyond_the_limit_are_left_at_an_infinite_gap():
    solids, offsets = two(CUBE, CUBE, [0, 0, 2.5])
    assert measure_gaps(solids, PAIR, offsets, 0.5 * (1 + 1e-12)).gaps[0] == pytest.approx(0.5)
    assert measure_gaps(solids, PAIR, offsets, 0.4).gaps[0] == np.inf


@pytest.mark.property
@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**31), st.floats(0.0, 1.2))
def test_a_certificate_never_promises_more_than_the_gap_and_proves_what_is_apart(seed, distance):
    rng = np.random.default_rng(seed)
    direction = rng.standard_normal(3)
    solids, offsets = two(blob(rng), blob(rng), distance * direction / np.linalg.norm(direction))
    gap = measure_gaps(solids, PAIR, offsets).gaps[0]
    normals, margins = certify(solids, PAIR, offsets)
    assert np.linalg.norm(normals[0]) == pytest.approx(1)
    assert margins[0] <= gap
    assert margins[0] > 0 or gap < 1e-13
    a, b = standing(solids, 0), standing(solids, 1)
    assert margins[0] < ((b + offsets[0]) @ normals[0]).min() - (a @ normals[0]).max()


@pytest.mark.unit
@pytest.mark.parametrize("kind", TOUCHING)
def test_solids_that_just_touch_are_certified_to_within_rounding(kind):
    first, turn, second, other, height, _ = TOUCHING[kind]
    solids, offsets = two(first, second, [0, 0, height], (turn, other))
    assert -1e-13 < certify(solids, PAIR, offsets)[1][0] <= 1e-15


@pytest.mark.unit
def test_gaps_are_the_same_bytes_on_any_number_of_threads():
    rng = np.random.default_rng(1)
    packing = place(polyhedra(*[blob(rng) for _ in range(60)]), rng.random((60, 3)) * 3)
    pairs = np.argwhere(np.triu(np.ones((60, 60)), 1)).astype(np.int32)
    solids, offsets = bodies(packing), offsets_between(packing, pairs)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = measure_gaps(solids, pairs, offsets)
    finally:
        numba.set_num_threads(threads)
    for one, other in zip(alone, measure_gaps(solids, pairs, offsets), strict=True):
        assert one.tobytes() == other.tobytes()
