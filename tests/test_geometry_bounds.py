from __future__ import annotations

from itertools import product

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import SOLIDS, place, polyhedra

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.bounds import boxes, near_images, near_pairs
from grainsdem.model import Domain


def every_pair(lower, upper, within):
    apart = np.maximum(np.maximum(lower[:, None] - upper[None], lower[None] - upper[:, None]), 0)
    return np.argwhere(np.triu((apart**2).sum(axis=2) <= within**2, 1))


def scattered(seed, n=400, spread=1.0):
    rng = np.random.default_rng(seed)
    centres = rng.random((n, 3))
    halves = 0.03 * np.exp(spread * rng.standard_normal((n, 1))) * rng.random((n, 3))
    return centres - halves, centres + halves


@pytest.mark.property
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.floats(0, 0.2), st.floats(0, 1.2))
def test_the_grid_finds_the_pairs_that_trying_all_of_them_finds(seed, within, spread):
    lower, upper = scattered(seed, spread=spread)
    np.testing.assert_array_equal(near_pairs(lower, upper, within), every_pair(lower, upper, within))


@pytest.mark.unit
def test_boxes_twenty_times_larger_and_one_far_away_change_nothing():
    lower, upper = scattered(3, n=1500, spread=0.0)
    middle, half = (lower + upper) / 2, (upper - lower) / 2
    half[::100] *= 20
    middle[7] += 1e9
    lower, upper = middle - half, middle + half
    np.testing.assert_array_equal(near_pairs(lower, upper), every_pair(lower, upper, 0.0))


@pytest.mark.unit
def test_boxes_that_touch_are_near_and_boxes_that_do_not_are_near_within_their_distance():
    lower = np.array([[0.0, 0, 0], [1, 1, 1], [5, 6, 1]])
    upper = lower + 1
    assert near_pairs(lower, upper).tolist() == [[0, 1]]
    assert near_pairs(lower, upper, 5).tolist() == [[0, 1], [1, 2]]
    assert near_pairs(lower, upper, 5 - 1e-9).tolist() == [[0, 1]]


@pytest.mark.unit
def test_no_box_one_box_and_boxes_without_extent_have_the_pairs_that_they_have():
    assert near_pairs(np.empty((0, 3)), np.empty((0, 3))).shape == (0, 2)
    assert near_pairs(np.zeros((1, 3)), np.ones((1, 3))).shape == (0, 2)
    assert near_pairs(np.zeros((3, 3)), np.zeros((3, 3))).tolist() == [[0, 1], [0, 2], [1, 2]]


@pytest.mark.unit
def test_the_pairs_do_not_depend_on_the_number_of_threads():
    lower, upper = scattered(5, n=3000)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = near_pairs(lower, upper, 0.01)
    finally:
        numba.set_num_threads(threads)
    assert alone.tobytes() == near_pairs(lower, upper, 0.01).tobytes()


@pytest.mark.unit
@pytest.mark.parametrize(
    ("lower", "upper", "within", "error", "message"),
    [
        (np.zeros((2, 2)), np.ones((2, 2)), 0.0, ShapeError, r"\(n, 3\); got \(2, 2\)"),
        (np.full((2, 3), np.nan), np.ones((2, 3)), 0.0, InputError, "2 do not: 0, 1"),
        (np.ones((2, 3)), np.zeros((2, 3)), 0.0, InputError, "run upward"),
        (np.zeros((2, 3)), np.ones((2, 3)), -1.0, InputError, "got -1"),
    ],
)
def test_boxes_that_are_none_are_refused(lower, upper, within, error, message):
    with pytest.raises(error, match=message):
        near_pairs(lower, upper, within)


@pytest.mark.unit
def test_a_cube_turned_by_an_eighth_has_the_box_of_its_diagonal():
    turn = [[np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]]
    lower, upper = boxes(place(polyhedra(SOLIDS["cube"][0]), [[5.0, 5, 5]], quaternions=turn))
    np.testing.assert_allclose(upper[0] - lower[0], [2 * np.sqrt(2), 2 * np.sqrt(2), 2], rtol=1e-14)
    np.testing.assert_allclose((upper[0] + lower[0]) / 2, [5, 5, 5], rtol=1e-14)


@pytest.mark.property
@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**31), st.tuples(st.booleans(), st.booleans(), st.booleans()))
def test_images_across_periodic_boundaries_are_those_of_all_copies(seed, periodic):
    rng = np.random.default_rng(seed)
    domain = Domain.box((1.0, 1.5, 1.2), periodic=periodic)
    n = 20
    # Some lie outside the domain, as grains do that a simulation has not wrapped.
    positions = rng.uniform(-0.3, 1.8, (n, 3))
    packing = place(
        polyhedra(*[SOLIDS["cube"][0] * rng.uniform(0.02, 0.3) for _ in range(n)]), positions, domain=domain
    )
    within = 0.05
    found = near_images(packing, within)
    lower, upper = boxes(packing)
    wanted = set()
    reach = [range(-4, 5) if wraps else (0,) for wraps in periodic]
    for shift in product(*reach):
        offset = np.array(shift) * domain.lengths
        apart = np.maximum(np.maximum(lower[:, None] - upper - offset, lower + offset - upper[:, None]), 0)
        for i, j in np.argwhere((apart**2).sum(axis=2) <= within**2 + 1e-12):
            if i < j or (i == j and shift > (0, 0, 0)):
                wanted.add((i, j, *shift))
    rows = [(*pair, *shift) for pair, shift in zip(found.pairs.tolist(), found.shifts.tolist(), strict=True)]
    assert len(set(rows)) == len(rows)
    assert set(rows) == wanted
