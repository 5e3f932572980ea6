"""What all formats share: the table of suffixes, refusals, and files that are whole or not there."""

import errno
import hashlib
import json
import re
import resource
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import exporters
from exporters.text import filled, rows_of_text
from grainsdem.errors import InputError, RefusedError, WriteError
from grainsdem.model import Domain, Packing, Polyhedra

pytestmark = pytest.mark.unit

SUFFIXES = [suffix for row in exporters.FORMATS.values() for suffix in row.suffixes]


def changed(packing, name, index, value):
    array = getattr(packing, name).copy()
    array[index] = value
    return replace(packing, **{name: array})


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_format_writes_the_same_bytes_twice_and_to_disk(poured, tmp_path, suffix):
    content = exporters.files(poured, suffix)
    assert exporters.files(poured, suffix) == content
    paths = exporters.write(poured, tmp_path / f"bed{suffix}")
    assert paths[0] == tmp_path / f"bed{suffix}"
    assert {path.relative_to(tmp_path).as_posix(): path.read_bytes() for path in paths} == content
    on_disk = [path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(on_disk) == sorted(content)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_an_empty_packing_is_refused(fresh, suffix):
    nothing = Polyhedra(np.empty((0, 3)), [0], [0], [], [0])
    empty = Packing(nothing, np.empty((0, 3)), np.empty((0, 4)), [], fresh.domain)
    with pytest.raises(InputError, match="at least one grain; got 0"):
        exporters.files(empty, suffix)


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("positions", np.nan, "must be finite; not so: 7"),
        ("quaternions", np.inf, "must be finite; not so: 7"),
        ("quaternions", 0.0, "of unit length; not so: 7"),
        ("densities", np.nan, "must be finite; not so: 7"),
        ("densities", 0.0, "densities of grains must be positive; not so: 7"),
    ],
)
def test_numbers_that_no_program_can_use_are_refused_with_the_grains_they_are_in(
    fresh, tmp_path, suffix, name, value, message
):
    with pytest.raises(InputError, match=re.escape(message)):
        exporters.write(changed(fresh, name, 7, value), tmp_path / f"bed{suffix}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_vertices_that_are_not_finite_and_grains_inside_out_are_refused(fresh, suffix):
    vertices = fresh.grains.vertices.copy()
    vertices[fresh.grains.vertex_offsets[3]] = np.nan
    with pytest.raises(InputError, match="must be finite; not so: 3"):
        exporters.files(replace(fresh, grains=replace(fresh.grains, vertices=vertices)), suffix)
    mirrored = replace(fresh.grains, vertices=-fresh.grains.vertices)
    with pytest.raises(InputError, match=r"wound outward; not so: 0, 1, 2, 3, 4 and \d+ more"):
        exporters.files(replace(fresh, grains=mirrored), suffix)


@pytest.mark.parametrize("suffix", [".docx", "", ".h5"])
def test_an_unknown_suffix_is_refused_with_the_known_ones(fresh, tmp_path, suffix):
    with pytest.raises(InputError, match=re.escape(f"{suffix!r}; known are .xml, .usdc, .usda, .usdz, .stl")):
        exporters.write(fresh, tmp_path / f"bed{suffix}")


def test_a_suffix_in_capitals_is_the_same_format_under_the_name_that_was_asked_for(cube, tmp_path):
    [path] = exporters.write(cube, tmp_path / "BED.XML")
    assert path.name == "BED.XML"
    assert path.read_text().startswith("<mujoco")


def test_an_unknown_option_is_refused_with_the_known_ones(fresh):
    with pytest.raises(
        InputError, match=r"\.stl has no option friction; it has binary, per_grain, merge, origin, units, min_edge"
    ):
        exporters.files(fresh, ".stl", friction=0.5)


@pytest.mark.parametrize(
    ("suffix", "name"), [(".stl", "binary"), (".glb", "merge"), (".vtu", "by_corners"), (".xml", "split")]
)
@pytest.mark.parametrize("value", ["no", 0, 1.0, None])
def test_what_is_on_or_off_takes_no_other_word(fresh, suffix, name, value):
    with pytest.raises(InputError, match=rf"{name} of \{suffix} must be true or false; got"):
        exporters.files(fresh, suffix, **{name: value})


def test_an_existing_file_is_kept_where_it_must_not_be_replaced(cube, tmp_path):
    table = tmp_path / "bed.triangles.csv"
    table.write_text("mine")
    with pytest.raises(WriteError, match=r"bed\.triangles\.csv: exists already"):
        exporters.write(cube, tmp_path / "bed.stl", overwrite=False)
    assert [path.name for path in tmp_path.iterdir()] == ["bed.triangles.csv"]
    exporters.write(cube, tmp_path / "bed.stl")
    assert table.read_text() != "mine"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_is_not_there_is_one_clear_error(cube, tmp_path, suffix):
    with pytest.raises(WriteError, match="cannot be written: No such file or directory"):
        exporters.write(cube, tmp_path / "nowhere" / f"bed{suffix}")


@pytest.mark.parametrize("name", ["", "a/b", "a\\b", "a\nb"])
def test_a_name_that_cannot_be_a_file_is_refused(cube, name):
    for suffix in SUFFIXES:
        with pytest.raises(InputError, match="name must be the name of a file"):
            exporters.files(cube, suffix, name=name)


def test_importing_exporters_loads_no_client():
    script = "import sys, exporters, exporters.mjcf, exporters.usd, exporters.meshes.stl\nprint(*sys.modules)"
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, check=True, text=True)
    assert not {"mujoco", "pxr", "trimesh", "matplotlib"} & set(run.stdout.split())


