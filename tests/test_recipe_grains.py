from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.packing import size_of

pytestmark = pytest.mark.unit

SEEDS = {"process": "poisson", "relax": 2}
WRAPPED = {"periodic": "xyz"}


def grown(**tables):
    return recipes.grow(recipes.make(**{"rng": 3, "seeds": {**SEEDS, "count": 300}, **tables}))


def steps(packing):
    return [json.loads(step) for step in packing.provenance]


def wadell(packing):
    """Mean sphericity from volumes and areas."""
    v, a = gd.volumes(packing.grains), gd.surface_areas(packing.grains)
    return float((np.cbrt(36 * np.pi * v**2) / a).mean())


@pytest.mark.parametrize("void", [{"porosity": 0.4}, {"solid_fraction": 0.6}, {"void_ratio": 2 / 3}])
@pytest.mark.parametrize("about", ["centroid", "seed", "vertex_mean"])
def test_every_measure_of_void_is_a_key_and_reached_exactly(void, about):
    assert gd.porosity(grown(grains={**void, "about": about})) == pytest.approx(0.4, rel=1e-12)


def test_the_porosity_may_be_that_of_the_domain_or_of_a_box_in_metres():
    domain = {"side": 0.02, **WRAPPED}
    box = ((0.004, 0.004, 0.004), (0.015, 0.014, 0.016))
    for region in ("domain", box):
        bed = grown(domain=domain, grains={"void_ratio": 0.8, "region": region})
        assert gd.porosity(bed, region=region) == pytest.approx(0.8 / 1.8, rel=1e-10)


def test_a_named_relation_gives_the_optimal_scale():
    bed = grown(domain=WRAPPED, grains={"relation": "cho_2006_max"})
    void = gd.porosity(bed) / (1 - gd.porosity(bed))
    assert void == pytest.approx(1.6 - 0.86 * wadell(bed), rel=1e-12)
    assert steps(bed)[-1]["scale"] == pytest.approx((1 + void) ** (-1 / 3), rel=1e-12)


@pytest.mark.parametrize("name", ["mean_diameter", "median_diameter"])
def test_of_diameter_count_and_side_any_two_give_the_third(name):
    grains = {"porosity": 0.4, name: 1e-3}
    by_count = grown(domain=WRAPPED, grains=grains)
    assert size_of(by_count, name) == pytest.approx(1e-3, rel=1e-12)
    assert len(by_count) == 300
    # The side that followed, asked for, with no count: about as many grains, whose size is as near as one more or less.
    side = float(by_count.domain.lengths[0])
    by_side = grown(seeds=SEEDS, domain={"side": side, **WRAPPED}, grains=grains)
    assert by_side.domain.lengths[0] == side
    assert len(by_side) == pytest.approx(300, abs=5)
    assert size_of(by_side, name) == pytest.approx(1e-3, rel=0.005)
    assert next(step["count"] for step in steps(by_side) if step["step"] == "count") == len(by_side)
    by_both = grown(domain={"side": side, **WRAPPED}, grains={"porosity": 0.4})
    assert size_of(by_both, name) == pytest.approx(1e-3, rel=1e-12)


def test_in_a_slab_the_count_follows_from_the_area():
    slab = {"shape": "slab", "lengths": (0.03, 0.02, 0.001), "periodic": "xy"}
    bed = grown(seeds=SEEDS, domain=slab, grains={"porosity": 0.2, "mean_diameter": 1e-3})
    assert size_of(bed, "mean_diameter") == pytest.approx(1e-3, rel=0.005)
    # n discs of 1 mm and 80 % of the area; those of unequal size need a little more of it.
    assert 0.95 < len(bed) * np.pi / 4 * 1e-6 / (0.8 * 6e-4) < 1.0


