from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest

from grainsdem.atomic import replacing, working_in, write_all
from grainsdem.claims import claim, held
from grainsdem.dynamics import settle
from grainsdem.errors import FileFormatError, InputError, WriteError
from grainsdem.recipe import make, run
from grainsdem.storage import HistoryWriter, load, load_history, save
from grainsdem.storage.hdf5 import RESERVE

pytestmark = pytest.mark.unit

KILLED = """
import os, signal, sys
from pathlib import Path
from grainsdem.atomic import replacing, write_all
def pieces():
    yield b"half"
    os.kill(os.getpid(), signal.SIGKILL)
if sys.argv[2] == "all":
    write_all(sys.argv[1], {"a.txt": b"whole", "b.txt": pieces()})
with replacing(Path(sys.argv[1]) / "o.txt") as temporary:
    temporary.write_bytes(b"half")
    os.kill(os.getpid(), signal.SIGKILL)
"""


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize(("way", "left"), [("one", ".o-1.txt"), ("all", ".writing-1")])
def test_what_a_killed_write_left_is_removed_by_the_next(tmp_path, way, left):
    ended = subprocess.run([sys.executable, "-c", KILLED, tmp_path, way], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert names(tmp_path) == [left]
    with replacing(tmp_path / "o.txt") as temporary:
        temporary.write_bytes(b"whole")
    write_all(tmp_path, {"a.txt": b"whole"})
    assert names(tmp_path) == ["a.txt", "o.txt"]


def test_what_a_live_write_holds_is_left_alone_and_the_last_one_wins_whole(tmp_path):
    with replacing(tmp_path / "o.txt") as first:
        first.write_bytes(b"first")
        with replacing(tmp_path / "o.txt") as second:
            assert second != first
            second.write_bytes(b"second")
        assert (tmp_path / "o.txt").read_bytes() == b"second"
    assert (tmp_path / "o.txt").read_bytes() == b"first"
    assert names(tmp_path) == ["o.txt"]


def test_files_left_under_later_names_go_too_and_links_are_not_followed(tmp_path):
    target = tmp_path / "precious"
    target.write_bytes(b"mine")
    (tmp_path / ".o-1.txt").symlink_to(target)
    (tmp_path / ".o-2.txt").write_bytes(b"of a dead process")
    (tmp_path / ".o-3.txt").write_bytes(b"of another")
    with replacing(tmp_path / "o.txt") as temporary:
        assert temporary.read_bytes() == b""
        temporary.write_bytes(b"new")
    assert names(tmp_path) == [".o-1.txt", "o.txt", "precious"]
    assert target.read_bytes() == b"mine"


def test_a_place_that_a_run_holds_is_refused_to_others_in_one_line(tmp_path):
    with held(tmp_path / "run.h5"):
        with pytest.raises(WriteError, match=r"run\.h5: another run is writing it") as told, held(tmp_path / "run.h5"):
            pass
        assert "\n" not in str(told.value)
        code = (
            "import sys; from pathlib import Path; from grainsdem.claims import claim; print(claim(Path(sys.argv[1])))"
        )
        other = subprocess.run(
            [sys.executable, "-c", code, tmp_path / ".run.h5.lock"], stdout=subprocess.PIPE, check=True
        )
        assert other.stdout == b"None\n"
    assert names(tmp_path) == []
    with held(tmp_path / "run.h5"):
        pass


def test_a_folder_made_for_what_fails_is_removed_and_one_that_holds_something_stays(tmp_path):
    with pytest.raises(ValueError, match="bad"), working_in(tmp_path / "a" / "b"):
        raise ValueError("bad")
    assert names(tmp_path) == []
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "kept").touch()
    with pytest.raises(ValueError, match="bad"), working_in(tmp_path / "a"):
        raise ValueError("bad")
    assert names(tmp_path / "a") == ["kept"]
    with pytest.raises(WriteError, match="cannot be made a folder: "), working_in(tmp_path / "a" / "kept"):
        pass


