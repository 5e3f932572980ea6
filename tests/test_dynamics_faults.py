from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from importlib import import_module

import numpy as np
import pytest
from conftest import cube_packing
from shaking import child_code

from grainsdem.dynamics import settle
from grainsdem.dynamics.budget import allow, estimate
from grainsdem.dynamics.checkpoint import checkpoint_path
from grainsdem.errors import FileFormatError, InputError, UnstableError, WriteError
from grainsdem.geometry.rotations import random_quaternions
from grainsdem.model import Domain
from grainsdem.storage import load, load_history, save
from grainsdem.storage.hdf5 import RESERVE

loops = import_module("grainsdem.dynamics.loop")
SettleLoop = import_module("grainsdem.dynamics.settle").SettleLoop  # the function of the same name hides the module
advance_as_ever = SettleLoop._advance


@pytest.fixture(scope="module")
def heap():
    """Eight cubes that fall far enough for five chunks, and tumble."""
    places = [[2.0 + 4.0 * (k % 2), 2.0 + 4.0 * (k // 2 % 2), 32.0 + 4.0 * (k // 4)] for k in range(8)]
    cubes = cube_packing(places, domain=Domain.box((8.0, 8.0, 40.0)))
    turned = random_quaternions(8, np.random.default_rng(4))
    return type(cubes)(cubes.grains, cubes.positions, turned, cubes.densities, cubes.domain)


@pytest.fixture(scope="module")
def whole(heap, tmp_path_factory, shake):
    """The run that nothing interrupts, and its history's path."""
    path = tmp_path_factory.mktemp("whole") / "history.h5"
    return settle(heap, history_path=path), path


CHILD = """
    import resource, signal, sys, time
    import grainsdem as gd
    limit = int(sys.argv[3])
    if limit:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    gd.settle(gd.load(sys.argv[1]), history_path=sys.argv[2], resume=True, progress=lambda _: time.sleep(0.02))
"""


def start_child(bed, history, shake, limit=0):
    code = child_code(shake) + textwrap.dedent(CHILD)
    words = [sys.executable, "-c", code, str(bed), str(history), str(limit)]
    return subprocess.Popen(words, stderr=subprocess.PIPE, text=True)


def kill_after_chunks(process, state, *, chunks):
    """Send SIGKILL once so many checkpoints were written."""
    seen, deadline = set(), time.monotonic() + 600  # a busy machine takes a minute to import
    while len(seen) < chunks and time.monotonic() < deadline and process.poll() is None:
        if state.exists():
            seen.add(state.stat().st_mtime_ns)
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.communicate(timeout=60)
    assert process.returncode == -signal.SIGKILL
    assert len(seen) == chunks


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL there")
def test_a_run_killed_twice_goes_on_to_the_same_bits(heap, whole, shake, tmp_path):
    bed, path = save(heap, tmp_path / "bed.h5"), tmp_path / "history.h5"
    state = checkpoint_path(path)
    for _ in range(2):
        kill_after_chunks(start_child(bed, path, shake), state, chunks=1 if not state.exists() else 2)
    kept = load_history(path)["time"]
    assert 0 < kept.size < whole[0].history["time"].size - 1
    resumed = settle(load(bed), history_path=path, resume=True)
    assert resumed.packing.positions.tobytes() == whole[0].packing.positions.tobytes()
    assert resumed.packing.quaternions.tobytes() == whole[0].packing.quaternions.tobytes()
    assert resumed.report == whole[0].report
    one, two = load_history(path), load_history(whole[1])
    assert one.keys() == two.keys()
    assert all(one[name].tobytes() == two[name].tobytes() for name in one)
    assert not state.exists()


@pytest.mark.client
@pytest.mark.skipif(os.name == "nt", reason="there is no SIGKILL there")
def test_a_killed_run_loses_at_most_one_chunk(heap, whole, shake, tmp_path):
    bed, path = save(heap, tmp_path / "bed.h5"), tmp_path / "history.h5"
    kill_after_chunks(start_child(bed, path, shake), checkpoint_path(path), chunks=2)
    with np.load(checkpoint_path(path)) as file:
        n_safe = len(file["samples"]) - 1
    kept = load_history(path)["kinetic_energy"]
    assert n_safe == 2 * loops.SAMPLES_PER_CHUNK
    assert n_safe <= kept.size <= n_safe + loops.SAMPLES_PER_CHUNK
    np.testing.assert_array_equal(kept, whole[0].history["kinetic_energy"][1 : kept.size + 1])


@pytest.mark.slow
@pytest.mark.client
@pytest.mark.skipif(os.name == "nt", reason="there is no limit of that kind there")
def test_a_full_disk_ends_in_one_error_and_keeps_the_last_checkpoint(heap, whole, shake, tmp_path):
    bed, path = save(heap, tmp_path / "bed.h5"), tmp_path / "history.h5"
    process = start_child(bed, path, shake, limit=whole[1].stat().st_size - 2500 + RESERVE)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "WriteError" in errors
    assert "history" in errors.strip().splitlines()[-1]
    resumed = settle(load(bed), history_path=path, resume=True)
    assert resumed.packing.positions.tobytes() == whole[0].packing.positions.tobytes()


@pytest.mark.client
def test_a_history_in_a_folder_that_is_not_there_is_refused_before_the_start(heap, tmp_path):
    with pytest.raises(WriteError, match="nowhere"):
        settle(heap, history_path=tmp_path / "nowhere" / "history.h5")


def stop_early(monkeypatch, n):
    """Let a run end in an error after so many samples."""

    def keep(run, now):
        keep_as_ever(run, now)
        if len(run.samples) > n:
            raise KeyboardInterrupt

    keep_as_ever = SettleLoop.keep
    monkeypatch.setattr(SettleLoop, "keep", keep)


@pytest.mark.client
def test_a_run_does_not_go_on_with_other_options_or_grains(heap, tmp_path, monkeypatch):
    path = tmp_path / "history.h5"
    with monkeypatch.context() as patched:
        stop_early(patched, loops.SAMPLES_PER_CHUNK + 1)
        with pytest.raises(KeyboardInterrupt):
            settle(heap, history_path=path)
    with pytest.raises(InputError, match=r"max_time 50.0, was 200.0"):
        settle(heap, history_path=path, resume=True, max_time=50)
    with pytest.raises(InputError, match=r"model .* was"):
        settle(heap, history_path=path, resume=True, friction=0.3)


@pytest.mark.unit
def test_a_damaged_checkpoint_is_refused(heap, tmp_path):
    path = tmp_path / "history.h5"
    checkpoint_path(path).write_bytes(b"PK\x03\x04 not a checkpoint")
    with pytest.raises(FileFormatError, match="not a checkpoint"):
        settle(heap, history_path=path, resume=True)


@pytest.mark.client
def test_a_run_that_kept_nothing_starts_anew(heap, whole, tmp_path):
    resumed = settle(heap, history_path=tmp_path / "history.h5", resume=True)
    assert resumed.packing.positions.tobytes() == whole[0].packing.positions.tobytes()


@pytest.mark.unit
def test_resuming_needs_a_history(heap):
    with pytest.raises(InputError, match="resume needs"):
        settle(heap, resume=True)


def spoil(monkeypatch, harm, *, after=1.0):
    """Do harm to a run after each advance beyond a time."""

    def advance(run):
        steps = advance_as_ever(run)
        if run.scene.time() > after:
            harm(run.scene.engine.data)
        return steps

    monkeypatch.setattr(SettleLoop, "_advance", advance)


def throw_out(data):
    data.qpos.reshape(-1, 7)[3, 0] = 50.0


def turn_to_nan(data):
    data.qpos.reshape(-1, 7)[5, 2] = np.nan


def speed_up(data):
    data.qvel.reshape(-1, 6)[2, 2] = 9.0


def put_back(data):
    data.time = 0.0


@pytest.mark.client
@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (put_back, r"the clock went from 1 to 0"),
        (throw_out, r"1 grains left the container: 3"),
        (turn_to_nan, r"not finite, grains 5"),
        (speed_up, r"energy rose .*, grain 2 the fastest"),
    ],
)
def test_trouble_that_stays_is_told_with_what_when_and_which_grain(heap, monkeypatch, tmp_path, harm, words):
    spoil(monkeypatch, harm)
    path = tmp_path / "history.h5"
    with pytest.raises(UnstableError, match=words) as caught:
        settle(heap, history_path=path)
    message = str(caught.value)
    assert "went wrong at" in message
    assert "3 smaller time steps did not help" in message
    assert "The last good state is that at" in message
    assert np.isfinite(caught.value.last_good.positions).all()
    history = load_history(path)
    assert not any(np.isnan(series).any() for series in history.values())
    assert history["time"][-1] > 0


@pytest.mark.client
@pytest.mark.parametrize("kind", ["mjWARN_CONTACTFULL", "mjWARN_CNSTRFULL", "mjWARN_INERTIA", "mjWARN_BADQACC"])
def test_every_warning_of_mujoco_is_trouble_and_is_survived_by_a_smaller_step(heap, monkeypatch, kind):
    import mujoco

    warn = iter([False, True])

    def advance(run):
        steps = advance_as_ever(run)
        if next(warn, False):
            run.scene.engine.data.warning[getattr(mujoco.mjtWarning, kind)].number = 1
            assert kind in run.scene.engine.complaint()
        return steps

    monkeypatch.setattr(SettleLoop, "_advance", advance)
    report = settle(heap).report
    assert report.halvings == 1
    assert report.at_rest


@pytest.mark.unit
def test_the_factors_of_the_grain_units_are_in_the_history(whole):
    import h5py

    with h5py.File(whole[1]) as file:
        said = json.loads(file.attrs["attributes"])
    assert said["experiment"] == "settle"
    assert said["length"] == pytest.approx(np.cbrt(8 * 6 / np.pi))
    assert said["time"] == pytest.approx(np.sqrt(said["length"] / 9.81))
    assert said["mass"] == pytest.approx(said["length"] ** 3)


@pytest.mark.unit
def test_a_run_that_does_not_fit_is_refused_with_the_estimate_and_advice():
    huge = estimate(10_000_000, duration=40.0)
    with pytest.raises(
        InputError, match=r"does not fit: 10000000 grains: about 1.5e\+03 GB .* 8 GB are free; .*exaDEM"
    ):
        allow(huge, max_hours=1e9, memory=8e9)
    with pytest.raises(InputError, match=r"takes too long: 400000 grains.* days .*max_hours is 24; .*exaDEM"):
        allow(estimate(400_000, duration=40.0), max_hours=24.0, memory=1e15)


@pytest.mark.unit
def test_settling_says_what_it_takes_before_it_starts_and_keeps_to_max_hours(heap, caplog):
    with caplog.at_level("INFO", logger="grainsdem"), pytest.raises(InputError, match="takes too long: 8 grains"):
        settle(heap, max_hours=1e-6)
    assert not caplog.messages
    with caplog.at_level("INFO", logger="grainsdem"):
        settle(heap, max_time=0.1)
    assert len(caplog.messages) == 1
    assert caplog.messages[0].startswith("8 grains: about 0.26 GB and 0.002")


@pytest.mark.client
def test_a_large_model_is_kept_compiled_and_gives_the_same_bits(heap, tmp_path, monkeypatch):
    cache = import_module("grainsdem.dynamics.engine.cache")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "kept"))
    monkeypatch.setattr(cache, "LEAST_SIZE", 1)
    first = settle(heap, max_time=8.0)
    (kept,) = (tmp_path / "kept").glob("*.mjb")
    before = kept.stat().st_mtime_ns
    second = settle(heap, max_time=8.0)
    assert kept.stat().st_mtime_ns == before
    assert first.packing.positions.tobytes() == second.packing.positions.tobytes()
    kept.write_bytes(b"damaged")
    third = settle(heap, max_time=8.0)
    assert first.packing.positions.tobytes() == third.packing.positions.tobytes()


@pytest.mark.unit
def test_only_the_newest_models_are_kept(heap, tmp_path, monkeypatch):
    cache = import_module("grainsdem.dynamics.engine.cache")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path))
    monkeypatch.setattr(cache, "LEAST_SIZE", 1)
    monkeypatch.setattr(cache, "MOST_MODELS", 2)
    for friction in (0.1, 0.2, 0.3):
        settle(heap, max_time=0.1, friction=friction)
    assert len(list(tmp_path.glob("*.mjb"))) == 2


@pytest.mark.unit
def test_frames_of_a_history_begin_with_the_start_and_end_with_the_end(heap, whole):
    frames = load_history(whole[1])
    assert frames["frame_times"][0] == 0
    assert frames["frame_times"][-1] == frames["time"][-1]
    np.testing.assert_allclose(frames["positions"][0], heap.positions, atol=1e-8)  # the text places grains to 1e-9 d
    np.testing.assert_array_equal(frames["positions"][-1], whole[0].packing.positions)
    assert (np.diff(frames["frame_times"]) > 0).all()