def test_rows_of_text_hold_the_numbers_in_order_across_blocks():
    counts = np.arange(9000) % 4
    values = np.linspace(-1.0, 1.0, counts.sum())
    rows = rows_of_text(values, counts, digits=17)
    assert [len(row.split()) for row in rows] == counts.tolist()
    assert [float(word) for row in rows for word in row.split()] == values.tolist()


def test_a_pattern_is_repeated_and_minus_zero_is_zero():
    assert filled("<%g %g>", np.array([[1.0, -0.0], [2.5, 3.0]]), [2]) == ["<1 0><2.5 3>"]
    assert filled("%d", np.array([], dtype=np.int64), [0, 0], separator=",") == ["", ""]


def test_one_folder_holds_every_format_and_a_manifest_of_the_same_bytes_twice(fresh, tmp_path):
    seeded = fresh.with_step("recipe", rng=11)
    paths = exporters.write(seeded, tmp_path / "out", formats=["mjcf", "usd", ".usda", "stl"], friction=0.3)
    assert [path.name for path in paths] == [
        "bed.xml", "bed.usdc", "bed.usda", "bed.stl", "bed.triangles.csv", "manifest.json",
    ]  # fmt: skip
    manifest = json.loads(paths[-1].read_text())
    listed = [file for row in manifest["formats"] for file in row["files"]]
    assert {file["name"]: file["sha256"] for file in listed} == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in paths[:-1]
    }
    assert [row["options"].get("friction") for row in manifest["formats"]] == [0.3, 0.3, 0.3, None]
    assert all(row["loses"] for row in manifest["formats"])
    facts = manifest["packing"]
    assert (facts["n_grains"], facts["seeds"]) == (len(fresh), [11])
    assert facts["porosity_of_domain"] == pytest.approx(1 - facts["volume"] / fresh.domain.volume)
    mjcf, stl = manifest["formats"][0]["units"], manifest["formats"][3]["units"]
    assert mjcf["length"] == facts["median_diameter"]
    assert stl == {"length": 1.0, "mass": 1.0, "time": 1.0}
    again = exporters.write(seeded, tmp_path / "again", formats=["mjcf", "usd", ".usda", "stl"], friction=0.3)
    assert [path.read_bytes() for path in paths] == [path.read_bytes() for path in again]


def test_formats_that_cannot_be_written_together_are_refused(cube, tmp_path):
    with pytest.raises(InputError, match=r"usd\.usdc writes bed\.usdc, which a format before it writes too"):
        exporters.write(cube, tmp_path / "out", formats=["usd", ".usdc"])
    with pytest.raises(InputError, match="at least one format; got none"):
        exporters.write(cube, tmp_path / "out", formats=[])
    with pytest.raises(InputError, match=r"has no option hue; it has"):
        exporters.write(cube, tmp_path / "out", formats=["mjcf", "stl"], hue=1)
    assert not list(tmp_path.iterdir())


def far(packing):
    """The packing far away: STL, read in single precision, cannot hold it; other formats can."""
    moved = Domain(packing.domain.lower + 1e5, packing.domain.upper + 1e5)
    return replace(packing, positions=packing.positions + 1e5, domain=moved)