def test_the_gap_and_the_diameter_of_the_finished_bed_are_those_asked_for():
    grains = {"gap": 4e-5, "mean_diameter": 1e-3}
    bed = grown(domain=WRAPPED, grains=grains)
    assert size_of(bed, "mean_diameter") == pytest.approx(1e-3, rel=1e-9)
    np.testing.assert_allclose(gd.throat_widths(bed), 4e-5, rtol=1e-9)
    side = float(bed.domain.lengths[0])
    by_side = grown(seeds=SEEDS, domain={"side": side, **WRAPPED}, grains=grains)
    np.testing.assert_allclose(gd.throat_widths(by_side), 4e-5, rtol=1e-9)
    assert size_of(by_side, "mean_diameter") == pytest.approx(1e-3, rel=0.005)


def test_throats_are_moved_last_by_a_stream_of_their_own_and_told_in_metres(tmp_path):
    still = {"domain": WRAPPED, "grains": {"porosity": 0.4, "mean_diameter": 1e-3}}
    moved = {**still, "grains": {**still["grains"], "throats": {"fraction": 0.3, "strength": 0.8, "axes": "xy"}}}
    one, two = grown(**still), grown(**moved)
    np.testing.assert_array_equal(one.grains.vertices, two.grains.vertices)
    shifted = one.positions != two.positions
    assert shifted.any(axis=1).sum() == 90
    assert not shifted[:, 2].any()
    recipe = recipes.make(rng=3, seeds={**SEEDS, "count": 300}, **moved, output={"formats": [], "figures": False})
    told = recipes.run(recipe, tmp_path).summaries["bed"]["throats"]
    assert told["before"]["mean"] == pytest.approx(gd.throat_widths(one).mean())
    assert told["after"]["std"] == pytest.approx(gd.throat_widths(two).std())
    assert told["after"]["std"] > told["before"]["std"]
    assert json.loads((tmp_path / "summary.json").read_text())["bed"]["throats"] == told


def test_grains_have_the_quantiles_of_a_law_in_metres():
    law = stats.lognorm(0.25, scale=8e-4)
    wanted = law.ppf((np.arange(200) + 0.5) / 200)
    sizes = {"law": "lognorm", "parameters": {"s": 0.25, "scale": 8e-4}, "tolerance": 1e-3}
    bed = grown(seeds={**SEEDS, "count": 200}, domain=WRAPPED, grains={"porosity": 0.4, "sizes": sizes})
    np.testing.assert_allclose(np.sort(gd.diameters(bed.grains)), wanted, rtol=4e-4)
    assert gd.porosity(bed) == pytest.approx(0.4, rel=1e-12)


def test_the_count_follows_from_a_law_and_the_domain():
    sizes = {"law": "uniform", "parameters": {"loc": 1e-3, "scale": 1e-3}}
    for domain, share, mean in (
        ({"side": 0.011, **WRAPPED}, 0.6 * 0.011**3, np.pi / 6 * 3.75e-9),
        (
            {"shape": "slab", "lengths": (0.02, 0.02, 0.001), "periodic": "xy"},
            0.6 * 4e-4,
            np.pi / 4 * 7e-6 / 3,
        ),
    ):
        bed = grown(seeds={"process": "poisson"}, domain=domain, grains={"porosity": 0.4, "sizes": sizes})
        # Σ π/6 d³, or Σ π/4 d², is the solid's share; E[d³] = 3.75 mm³ and E[d²] = 7/3 mm².
        assert len(bed) == pytest.approx(share / mean, abs=1.5)
        assert size_of(bed, "mean_diameter") == pytest.approx(1.5e-3, rel=2e-3)


@pytest.mark.parametrize("suffix", [".txt", ".csv", ".npy", None])
def test_sizes_one_by_one_go_to_the_seeds_in_their_order(tmp_path, suffix):
    wanted = np.random.default_rng(1).uniform(1e-3, 2e-3, 60)
    rng = np.random.default_rng(2)
    np.savetxt(tmp_path / "seeds.txt", rng.random((60, 3)))
    sizes = {"diameters": wanted.tolist()}
    if suffix is not None:
        path = tmp_path / f"sizes{suffix}"
        np.save(path, wanted) if suffix == ".npy" else np.savetxt(path, wanted)
        sizes = {"path": path.name}
    (tmp_path / "r.toml").write_text(
        'domain = {periodic = "xyz"}\nseeds = {process = "file", path = "seeds.txt"}\n'
        f"[grains]\nscale = 0.8\n[grains.sizes]\n{''.join(f'{k} = {json.dumps(v)}' for k, v in sizes.items())}\n"
    )
    bed = recipes.grow(recipes.read(tmp_path / "r.toml"))
    np.testing.assert_allclose(gd.diameters(bed.grains), wanted, rtol=4e-3)


