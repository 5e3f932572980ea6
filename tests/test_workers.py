from __future__ import annotations

import os
import re

import pytest

from grainsdem.errors import GrainsDEMError
from grainsdem.workers import n_processors, share

pytestmark = pytest.mark.unit


def test_every_job_is_done_once_whoever_does_it():
    jobs = [f"{k} word" for k in range(7)]
    for workers in (1, 2, 20):
        assert sorted(share(re.escape, jobs, workers=workers)) == [(k, re.escape(job)) for k, job in enumerate(jobs)]
    assert list(share(re.escape, [])) == []


def test_the_work_is_done_in_other_processes():
    others = {pid for _, pid in share(os.getpgid, [0, 0, 0, 0], workers=2)}
    assert os.getpgid(0) not in others
    assert 1 <= len(others) <= 2


def test_what_a_job_raises_is_raised_here():
    for workers in (1, 2):
        with pytest.raises(re.error, match="unterminated"):
            list(share(re.compile, ["a", "("], workers=workers))


def test_a_process_that_ends_early_is_told():
    with pytest.raises(GrainsDEMError, match="ended before its job"):
        list(share(os._exit, [3, 3], workers=2))


def test_what_a_job_prints_does_not_mix_with_the_answers(capfd):
    assert sorted(share(print, ["noise", "noise"], workers=2)) == [(0, None), (1, None)]
    captured = capfd.readouterr()
    assert (captured.out, captured.err.count("noise")) == ("", 2)


def test_there_is_a_processor():
    assert n_processors() >= 1
