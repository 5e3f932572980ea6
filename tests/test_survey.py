from __future__ import annotations

import math
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import survey
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.survey import running

pytestmark = pytest.mark.unit

BASE = {"seeds": {"process": "poisson", "count": 80}, "grains": {"porosity": 0.4}}


def plan(**changes):
    return survey.Survey(BASE, **{"vary": {"seeds.count": [80, 120], "seeds.relax": [0, 2]}, "repeats": 2, **changes})


def test_a_row_is_what_the_recipe_grows(tmp_path):
    table = survey.run(plan(), tmp_path / "t.csv", workers=1)
    assert table["seeds_count"].tolist() == [80] * 4 + [120] * 4
    assert table["seeds_relax"].tolist() == [0, 0, 2, 2] * 2
    assert table["n_seeds"].tolist() == table["seeds_count"].tolist()
    for row, (_, _, recipe) in zip(table, plan().jobs(), strict=True):
        bed = gd.recipe.grow(recipe)
        assert row["rng"] == recipe.rng
        assert row["n_grains"] == len(bed)
        assert row["mean_sphericity"] == gd.sphericities(bed.grains).mean()
    np.testing.assert_allclose(table["porosity"], 0.4, rtol=1e-12)
    np.testing.assert_allclose(table["void_ratio"], 0.4 / 0.6, rtol=1e-12)


def test_the_table_is_the_same_bytes_whatever_the_order_of_the_work(tmp_path):
    survey.run(plan(), tmp_path / "one.csv", workers=1)
    survey.run(plan(), tmp_path / "two.csv", workers=2)
    backwards = plan(vary={"seeds.count": [120, 80], "seeds.relax": [2, 0]})
    turned = survey.run(backwards, tmp_path / "turned.csv", workers=1)
    assert (tmp_path / "one.csv").read_bytes() == (tmp_path / "two.csv").read_bytes()
    table = survey.load(tmp_path / "one.csv")
    assert sorted(turned["rng"]) == sorted(table["rng"])
    assert np.unique(table["rng"]).size == len(table)


CLUSTERS = {"process": "cluster", "parents": 20, "children": 6.0, "spread": 0.05}


@pytest.mark.slow
def test_parents_children_and_spread_of_clusters_can_be_swept_in_any_order(tmp_path):
    base = {"seeds": CLUSTERS, "grains": {"relation": "cho_2006_max"}}
    vary = {"seeds.parents": [15, 30], "seeds.children": [5.0, 10.0], "seeds.spread": [0.1, 0.3]}
    forth = survey.run(survey.Survey(base, vary), tmp_path / "forth.csv", workers=2)
    back = survey.Survey(base, {key: values[::-1] for key, values in reversed(vary.items())})
    turned = survey.run(back, tmp_path / "back.csv", workers=1)
    for name in ("n_grains", "scale", "mean_sphericity", "d50"):
        np.testing.assert_array_equal(forth[name][np.argsort(forth["rng"])], turned[name][np.argsort(turned["rng"])])
    mean = forth["seeds_parents"] * forth["seeds_children"]
    # Children beyond the walls are lost: there are fewer than M λ, and never more by chance than 5 standard deviations.
    assert (forth["n_seeds"] < mean + 5 * np.sqrt(mean * (1 + forth["seeds_children"]))).all()
    np.testing.assert_allclose(forth["void_ratio"], 1.6 - 0.86 * forth["mean_sphericity"], rtol=1e-9)
    np.testing.assert_allclose(forth["scale"], (1 + forth["void_ratio"]) ** (-1 / 3), rtol=1e-9)


def test_whole_models_can_be_swept_and_an_interrupted_sweep_goes_on(tmp_path, monkeypatch):
    models = [
        {"process": "halton", "count": 90, "relax": 2},
        CLUSTERS,
        {"process": "strauss", "count": 90, "distance": 0.1, "inhibition": 0.1},
        {"process": "noise", "count": 90, "resolution": 16},
    ]
    plan = survey.Survey({"seeds": {}, "grains": {"scale": 0.9}}, {"seeds": models, "grains.scale": [0.8, 0.9]})
    whole = survey.run(plan, tmp_path / "whole.csv", workers=1)
    measure, grown = running.measure, []
    monkeypatch.setattr(running, "measure", lambda recipe: grown.append(recipe) or measure(recipe))
    lines = (tmp_path / "whole.csv").read_text().splitlines(keepends=True)
    (tmp_path / "part.csv").write_text("".join(lines[:1] + lines[4:6]))
    survey.run(plan, tmp_path / "part.csv", workers=1)
    assert (tmp_path / "part.csv").read_text() == "".join(lines)
    assert len(grown) == 6
    np.testing.assert_array_equal(whole["scale"], [0.8, 0.9] * 4)


