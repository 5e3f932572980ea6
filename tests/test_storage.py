from __future__ import annotations

import hashlib
import json
import os
import signal
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError, WriteError
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.storage import HistoryWriter, load, load_history, save

ARRAYS = ("vertices", "vertex_offsets", "face_offsets", "face_vertices", "face_vertex_offsets")


def assert_same(a, b):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(a.grains, name), getattr(b.grains, name))
    for name in ("positions", "quaternions", "densities"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    for name in ("lower", "upper", "periodic", "is_planar"):
        np.testing.assert_array_equal(getattr(a.domain, name), getattr(b.domain, name))
    assert (a.links is None) == (b.links is None)
    if a.links is not None:
        for name in ("neighbors", "shifts", "cell_volumes"):
            np.testing.assert_array_equal(getattr(a.links, name), getattr(b.links, name))
    assert a.provenance == b.provenance


@pytest.fixture(scope="module")
def stored(fresh, tmp_path_factory):
    """The bytes of a stored packing."""
    return save(fresh, tmp_path_factory.mktemp("stored") / "bed.h5").read_bytes()


@pytest.mark.unit
def test_a_packing_comes_back_bit_for_bit(fresh, poured, tmp_path):
    for name, packing in (("a.h5", fresh), ("b.hdf5", poured)):
        assert save(packing, tmp_path / name) == tmp_path / name
        assert_same(load(tmp_path / name), packing)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "b.hdf5"]


@pytest.mark.unit
def test_planar_periodic_empty_and_long_lived_packings_come_back_too(tmp_path):
    slab = cube_packing([[1, 1, 1]], domain=Domain.slab((4.0, 5.0), 2.0, periodic=(True, False)))
    empty = Packing(
        Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], Domain.cube(2.0)
    )
    # HDF5's older formats hold at most 64 kB in an attribute.
    old = replace(slab, provenance=tuple(json.dumps({"step": "µ" * 100, "n": i}) for i in range(1000)))
    for packing in (slab, empty, old):
        assert_same(load(save(packing, tmp_path / "bed.h5")), packing)


@pytest.mark.unit
def test_an_older_file_is_replaced_whole(fresh, poured, tmp_path):
    save(fresh, tmp_path / "bed.h5")
    save(poured, tmp_path / "bed.h5")
    assert_same(load(tmp_path / "bed.h5"), poured)


@pytest.mark.golden
def test_the_same_packing_gives_the_same_bytes_in_another_process(stored, fresh, tmp_path):
    save(load(save(fresh, tmp_path / "one.h5")), tmp_path / "two.h5")
    code = "import sys; from grainsdem.storage import load, save; save(load(sys.argv[1]), sys.argv[2])"
    subprocess.run([sys.executable, "-c", code, tmp_path / "one.h5", tmp_path / "three.h5"], check=True)
    digests = {hashlib.sha256((tmp_path / f"{n}.h5").read_bytes()).hexdigest() for n in ("one", "two", "three")}
    assert digests == {hashlib.sha256(stored).hexdigest()}


@pytest.mark.client
def test_h5py_alone_can_read_the_file_and_what_it_says_of_itself(fresh, tmp_path):
    with h5py.File(save(fresh, tmp_path / "bed.h5")) as file:
        assert file.attrs["schema"] == "grainsdem.packing"
        assert file.attrs["schema_version"] == "1.0"
        assert [json.loads(step)["step"] for step in json.loads(file.attrs["provenance"])] == ["carve", "shrink"]
        np.testing.assert_array_equal(file["grains/vertices"][5:9], fresh.grains.vertices[5:9])


@pytest.mark.unit
@pytest.mark.parametrize("name", ["bed.npz", "bed", "bed.h5.bak"])
def test_another_suffix_is_refused_by_both_ways(fresh, tmp_path, name):
    for attempt in (lambda: save(fresh, tmp_path / name), lambda: load(tmp_path / name)):
        with pytest.raises(FileFormatError, match=r"HDF5 files end in \.h5 or \.hdf5; got"):
            attempt()


@pytest.mark.unit
def test_a_missing_file_or_folder_is_named(fresh, tmp_path):
    with pytest.raises(MissingFileError, match=r"gone\.h5: no such file"):
        load(tmp_path / "gone.h5")
    with pytest.raises(MissingFileError, match="no such file"):
        load_history(tmp_path / "gone.h5")
    with pytest.raises(WriteError, match="cannot be written"):
        save(fresh, tmp_path / "nowhere" / "bed.h5")
    with pytest.raises(WriteError, match="cannot be written"):
        HistoryWriter(tmp_path / "nowhere" / "run.h5", ["time"])


