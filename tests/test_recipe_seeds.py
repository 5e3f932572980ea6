from __future__ import annotations

import json
import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from PIL import Image
from scipy.spatial import cKDTree
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import points
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.cli.making import Process as NamedByTheCommandLine
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.recipe.seeds import Process, SeedsTable, place
from grainsdem.survey import read as read_survey

pytestmark = pytest.mark.unit

BOX = {"lengths": [1.0, 1.0, 1.0]}
SLAB = {"shape": "slab", "lengths": [1.0, 1.0, 0.1]}
GRAINS = {"porosity": 0.4, "keep": "all"}

SEEDS = {
    "halton": {"bases": [5, 7, 11]},
    "poisson": {},
    "cluster": {"parents": 8, "spread": 0.1, "walls": "reflect"},
    "strauss": {"distance": 0.05, "inhibition": 0.1},
    "strauss_process": {"distance": 0.05, "inhibition": 0.1, "sweeps": 20},
    "density": {"path": "density.npy"},
    "noise": {"beta": 2.0, "resolution": 16, "gain": 5.0},
    "image": {"path": "ramp.png", "low_pass": 0.1, "light": "fine"},
    "file": {"path": "own.txt", "bounds": [[0, 0, 0], [10, 10, 10]]},
}


@pytest.fixture
def folder(tmp_path):
    """Files of a density, an image, points and parents."""
    np.save(tmp_path / "density.npy", np.arange(20.0).reshape(4, 5))
    Image.fromarray(np.arange(200, dtype=np.uint8).reshape(10, 20)).save(tmp_path / "ramp.png")
    np.savetxt(tmp_path / "own.txt", 10 * np.random.default_rng(1).random((80, 3)))
    np.savetxt(tmp_path / "parents.csv", [[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]], delimiter=",", header="x,y,z", comments="")
    return tmp_path


def table(process, **changes):
    count = {} if process == "file" else {"count": 80}
    return {"process": process, **count, **SEEDS[process], **changes}


def sow(folder, seeds, *, domain=BOX, rng=0):
    """Return the seeds of a recipe that is read from a file in the folder."""
    tables = {"rng": rng, "domain": domain, "seeds": seeds, "grains": GRAINS}
    path = folder / "bed.toml"
    path.write_text("\n".join(f"{key} = {toml(value)}" for key, value in tables.items()))
    recipe = recipes.read(path)
    return place(recipe.seeds, recipe.domain.make(), np.random.default_rng(rng))


def toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + "}"
    return json.dumps(value)


def test_every_process_has_a_name_here_and_on_the_command_line():
    assert set(SEEDS) == set(get_args(Process)) == set(get_args(NamedByTheCommandLine))


def test_the_page_about_seeds_names_every_process_its_function_and_its_keys():
    page = (Path(__file__).parent.parent / "docs" / "seeds.md").read_text(encoding="utf-8")
    rows = {row.split("`")[1]: re.findall(r"`(\w+)`", row) for row in page.splitlines() if row.startswith("| `")}
    del rows["process"]
    assert set(rows) == set(SEEDS)
    for _, function, *words in rows.values():
        assert callable(getattr(points, function))
        assert set(words) - {"scaled", "rng"} <= set(SeedsTable.model_fields)


@pytest.mark.parametrize("process", SEEDS)
@pytest.mark.parametrize("domain", [BOX, SLAB], ids=["3-D", "2-D"])
def test_every_process_grows_a_bed_that_is_reached_exactly(folder, process, domain, monkeypatch):
    monkeypatch.chdir(folder)
    bed = recipes.grow(recipes.make(domain=domain, seeds=table(process), grains=GRAINS))
    assert len(bed) == 80
    assert bed.domain.is_planar == (domain is SLAB)
    assert gd.porosity(bed) == pytest.approx(0.4, rel=1e-9)
    again = recipes.grow(recipes.make(domain=domain, seeds=table(process), grains=GRAINS))
    assert again.grains.vertices.tobytes() == bed.grains.vertices.tobytes()