VIEWED = {
    **BASE,
    "grains": {"porosity": 0.4, "throats": {"fraction": 0.5}},
    "section": {"at": 0.4},
    "planform": {"per_diameter": 8},
    "output": {"formats": [], "figures": False},
}


def test_a_survey_tells_what_sections_planforms_and_throats_do(tmp_path):
    plan = survey.Survey(VIEWED, {"seeds.count": [80, 2]})
    table = survey.run(plan, tmp_path / "t.csv", workers=1)
    (_, _, recipe), _ = plan.jobs()
    result = gd.recipe.run(recipe, tmp_path / "run")
    for view in ("section", "planform"):
        told = {f"{view}_{name}": value for name, value in result.summaries[view].items() if name != "expected"}
        assert set(told) == {name for name in table.dtype.names if name.startswith(f"{view}_")}
        for name, value in told.items():
            assert table[name][0] == pytest.approx(value, rel=1e-12), name
    throats = result.summaries["bed"]["throats"]
    for when, widths in throats.items():
        for name, value in widths.items():
            assert table[f"throats_{when}_{name}"][0] == value
    assert table["throats_after_std"][0] > table["throats_before_std"][0]
    assert math.isnan(table["planform_d50_area_bias"][1])
    assert math.isnan(table["throats_after_mean"][1])
    plain = survey.run(survey.Survey(BASE), tmp_path / "plain.csv", workers=1)
    assert not [name for name in plain.dtype.names if name.startswith(("section", "planform", "throats"))]


@pytest.mark.statistical
def test_means_of_cases_have_intervals_by_students_distribution(tmp_path):
    from scipy import stats

    base = {**BASE, "grains": {"porosity": 0.4}}
    plan = survey.Survey(base, {"seeds.count": [80, 2], "grains.keep": ["inside"]}, repeats=4)
    table = survey.run(plan, tmp_path / "t.csv", workers=1)
    found = survey.means(table)
    assert found.dtype.names[:3] == ("seeds_count", "grains_keep", "n")
    assert found["seeds_count"].tolist() == [80, 2]
    assert found["n"].tolist() == [4, 0]
    values = table["mean_sphericity"][:4]
    low, high = stats.t.interval(0.95, 3, loc=values.mean(), scale=stats.sem(values))
    assert found["mean_sphericity"][0] == pytest.approx(0.5 * (low + high))
    assert found["mean_sphericity_half_width"][0] == pytest.approx(0.5 * (high - low))
    assert np.isnan([found["porosity"][1], found["porosity_half_width"][1]]).all()
    alone = survey.means(survey.run(survey.Survey(base), tmp_path / "one.csv", workers=1))
    assert alone["n"].tolist() == [1]
    assert math.isnan(alone["d50_half_width"][0])
    with pytest.raises(InputError, match=r"means are of what survey\.run returns"):
        survey.means(found)


def test_a_planar_survey_measures_circles_and_outlines(tmp_path):
    slab = {"shape": "slab", "lengths": [1.0, 1.0, 0.05], "periodic": "xy"}
    plan = survey.Survey({**BASE, "domain": slab}, {"grains.porosity": [0.0, 0.2]})
    table = survey.run(plan, tmp_path / "t.csv", workers=1)
    # n circles of mean square diameter d² + var have the area of the solid.
    square = table["mean_diameter"] ** 2 + table["std_diameter"] ** 2
    np.testing.assert_allclose(np.pi / 4 * square * table["n_grains"], 1 - table["porosity"], rtol=1e-9)
    assert (table["mean_sphericity"] < 1).all()


def test_a_gap_has_no_scale(tmp_path):
    base = {"seeds": {"process": "poisson", "count": 80, "relax": 5}, "grains": {"gap": 1e-4}}
    table = survey.run(survey.Survey(base), tmp_path / "t.csv", workers=1)
    assert math.isnan(table["scale"][0])
    assert table["error"][0] == ""