def test_a_list_gives_the_number_of_seeds_and_a_diameter_of_its_own_its_unit():
    sizes = {"diameters": [1.0] * 30 + [2.0] * 30}
    bed = grown(seeds=SEEDS, domain=WRAPPED, grains={"scale": 0.8, "sizes": sizes, "mean_diameter": 3e-3})
    np.testing.assert_allclose(gd.diameters(bed.grains), np.repeat([2e-3, 4e-3], 30), rtol=4e-3)


def test_the_count_of_a_list_is_the_only_one(tmp_path):
    sizes = {"diameters": [1e-3] * 30}
    with pytest.raises(InputError, match="one diameter for each of the 300 seeds; got 30"):
        grown(domain=WRAPPED, grains={"scale": 0.8, "sizes": sizes})
    for name, text, error, words in (
        ("none.csv", None, MissingFileError, "no such file"),
        ("sizes.xlsx", "1", FileFormatError, ".txt, .csv, .npy; got '.xlsx'"),
        ("words.csv", "1,two\n", FileFormatError, r"words\.csv: line 1: 'two' is no number"),
        ("empty.csv", "", FileFormatError, "one number or more"),
        ("cut.npy", "x", FileFormatError, "not a list of numbers"),
    ):
        path = tmp_path / name
        if text is not None:
            path.write_text(text)
        with pytest.raises(error, match=words):
            grown(seeds=SEEDS, grains={"scale": 0.8, "sizes": {"path": str(path)}})


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"grains": {"gap": 1e-5, "about": "seed"}}, "grains: a gap moves faces"),
        ({"grains": {"scale": 0.9, "region": "domain"}}, "grains: region says what a porosity is of"),
        ({"grains": {"gap": 1e-5, "region": "domain"}}, "grains: region says what a porosity is of"),
        ({"grains": {"relation": "cho"}}, "one of cho_2006_max, cho_2006_min, terzaghi_1996; got 'cho'"),
        ({"grains": {"scale": 0.9, "mean_diameter": 1, "median_diameter": 2}}, "mean_diameter or median_diameter"),
        ({"grains": {"void_ratio": -1}}, "grains.void_ratio: .*greater than or equal to 0; got -1"),
        ({"grains": {"solid_fraction": 0}}, "grains.solid_fraction: .*greater than 0; got 0"),
        ({"grains": {"scale": 1, "throats": {}}}, "no room to move"),
        ({"grains": {"porosity": 0, "throats": {}}}, "no room to move"),
        ({"grains": {"porosity": 0.4, "throats": {"axes": "xx"}}}, "grains.throats: axes must be .*got 'xx'"),
        ({"grains": {"porosity": 0.4, "throats": {"share": 1}}}, "share: unknown key; allowed are fraction, strength"),
        ({"grains": {"porosity": 0.4, "throats": {"fraction": 1.5}}}, "grains.throats.fraction: .*got 1.5"),
        ({"grains": {"gap": 1e-5, "sizes": {"law": "norm"}}}, "give sizes or gap"),
        ({"grains": {"scale": 1, "sizes": {}}}, "one of law, diameters and path; got none"),
        ({"grains": {"scale": 1, "sizes": {"law": "log-normal"}}}, "such as lognorm or uniform; got 'log-normal'"),
        ({"grains": {"scale": 1, "sizes": {"law": "lognorm"}}}, "lognorm takes s, loc, scale; got none"),
        (
            {"grains": {"scale": 1, "sizes": {"law": "lognorm", "parameters": {"s": -1}}}},
            "there is no lognorm with s = -1",
        ),
        (
            {"grains": {"scale": 1, "sizes": {"diameters": [1], "parameters": {"s": 1}}}},
            "got s beside diameters",
        ),
        ({"grains": {"scale": 1, "sizes": {"diameters": [1, -1]}}}, "diameters.1: .*greater than 0; got -1"),
        (
            {"domain": {"side": 1}, "grains": {"scale": 1, "mean_diameter": 1e-3}},
            "recipe: give two of the domain's side.* got all three",
        ),
        ({"domain": {"side": 1, "lengths": (1, 1, 1)}}, "domain: side is that of a cube.* beside lengths"),
        ({"domain": {"side": 1, "shape": "hopper"}}, "domain: side is that of a cube.* beside a hopper"),
        ({"seeds": SEEDS}, "recipe: process 'poisson' needs seeds.count, or a size"),
        ({"seeds": SEEDS, "grains": {"scale": 1, "mean_diameter": 1e-3}}, "give the domain's side or lengths"),
        (
            {"grains": {"porosity": 0.4, "mean_diameter": 1e-3, "region": ((0, 0, 0), (1, 1, 1))}},
            "corners are in metres, and this bed is scaled",
        ),
        ({"grains": {"porosity": 0.4, "region": "hull"}}, "grains.region: region must be .*two corners.*got 'hull'$"),
        ({"grains": {"porosity": 0.4, "region": [[0, 0, 0], [1, 1]]}}, "grains.region: region must be .*three numbers"),
        ({"seeds": {"process": "cluster", "spread": 1, "parents": 0}}, "seeds.parents: .* equal to 1, or .*; got 0$"),
    ],
)
def test_combinations_without_a_meaning_get_one_clear_error(tables, words):
    with pytest.raises(InputError, match=words):
        recipes.make(**{"seeds": {**SEEDS, "count": 50}, "grains": {"scale": 0.9}, **tables})


