from __future__ import annotations

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import SOLIDS, blob, place, polyhedra, solid

from grainsdem.measures import box_axes, sieve_diameters, size_distribution, table
from grainsdem.model import Domain, Polyhedra
from grainsdem.packing import carve
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

LOOSE = 5e-3  # how far above the smallest hole an answer may be
FINE = 2e-4  # and where orientations near the best one are alike, as around the closed forms here


def brick(a, b, c):
    return 0.5 * np.array([a, b, c]) * SOLIDS["cube"][0]


def cylinder(diameter, height, sides=360):
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = 0.5 * diameter * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.vstack([np.column_stack([ring, np.full(sides, z)]) for z in (-0.5 * height, 0.5 * height)])


def ball(n=1500):
    k = np.arange(n) + 0.5
    polar, turn = np.arccos(1 - 2 * k / n), np.pi * (1 + np.sqrt(5)) * k
    return 0.5 * np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])


@pytest.mark.unit
@pytest.mark.parametrize(
    ("points", "side"),
    [
        # Its shadow along the line through the middles of two opposite edges is a square whose diagonals they are.
        (SOLIDS["tetrahedron"][0] / SOLIDS["tetrahedron"][1], 1 / np.sqrt(2)),
        # Along u it is |u_x| + |u_y| + |u_z| >= 1 wide.
        (brick(1, 1, 1), 1.0),
        # √2 max |u_k| wide; of directions at right angles (2, 2, 1) / 3 and (2, -1, -2) / 3 have the least of both.
        (SOLIDS["octahedron"][0] / SOLIDS["octahedron"][1], 2 * np.sqrt(2) / 3),
        (brick(3, 2, 1), 2.0),
        (brick(10, 1, 1), 1.0),
        # Thin: along the diagonal, b + c over √2 wide both ways.
        (brick(3, 2, 0.5), 2.5 / np.sqrt(2)),
        (brick(3, 2, 0.05), 2.05 / np.sqrt(2)),
        (cylinder(1.0, 0.01), 1.01 / np.sqrt(2)),
        (cylinder(1.0, 0.3), 1.3 / np.sqrt(2)),
        (cylinder(1.0, 0.6), 1.0),
        (cylinder(1.0, 4.0), 1.0),
        (ball(), 1.0),
    ],
    ids=["tetrahedron", "cube", "octahedron", "brick", "rod", "plate", "sheet", "foil", "disc", "drum", "pipe", "ball"],
)
def test_named_solids_pass_the_square_holes_of_their_closed_forms_however_they_lie(points, side):
    turns = [np.eye(3), *Rotation.random(2, rng=5).as_matrix()]
    found = sieve_diameters(polyhedra(*(points @ turn.T for turn in turns)))
    slack = 3e-3 if len(points) > 100 else FINE  # a ball or ring of corners is narrower than the round one by as much
    np.testing.assert_allclose(found, side, rtol=slack)


def holes_below(points, side):
    """Return the widths along both sides of squares < side that a body passes: none is missed, by a bound.

    Orientations are Euler's angles. Within an angle r of a direction in which a body is w wide, between two corners
    that are s apart across it, it is at least w cos r - s sin r wide.
    """
    half = np.full(3, np.pi / 36)
    middles = [(np.arange(n) + 0.5) * 2 * half[0] for n in (9, 36, 9)]  # tilt, azimuth, turn: a quarter for the square
    cells = np.stack(np.meshgrid(*middles, indexing="ij"), axis=-1).reshape(-1, 3)
    signs = np.stack(np.meshgrid(*[[-1, 1]] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    found = []
    while len(cells):
        frames, radius = Rotation.from_euler("ZYZ", cells[:, [1, 0, 2]]).as_matrix(), half.sum()
        is_left, widest = np.ones(len(cells), dtype=bool), np.zeros(len(cells))
        for k in (0, 1):
            along = frames[is_left, :, k] @ points.T
            low, high = along.argmin(axis=1), along.argmax(axis=1)
            wide = np.ptp(along, axis=1)
            apart = np.sqrt(np.maximum(np.sum((points[high] - points[low]) ** 2, axis=1) - wide**2, 0))
            widest[is_left] = np.maximum(widest[is_left], wide)
            is_left[is_left] = wide * np.cos(radius) - apart * np.sin(radius) < side
        found.append(widest[is_left & (widest < side)])
        half = half / 2
        cells = (cells[is_left, None] + signs * half).reshape(-1, 3)
        if np.concatenate(found).size:
            break
    return np.concatenate(found)


@pytest.mark.statistical
@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 1, 0.3), (1, 2, 4)])
def test_no_orientation_passes_a_hole_that_is_smaller_by_half_a_percent(scale):
    domain = Domain.cube()
    cloud = carve(tessellate(poisson(domain, 80, rng=3), domain)).grains.vertices_of(2) * scale
    side = sieve_diameters(polyhedra(cloud))[0]
    assert holes_below(cloud, side * (1 - LOOSE)).size == 0
    assert holes_below(cloud, side * (1 + LOOSE)).size > 0


