from __future__ import annotations

import os
import re
import sys
import time

import pytest

from grainsdem.errors import GrainsDEMError
from grainsdem.workers import can_start, n_processors, share

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


def test_a_job_waits_for_those_that_it_comes_after():
    # A process that slept would answer last; what waits for it answers later still.
    order = [number for number, _ in share(time.sleep, [0.5, 0, 0, 0], workers=3, after=[(), (0,), (), (1, 2)])]
    assert order.index(0) < order.index(1) < order.index(3)
    assert order[0] == 2


def test_a_job_whose_forerunner_fails_is_not_waited_for():
    with pytest.raises(re.error, match="unterminated"):
        list(share(re.compile, ["(", "a", "b"], workers=2, after=[(), (0,), (0,)]))


@pytest.mark.parametrize(
    ("executable", "can"),
    [("/usr/bin/python3.11", True), ("C:/Python/python.exe", True), ("/opt/blender/blender", False), ("", False)],
)
def test_only_an_interpreter_can_be_started_again(monkeypatch, executable, can):
    monkeypatch.setattr(sys, "executable", executable)
    assert can_start() is can
