"""What HDF5 must not see: files are held against their digest, and read in another process where they have none."""

from __future__ import annotations

import os
import resource
import time

import h5py
import numpy as np
import pytest

from grainsdem import apart
from grainsdem.errors import FileFormatError
from grainsdem.storage import HistoryWriter, hdf5, load, load_history, save, seals

SEAL = 83
"""Bytes behind the end of the HDF5 file."""

FLAGS = 11
"""Byte of the superblock that says whether a file is being written; 5 where others may look on."""

LENGTH = 28
"""Byte of the superblock in the file's length."""


@pytest.fixture(scope="module")
def stored(fresh, tmp_path_factory):
    return save(fresh, tmp_path_factory.mktemp("stored") / "bed.h5").read_bytes()


@pytest.fixture
def unopened(monkeypatch):
    """Make every use of HDF5 and of another process an error."""

    def refuse(*_, **__):
        raise AssertionError

    monkeypatch.setattr(hdf5, "opened", refuse)
    monkeypatch.setattr(hdf5, "read_apart", refuse)


def end(_):
    os._exit(7)


def crash(_):
    os.abort()


def wait(_):
    time.sleep(60)


def burn(_):
    while True:
        pass


def eat(_):
    return {"all": np.ones(10**12)}


@pytest.mark.unit
def test_every_flipped_bit_is_found_before_hdf5_reads_one(stored, unopened, tmp_path):
    path = tmp_path / "bed.h5"
    for place in (
        0,
        8,
        FLAGS,
        LENGTH,
        100,
        len(stored) // 2,
        len(stored) - SEAL - 1,
        len(stored) - SEAL + 30,
        len(stored) - 2,
    ):
        broken = bytearray(stored)
        broken[place] ^= 4
        path.write_bytes(broken)
        with pytest.raises(FileFormatError, match="its bytes are not those that were written"):
            load(path)
    path.write_bytes(stored[:-1])
    with pytest.raises(FileFormatError, match="cut off within the last"):
        load(path)


@pytest.mark.unit
def test_a_closed_history_is_sealed_too(unopened, tmp_path):
    path = tmp_path / "run.h5"
    with HistoryWriter(path, ["time"]) as history:
        history.append(time=1.0)
    content = bytearray(path.read_bytes())
    content[40] ^= 1
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="its bytes are not those that were written"):
        load_history(path)


