from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import cube_packing

import exporters
from exporters.rest import rest_of
from grainsdem import apart, foreign
from grainsdem.errors import FileFormatError, InputError, MissingFileError, MissingPackageError
from grainsdem.model import Domain

pytestmark = pytest.mark.unit


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ValueError("one\ntwo"), "no bed: one two"),
        (KeyError("x"), "no bed: x"),
        (RecursionError(), "no bed: nested too deep"),
        (MemoryError(), "no bed: it would take more memory than there is"),
        (ZeroDivisionError(), "no bed: ZeroDivisionError"),
        (InputError("side\nmust be"), "side must be"),
    ],
)
def test_whatever_a_reader_meets_is_one_line_with_the_file(tmp_path, error, words):
    with pytest.raises(FileFormatError) as caught, foreign.refusing(tmp_path, "no bed"):
        raise error
    assert str(caught.value) == f"{tmp_path}: {words}"


def test_what_is_no_fault_of_the_file_stays_what_it_is(tmp_path):
    for error in (MissingPackageError("no pxr"), KeyboardInterrupt(), MissingFileError(f"{tmp_path}: no such file")):
        with pytest.raises(type(error)) as caught, foreign.refusing(tmp_path, "no bed"):
            raise error
        assert str(caught.value) == str(error)


def test_arrays_are_read_as_numpy_writes_them(tmp_path):
    for values in (np.arange(6.0).reshape(2, 3), np.arange(3, dtype=">i2"), np.ones((0, 3)), np.float32(2.0)):
        np.save(tmp_path / "a.npy", values)
        np.savez_compressed(tmp_path / "a.npz", x=values, y=1.0)
        for found in (foreign.array_of(tmp_path / "a.npy"), foreign.array_of(tmp_path / "a.npz", "x")):
            np.testing.assert_array_equal(found, values)
    np.save(tmp_path / "a.npy", np.asfortranarray(np.arange(6.0).reshape(2, 3)))
    np.testing.assert_array_equal(foreign.array_of(tmp_path / "a.npy"), np.arange(6.0).reshape(2, 3))


def test_an_archive_that_unpacks_to_more_than_may_be_taken_is_refused_before_it_does(tmp_path, monkeypatch):
    np.savez_compressed(tmp_path / "a.npz", points=np.zeros((1_000_000, 3)))
    monkeypatch.setenv("GRAINSDEM_MEMORY", "0.05")
    with pytest.raises(InputError, match=r"bytes of an array would take 0\.096 GB, and 0\.05 GB may be taken"):
        foreign.array_of(tmp_path / "a.npz", "points")


def test_a_stage_is_read_from_its_own_folder_and_no_other(tmp_path):
    packing = cube_packing([[2, 2, 2]], domain=Domain.cube(4))
    (tmp_path / "inner").mkdir()
    exporters.write(packing, tmp_path / "bed.usdc")
    exporters.write(packing, tmp_path / "inner" / "bed.usdc")
    (tmp_path / "all.usda").write_text(
        "#usda 1.0\n(\n    metersPerUnit = 1\n    subLayers = [@./bed.usdc@, @inner/bed.usdc@]\n)\n"
    )
    assert len(exporters.read(tmp_path / "all.usda")) == 1
    (tmp_path / "inner" / "out.usda").write_text("#usda 1.0\n(\n    subLayers = [@../bed.usdc@]\n)\n")
    with pytest.raises(FileFormatError, match=r"names '\.\./bed\.usdc', which is outside its folder and is not read"):
        exporters.read(tmp_path / "inner" / "out.usda")


def test_a_program_that_python_is_built_into_reads_files_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(apart, "can_start", lambda: False)
    assert apart.read_apart(lambda path: {"n": np.array(len(path.name))}, tmp_path / "abc")["n"] == 3


@pytest.mark.parametrize("told", [5, {"down": [0, 0]}, {"down": None}, "x", {"time_step": -1.0}, {"mixing": "most"}])
def test_a_rest_that_is_none_is_refused_when_a_bed_is_written(told):
    sound = {"time_step": 1e-4, "friction": 0.5, "wall_friction": None, "down": [0, 0, -1], "are_spheres": False}
    bed = cube_packing([[2, 2, 2]], domain=Domain.cube(4))
    assert rest_of(bed.with_step("settle", resting=sound)).friction == 0.5
    bad = {**sound, **told} if isinstance(told, dict) else told
    with pytest.raises(InputError, match="the provenance notes no rest that can be"):
        rest_of(bed.with_step("settle", resting=json.loads(json.dumps(bad))))
