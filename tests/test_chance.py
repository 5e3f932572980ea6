from __future__ import annotations

import numpy as np
import pytest
from chance import margin
from scipy.stats import norm

pytestmark = pytest.mark.statistical


def test_a_margin_is_left_as_often_as_it_says():
    draws = np.random.default_rng(2).normal(5.0, 3.0, (20_000, 9))
    known, new = draws[:, :6], draws[:, 6:]
    limits = margin(known.std(axis=1, ddof=1), measured=6, runs=3, rate=0.02)
    alarms = np.mean(np.abs(new.mean(axis=1) - known.mean(axis=1)) > limits)
    assert alarms == pytest.approx(0.02, abs=5 * np.sqrt(0.02 * 0.98 / len(draws)))


def test_a_spread_of_many_runs_gives_the_normal_distributions_margin():
    assert margin(2.0, measured=10**9, runs=4, rate=1e-4) == pytest.approx(norm.ppf(1 - 5e-5), rel=1e-6)