@pytest.mark.property
@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-5, 1e3))
def test_the_hole_scales_with_a_grain_does_not_turn_with_it_and_lies_between_its_widths(seed, s):
    rng = np.random.default_rng(seed)
    points = blob(rng)
    a, b = polyhedra(points), polyhedra(points @ Rotation.random(rng=rng).as_matrix().T + rng.uniform(-1, 1, 3))
    grown = Polyhedra(a.vertices * s, a.vertex_offsets, a.face_offsets, a.face_vertices, a.face_vertex_offsets)
    side = sieve_diameters(a)[0]
    assert sieve_diameters(b)[0] == pytest.approx(side, rel=LOOSE)
    assert sieve_diameters(grown)[0] == pytest.approx(s * side, rel=1e-9)
    # It is as wide as that along some direction, and the box that it is gripped by passes a square of its b.
    assert side <= box_axes(a)[0, 1] * (1 + LOOSE)
    directions = rng.standard_normal((20_000, 3))
    wide = np.ptp(directions @ points.T, axis=1) / np.linalg.norm(directions, axis=1)
    assert side > 0.99 * wide.min()


@pytest.mark.property
def test_holes_do_not_depend_on_the_number_of_threads_or_on_the_other_grains():
    domain = Domain.cube()
    grains = carve(tessellate(relax(poisson(domain, 250, rng=3), domain), domain)).grains
    found = sieve_diameters(grains)
    before = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(sieve_diameters(grains), found)
    finally:
        numba.set_num_threads(before)
    assert sieve_diameters(polyhedra(grains.vertices_of(70)))[0] == pytest.approx(found[70], rel=1e-9)


@pytest.mark.unit
def test_the_table_and_the_distribution_of_sizes_are_sieved_by_the_hole_not_by_the_box():
    bed = place(polyhedra(*[SOLIDS["tetrahedron"][0] * s for s in (1.0, 1.5)]), [[2.0, 2, 2], [7.0, 7, 7]])
    edges = SOLIDS["tetrahedron"][1] * np.array([1.0, 1.5])
    rows = table(bed)
    np.testing.assert_allclose(rows["sieve_diameter"], edges / np.sqrt(2), rtol=FINE)
    np.testing.assert_allclose(rows["box_b"], edges * np.sqrt(3) / 2, rtol=1e-9)
    marks = size_distribution(bed, diameter="sieve")["by_number"]["percentiles"]
    assert marks["d50"] == pytest.approx(1.25 * SOLIDS["tetrahedron"][1] / np.sqrt(2), rel=FINE)


@pytest.mark.unit
def test_a_flat_grain_passes_a_slit_of_its_least_width():
    # A right triangle with sides 1 and 3: the smallest rectangles lie along any of the three, the slit across √10.
    corners = np.array([[0.0, 0], [3, 0], [0, 1]])
    prism = np.vstack([np.column_stack([corners - corners.mean(axis=0), np.full(3, z)]) for z in (-0.1, 0.1)])
    bed = place(polyhedra(prism), [[2.0, 2, 0.1]], domain=Domain.slab((4.0, 4.0), 0.2))
    assert sieve_diameters(bed)[0] == pytest.approx(3 / np.sqrt(10), rel=1e-12)
    assert table(bed)["sieve_diameter"][0] == pytest.approx(3 / np.sqrt(10), rel=1e-12)


@pytest.mark.unit
def test_no_grains_have_no_holes_and_one_without_corners_has_none_of_its_own():
    assert sieve_diameters(Polyhedra(np.empty((0, 3)), [0], [0], [], [0])).shape == (0,)
    some = solid("cube")
    bare = Polyhedra(some.vertices, [0, 0, 8], [0, 0, some.n_faces], some.face_vertices, some.face_vertex_offsets)
    np.testing.assert_allclose(sieve_diameters(bare), [np.nan, 1.0], rtol=FINE)