@pytest.mark.unit
def test_a_history_for_whose_digest_there_is_no_room_is_read_all_the_same(tmp_path):
    path = tmp_path / "run.h5"
    with HistoryWriter(path, ["time"]) as history:
        history.append(time=1.0)
    content = path.read_bytes()[:-SEAL]
    path.write_bytes(content)
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(content) + 10, before[1]))
    try:
        with pytest.raises(OSError, match=r"room|large"):
            seals.seal(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert path.read_bytes() == content
    assert load_history(path)["time"].tolist() == [1.0]


@pytest.mark.unit
def test_a_sealed_file_is_read_without_another_process(stored, fresh, tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5, "read_apart", None)
    path = tmp_path / "bed.h5"
    path.write_bytes(stored)
    assert len(load(path)) == len(fresh)


@pytest.mark.unit
def test_a_file_of_before_or_changed_by_others_is_tried_once(stored, fresh, tmp_path, monkeypatch):
    tried = []
    monkeypatch.setattr(hdf5, "read_apart", lambda _, path: tried.append(path))
    path = tmp_path / "bed.h5"
    path.write_bytes(stored[:-SEAL])
    assert len(load(path)) == len(load(path)) == len(fresh)
    assert tried == [path]
    path.write_bytes(stored)
    with h5py.File(path, "r+") as file:
        file["densities"][0] = 1000.0
    assert load(path).densities[0] == 1000.0
    assert tried == [path, path]


@pytest.mark.unit
def test_hdf5_waiting_for_ever_is_stopped(stored, tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "PATIENCE", 0.5)
    broken = bytearray(stored[:-SEAL])
    broken[LENGTH] ^= 64
    path = tmp_path / "bed.h5"
    path.write_bytes(broken)
    with pytest.raises(FileFormatError, match="damaged or incomplete"):
        load(path)
    # As one that is being written it is looked at again and again: it might yet become whole.
    broken[FLAGS] = 5
    path.write_bytes(broken)
    with pytest.raises(FileFormatError, match=r"bed\.h5: damaged: reading it does not end within 1 s"):
        load(path)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("function", "words"),
    [
        (end, "ends the process that does, with exit status 7"),
        (crash, "ends the process that does, with exit status -6"),
        (wait, "does not end within 1 s"),
        (burn, "takes more than 1 s of a processor|does not end within"),  # a busy machine gives it less than a second
        (eat, "takes more memory than may be taken"),
    ],
)
def test_another_process_that_gives_no_answer_is_told_in_one_line(function, words, tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "PATIENCE", 0.5 if function is wait else 3.0 if function is not burn else 1.0)
    path = tmp_path / "a.h5"
    path.touch()
    with pytest.raises(FileFormatError, match=words):
        apart.read_apart(function, path)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda file: file.attrs.modify("provenance", '["{"]'), "provenance must be a list of JSON texts"),
        (lambda file: file.attrs.modify("provenance", "[1, 2]"), "provenance must be a list of JSON texts"),
        (lambda file: file.attrs.modify("provenance", '["[]"]'), "provenance must be a list of JSON texts"),
        (lambda file: file.attrs.modify("provenance", '["{}"]'), "provenance must be a list of JSON texts"),
        (lambda file: file.attrs.modify("provenance", "[" * 100_000), "provenance must be a list of JSON texts"),
        (
            lambda file: swap(file, "grains/face_vertices", lambda a: a.astype(np.int64) + 2**62),
            "face_vertices must be",
        ),
        (lambda file: swap(file, "links/neighbors", lambda a: a + 0.5), "neighbors must be whole numbers from -214"),
        (lambda file: swap(file, "links/neighbors", lambda a: a + 10_000), "links must be to grains 0 to"),
        (lambda file: swap(file, "links/cell_volumes", lambda a: a * np.nan), "cell_volumes of links must be finite"),
        (lambda file: swap(file, "densities", lambda a: -a), "densities must be 0 to 1e\\+30; not so: 0, 1"),
        (lambda file: swap(file, "densities", lambda a: np.full(a.shape, b"x")), "densities must hold numbers"),
        (lambda file: swap(file, "positions", lambda a: a[0]), "positions must have shape"),
        (
            lambda file: declare(file, "positions", (10**11, 3)),
            "says that it is of shape .* nearly all of that is missing",
        ),
        (lambda file: link(file, "positions"), "dataset positions is missing"),
    ],
)
def test_odd_content_is_refused_in_one_line(stored, tmp_path, monkeypatch, change, words):
    monkeypatch.setattr(hdf5, "read_apart", lambda *_: {})
    path = tmp_path / "bed.h5"
    path.write_bytes(stored)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(FileFormatError, match=words) as caught:
        load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_what_memory_does_not_hold_is_refused_before_it_is_read(stored, tmp_path, monkeypatch):
    path = tmp_path / "bed.h5"
    path.write_bytes(stored)
    monkeypatch.setenv("GRAINSDEM_MEMORY", "1e-6")
    with pytest.raises(FileFormatError, match=r"bytes of its datasets would take .* GB, and 1e-06 GB may be taken"):
        load(path)


def swap(file, name, change):
    values = change(file[name][:])
    del file[name]
    file[name] = values


def declare(file, name, shape):
    del file[name]
    file.create_dataset(name, shape, dtype=float, chunks=(1000, 3))


def link(file, name):
    del file[name]
    file[name] = h5py.ExternalLink("/etc/other.h5", "/positions")