@pytest.mark.parametrize(
    ("side", "words"),
    [(10.0, r"takes 1.91e\+12 seeds in that domain, at most 10000000"), (1e-4, "too small for one grain")],
)
def test_a_mistaken_unit_is_told_before_anything_is_grown(side, words):
    with pytest.raises(InputError, match=words):
        grown(seeds=SEEDS, domain={"side": side}, grains={"porosity": 0.4, "mean_diameter": 1e-3})


def test_law_that_reaches_below_zero_is_refused():
    with pytest.raises(InputError, match="diameters must be positive"):
        grown(grains={"scale": 0.8, "sizes": {"law": "norm"}})


def test_the_recipes_of_the_documentation_can_be_read(tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "recipes.md").read_text(encoding="utf-8")
    blocks = re.findall(r"(?:^ {4}.*\n|^\n)+", page, re.MULTILINE)
    texts = [re.sub("^ {4}", "", block, flags=re.MULTILINE) for block in blocks if block.strip()]
    whole, *parts = texts
    assert recipes.parse(whole).is_count_open
    assert len(parts) >= 3
    for part in parts:
        # A survey's table stands in a recipe that is read as one of many.
        tables = tomllib.loads(f"{whole}\n{part}")
        tables.pop("survey", None)
        # These say how large grains are, and layers have seeds of their own.
        if {"sieves", "layer"} & set(tables["grains"]):
            del tables["grains"]["mean_diameter"], tables["seeds"]["relax"]
        # An infill has the porosity of the whole, and grains that are not moved.
        if "infill" in tables["grains"]:
            del tables["grains"]["relation"], tables["grains"]["throats"]
            tables["grains"]["porosity"] = 0.25
        assert recipes.make(**tables).seeds.process == "poisson"
    (swept,) = (part for part in parts if "seeds.process = [" in part)
    (tmp_path / "bed.toml").write_text(f"{whole}\n{swept}")
    processes = [recipe.seeds.process for _, _, recipe in gd.survey.read(tmp_path / "bed.toml").jobs()]
    assert processes == ["poisson"] * 5 + ["cluster"] * 10 + ["strauss"] * 5 + ["halton"] * 5


