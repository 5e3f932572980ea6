from __future__ import annotations

import dataclasses
import json
import os
import re
import signal
import subprocess
import sys
import time
from io import StringIO

import h5py
import numpy as np
import pytest
from loading import grow
from rich.console import Console
from typer.testing import CliRunner

import exporters
import grainsdem
from grainsdem.cli import app
from grainsdem.errors import InputError
from grainsdem.screen import print_settling

pytestmark = pytest.mark.unit

COMMANDS = ["demo", "run", "generate", "pack", "validate", "measure", "export", "settle", "heal", "render", "info"]
COMMANDS += ["compact", "tap", "voxels", "phases", "section", "planform", "images"]


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture(scope="module")
def bed(tmp_path_factory):
    """A bed that the command line grew."""
    path = tmp_path_factory.mktemp("bed") / "bed.h5"
    options = ["--process", "poisson", "--count", 250, "--relax", 2, "--lengths", 6, 6, 7, "--rng", 3]
    result = call("generate", path, *options, "--porosity", 0.4, "--median-diameter", 0.72e-3, "--quiet")
    assert result.exit_code == 0, result.output
    return path


@pytest.fixture(scope="module")
def heap(tmp_path_factory):
    """A bed of few grains, which soon come to rest."""
    path = tmp_path_factory.mktemp("heap") / "heap.h5"
    return grainsdem.save(grow(12), path)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(command):
    result = call(command, "--help")
    assert result.exit_code == 0
    assert len(result.output.splitlines()) > 8


def test_help_without_a_command_lists_them_all():
    listed = call("--help").output
    assert all(re.search(rf"\b{command}\b", listed) for command in COMMANDS)


def test_the_version_is_that_of_the_package():
    assert call("--version").output.strip() == f"grainsdem {grainsdem.__version__}"


def test_measure_prints_the_porosity_that_was_asked_for(bed):
    result = call("measure", bed, "--json")
    measured = json.loads(result.stdout)
    assert measured["porosity"] == pytest.approx(0.4, rel=1e-12)
    assert measured["d50"] == pytest.approx(0.72e-3, rel=1e-12)
    assert "0.4000 (cells)" in call("measure", bed).output


def test_measure_writes_one_row_a_grain(bed, tmp_path):
    assert call("measure", bed, "--table", tmp_path / "grains.csv", "--quiet").exit_code == 0
    rows = np.genfromtxt(tmp_path / "grains.csv", delimiter=",", names=True)
    assert len(rows) == len(grainsdem.load(bed))


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".graphml", ".vtp"])
def test_measure_writes_who_touches_whom_by_suffix(bed, tmp_path, suffix):
    words = ["--within", 2e-4, "--contacts", tmp_path / f"edges{suffix}", "--json"]
    plain = json.loads(call("measure", bed, *words).stdout)
    assert (tmp_path / f"edges{suffix}").stat().st_size > 1000
    with_walls = json.loads(call("measure", bed, *words, "--walls").stdout)
    assert with_walls == plain
    if suffix == ".csv":
        ids = np.genfromtxt(tmp_path / "edges.csv", delimiter=",", names=True, dtype=None, encoding=None)["i"]
        packing = grainsdem.load(bed)
        assert len(ids) == len(grainsdem.contacts(packing, within=2e-4, walls=True)) > 100


def test_measure_refuses_contacts_in_another_format_before_it_searches_any(bed, tmp_path):
    result = call("measure", bed, "--contacts", tmp_path / "edges.xlsx")
    assert result.exit_code == 2
    assert "contacts are written as .csv, .parquet, .graphml or .vtp; got '.xlsx'" in result.stderr
    assert result.stdout == ""


@pytest.mark.parametrize("by", ["scale", "inset"])
def test_heal_takes_overlapping_grains_apart_and_says_what_it_changed(bed, tmp_path, by):
    from dataclasses import replace

    packing = grainsdem.load(bed)
    steps = 5e-5 * np.random.default_rng(1).standard_normal((len(packing), 3))
    grainsdem.save(replace(packing, positions=packing.positions + steps, links=None), tmp_path / "pressed.h5")
    assert call("validate", tmp_path / "pressed.h5", "--quiet").exit_code == 1
    words = ["heal", tmp_path / "pressed.h5", tmp_path / "healed.h5", "--gap", 1e-7, "--by", by]
    changes = json.loads(call(*words, "--json").stdout)
    assert 0 < changes["grains_changed"] <= changes["grains"]
    assert changes["volume_change"] < 0 < changes["porosity_change"]
    assert call("validate", tmp_path / "healed.h5", "--quiet").exit_code == 0
    healed = grainsdem.load(tmp_path / "healed.h5")
    assert grainsdem.contacts(healed, within=1e-5).gaps.min() >= 1e-7 * (1 - 1e-9)
    assert "porosity change" in call(*words).output


