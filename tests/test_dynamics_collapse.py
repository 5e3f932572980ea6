from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing
from loading import check_that_it_goes_on, first_at_rest, grow, grow_planar

from grainsdem.dynamics import collapse
from grainsdem.errors import InputError
from grainsdem.model import Domain

pytestmark = pytest.mark.client


def test_a_stack_that_stands_by_itself_stays_when_the_walls_are_taken_away():
    stack = cube_packing([[3.0, 3.0, 1.0], [3.0, 3.0, 3.0]], domain=Domain.box((6.0, 6.0, 8.0)))
    outcome = collapse(stack)
    assert outcome.report.at_rest
    assert outcome.report.final_height == pytest.approx(4.0, abs=0.01)
    np.testing.assert_allclose(outcome.packing.positions, stack.positions, atol=0.01)


def test_a_wide_pile_runs_out_on_all_sides_and_comes_to_rest():
    start = grow(20)
    outcome = first_at_rest(lambda seed: collapse(start, rng=seed))
    report = outcome.report
    # Of 11 heaps: 3.7 ± 0.8 times as wide and 0.42 ± 0.05 times as high; as logarithms 6 and 7 spreads from one.
    assert report.final_run_out > report.initial_run_out
    assert report.final_height < report.initial_height
    assert (outcome.packing.positions < start.domain.lower).any()
    assert (outcome.packing.positions[:, 2] > 0).all()


def test_a_bed_does_not_run_out_where_its_wall_stays():
    outcome = collapse(grow_planar(12), rng=1, release=["wall_x1"], max_time=8.0)
    assert outcome.packing.positions[:, 0].min() > 0


@pytest.mark.slow
@pytest.mark.statistical
def test_beds_run_out_where_their_wall_is_taken_away():
    start = grow_planar(16)
    outcomes = [collapse(start, rng=seed, release=["wall_x1"]) for seed in range(6)]
    farthest = [outcome.packing.positions[:, 0].max() / start.domain.upper[0] for outcome in outcomes]
    falls = [outcome.profile["height"][0] / outcome.profile["height"][-1] for outcome in outcomes]
    # Of 11 beds: 1.8 ± 0.3 times as wide, 2.9 ± 0.8 times as high at the wall as at the end; 6 spreads of the mean.
    assert np.mean(farthest) > 1.0
    assert np.mean(falls) > 1.0


def test_a_collapse_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(collapse, grow(12), tmp_path, samples=36, rng=1, max_time=10.0)


def test_a_heap_that_has_no_time_to_rest_is_not_at_rest():
    report = collapse(grow_planar(9), rng=1, max_time=0.3).report
    assert report.is_settled
    assert not report.at_rest


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"release": ["lid"]}, "release must name some of wall_x0, wall_x1"),
        ({"release": []}, "release"),
        ({"max_time": 0.0}, "max_time"),
        ({"wall_friction": -1.0}, "wall_friction"),
    ],
)
def test_options_out_of_range_are_refused_by_name(cube, options, words):
    with pytest.raises(InputError, match=words):
        collapse(cube, **options)