@pytest.mark.parametrize("process", SEEDS)
def test_files_are_found_beside_the_recipe(folder, process):
    seeds = sow(folder, table(process))
    assert seeds.shape == (80, 3)
    if process in ("halton", "file"):
        with pytest.raises(FileFormatError, match=r"rng = 1 changes nothing: .* the same at every rng"):
            sow(folder, table(process), rng=1)
    else:
        assert seeds.tobytes() != sow(folder, table(process), rng=1).tobytes()


def test_what_a_recipe_places_is_what_python_places(folder):
    domain = gd.Domain.cube()

    def rng():
        return np.random.default_rng(0)

    ours = {
        "halton": points.halton(domain, 80, bases=(5, 7, 11)),
        "poisson": points.poisson(domain, 80, rng=rng()),
        "cluster": points.cluster_poisson(domain, 80, parents=8, spread=0.1, walls="reflect", rng=rng()),
        "strauss": points.strauss(domain, 80, distance=0.05, inhibition=0.1, rng=rng()),
        "strauss_process": points.strauss_process(domain, 80, distance=0.05, inhibition=0.1, sweeps=20, rng=rng()),
        "density": points.from_density(domain, 80, np.arange(20.0).reshape(4, 5), rng=rng()),
        "noise": points.pink_noise(domain, 80, beta=2.0, resolution=16, gain=5.0, rng=rng()),
        "image": points.from_image(domain, 80, folder / "ramp.png", low_pass=0.1, light="fine", rng=rng()),
        "file": np.loadtxt(folder / "own.txt") / 10,
    }
    for process, seeds in ours.items():
        np.testing.assert_allclose(sow(folder, table(process)), seeds, rtol=1e-12, err_msg=process)


def test_haltons_sequence_is_its_own_without_an_rng_and_shifted_where_chance_is_asked_for(folder):
    cube = gd.Domain.cube()
    np.testing.assert_array_equal(sow(folder, {"count": 50}), points.halton(cube, 50))
    for k in (1, 2):
        np.testing.assert_array_equal(
            sow(folder, {"count": 50, "scramble": "shift"}, rng=k),
            points.halton(cube, 50, rng=np.random.default_rng(k)),
        )
    assert (points.halton(cube, 50, rng=1) != points.halton(cube, 50, rng=2)).all()


LAW = {"law": "uniform", "parameters": {"loc": 1e-3, "scale": 1e-3}}


@pytest.mark.parametrize(
    ("seeds", "tables", "cure"),
    [
        ({"count": 60}, {}, r"Halton's sequence is the same at every rng: scramble = 'shift' \(--seed-parameter"),
        ({"count": 60, "relax": 1}, {"voxels": {"per_diameter": 5}}, "scramble = 'shift'"),
        ({"process": "file", "path": "own.txt"}, {}, "points of a file are the same at every rng; give another"),
        ({"count": 60}, {"grains": {"scale": 0.9, "throats": {"fraction": 0.0}}}, "scramble = 'shift'"),
        ({"count": 60, "scramble": "shift"}, {}, None),
        ({"count": 60}, {"grains": {"scale": 0.9, "throats": {}}}, None),
        ({"count": 60}, {"grains": {"scale": 0.9, "sizes": LAW}}, None),
        ({"count": 60}, {"settle": {"start": "pour"}}, None),
    ],
)
def test_an_rng_that_would_change_nothing_is_refused(seeds, tables, cure):
    tables = {"domain": BOX, "seeds": seeds, "grains": GRAINS, **tables}
    assert recipes.make(**tables, rng=0).rng == 0
    if cure is None:
        assert recipes.make(**tables, rng=3).rng == 3
    else:
        with pytest.raises(InputError, match=f"rng = 3 changes nothing: .*{cure}"):
            recipes.make(**tables, rng=3)


def test_generate_makes_no_copies_under_another_rng(folder):
    base = ["generate", folder / "a.h5", "--count", 60, "--porosity", 0.4, "--quiet"]
    assert "rng = 1 changes nothing" in command(*base, "--rng", 1, code=2)
    assert not (folder / "a.h5").exists()
    beds = []
    for rng in (1, 2):
        command(*base, "--rng", rng, "--seed-parameter", "scramble=shift")
        beds.append(gd.load(folder / "a.h5").positions)
    assert beds[0].shape != beds[1].shape or (beds[0] != beds[1]).any()