def test_validate_exits_0_for_a_good_bed_and_names_its_checks(bed):
    result = call("validate", bed)
    assert result.exit_code == 0
    assert "overlaps" in result.output


def test_validate_exits_1_for_a_bed_with_an_overlap_and_names_the_pair(bed, tmp_path):
    packing = grainsdem.load(bed)
    positions = packing.positions.copy()
    positions[7] = positions[3] + 0.3 * np.abs(packing.grains.vertices_of(3)).max()
    from dataclasses import replace

    grainsdem.save(replace(packing, positions=positions), tmp_path / "bad.h5")
    result = call("validate", tmp_path / "bad.h5")
    assert result.exit_code == 1
    assert "3–7" in result.output
    assert json.loads(call("validate", tmp_path / "bad.h5", "--json").stdout)["ok"] is False


def test_export_writes_every_format_that_is_asked_for(bed, tmp_path):
    names = ["bed.xml", "bed.usdc", "bed.stl"]
    result = call("export", bed, *[tmp_path / name for name in names], "--json")
    assert result.exit_code == 0
    assert {str(tmp_path / name) for name in names} <= set(json.loads(result.stdout)["files"])
    assert all((tmp_path / name).stat().st_size > 1000 for name in names)


def test_export_fills_a_folder_and_replaces_its_files_only_by_force(bed, tmp_path):
    words = ["export", bed, tmp_path / "out", "--to", "mjcf", "--to", "usd", "--option", "friction=0.3", "--json"]
    first = json.loads(call(*words).stdout)["files"]
    assert [path.rsplit("/", 1)[1] for path in first] == ["bed.xml", "bed.usdc", "manifest.json"]
    again = call(*words)
    assert again.exit_code == 2
    assert "bed.xml: exists already; pass overwrite=True (--force) to replace it" in again.stderr
    assert call(*words, "--force").exit_code == 0


@pytest.fixture(scope="module")
def far(bed):
    """The bed a kilometre away: STL, read in single precision, cannot hold it; other formats can."""
    near = grainsdem.load(bed)
    domain = grainsdem.Domain(near.domain.lower + 1e3, near.domain.upper + 1e3)
    moved = dataclasses.replace(near, positions=near.positions + 1e3, domain=domain, links=None)
    return grainsdem.save(moved, bed.with_name("far.h5"))


@pytest.mark.parametrize("words", ["bed.xml bed.stl bed.obj", "out --to mjcf --to stl --to obj"])
def test_export_writes_the_formats_that_can_be_written_and_names_the_others(far, tmp_path, words):
    names = [tmp_path / word if "." in word or word == "out" else word for word in words.split()]
    result = call("export", far, *names, "--json")
    assert result.exit_code == 1
    assert result.stderr.count("\n") == 1
    assert re.search(r"refused: all but 1 of the files are written; .*stl: STL is read in single", result.stderr)
    files = json.loads(result.stdout)["files"]
    assert {"bed.xml", "bed.obj"} <= {path.rsplit("/", 1)[1] for path in files}
    assert sorted(files) == sorted(str(path) for path in tmp_path.rglob("bed*") if path.is_file()) + (
        [str(tmp_path / "out" / "manifest.json")] if "out" in words else []
    )


def test_export_finds_what_is_wrong_before_it_writes_the_first_file(far, bed, tmp_path):
    assert call("export", far, tmp_path / "bed.stl").exit_code == 2
    assert call("export", bed, tmp_path / "b.stl", tmp_path / "b.xml", "--option", "binary=false").exit_code == 2
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "b.xml").write_text("mine")
    result = call("export", bed, tmp_path / "b.stl", tmp_path / "b.xml")
    assert result.exit_code == 2
    assert "b.xml: exists already; pass --force" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["b.xml"]