def test_a_lock_that_is_let_go_is_taken_again(tmp_path):
    first = claim(tmp_path / "lock")
    assert claim(tmp_path / "lock") is None
    os.close(first)
    second = claim(tmp_path / "lock")
    assert second is not None
    os.close(second)


@contextmanager
def at_most(size):
    """Let no file be larger, as on a disk that is nearly full."""
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))


@pytest.mark.parametrize("limit", [0, 1, 100, 4096, 20_000])
def test_a_packing_that_the_disk_has_no_room_for_is_an_error_and_nothing_is_left(fresh, tmp_path, limit):
    whole = save(fresh, tmp_path / "whole.h5").read_bytes()
    assert limit < len(whole)
    with at_most(limit), pytest.raises(WriteError, match=r"full\.h5: cannot be written: File too large"):
        save(fresh, tmp_path / "full.h5")
    assert names(tmp_path) == ["whole.h5"]
    save(load(tmp_path / "whole.h5"), tmp_path / "whole.h5")
    assert (tmp_path / "whole.h5").read_bytes() == whole


def test_a_history_that_the_disk_has_no_room_to_begin_is_an_error_and_nothing_is_left(fresh, tmp_path):
    with (
        at_most(RESERVE + 1000),
        pytest.raises(WriteError, match=r"^\S+run\.h5: cannot be written: no room for") as told,
    ):
        HistoryWriter(tmp_path / "run.h5", ["time"], n_grains=len(fresh), grains=fresh)
    assert str(told.value).count("cannot be written") == 1
    assert names(tmp_path) == []


def test_a_second_run_with_the_history_of_one_that_lives_is_refused(cube, tmp_path):
    def again(_):
        with pytest.raises(WriteError, match=r"run\.h5: another run is writing it"):
            settle(cube, history_path=tmp_path / "run.h5")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        settle(cube, history_path=tmp_path / "run.h5", progress=again)
    assert load_history(tmp_path / "run.h5")["time"].size
    assert names(tmp_path) == ["run.h5"]


def test_a_run_does_not_go_on_from_an_empty_checkpoint(cube, tmp_path):
    (tmp_path / "run.state.npz").touch()
    with pytest.raises(FileFormatError, match=r"run\.state\.npz: not a checkpoint that a run can go on from"):
        settle(cube, history_path=tmp_path / "run.h5", resume=True)
    assert names(tmp_path) == ["run.state.npz"]


def test_a_folder_where_a_recipe_is_being_made_is_refused_to_another(tmp_path):
    recipe = make(seeds={"count": 27}, grains={"scale": 0.9, "keep": "all"})
    with working_in(tmp_path / "out"), pytest.raises(WriteError, match="out: another run is writing it"):
        run(recipe, tmp_path / "out")
    with pytest.raises(InputError, match="cells touch a wall"):
        run(make(seeds={"count": 2}, grains={"scale": 0.9}), tmp_path / "none")
    assert names(tmp_path) == ["out"]


BEGUN = """
import os, signal, sys
import h5py
from grainsdem.storage import HistoryWriter
with HistoryWriter(sys.argv[1], ["time"]) as history:
    history.append(time=1.0)
h5py.File.flush = lambda _: os.kill(os.getpid(), signal.SIGKILL)
HistoryWriter(sys.argv[1], ["time"])
"""


def test_a_history_that_is_killed_while_it_begins_leaves_the_one_before_it(tmp_path):
    ended = subprocess.run([sys.executable, "-c", BEGUN, tmp_path / "run.h5"], check=False)
    assert ended.returncode == -signal.SIGKILL
    assert load_history(tmp_path / "run.h5")["time"].tolist() == [1.0]
    with HistoryWriter(tmp_path / "run.h5", ["time"]) as history:
        history.append(time=2.0)
        history.flush()
        assert load_history(tmp_path / "run.h5")["time"].tolist() == [2.0]  # while it is being written
    assert names(tmp_path) == ["run.h5"]