def test_of_many_formats_those_are_written_that_can_be(cube, tmp_path):
    with pytest.raises(RefusedError, match=r"all but 1 of the files are written; stl: STL is read in single") as caught:
        exporters.write(far(cube), tmp_path / "a", formats=["stl", "mjcf", "obj"])
    assert {path.name for path in caught.value.made} == {path.name for path in (tmp_path / "a").iterdir()}
    assert {path.name for path in caught.value.made} >= {"bed.xml", "bed.obj", "manifest.json"}
    told = json.loads((tmp_path / "a" / "manifest.json").read_text())
    assert [row["format"] for row in told["formats"]] == ["mjcf", "obj"]
    assert told["refused"] == caught.value.refused
    with pytest.raises(RefusedError, match=r"all but 1 of .*; stl: "):
        exporters.write(far(cube), tmp_path / "c", formats=["obj", "stl"])
    assert "refused" not in json.loads(exporters.write(cube, tmp_path / "b", formats=["stl"])[-1].read_text())


def test_formats_none_of_which_can_be_written_leave_nothing(cube, tmp_path):
    for formats in (["stl"], ["stl", "stl"]):
        with pytest.raises(InputError, match="single precision") as caught:
            exporters.write(far(cube), tmp_path / "a", formats=formats)
        assert not isinstance(caught.value, RefusedError)
    with pytest.raises(InputError, match="has no option frction"):
        exporters.write(far(cube), tmp_path / "a", formats=["stl", "mjcf"], frction=0.3)
    assert not (tmp_path / "a").exists()


def test_a_disk_that_fills_up_is_one_error_and_leaves_nothing(cube, tmp_path, monkeypatch):
    from exporters.meshes import stl

    def endless(*_args, **_options):
        def blocks():
            yield b"half of it"
            raise OSError(errno.ENOSPC, "No space left on device")

        return {"bed.stl": blocks()}

    monkeypatch.setattr(stl, "files", endless)
    (tmp_path / "bed.xml").write_text("mine")
    with pytest.raises(WriteError, match=r"bed\.stl: cannot be written: No space left on device"):
        exporters.write(cube, tmp_path, formats=["mjcf", "stl"])
    assert [path.name for path in tmp_path.iterdir()] == ["bed.xml"]
    assert (tmp_path / "bed.xml").read_text() == "mine"
    with pytest.raises(WriteError, match="No space left"):
        exporters.write(cube, tmp_path / "new" / "folder", formats=["stl"])
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_file_that_outgrows_what_there_is_leaves_nothing_half_written(fresh, tmp_path, suffix):
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, most))
    try:
        with pytest.raises(WriteError, match="cannot be written: File too large"):
            exporters.write(fresh, tmp_path / f"bed{suffix}")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert not list(tmp_path.iterdir())


@pytest.fixture
def third_party(tmp_path, monkeypatch):
    """A distribution of somebody else's, installed as pip leaves it: a module and its metadata."""
    site = tmp_path / "site"
    info = site / "xyzgrains-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: xyzgrains\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[grainsdem.exporters]\nxyz = xyzgrains\nbad = json\n")
    (site / "xyzgrains.py").write_text(
        "from dataclasses import dataclass\n"
        'SUFFIXES = (".xyz",)\n'
        'LOSES = ("All but positions.",)\n'
        "@dataclass(frozen=True, kw_only=True)\n"
        "class Options:\n"
        "    digits: int = 3\n"
        "def files(packing, *, name, suffix, options):\n"
        '    rows = (f"{x:.{options.digits}f}\\n".encode() for x in packing.positions[:, 0])\n'
        '    return {f"{name}{suffix}": rows}\n'
    )
    monkeypatch.syspath_prepend(str(site))
    return site


@pytest.mark.usefixtures("third_party")
def test_another_distribution_adds_a_format_by_an_entry_point(cube, tmp_path):
    assert "xyz" in exporters.known()
    [path] = exporters.write(cube, tmp_path / "bed.xyz", format="xyz", digits=1)
    assert path.read_text() == "2.0\n"
    paths = exporters.write(cube, tmp_path / "out", formats=["xyz", "mjcf"])
    assert [path.name for path in paths] == ["bed.xyz", "bed.xml", "manifest.json"]
    with pytest.raises(InputError, match=r"json, a format by entry point 'bad', lacks SUFFIXES, LOSES, Options, files"):
        exporters.find("bad")