OWN = {"count": 60, "cluster": {"parents": 9, "spread": 0.1}, "strauss": {"distance": 0.05, "inhibition": 0.1}}


def test_a_process_has_a_table_of_its_own():
    tables = {"domain": BOX, "grains": GRAINS}
    for process, flat in (
        ("poisson", {}),
        ("cluster", OWN["cluster"]),
        ("strauss", OWN["strauss"]),
    ):
        own = recipes.make(**tables, seeds={"process": process, **OWN})
        assert own == recipes.make(**tables, seeds={"process": process, "count": 60, **flat})
    counted = recipes.make(**tables, seeds={"process": "noise", "count": 60, "noise": {"count": 70, "relax": 2}})
    assert (counted.seeds.count, counted.seeds.relax) == (70, 2)


@pytest.mark.parametrize(
    ("seeds", "words"),
    [
        ({"count": 5, "cluster": {"spread": 0.1}}, r"which process\? There are tables of cluster"),
        (
            {"process": "poisson", "count": 5, "cluster": {"sprad": 0.1}},
            "process 'cluster' takes .*; got sprad",
        ),
        ({"process": "poisson", "count": 5, "cluster": 3}, "table of process 'cluster' takes .*; got 3"),
        ({"process": "cluster", "count": 5, "cluster": {"spread": -1}}, "seeds.spread: .*greater than 0; got -1"),
        ({"process": "poisson", "count": 5, "spread": 0.1}, r"a table of its own, such as \[seeds.cluster\]"),
    ],
)
def test_tables_of_processes_with_foreign_keys_are_refused(seeds, words):
    with pytest.raises(InputError, match=words):
        recipes.make(domain=BOX, seeds=seeds, grains=GRAINS)


def test_haltons_bases_are_two_in_a_slab_and_three_in_a_box(folder):
    flat = sow(folder, {"count": 30, "bases": [5, 7], "start": 4}, domain=SLAB)
    np.testing.assert_array_equal(flat[:, :2], points.halton(gd.Domain.cube(), 30, bases=(5, 7, 11), start=4)[:, :2])
    with pytest.raises(InputError, match=r"three whole numbers .* got \(5, 7\)"):
        sow(folder, {"count": 30, "bases": [5, 7]})
    with pytest.raises(InputError, match=r"seeds\.bases: .*at most 3 items"):
        recipes.make(seeds={"count": 30, "bases": [2, 3, 5, 7]}, grains=GRAINS)


def test_counts_may_be_left_to_chance(folder):
    for options in (
        {"process": "poisson", "count": 80, "exact": False},
        {"process": "cluster", "parents": 10, "children": 8.0, "spread": 0.1},
        {"process": "strauss_process", "intensity": 100.0, "distance": 0.05, "inhibition": 0.5},
    ):
        counts = {len(sow(folder, options, rng=k)) for k in range(6)}
        assert len(counts) > 2
        assert 30 < min(counts) <= max(counts) < 160


def test_children_gather_about_parents_of_a_file(folder):
    options = {"process": "cluster", "count": 100, "parents": "parents.csv", "spread": 0.03}
    seeds = sow(folder, options)
    assert (cKDTree([[0.1] * 3, [0.9] * 3]).query(seeds)[0] < 0.2).all()
    (folder / "survey.toml").write_text(
        f"domain = {toml(BOX)}\nseeds = {toml(options)}\ngrains = {toml(GRAINS)}\n[survey]\nrepeats = 2\n"
    )
    ((_, _, recipe), _) = read_survey(folder / "survey.toml").jobs()
    assert recipe.seeds.parents == str(folder / "parents.csv")


