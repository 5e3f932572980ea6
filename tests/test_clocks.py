"""A clock that is set while something runs changes no byte, and nothing is taken for old or new by its time."""

from __future__ import annotations

import ast
import itertools
import os
import time
from importlib import import_module
from pathlib import Path

import pytest

import exporters
import grainsdem as gd
from grainsdem.atomic import replacing
from grainsdem.storage import load_history

pytestmark = pytest.mark.unit

ROOT = Path(gd.__file__).parents[1]
DAY = 86400.0
LOOKED_AT = {"time", "time_ns", "now", "utcnow", "today", "localtime", "gmtime", "ctime", "clock_gettime"}


def jumping(monkeypatch):
    """Have the clock jump a day back or forward, or to 1970, each time it is looked at."""
    jumps, now = itertools.cycle([-DAY, DAY, 0.0, -time.time()]), time.time()
    monkeypatch.setattr(time, "time", lambda: now + next(jumps))
    monkeypatch.setattr(time, "time_ns", lambda: int(1e9 * (now + next(jumps))))


def test_no_code_of_ours_looks_at_a_clock_that_can_be_set():
    found = []
    for path in itertools.chain(*((ROOT / room).rglob("*.py") for room in ("grainsdem", "exporters"))):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "time" in text else ():
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                if node.value.id in ("time", "datetime", "date") and node.attr in LOOKED_AT:
                    found.append(f"{path.name}:{node.lineno}")
            elif isinstance(node, ast.ImportFrom) and node.module in ("time", "datetime"):
                found += [f"{path.name}:{node.lineno}" for one in node.names if one.name in LOOKED_AT]
    assert found == []


def written(cube, folder):
    """Return the bytes by name of files of every kind: formats, tables, a picture, and a run that is gone on with."""
    folder.mkdir()
    formats = [name for name in exporters.FORMATS if name != "openfoam"]
    found = {f"{name}/{file}": data for name in formats for file, data in exporters.files(cube, name).items()}
    gd.save(cube, folder / "bed.h5")
    gd.write_table(gd.table(cube), folder / "grains.csv")
    gd.write_table(gd.table(cube), folder / "grains.parquet")
    gd.write_planform(gd.planform(cube, per_diameter=8), cube, folder / "seen")
    gd.settle(cube, max_time=0.02, history_path=folder / "run.h5")
    gd.settle(cube, max_time=0.04, history_path=folder / "run.h5", resume=True)
    kept = [path for path in sorted(folder.rglob("*.*")) if path.name != "run.h5"]  # its own trace is held below
    history = load_history(folder / "run.h5")
    return {
        **found,
        **{path.name: path.read_bytes() for path in kept},
        **{name: history[name].tobytes() for name in history},
    }


def test_files_and_runs_are_the_same_whatever_becomes_of_the_clock(cube, tmp_path, monkeypatch):
    before = written(cube, tmp_path / "before")
    jumping(monkeypatch)
    after = written(cube, tmp_path / "after")
    assert {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)} == set()


@pytest.mark.parametrize("when", [-400 * DAY, 400 * DAY], ids=["a year ago", "in a year"])
def test_what_is_left_or_held_is_known_by_its_lock_and_not_by_its_age(tmp_path, when):
    left, held = tmp_path / ".o-1.txt", tmp_path / ".o-2.txt"
    left.write_text("half")
    with replacing(tmp_path / "o.txt") as first:
        assert first == left
        os.utime(first, (time.time() + when,) * 2)
        with replacing(tmp_path / "o.txt") as second:
            assert second == held
            second.write_text("second")
        first.write_text("first")
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"o.txt": "first"}


def test_models_kept_before_the_clock_was_set_back_make_room_for_later_ones(tmp_path, monkeypatch):
    cache, mujoco = import_module("grainsdem.dynamics.engine.cache"), pytest.importorskip("mujoco")
    monkeypatch.setattr(cache, "MOST_MODELS", 2)
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    for name in ("tomorrow", "later"):
        (tmp_path / f"{name}.mjb").touch()
        os.utime(tmp_path / f"{name}.mjb", (time.time() + DAY,) * 2)
    for name in ("one", "two"):
        cache.keep(model, tmp_path / f"{name}.mjb")
        assert (tmp_path / f"{name}.mjb").exists()
    assert sorted(path.stem for path in tmp_path.iterdir()) == ["one", "two"]