def test_an_extended_survey_does_only_what_is_new(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    before = survey.run(plan(), path, workers=1)
    grown = []
    measure = running.measure
    monkeypatch.setattr(running, "measure", lambda recipe: grown.append(recipe) or measure(recipe))
    after = survey.run(plan(repeats=3), path, workers=1)
    assert len(grown) == 4
    assert set(before["rng"]) < set(after["rng"])


def test_an_interrupted_survey_keeps_what_it_had_and_goes_on(tmp_path, monkeypatch):
    path = tmp_path / "t.csv"
    measure, grown = running.measure, []

    def interrupt(recipe):
        if len(grown) == 3:
            raise KeyboardInterrupt
        grown.append(recipe)
        return measure(recipe)

    monkeypatch.setattr(running, "measure", interrupt)
    with pytest.raises(KeyboardInterrupt):
        survey.run(plan(), path, workers=1)
    assert len(survey.load(path)) == 3
    monkeypatch.setattr(running, "measure", measure)
    survey.run(plan(), path, workers=1)
    survey.run(plan(), tmp_path / "whole.csv", workers=1)
    assert path.read_bytes() == (tmp_path / "whole.csv").read_bytes()


def test_a_killed_survey_leaves_a_whole_table_or_none(tmp_path):
    path = tmp_path / "t.csv"
    code = (
        "from grainsdem import survey; from grainsdem.survey import running; running.PAUSE = 0.0;"
        f"survey.run(survey.Survey({BASE!r}, repeats=3000), {str(path)!r}, workers=1)"
    )
    process = subprocess.Popen([sys.executable, "-c", code])
    end = time.monotonic() + 60
    while not path.exists() and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()
    assert 0 < len(survey.load(path)) < 3000


def test_a_bed_that_cannot_be_grown_is_a_row_that_says_why(tmp_path):
    table = survey.run(survey.Survey(BASE, {"seeds.count": [2, 80]}), tmp_path / "t.csv", workers=1)
    assert "all 2 cells touch a wall" in str(table["error"][0])
    assert math.isnan(table["porosity"][0])
    assert table["error"][1] == ""
    assert table["n_grains"][1] > 0


def test_varied_rngs_are_a_column_and_a_run_each(tmp_path):
    table = survey.run(survey.Survey(BASE, {"rng": [1, 2, 9]}), tmp_path / "t.csv", workers=1)
    assert list(table.dtype.names).count("rng") == 1
    assert table["rng"].tolist() == [1, 2, 9]
    assert np.unique(table["mean_sphericity"]).size == 3
    for row in table:
        bed = gd.recipe.grow(gd.recipe.make(**BASE, rng=int(row["rng"])))
        assert row["mean_sphericity"] == gd.sphericities(bed.grains).mean()


def test_rngs_varied_beside_other_keys_are_not_taken_for_one_another(tmp_path, monkeypatch):
    both = survey.Survey(BASE, {"rng": [1, 2], "seeds.count": [80, 120]})
    table = survey.run(both, tmp_path / "t.csv", workers=1)
    assert list(zip(table["rng"], table["n_seeds"], strict=True)) == [(1, 80), (1, 120), (2, 80), (2, 120)]
    measure, grown = running.measure, []
    monkeypatch.setattr(running, "measure", lambda recipe: grown.append(recipe) or measure(recipe))
    again = survey.run(survey.Survey(BASE, {**both.vary, "rng": [1, 2, 3]}), tmp_path / "t.csv", workers=1)
    assert len(grown) == 2
    assert again["n_seeds"].tolist() == [80, 120] * 3
    with pytest.raises(InputError, match="rows of other cases"):
        survey.run(survey.Survey({**BASE, "grains": {"porosity": 0.3}}, both.vary), tmp_path / "t.csv", workers=1)


OWN = {"count": 70, "cluster": {"parents": 20}, "noise": {"resolution": 16}, "halton": {"bases": [5, 7, 11]}}


def test_processes_are_varied_with_a_table_of_keys_each(tmp_path):
    vary = {"seeds.process": ["halton", "poisson", "cluster", "noise"], "seeds.cluster.spread": [0.05, 0.2]}
    plan = survey.Survey({**BASE, "seeds": OWN}, vary)
    table = survey.run(plan, tmp_path / "t.csv", workers=1)
    assert table["seeds_process"].tolist() == ["halton", "poisson", "cluster", "cluster", "noise"]
    np.testing.assert_array_equal(table["seeds_cluster_spread"], [np.nan, np.nan, 0.05, 0.2, np.nan])
    assert len(plan) == 5
    assert (table["n_seeds"] == 70).all()
    recipes = [recipe for _, _, recipe in plan.jobs()]
    assert recipes[0].seeds.bases == (5, 7, 11)
    assert [recipe.seeds.spread for recipe in recipes] == [None, None, 0.05, 0.2, None]
    # What stands in other processes' tables does not touch a bed.
    alone = survey.Survey({**BASE, "seeds": {"count": 70, "noise": OWN["noise"]}}, {"seeds.process": ["noise"]})
    ((_, _, noise),) = alone.jobs()
    assert noise == recipes[-1]


@pytest.mark.slow
def test_the_command_varies_processes_whose_tables_the_file_holds(tmp_path):
    np.savetxt(tmp_path / "parents.txt", np.random.default_rng(1).random((5, 3)))
    (tmp_path / "r.toml").write_text(
        "[seeds]\ncount = 70\n[seeds.cluster]\nparents = 'parents.txt'\n[seeds.strauss]\ninhibition = 0\n"
        "distance = 0.05\n[grains]\nporosity = 0.4\n"
    )
    options = ["--vary", "seeds.process=cluster,strauss", "--vary", "seeds.cluster.spread=0.1,0.2", "--repeats", "2"]
    result = CliRunner().invoke(app, ["survey", str(tmp_path / "r.toml"), str(tmp_path / "t.csv"), *options])
    assert result.exit_code == 0, result.output
    table = survey.load(tmp_path / "t.csv")
    assert table["seeds_process"].tolist() == ["cluster"] * 4 + ["strauss"] * 2
    assert (table["error"] == "").all()


HALTON = {**BASE, "seeds": {"process": "halton", "count": 80}}


@pytest.mark.parametrize(
    ("base", "options", "words"),
    [
        (HALTON, {"repeats": 3}, "the beds of the recipe would be copies of one: Halton's .* scramble = 'shift'"),
        (HALTON, {"vary": {"rng": [1, 2]}}, "the beds of rng = 1 would be copies of one"),
        (
            BASE,
            {"vary": {"seeds.process": ["poisson", "halton"]}, "repeats": 2},
            "process = halton would be copies",
        ),
        (BASE, {"vary": {"seeds.count": [80, 90, 80]}}, "seeds.count = 80 and seeds.count = 80 are the same bed"),
        (BASE, {"vary": {"name": ["a", "b"]}}, "name = a and name = b are the same bed"),
        (BASE, {"vary": {"rng": [1, 1]}}, "rng = 1 and rng = 1 are the same bed"),
    ],
)
def test_copies_of_a_bed_do_not_stand_in_a_table_as_statistics(base, options, words, tmp_path):
    with pytest.raises(InputError, match=words):
        survey.run(survey.Survey(base, **options), tmp_path / "t.csv", workers=1)
    assert list(tmp_path.iterdir()) == []


def test_shifted_haltons_sequences_are_beds_of_their_own(tmp_path):
    base = {**HALTON, "rng": 7, "seeds": {**HALTON["seeds"], "halton": {"scramble": "shift"}}}
    table = survey.run(survey.Survey(base, repeats=3), tmp_path / "t.csv", workers=1)
    assert np.unique(table["mean_sphericity"]).size == 3
    # One bed of the sequence itself is no statistics.
    own = survey.Survey({**HALTON, "rng": 7}, {"seeds.count": [60, 80]})
    assert [recipe.rng for _, _, recipe in own.jobs()] == [0, 0]


def test_lists_can_be_zipped():
    cases = [case for case, _, _ in plan(combine="zip", repeats=1).jobs()]
    assert cases == [{"seeds.count": 80, "seeds.relax": 0}, {"seeds.count": 120, "seeds.relax": 2}]
    assert len(plan(combine="zip")) == 4
    assert len(plan()) == 8


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"vary": {"seeds.count": []}}, "seeds.count has none"),
        ({"vary": {"seeds.count": 5}}, "seeds.count has none"),
        ({"combine": "sum"}, "'product' or 'zip'; got 'sum'"),
        ({"combine": "zip", "vary": {"rng": [1], "seeds.count": [1, 2]}}, "rng: 1, seeds.count: 2"),
        ({"repeats": 0}, "1 or more; got 0"),
        ({"vary": {"rng": [1, 2]}, "repeats": 3}, "each value of rng is one bed: repeats must be 1 .*; got 3"),
        ({"vary": {"settle.friction": [0.1]}}, "does not settle"),
    ],
)
def test_an_impossible_plan_is_refused(change, words):
    with pytest.raises(InputError, match=words):
        plan(**change)