def test_points_of_a_file_are_taken_as_they_are_or_fitted(folder):
    with pytest.raises(InputError, match="lie outside"):
        sow(folder, {"process": "file", "path": "own.txt"})
    own = np.loadtxt(folder / "own.txt")
    np.testing.assert_allclose(
        sow(folder, {"process": "file", "path": "own.txt", "fit": True}), points.scaled(own, gd.Domain.cube())
    )


def test_a_recipe_in_the_provenance_makes_the_same_bed_again(folder, monkeypatch):
    monkeypatch.chdir(folder)
    for process in SEEDS:
        bed = recipes.grow(recipes.make(domain=BOX, seeds=table(process), grains=GRAINS))
        first = json.loads(bed.provenance[0])
        again = recipes.make(domain=first["domain"], seeds=first["seeds"], grains=GRAINS)
        assert recipes.grow(again).positions.tobytes() == bed.positions.tobytes()


def test_the_number_of_strauss_points_follows_from_the_size_of_grains():
    tables = {"domain": {"side": 1.0}, "grains": {**GRAINS, "mean_diameter": 0.2}}
    bed = recipes.grow(recipes.make(seeds={"process": "strauss", "distance": 0.1, "inhibition": 0.0}, **tables))
    assert gd.diameters(bed.grains).mean() == pytest.approx(0.2, rel=0.03)


@pytest.mark.parametrize(
    ("seeds", "words"),
    [
        ({"process": "strauss", "count": 5}, "process 'strauss' needs distance and inhibition"),
        ({"process": "strauss", "count": 5, "distance": 0.1}, "process 'strauss' needs distance and inhibition"),
        ({"process": "poisson", "count": 5, "spread": 0.1}, "process 'poisson' takes count, exact; got spread"),
        ({"count": 5, "path": "a.txt"}, "process 'halton' takes count, bases, start, scramble; got path"),
        ({"process": "image", "count": 5}, "process 'image' needs path"),
        ({"process": "file", "path": "a.txt", "count": 5}, "process 'file' needs path, and no count"),
        ({"process": "cluster", "count": 5, "spread": 0.1}, "two of count, parents and children; give parents or"),
        (
            {"process": "cluster", "count": 5, "spread": 0.1, "parents": 2, "children": 3.0},
            "two of count, parents and children; got all three",
        ),
        (
            {"process": "strauss_process", "count": 5, "distance": 0.1, "inhibition": 0.1, "intensity": 3.0},
            "either count or intensity; got both",
        ),
        ({"process": "strauss", "count": 5, "distance": -0.1, "inhibition": 0.1}, "seeds.distance: .*greater than 0"),
        ({"process": "strauss", "count": 5, "distance": 0.1, "inhibition": 2.0}, "seeds.inhibition: .*equal to 1"),
        ({"process": "noise", "count": 5, "resolution": 1}, "seeds.resolution: .*equal to 2; got 1"),
        ({"count": 5, "scramble": True}, "seeds.scramble: .*'none' or 'shift'; got True"),
        ({"process": "strauss", "distance": 0.1, "inhibition": 0.1}, "'strauss' needs seeds.count, or a size"),
    ],
)
def test_keys_of_another_process_and_values_out_of_range_are_refused(seeds, words):
    with pytest.raises(InputError, match=words):
        recipes.make(domain=BOX, seeds=seeds, grains=GRAINS)


def test_files_that_are_missing_or_no_density_are_told(folder):
    with pytest.raises(MissingFileError, match=r"none\.npy: no such file"):
        sow(folder, table("density", path="none.npy"))
    with pytest.raises(FileFormatError, match=r"images are read from .*; got '\.npy'"):
        sow(folder, table("image", path="density.npy"))


def command(*words, code=0):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == code, result.output
    return result.output if code == 0 else result.stderr


@pytest.mark.parametrize("process", SEEDS)
def test_generate_takes_every_process(folder, process):
    words = ["generate", folder / "bed.h5", "--process", process, "--keep", "all", "--porosity", 0.4, "--json"]
    for key, value in table(process).items():
        if key == "count":
            words += ["--count", value]
        elif key == "path":
            words += ["--seeds", folder / value]
        elif key != "process":
            words += ["--seed-parameter", f"{key}={value}"]
    assert json.loads(command(*words))["n_grains"] == 80
    recipe = recipes.make(domain=BOX, seeds=table(process, **with_path(folder, process)), grains=GRAINS)
    # The same bytes but for the path's spelling: a recipe and a command are one.
    assert gd.load(folder / "bed.h5").positions.tobytes() == recipes.grow(recipe).positions.tobytes()


