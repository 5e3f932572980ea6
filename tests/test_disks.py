"""Disks that refuse, wherever a write is when they begin to: one error, and what is there is whole or absent."""

from __future__ import annotations

import errno
import itertools
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import failing_disks
import pytest

import exporters
import grainsdem as gd
from grainsdem import survey
from grainsdem.errors import WriteError
from grainsdem.measures.planform import write_planform

pytestmark = pytest.mark.unit


def _survey(cube, folder):
    base = {"domain": {"side": 3e-3}, "seeds": {"count": 27}, "grains": {"scale": 0.9, "keep": "all"}}
    survey.run(survey.Survey(base, {"seeds.count": [20, 27]}), folder / "out.csv", workers=1)


WAYS = {
    "packing": lambda cube, folder: gd.save(cube, folder / "out.h5"),
    "folder of formats": lambda cube, folder: exporters.write(cube, folder / "out", formats=["stl", "mjcf", "usd"]),
    "table": lambda cube, folder: gd.write_table(gd.table(cube), folder / "out.csv"),
    "columns": lambda cube, folder: gd.write_table(gd.table(cube), folder / "out.parquet"),
    "voxels": lambda cube, folder: gd.write_voxels(cube, folder / "out.npy", per_diameter=4),
    "raw voxels": lambda cube, folder: gd.write_voxels(cube, folder / "out.raw", per_diameter=4),
    "photograph": lambda cube, folder: write_planform(gd.planform(cube, per_diameter=4), cube, folder / "out"),
    "seeds": lambda cube, folder: gd.points.write(gd.points.poisson(cube.domain, 9, rng=1), folder / "out.csv"),
    "run": lambda cube, folder: gd.settle(cube, max_time=0.02, history_path=folder / "out.h5"),
    "survey": _survey,
}


def refused(write):
    """Return what is said where something cannot be written, or nothing."""
    try:
        write()
    except WriteError as error:
        return str(error)
    return ""


def contents(folder):
    return {str(path.relative_to(folder)): path.is_file() and path.read_bytes() for path in folder.rglob("*")}


@pytest.mark.parametrize("code", [errno.EROFS, errno.ENOSPC], ids=["read-only", "no room"])
@pytest.mark.parametrize("way", WAYS)
def test_whatever_call_fails_first_what_is_written_is_whole_or_absent(cube, tmp_path, way, code):
    WAYS[way](cube, tmp_path)
    whole = contents(tmp_path)
    for first in itertools.count():
        assert first < failing_disks.MOST
        with tempfile.TemporaryDirectory() as place, failing_disks.Faults(place, code, first) as faults:
            told = refused(lambda place=place: WAYS[way](cube, Path(place)))
            assert "\n" not in told
            found = contents(Path(place))
            if told:
                assert told.count(str(place)) == 1
                assert {name: whole.get(name) for name in found} == found
            else:
                assert found.keys() == whole.keys()
        if faults.calls <= first:
            assert told == ""
            return
        # Nothing is passed over in silence, but for the digest at the end of a history that is whole without it.
        assert told or way == "run"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["export", "measure", "run", "settle", "survey", "voxels"])
def test_a_command_whose_disk_refuses_ends_in_one_line_and_leaves_nothing_half_written(name):
    # In a process of its own: one that has started threads cannot be forked.
    words = [sys.executable, str(Path(__file__).with_name("failing_disks.py")), "calls", name]
    env = {**os.environ, "PYTHONSAFEPATH": ""}  # it imports what lies beside it
    ended = subprocess.run(words, stdout=subprocess.PIPE, text=True, check=False, env=env)
    assert " calls, 0 wrong: " in ended.stdout
    assert "exit 2" in ended.stdout
    assert ended.returncode == 0
