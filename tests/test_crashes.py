"""Commands killed at random moments, those of `crashing`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.client]


@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL there")
@pytest.mark.parametrize(
    ("name", "stop"),
    [
        *((name, "KILL") for name in ("save", "export", "survey", "images", "run", "settle", "tilt")),
        *((name, stop) for name in ("export", "settle") for stop in ("TERM", "INT")),
    ],
)
def test_what_a_stopped_command_left_is_whole_or_absent_and_goes_on_to_the_same_bits(name, stop):
    # In a process of its own: one that has started threads cannot be forked.
    words = [sys.executable, str(Path(__file__).with_name("crashing.py")), "3", name, "--stop", stop]
    # Which may import what lies beside it.
    env = {key: value for key, value in os.environ.items() if key != "PYTHONSAFEPATH"}
    ended = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=True, env=env)
    assert "'tried': 3" in ended.stdout
    assert "wrong" not in ended.stdout