@pytest.mark.parametrize(
    ("vary", "words"),
    [
        ({"seeds.colour": [1]}, "seeds.colour: unknown key"),
        ({"seeds.count": [0]}, "greater than or equal to 1; got 0"),
        ({"name.first": ["x"]}, "name is no table"),
    ],
)
def test_an_impossible_case_is_refused_before_any_work(vary, words, tmp_path):
    with pytest.raises(InputError, match=words):
        survey.run(survey.Survey({**BASE, "name": "bed"}, vary), tmp_path / "t.csv", workers=1)
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_something_else_is_not_overwritten(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("my,own,numbers\n1,2,3\n")
    with pytest.raises(InputError, match="something else than this survey's"):
        survey.run(plan(), path, workers=1)
    survey.run(survey.Survey(BASE), tmp_path / "u.csv", workers=1)
    with pytest.raises(InputError, match="1 rows of other cases"):
        survey.run(survey.Survey({**BASE, "rng": 5}), tmp_path / "u.csv", workers=1)
    with pytest.raises(FileFormatError, match=r"\.csv; got '\.txt'"):
        survey.run(plan(), tmp_path / "t.txt")
    with pytest.raises(MissingFileError):
        survey.load(tmp_path / "none.csv")
    path.write_text("only,a,header\n")
    with pytest.raises(FileFormatError, match="not a survey's table"):
        survey.load(path)


def test_the_command_takes_the_plan_of_the_file_and_of_its_options(tmp_path):
    recipe, output = tmp_path / "r.toml", tmp_path / "t.csv"
    recipe.write_text(
        '[seeds]\nprocess = "poisson"\ncount = 80\n[grains]\nporosity = 0.4\n'
        "[survey]\nrepeats = 5\n[survey.vary]\nseeds.relax = [0, 1]\n"
    )
    options = ["--vary", "seeds.process=poisson,halton", "--repeats", "1", "--workers", "1"]
    options += ["--means", str(tmp_path / "means.csv")]
    result = CliRunner().invoke(app, ["survey", str(recipe), str(output), *options])
    assert result.exit_code == 0, result.output
    assert "4 beds, 0 could not be grown" in result.output
    table = survey.load(output)
    assert set(zip(table["seeds_process"].tolist(), table["seeds_relax"].tolist(), strict=True)) == {
        (process, relax) for process in ("poisson", "halton") for relax in (0, 1)
    }
    for wrong in (["--vary", "seeds.count"], ["--vary", "seeds.count=5"]):
        assert CliRunner().invoke(app, ["survey", str(recipe), str(output), *wrong]).exit_code == 2


def test_files_that_a_survey_names_lie_beside_it(tmp_path):
    np.savetxt(tmp_path / "parents.txt", np.random.default_rng(1).random((5, 3)))
    np.savetxt(tmp_path / "sizes.txt", [1e-3] * 40)
    (tmp_path / "r.toml").write_text(
        'seeds = {process = "cluster", parents = "parents.txt", spread = 0.1}\n'
        '[grains]\nscale = 0.9\nsizes = {path = "sizes.txt"}\n'
    )
    table = survey.run(survey.read(tmp_path / "r.toml"), tmp_path / "t.csv", workers=1)
    assert table["n_seeds"].tolist() == [40]
    assert table["mean_diameter"] == pytest.approx(1e-3, rel=5e-3)


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("[survey]\ncolour = 1\n", InputError, "takes vary, combine and repeats"),
        ("[survey\n", FileFormatError, "not TOML"),
    ],
)
def test_files_that_are_no_surveys_get_one_clear_error(text, error, words, tmp_path):
    path = tmp_path / "r.toml"
    path.write_text(text)
    with pytest.raises(error, match=words):
        survey.read(path)
    with pytest.raises(MissingFileError):
        survey.read(tmp_path / "none.toml")
