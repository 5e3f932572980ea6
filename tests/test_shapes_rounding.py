"""Roundness against closed forms, and shapes rounded to it."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from test_shapes_solids import _is_sound

import grainsdem as gd
from grainsdem.errors import ConvergenceError, InputError, ShapeError
from grainsdem.geometry.hulls import convex_hull


def _bevelled_cube(radius):
    """Return a cube of half-edge one whose edges are cut along planes that touch an arc of a radius."""
    near = 1 - radius + np.tan(np.pi / 8) * radius
    corners = [
        np.array(signs) * np.where(np.arange(3) == k, 1.0, near)
        for signs in product((-1, 1), repeat=3)
        for k in range(3)
    ]
    return convex_hull(np.array(corners))


def _rounded_square(radius, sides):
    """Return an upright prism over a square of half-side one, each corner an arc with so many sides along it."""
    turn = np.pi / 2 / sides
    # Where tangents of the arc meet, the square's own sides among them.
    angles = (np.arange(sides) + 0.5) * turn
    arc = (1 - radius) + radius / np.cos(turn / 2) * np.column_stack([np.cos(angles), np.sin(angles)])
    quarter = [[np.cos(a), -np.sin(a), np.sin(a), np.cos(a)] for a in np.arange(4) * np.pi / 2]
    ring = np.concatenate([arc @ np.reshape(q, (2, 2)).T for q in quarter])
    return convex_hull(np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-3.0, 3.0)]))


@pytest.mark.unit
def test_right_angles_and_sharper_ones_have_no_roundness():
    for shape in (
        gd.shapes.platonic("cube"),
        gd.shapes.box(3, 2, 1),
        gd.shapes.platonic("tetrahedron"),
        gd.shapes.prism(3),
    ):
        assert gd.roundness(shape)[0] == 0.0


@pytest.mark.unit
def test_balls_come_near_to_one_with_their_corners():
    found = [gd.roundness(gd.shapes.ellipsoid(1, 1, 1, n_vertices=n))[0] for n in (32, 64, 200)]
    assert 0.8 < found[0] < found[1] < 1
    assert found[2] == pytest.approx(1, abs=0.05)


@pytest.mark.property
@settings(max_examples=20)
@given(st.floats(0.02, 0.98))
def test_a_bevelled_cube_has_the_radius_of_its_edges(radius):
    assert gd.roundness(_bevelled_cube(radius))[0] == pytest.approx(radius, rel=1e-9)


@pytest.mark.property
@settings(max_examples=20)
@given(st.floats(0.05, 0.95), st.integers(2, 30))
def test_arcs_count_alike_however_many_sides_they_have(radius, sides):
    # Along its axis the prism shows the rounded square, across it rectangles: a third of the mean.
    assert gd.roundness(_rounded_square(radius, sides))[0] == pytest.approx(radius / 3, rel=1e-6)


@pytest.mark.unit
def test_of_a_planar_bed_the_outline_in_its_plane_counts():
    shape = _rounded_square(0.4, 3)
    slab = gd.Domain.slab((9.0, 9.0), 6.0)
    bed = gd.Packing(shape, [[4.0, 4.0, 3.0]], [[1.0, 0, 0, 0]], [1.0], slab)
    assert gd.roundness(bed)[0] == pytest.approx(0.4)
    assert gd.roundness(shape)[0] == pytest.approx(0.4 / 3)


@pytest.mark.property
@settings(max_examples=20)
@given(st.integers(0, 2**32), st.floats(1e-6, 1e3))
def test_roundness_is_the_same_in_any_size_and_any_turn(seed, size):
    rng = np.random.default_rng(seed)
    rock = gd.shapes.rock(elongation=0.8, flatness=0.6, rng=rng)
    turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    turn[0] *= np.sign(np.linalg.det(turn))
    moved = replace(rock, vertices=size * (rock.vertices @ turn.T) + size * rng.standard_normal(3))
    assert gd.roundness(moved)[0] == pytest.approx(gd.roundness(rock)[0], abs=1e-6)
    assert 0 <= gd.roundness(rock)[0] <= 1


@pytest.mark.unit
@pytest.mark.parametrize("wanted", [0.1, 0.4, 0.8])
def test_shapes_are_rounded_to_the_roundness_asked_for_and_keep_their_volumes(wanted):
    shapes = gd.shapes.together(gd.shapes.platonic("cube"), gd.shapes.box(3, 2, 2), gd.shapes.box(2, 2, 1))
    found = gd.shapes.rounded(shapes, wanted)
    assert gd.roundness(found) == pytest.approx(np.full(3, wanted), abs=0.02)
    assert gd.volumes(found) == pytest.approx(gd.volumes(shapes), rel=1e-9)
    assert np.diff(found.vertex_offsets).max() <= 64
    assert np.diff(found.face_offsets).max() <= 64
    assert gd.sphericities(found)[0] > gd.sphericities(shapes)[0]
    assert _is_sound(found)


@pytest.mark.unit
def test_a_rounded_cube_is_the_cube_cut_by_planes_that_touch_its_rounded_self():
    shape = gd.shapes.rounded(gd.shapes.platonic("cube"), 0.5)
    assert (len(shape.vertices), shape.n_faces) == (48, 26)
    planes = gd.face_planes(shape)
    half, edge, corner = (
        planes.heights[np.count_nonzero(np.abs(planes.normals) > 1e-6, axis=1) == k] for k in (1, 2, 3)
    )
    radius = gd.roundness(shape)[0]
    # Support of a cube of half-edge 1 - r, and r beyond it, along (1, 1, 0) and (1, 1, 1).
    assert edge / half[0] == pytest.approx((1 - radius) * np.sqrt(2) + radius, rel=1e-9)
    assert corner / half[0] == pytest.approx((1 - radius) * np.sqrt(3) + radius, rel=1e-9)


@pytest.mark.unit
def test_what_is_as_round_as_asked_for_stays_as_it_is():
    rock = gd.shapes.rock(rng=1)
    same = gd.shapes.rounded(rock, gd.roundness(rock)[0])
    assert same.vertices == pytest.approx(rock.vertices, abs=1e-12)


@pytest.mark.unit
@pytest.mark.parametrize("wanted", [0.2, 0.45, 0.65])
def test_rocks_are_as_round_as_asked_for_and_keep_their_proportions(wanted):
    rocks = gd.shapes.rock(6, elongation=0.8, flatness=0.7, roundness=wanted, rng=1)
    assert gd.roundness(rocks) == pytest.approx(np.full(6, wanted), abs=0.02)
    a, b, c = gd.box_axes(rocks).T
    assert b / a == pytest.approx(np.full(6, 0.8), rel=3e-9)
    assert c / b == pytest.approx(np.full(6, 0.7), rel=3e-9)
    assert np.diff(rocks.vertex_offsets).max() <= 64
    assert np.diff(rocks.face_offsets).max() <= 64
    assert _is_sound(rocks)


@pytest.mark.unit
def test_what_cannot_be_so_round_is_refused_in_a_line(monkeypatch):
    cube, ball = gd.shapes.platonic("cube"), gd.shapes.ellipsoid(1, 1, 1)
    both = gd.shapes.together(cube, ball)
    cases = [
        (
            lambda: gd.shapes.rounded(both, 0.5),
            InputError,
            "shape 1 was to have roundness 0.5, and is rounder already: 0.869",
        ),
        (
            lambda: gd.shapes.rounded(gd.shapes.platonic("tetrahedron"), 0.9),
            InputError,
            "gets no nearer with 64 corners: 0.4",
        ),
        (lambda: gd.shapes.rounded(cube, 0.5, n_vertices=10), InputError, "gets no nearer with 10 corners"),
        (lambda: gd.shapes.rounded(cube, 1.5), InputError, r"in \[0, 1\]; got 1.5"),
        (lambda: gd.shapes.rounded(cube, [0.1, 0.2]), ShapeError, "one for each of 1 shapes"),
        (lambda: gd.shapes.rock(roundness=-1), InputError, r"in \[0, 1\]; got -1"),
    ]
    for make, kind, words in cases:
        with pytest.raises(kind, match=words) as caught:
            make()
        assert "\n" not in str(caught.value)
    monkeypatch.setattr("grainsdem.shapes.rocks._DRAWS", 3)
    with pytest.raises(
        ConvergenceError, match=r"of 3 rocks none got elongation 0.75, flatness 0\.75 and roundness 0\.99"
    ):
        gd.shapes.rock(roundness=0.99, rng=1)


@pytest.mark.slow
@pytest.mark.statistical
def test_round_quartz_sand_lies_as_loose_or_dense_as_it_does_in_the_laboratory():
    # Ottawa sand, round: void ratios from 0.50 to 0.74 (ASTM D4253, D4254). Eight such beds, tapped four times, came to
    # 0.599 ± 0.034: the mean of three is five of its spreads above the lower and seven below the upper.
    n, found = 120, []
    for seed in (1, 2, 3):
        sand = gd.shapes.rock(60, elongation=0.85, flatness=0.85, roundness=0.7, rng=seed)
        assert gd.roundness(sand).mean() == pytest.approx(0.7, abs=0.02)
        side = 0.866e-3 * n ** (1 / 3)
        box = gd.Domain.box((side, side, 2.6 * side))
        loose = gd.pack(sand, stats.lognorm(s=0.08, scale=0.95e-3), box, n=n, rng=seed)
        poured = gd.settle(loose, friction=0.3, rng=seed, time_step=0.02).packing
        tapped = gd.dynamics.tap(poured, friction=0.3, taps=4, rng=seed, time_step=0.02).packing
        porosity = gd.porosity(tapped, region=gd.core_box(tapped))
        found.append(porosity / (1 - porosity))
    assert 0.50 < np.mean(found) < 0.74