def with_path(folder, process):
    return {"path": str(folder / SEEDS[process]["path"])} if "path" in SEEDS[process] else {}


def test_generate_says_what_a_process_takes(folder):
    base = ["generate", folder / "bed.h5", "--count", 50, "--process", "strauss"]
    assert "needs distance and inhibition" in command(*base, code=2)
    wrong = [*base, "--seed-parameter", "distnace=0.1"]
    assert "seeds.distnace: unknown key; allowed are" in command(*wrong, code=2)
    full = [*base, "--seed-parameter", "distance=0.5", "--seed-parameter", "inhibition=0"]
    assert "of 50 points fit at a distance of 0.5 m" in command(*full, code=2)
    assert not (folder / "bed.h5").exists()


def test_seeds_are_shown_as_a_table_and_as_json(folder):
    domain = gd.Domain.cube()
    seeds = points.poisson(domain, 200, rng=1)
    points.write(seeds, folder / "a.csv")
    said = json.loads(command("seeds", folder / "a.csv", "--periodic", "xyz", "--reach", 0.3, "--json"))
    assert said == points.describe(seeds, gd.Domain.cube(periodic=True), reach=0.3)
    shown = command("seeds", folder / "a.csv")
    assert "Clark and Evans" in shown
    assert f"{points.clark_evans(seeds, domain):.3f}" in shown
    assert not command("seeds", folder / "a.csv", "--quiet")


def test_seeds_of_a_recipe_are_relaxed_shown_and_written(folder):
    (folder / "bed.toml").write_text(
        f"domain = {toml(SLAB)}\nseeds = {toml(table('poisson', relax=3))}\ngrains = {toml(GRAINS)}\n"
    )
    command("seeds", folder / "bed.toml", "--write", folder / "seeds.npy")
    recipe = recipes.read(folder / "bed.toml")
    domain = recipe.domain.make()
    expected = gd.relax(place(recipe.seeds, domain, np.random.default_rng([0, 0])), domain, iterations=3)
    np.testing.assert_array_equal(points.read(folder / "seeds.npy"), expected)
    # What was written grows the same bed.
    bed = recipes.grow(recipe)
    own = {"process": "file", "path": str(folder / "seeds.npy")}
    again = recipes.grow(recipes.make(domain=SLAB, seeds=own, grains=GRAINS))
    assert again.positions.tobytes() == bed.positions.tobytes()


def test_points_of_two_columns_lie_in_a_slab_and_any_points_may_be_fitted(folder):
    np.savetxt(folder / "flat.txt", 100 * np.random.default_rng(1).random((50, 2)))
    said = json.loads(command("seeds", folder / "flat.txt", "--lengths", 2, 1, 0.1, "--fit", "--json"))
    assert said["intensity"] == pytest.approx(25.0)
    assert "lie outside" in command("seeds", folder / "flat.txt", code=2)


def test_the_seeds_command_refuses_what_does_not_fit(folder):
    (folder / "bed.toml").write_text("seeds = {}\ngrains = {scale = 1.0, mean_diameter = 0.2}\ndomain = {side = 1.0}\n")
    assert "give seeds.count" in command("seeds", folder / "bed.toml", code=2)
    assert "a recipe has its own domain" in command("seeds", folder / "bed.toml", "--fit", code=2)
    assert "any of x, y and z; got 'w'" in command("seeds", folder / "own.txt", "--periodic", "w", code=2)
    assert "no such file" in command("seeds", folder / "none.txt", code=2)
    assert "seeds are read from" in command("seeds", folder / "ramp.png", code=2)
    assert "written as" in command("seeds", folder / "own.txt", "--fit", "--write", folder / "a.h5", code=2)