@pytest.mark.unit
@pytest.mark.parametrize("part", [0.0, 0.001, 0.3, 0.9, 0.9999])
def test_a_truncated_file_is_refused_in_one_line(stored, tmp_path, part):
    path = tmp_path / "bed.h5"
    path.write_bytes(stored[: int(part * len(stored))])
    with pytest.raises(FileFormatError, match=r"bed\.h5: (not an HDF5 file|damaged or incomplete)") as caught:
        load(path)
    assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_a_flipped_bit_in_the_geometry_is_found(stored, tmp_path):
    broken = bytearray(stored)
    broken[len(stored) // 2] ^= 1
    path = tmp_path / "bed.h5"
    path.write_bytes(broken)
    with pytest.raises(FileFormatError, match="damaged or incomplete"):
        load(path)


@pytest.mark.unit
def test_a_file_of_another_kind_is_refused_with_what_it_holds(tmp_path):
    path = tmp_path / "other.h5"
    path.write_text("name,x\n")
    with pytest.raises(FileFormatError, match="not an HDF5 file"):
        load(path)
    with h5py.File(path, "w") as file:
        file["temperature"] = [1.0]
    with pytest.raises(FileFormatError, match=r"another kind: no schema, but temperature; schema 'grainsdem\.packing'"):
        load(path)
    with HistoryWriter(path, ["time"]):
        pass
    with pytest.raises(FileFormatError, match=r"schema 'grainsdem\.history'; schema 'grainsdem\.packing' is needed"):
        load(path)


def edit(stored, path, change):
    path.write_bytes(stored)
    with h5py.File(path, "r+") as file:
        change(file)
    return path


@pytest.mark.unit
def test_an_unknown_major_version_is_refused_and_a_newer_minor_one_read(stored, fresh, tmp_path):
    path = edit(stored, tmp_path / "bed.h5", lambda file: file.attrs.modify("schema_version", "2.0"))
    with pytest.raises(FileFormatError, match=r"version '2\.0' of grainsdem\.packing; grainsdem \S+ reads 1\.x"):
        load(path)
    path = edit(stored, tmp_path / "bed.h5", lambda file: file.attrs.modify("schema_version", "1.7"))
    assert_same(load(path), fresh)


@pytest.mark.unit
@pytest.mark.parametrize("name", ["positions", "grains/face_vertices", "links/shifts", "domain/upper"])
def test_a_missing_dataset_is_named(stored, tmp_path, name):
    path = edit(stored, tmp_path / "bed.h5", lambda file: file.__delitem__(name))
    with pytest.raises(FileFormatError, match=f"damaged or incomplete: dataset {name} is missing"):
        load(path)


@pytest.mark.unit
def test_arrays_that_do_not_fit_together_are_refused(stored, tmp_path):
    def shorten(file):
        positions = file["positions"][:-1]
        del file["positions"]
        file["positions"] = positions

    with pytest.raises(FileFormatError, match="damaged or incomplete: positions must have shape"):
        load(edit(stored, tmp_path / "bed.h5", shorten))


@pytest.mark.unit
def test_a_history_comes_back_with_its_rows_and_frames(tmp_path):
    path = tmp_path / "run.h5"
    with HistoryWriter(path, {"time": "s", "kinetic_energy": "J"}, n_grains=2, attributes={"seed": 7}) as history:
        for i in range(40):
            history.append(time=0.1 * i, kinetic_energy=i**2)
            if i % 20 == 0:
                history.append_frame(0.1 * i, positions=np.full((2, 3), i), quaternions=np.full((2, 4), -i))
    found = load_history(path)
    np.testing.assert_array_equal(found["time"], 0.1 * np.arange(40))
    np.testing.assert_array_equal(found["kinetic_energy"], np.arange(40.0) ** 2)
    np.testing.assert_array_equal(found["frame_times"], [0, 2])
    np.testing.assert_array_equal(found["positions"][1], np.full((2, 3), 20))
    np.testing.assert_array_equal(found["quaternions"][1], np.full((2, 4), -20))
    with h5py.File(path) as file:
        assert json.loads(file.attrs["units"]) == {"time": "s", "kinetic_energy": "J"}
        assert json.loads(file.attrs["attributes"]) == {"seed": 7}


@pytest.mark.unit
def test_a_history_without_rows_is_empty_and_nan_is_a_value_like_any_other(tmp_path):
    with HistoryWriter(tmp_path / "run.h5", ["time", "force"]):
        pass
    assert {k: v.shape for k, v in load_history(tmp_path / "run.h5").items()} == {"time": (0,), "force": (0,)}
    with HistoryWriter(tmp_path / "run.h5", ["time", "force"]) as history:
        history.append(time=1.0, force=np.nan)
    assert np.isnan(load_history(tmp_path / "run.h5")["force"][0])


@pytest.mark.unit
def test_a_history_can_be_read_while_it_is_written(tmp_path):
    with HistoryWriter(tmp_path / "run.h5", ["time"], rows_per_chunk=4) as history:
        for i in range(10):
            history.append(time=i)
        assert load_history(tmp_path / "run.h5")["time"].tolist() == list(range(8))
        history.flush()
        assert len(load_history(tmp_path / "run.h5")["time"]) == 10


@pytest.mark.unit
def test_an_error_in_the_run_keeps_every_row(tmp_path):
    def run():
        with HistoryWriter(tmp_path / "run.h5", ["time"]) as history:
            history.append(time=1)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run()
    assert load_history(tmp_path / "run.h5")["time"].tolist() == [1]


@pytest.mark.unit
def test_a_run_that_was_killed_keeps_all_but_the_last_rows(tmp_path):
    code = """
import os, signal, sys
import numpy as np
from grainsdem.storage import HistoryWriter
history = HistoryWriter(sys.argv[1], ["time", "energy"], n_grains=3, rows_per_chunk=8)
for i in range(1, 101):
    history.append(time=i, energy=2 * i)
    if i % 30 == 0:
        history.append_frame(i, positions=np.full((3, 3), i), quaternions=np.ones((3, 4)))
os.kill(os.getpid(), signal.SIGKILL)
"""
    path = tmp_path / "run.h5"
    ended = subprocess.run([sys.executable, "-c", code, path], check=False, env={**os.environ})
    assert ended.returncode == -signal.SIGKILL
    found = load_history(path)
    # the frame at 90 wrote what waited; a chunk of 8 more followed
    np.testing.assert_array_equal(found["time"], np.arange(1, 99))
    np.testing.assert_array_equal(found["energy"], 2 * found["time"])
    np.testing.assert_array_equal(found["frame_times"], [30, 60, 90])
    np.testing.assert_array_equal(found["positions"][:, 0, 0], [30, 60, 90])


@pytest.mark.unit
@pytest.mark.parametrize("columns", [[], ["time", "time"], ["time", "positions"]])
def test_columns_need_names_of_their_own(tmp_path, columns):
    with pytest.raises(InputError, match="columns of different names"):
        HistoryWriter(tmp_path / "run.h5", columns)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.unit
def test_rows_and_frames_that_do_not_fit_are_refused(tmp_path):
    with HistoryWriter(tmp_path / "run.h5", ["time", "energy"], n_grains=2) as history:
        with pytest.raises(InputError, match="a row needs time, energy; missing or unknown: energy, power"):
            history.append(time=1, power=2)
        with pytest.raises(ShapeError, match=r"positions must have shape \(2, 3\); got \(1, 3\)"):
            history.append_frame(0, positions=np.ones((1, 3)), quaternions=np.ones((2, 4)))
    with (
        HistoryWriter(tmp_path / "run.h5", ["time"]) as history,
        pytest.raises(InputError, match="no frames"),
    ):
        history.append_frame(0, positions=np.ones((1, 3)), quaternions=np.ones((1, 4)))
    assert len(load_history(tmp_path / "run.h5")["time"]) == 0


@pytest.mark.unit
def test_a_domain_cut_by_planes_comes_back_with_them(fresh, tmp_path):
    cylinder = replace(fresh, domain=Domain.cylinder(5e-3, 7e-3, sides=16))
    back = load(save(cylinder, tmp_path / "bed.h5"))
    np.testing.assert_array_equal(back.domain.planes, cylinder.domain.planes)
    assert back.domain.volume == cylinder.domain.volume
