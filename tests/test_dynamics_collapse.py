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


@pytest.mark.slow
@pytest.mark.statistical
def test_piles_run_out_on_all_sides_and_come_to_rest():
    start = grow(20)
    outcomes = [first_at_rest(lambda seed, k=k: collapse(start, rng=10 * seed + k)) for k in range(4)]
    reports = [outcome.report for outcome in outcomes]
    # Of 10 heaps: 3.7 ± 0.7 times as wide, 0.43 ± 0.11 times as high; means of four are 8 and 10 spreads from one.
    assert np.mean([report.final_run_out / report.initial_run_out for report in reports]) > 1.0
    assert np.mean([report.final_height / report.initial_height for report in reports]) < 1.0
    assert all((outcome.packing.positions[:, 2] > 0).all() for outcome in outcomes)
    assert np.mean([(outcome.packing.positions < start.domain.lower).any() for outcome in outcomes]) > 0.5


def test_a_bed_does_not_run_out_where_its_wall_stays():
    outcome = collapse(grow_planar(12), rng=1, release=["wall_x1"], max_time=8.0)
    assert outcome.packing.positions[:, 0].min() > 0


@pytest.mark.slow
@pytest.mark.statistical
def test_beds_run_out_where_their_wall_is_taken_away():
    start = grow_planar(16)
    outcomes = [collapse(start, rng=seed, release=["wall_x1"], friction=0.1) for seed in range(6)]
    farthest = [outcome.packing.positions[:, 0].max() / start.domain.upper[0] for outcome in outcomes]
    # Of 7 beds: 4.8 ± 1.2 times as wide; as a logarithm the mean is 10 of its spreads above nothing.
    assert np.mean(farthest) > 1.0


@pytest.mark.slow
def test_a_collapse_goes_on_after_an_interrupt_to_the_same_bits(tmp_path):
    check_that_it_goes_on(collapse, grow(12), tmp_path, samples=36, rng=1, max_time=10.0)


def test_a_heap_that_has_no_time_to_rest_is_not_at_rest():
    report = collapse(grow_planar(9), rng=1, max_time=0.3).report
    assert report.is_settled
    assert not report.at_rest


def test_a_heap_with_a_short_flank_is_warned_of(caplog):
    report = collapse(grow_planar(9), rng=1, max_time=0.3).report
    assert report.n_bins < 8
    assert f"the flank of the heap is {report.n_bins} bins" in caplog.text


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
