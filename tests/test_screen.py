from __future__ import annotations

import pytest

from grainsdem.screen import LEAST_SHARE, Pace

pytestmark = pytest.mark.unit


def test_what_is_left_follows_from_the_pace_so_far():
    pace = Pace()
    assert pace.left(0.0, 100.0) is None
    assert pace.left(0.25, 110.0) == pytest.approx(30.0)
    assert pace.left(0.5, 130.0) == pytest.approx(30.0)
    assert pace.left(1.0, 160.0) == 0.0


def test_the_time_in_which_nothing_could_be_told_does_not_count():
    pace = Pace()
    for now in (0.0, 50.0, 100.0):
        assert pace.left(0.0, now) is None
    assert pace.left(0.1, 110.0) == pytest.approx(90.0)


def test_what_was_done_before_a_run_went_on_does_not_count():
    pace = Pace()
    pace.left(0.8, 0.0)
    assert pace.left(0.9, 10.0) == pytest.approx(10.0)


def test_a_little_says_nothing_of_the_pace():
    pace = Pace()
    pace.left(0.0, 0.0)
    assert pace.left(0.5 * LEAST_SHARE, 1.0) is None