LAW = {"law": "uniform", "parameters": {"loc": 0.5e-3, "scale": 1.5e-3}}
SAID = re.compile(r"(\d+) of (\d+) cells of prescribed sizes .* by ([-+.\d]+), ([-+.\d]+) and ([-+.\d]+) %")


def told(caplog):
    """Return the numbers of every warning, each as dropped, cells, and the three percentages."""
    found = [SAID.search(record.getMessage()) for record in caplog.records if record.levelname == "WARNING"]
    assert all(found)
    return [[float(number) for number in match.groups()] for match in found]


def by_mass(diameters, marks, power):
    """Percentiles by mass: half of a grain lies below itself."""
    d = np.sort(diameters)
    share = np.cumsum(d**power)
    return np.interp(marks, 100 * (share - 0.5 * d**power) / share[-1], d)


@pytest.mark.parametrize(("domain", "power"), [({}, 3), ({"shape": "slab", "lengths": [1, 1, 0.1]}, 2)])
def test_sizes_that_are_dropped_at_walls_are_told_with_what_it_does_to_the_curve(caplog, domain, power):
    tables = {"rng": 2, "domain": domain, "seeds": {"process": "poisson", "count": 150}}
    asked = stats.uniform(**LAW["parameters"]).ppf((np.arange(150) + 0.5) / 150)
    listed = np.random.default_rng(1).permutation(asked).tolist()
    grains = {"scale": 0.9, "sizes": {"diameters": listed, "tolerance": 1e-3}}
    bed = recipes.grow(recipes.make(**tables, grains=grains))
    ((dropped, cells, *moved),) = told(caplog)
    assert (dropped, cells) == (150 - len(bed), 150)
    had = (
        gd.diameters(bed.grains) if power == 3 else np.sqrt(4 / np.pi * gd.volumes(bed.grains) / bed.domain.lengths[2])
    )
    marks = [10, 50, 90]
    expected = 100 * (by_mass(had, marks, power) / by_mass(asked, marks, power) - 1)
    np.testing.assert_allclose(moved, expected, atol=0.15)  # the tolerance of the volumes, and of the percentage shown
    caplog.clear()
    recipes.grow(recipes.make(**tables, grains={**grains, "keep": "all"}))
    recipes.grow(recipes.make(**{**tables, "domain": {**domain, "periodic": "xyz"[:power]}}, grains=grains))
    recipes.grow(recipes.make(**tables, grains={"scale": 0.9}))
    assert told(caplog) == []


def test_python_the_recipe_and_the_command_tell_of_dropped_sizes_once(caplog, tmp_path):
    cells = gd.sized_cells(gd.Domain.cube(), np.linspace(1, 3, 60), rng=1)
    assert len(told(caplog)) == 0
    bed = gd.carve(cells)
    assert [row[:2] for row in told(caplog)] == [[60 - len(bed), 60]]
    gd.carve(cells, keep="all")
    assert len(told(caplog)) == 1
    caplog.clear()
    np.savetxt(tmp_path / "sizes.csv", np.linspace(1e-3, 2e-3, 60))
    words = ["generate", tmp_path / "a.h5", "--process", "poisson", "--sizes", tmp_path / "sizes.csv", "--quiet"]
    words += ["--porosity", 0.4]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.output
    assert len(told(caplog)) == 1
    assert result.stderr.count("warning: ") == result.stderr.count("\n") == 1
    assert SAID.search(result.stderr)
    for cure in ("keep = 'all'", "a larger domain with more grains"):
        assert cure in result.stderr


def test_a_survey_tells_once_in_how_many_beds_sizes_were_dropped(caplog, tmp_path):
    sizes = {"diameters": np.linspace(1e-3, 2e-3, 60).tolist()}
    base = {"seeds": {"process": "poisson", "count": 60}, "grains": {"scale": 0.9, "sizes": sizes}}
    plan = gd.survey.Survey(base, {"grains.keep": ["inside", "all"]}, repeats=2)
    gd.survey.run(plan, tmp_path / "t.csv", workers=1)
    (record,) = caplog.records
    assert record.getMessage().startswith("in 2 of 4 beds cells of prescribed sizes touch a wall")