@pytest.mark.parametrize("options", [[], ["--json"], ["--quiet"]])
def test_a_run_does_all_the_rest_where_a_format_refuses_its_bed(tmp_path, monkeypatch, options):
    def refuse(*_args, **_options):
        raise InputError("grains of this kind are none of mine")

    monkeypatch.setattr(exporters.module_for(".obj"), "files", refuse)
    (tmp_path / "r.toml").write_text(
        'rng = 3\nseeds = {process = "poisson", count = 150, relax = 1}\ngrains = {porosity = 0.4}\n'
        '[section]\n[output]\nformats = ["xml", "obj", "stl"]\nfigures = false\n'
    )
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "bed.obj").write_text("another bed")
    result = call("run", tmp_path / "r.toml", "--folder", tmp_path / "out", *options)
    assert result.exit_code == 1
    assert result.stderr.endswith(
        "refused: all but 1 of the files are written; bed.obj: grains of this kind are none of mine\n"
    )
    # Before it at most a word about kernels that are compiled for the first time.
    assert result.stderr.count("\n") <= 2
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names >= {"bed.h5", "bed.xml", "bed.stl", "section.csv", "summary.json"}
    assert "bed.obj" not in names
    assert bool(result.stdout) == (options != ["--quiet"])


def test_settle_writes_a_packing_and_a_history(heap, tmp_path):
    result = call("settle", heap, tmp_path / "settled.h5", "--history", tmp_path / "history.h5", "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    # Whether a bed of so few grains rests within the time is chance; what is said of it is not.
    assert not told["at_rest"] or told["kinetic_energy"] < 1e-6
    assert len(grainsdem.load(tmp_path / "settled.h5")) == len(grainsdem.load(heap))
    assert grainsdem.load_history(tmp_path / "history.h5")["kinetic_energy"][-1] == told["kinetic_energy"]


def test_settle_takes_two_materials_and_a_smooth_wall(heap, tmp_path):
    result = call(
        "settle", heap, tmp_path / "settled.h5", "--max-time", 0.5, "--friction", "0.3:0.5,0.6:0.5",
        "--wall-friction", "floor=0.6,wall_x0=0", "--mixing", "min", "--restitution", 0.5, "--quiet",
    )  # fmt: skip
    assert result.exit_code == 0, result.output
    settled = grainsdem.load(tmp_path / "settled.h5")
    assert set(settled.frictions) <= {0.3, 0.6}
    rest = json.loads(settled.provenance[-1])["resting"]
    assert (rest["friction"], rest["mixing"], rest["restitution"]) == (None, "min", 0.5)
    assert rest["wall_friction"] == {"floor": 0.6, "wall_x0": 0.0}


def test_the_table_of_a_settled_bed_tells_floor_and_walls_apart(bed):
    rest = {"at_rest": True, "time": 0.2, "kinetic_energy": 1e-7, "overlap_max": 3e-4, "drop_height": 0.0312}
    told = Console(file=StringIO(), width=120)
    summary = grainsdem.summary(grainsdem.load(bed))
    print_settling(told, "settled", {**summary, **rest, "floor_force": 1.2083, "wall_force": -0.2081})
    lines = told.file.getvalue().splitlines()
    assert any("borne by the floor" in line and "1.2083" in line for line in lines)
    assert any("borne by the walls" in line and "-0.2081" in line for line in lines)
    assert any("fall of a grain" in line and "0.0312" in line for line in lines)


def test_a_run_that_goes_wrong_leaves_its_last_good_state_and_says_where(bed, tmp_path):
    result = call("settle", bed, tmp_path / "settled.h5", "--time-step", 1.0, "--quiet")
    assert result.exit_code == 2
    assert "settled_last_good.h5" in result.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["settled_last_good.h5"]
    assert len(grainsdem.load(tmp_path / "settled_last_good.h5")) == len(grainsdem.load(bed))


def test_info_tells_what_made_the_file(bed):
    facts = json.loads(call("info", bed, "--json").stdout)
    assert [step["step"] for step in facts["provenance"]] == ["recipe", "carve", "shrink", "rescale"]
    assert "step: carve" in call("info", bed).output


def test_nothing_in_a_file_is_obeyed_when_it_is_printed(bed, tmp_path):
    step = {"step": "[/bold] :smile: \x1b[31m", "[red]": "[/red]"}
    told = dataclasses.replace(grainsdem.load(bed), provenance=(json.dumps(step),))
    grainsdem.save(told, tmp_path / "[red].h5")
    result = call("info", tmp_path / "[red].h5")
    assert result.exit_code == 0
    assert "step: [/bold] :smile: �[31m" in result.output
    assert "[red] = [/red]" in result.output
    assert "[red].h5" in result.output


def test_quiet_prints_nothing(bed, tmp_path):
    for words in (["measure", bed], ["validate", bed], ["info", bed], ["export", bed, tmp_path / "a.stl"]):
        assert call(*words, "--quiet").output == ""


def bad_input(tmp_path, bed):
    """Ten kinds of bad input: the words, and what the one line must say."""
    (tmp_path / "empty.csv").write_text("")
    (tmp_path / "nan.csv").write_text("0.1,0.2,0.3\n0.5,nan,0.5\n")
    (tmp_path / "key.toml").write_text("seeds = {count = 50}\ngrains = {porosty = 0.4}\n")
    (tmp_path / "cut.h5").write_bytes(bed.read_bytes()[:3000])
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = 1
    out = tmp_path / "out.h5"
    return {
        "missing file": (["validate", tmp_path / "none.h5"], "none.h5: no such file"),
        "wrong suffix": (["generate", tmp_path / "out.vtk", "--count", 50], "got '.vtk'"),
        "unknown format": (["export", bed, tmp_path / "bed.gltf"], ".gltf"),
        "negative porosity": (["generate", out, "--count", 50, "--porosity", -0.2], "porosity"),
        "porosity of one": (["generate", out, "--count", 50, "--porosity", 1.0], "porosity"),
        "empty seeds": (["generate", out, "--seeds", tmp_path / "empty.csv"], "at least one seed"),
        "NaN": (["generate", out, "--seeds", tmp_path / "nan.csv"], "1 of 2 are not: 1"),
        "unknown recipe key": (["run", tmp_path / "key.toml"], "grains.porosty: unknown key; allowed are"),
        "truncated h5": (["info", tmp_path / "cut.h5"], "cut.h5"),
        "foreign h5": (["measure", tmp_path / "foreign.h5"], "foreign.h5"),
        "folder in a file": (["demo", "--folder", bed / "sub"], "cannot be made a folder"),
        "folder not there": (["generate", tmp_path / "no" / "out.h5", "--count", 400], "cannot be written"),
        "too few seeds": (["generate", out, "--count", 3], "touch a wall"),
        "negative friction": (["settle", bed, out, "--friction", -1], "friction"),
        "no such wall": (["settle", bed, out, "--wall-friction", "roof=0.1"], "its walls are floor, wall_x0, wall_x1"),
        "friction of nothing": (["settle", bed, out, "--friction", "0.3:half"], "numbers and their shares as 0.3:0.5"),
        "a bounce too high": (
            ["settle", bed, out, "--restitution", 0.9],
            "restitution: input should be less than or equal to 0.7",
        ),
        "drop of what is poured": (["settle", bed, out, "--drop-height", 0.01], "drop_height needs start = 'rain'"),
    }


def test_bad_input_gets_one_line_exit_code_2_and_leaves_nothing_behind(tmp_path, bed):
    cases = bad_input(tmp_path, bed)
    before = sorted(tmp_path.rglob("*"))
    for name, (words, expected) in cases.items():
        result = call(*words)
        assert result.exit_code == 2, f"{name}: {result.output}"
        assert expected in result.stderr, f"{name}: {result.stderr}"
        assert len(result.stderr.strip().splitlines()) == 1, f"{name}: {result.stderr}"
        assert "Traceback" not in result.output, name
    assert sorted(tmp_path.rglob("*")) == before


def test_porosity_0_999_is_possible_and_reached(tmp_path):
    result = call("generate", tmp_path / "thin.h5", "--count", 200, "--porosity", 0.999, "--json")
    assert result.exit_code == 0
    assert json.loads(result.stdout)["porosity"] == pytest.approx(0.999, rel=1e-12)


@pytest.mark.skipif(os.name == "nt", reason="signals are sent another way there")
@pytest.mark.parametrize(
    ("word", "code", "told"),
    [
        (signal.SIGINT, 130, "interrupted"),
        pytest.param(signal.SIGTERM, 143, "terminated", marks=pytest.mark.slow),
    ],
)
def test_a_signal_while_settling_ends_with_one_line_and_keeps_the_history(tmp_path, bed, word, code, told):
    words = ["settle", bed, tmp_path / "settled.h5", "--history", tmp_path / "history.h5"]
    # A parent in the background may have switched the signal off for its children.
    listen = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    command = [
        sys.executable,
        "-c",
        f"{listen}; from grainsdem.__main__ import main; main()",
        *map(str, words),
        "--time-step",
        "1e-4",
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 60
    while not (tmp_path / "history.h5").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    time.sleep(1.0)
    process.send_signal(word)
    _, errors = process.communicate(timeout=60)
    assert process.returncode == code
    assert f"{told}; the history up to" in errors.strip().splitlines()[-1]
    assert "Traceback" not in errors
    assert "time" in grainsdem.load_history(tmp_path / "history.h5")
    assert [p.name for p in tmp_path.iterdir()] == ["history.h5"]
