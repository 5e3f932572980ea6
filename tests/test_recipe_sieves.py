from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.errors import FileFormatError, InputError

SHEET = "opening (mm),passing (%)\n2,100\n1,75\n0.5,25\n0.25,0\n"
TABLE = {"openings": [2, 1, 0.5, 0.25], "passing": [100, 75, 25, 0], "relaxations": 2}
SEEDS = {"process": "poisson", "count": 700}


def grow(sieves, **grains):
    return recipes.grow(recipes.make(seeds=SEEDS, grains={"porosity": 0.4, "sieves": sieves, **grains}))


def passing(bed, openings, sizes):
    masses = gd.masses(bed)
    return [100 * masses[sizes < size].sum() / masses.sum() for size in openings]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a sheet, and a bed that was grown from it by the command."""
    folder = tmp_path_factory.mktemp("sieves")
    (folder / "sheet.csv").write_text(SHEET, encoding="utf-8")
    words = ["generate", folder / "bed.h5", "--process", "poisson", "--count", 700, "--sieves", folder / "sheet.csv"]
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--porosity", 0.4, "--quiet")])
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return folder


def test_a_bed_has_the_curve_of_its_sheet_in_metres_from_recipe_and_command(folder):
    (folder / "bed.toml").write_text(
        '[seeds]\nprocess = "poisson"\ncount = 700\n[grains]\nporosity = 0.4\n[grains.sieves]\npath = "sheet.csv"\n',
        encoding="utf-8",
    )
    bed, same = gd.load(folder / "bed.h5"), recipes.grow(recipes.read(folder / "bed.toml"))
    assert passing(bed, [2e-3, 1e-3, 0.5e-3, 0.25e-3], gd.sieve_diameters(bed)) == pytest.approx(
        [100, 75, 25, 0], abs=0.5
    )
    assert bed.grains.vertices.tobytes() == same.grains.vertices.tobytes()
    assert gd.porosity(bed) == pytest.approx(0.4)


def test_the_command_fit_holds_a_bed_against_the_sheet_and_draws_both(folder):
    words = ["fit", folder / "sheet.csv", "--bed", folder / "bed.h5", "--figure", folder / "curve.png"]
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--json")])
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["bed"]["deviation"] < 0.5
    assert found["passing"] == [0, 25, 75, 100]
    assert set(found["fits"]) == {"normal", "lognormal"}
    assert "needs grains in 5 classes" in found["not_fitted"]["log-hyperbolic"]
    # Symmetric in φ about 0.7071 mm.
    assert np.exp(found["fits"]["lognormal"]["parameters"]["mu"]) == pytest.approx(0.7071e-3, rel=1e-3)
    assert found["statistics"]["percentiles"]["d50"] == pytest.approx(0.7071e-3, rel=1e-3)
    assert (folder / "curve.png").read_bytes().startswith(b"\x89PNG")
    told = CliRunner().invoke(app, [str(word) for word in words])
    assert "largest difference" in told.stdout
    assert "fits by mass, best first" in told.stdout
    assert "moderately sorted" in told.stdout


def test_openings_may_be_names_and_masses_and_equal_volume_diameters():
    bed = grow(
        {
            "openings": ["No. 10", "1 mm", "#35", "pan"],
            "retained": [0, 50, 100, 50],
            "finest": 0.25,
            "diameter": "equal-volume",
            "relaxations": 2,
        }
    )
    assert passing(bed, [2e-3, 1e-3, 0.5e-3, 0.25e-3], gd.diameters(bed)) == pytest.approx([100, 75, 25, 0], abs=0.5)


def test_what_is_assumed_of_open_ends_is_told_once(caplog):
    grow({**TABLE, "passing": [75, 60, 25, 5]}, keep="all")
    words = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert [word.split(":")[0] for word in words] == [
        "5 % of the mass is finer than the last sieve, 0.25 mm",
        "25 % of the mass is coarser than the last sieve, 2 mm",
    ]


@pytest.mark.slow
def test_the_curve_of_a_fit_and_a_law_by_mass_are_had_by_the_grains():
    bed = grow({**TABLE, "fit": "lognormal", "diameter": "equal-volume"}, keep="all")
    law = gd.fit_sieves([0, 0.25e-3, 0.5e-3, 1e-3, 2e-3, np.inf], [0, 25, 50, 25, 0], "lognormal").distribution
    marks = law.ppf([0.1, 0.3, 0.5, 0.7, 0.9])
    by_sheet = passing(bed, marks, gd.diameters(bed))
    # Half a per cent at the openings, as much left out at either end, and the mass of a grain.
    assert by_sheet == pytest.approx([10, 30, 50, 70, 90], abs=1.5)
    sizes = {"law": "lognormal", "parameters": {"mu": law.mu, "sigma": law.sigma}, "by": "mass", "relaxations": 2}
    same = recipes.grow(recipes.make(seeds=SEEDS, grains={"porosity": 0.4, "keep": "all", "sizes": sizes}))
    assert passing(same, marks, gd.diameters(same)) == pytest.approx([10, 30, 50, 70, 90], abs=1.5)


@pytest.mark.slow
def test_the_number_of_grains_follows_from_the_domain():
    bed = recipes.grow(
        recipes.make(
            domain={"side": 6e-3},
            seeds={"process": "poisson"},
            grains={"porosity": 0.4, "keep": "all", "sieves": TABLE},
        )
    )
    assert bed.domain.lengths == pytest.approx(6e-3)
    # Sizes are as near as a whole number of grains lets them be.
    assert passing(bed, [2.01e-3, 1e-3, 0.5e-3, 0.249e-3], gd.sieve_diameters(bed)) == pytest.approx(
        [100, 75, 25, 0], abs=1.0
    )


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ({}, "give one of passing, retained and path; got none"),
        ({**TABLE, "path": "a.csv"}, "got passing, path"),
        ({"path": "a.csv", "openings": [1, 2]}, "openings go with passing or retained"),
        ({"passing": [0, 100]}, "openings go with passing or retained"),
        ({**TABLE, "passing": [100, 0]}, "one number passing for each of the 4 openings; got 2"),
        ({**TABLE, "passing": [100, 25, 75, 0]}, "must not fall"),
        ({**TABLE, "passing": [110, 75, 25, 0]}, "from 0 to 100; got 0, 110"),
        ({**TABLE, "openings": [2, 2, 1, 0.5]}, "no two sieves are alike; got 2 mm twice"),
        ({**TABLE, "openings": [-2, 1, 0.5, 0.2]}, "above zero; got -0.002 m"),
        ({**TABLE, "openings": ["wide", 1, 0.5, 0.2]}, "'wide' is no opening"),
        ({**TABLE, "unit": "inch"}, "unit: .*'astm'; got 'inch'"),
        ({**TABLE, "finest": 0.1}, "finest is a size below the last sieve.* 0 % are finer"),
        ({**TABLE, "fit": "lognormal", "widest": 3}, "a fit has no open classes"),
        ({**TABLE, "fit": "log-hyperbolic"}, "grains in 5 classes or more"),
        ({**TABLE, "tolerance": 0}, "tolerance"),
    ],
)
def test_sheets_without_a_meaning_get_one_line(table, words):
    with pytest.raises(InputError, match=words):
        recipes.make(seeds=SEEDS, grains={"porosity": 0.4, "sieves": table})


def test_sieves_go_with_no_other_size_and_no_gap(tmp_path):
    for grains, words in (
        (
            {"porosity": 0.4, "sizes": {"diameters": [1.0, 2.0]}},
            "give one of sizes, sieves and layers; got sizes, sieves",
        ),
        ({"gap": 1e-5}, "give sieves or gap"),
        ({"porosity": 0.4, "median_diameter": 1e-3}, "leave out median_diameter"),
    ):
        with pytest.raises(InputError, match=words):
            recipes.make(seeds=SEEDS, grains={"sieves": TABLE, **grains})
    with pytest.raises(InputError, match="by says what a law is a distribution of; got 'mass' beside diameters"):
        recipes.make(seeds=SEEDS, grains={"scale": 1, "sizes": {"diameters": [1.0, 2.0], "by": "mass"}})
    with pytest.raises(InputError, match="lognormal takes mu, sigma; got s"):
        recipes.make(seeds=SEEDS, grains={"scale": 1, "sizes": {"law": "lognormal", "parameters": {"s": 1}}})
    empty = tmp_path / "empty.csv"
    empty.write_text("", encoding="utf-8")
    with pytest.raises(FileFormatError, match="no line holds a sieve"):
        recipes.grow(recipes.make(seeds=SEEDS, grains={"scale": 1, "sieves": {"path": str(empty)}}))


@pytest.mark.slow
def test_few_grains_and_few_seeds_are_told_what_it_takes():
    wide = {"openings": [20, 15, 10, 5, 1], "passing": [100, 98, 60, 30, 0]}
    with pytest.raises(InputError, match=r"too few for this grading.*; \d+ grains can have it"):
        grow(wide)


@pytest.mark.slow
def test_flat_grains_have_the_curve_too():
    bed = grow(TABLE, axes={"flatness": 0.4, "elongation": 0.75, "dip": 0.3})
    assert passing(bed, [2e-3, 1e-3, 0.5e-3, 0.25e-3], gd.sieve_diameters(bed)) == pytest.approx(
        [100, 75, 25, 0], abs=0.5
    )
    rows = gd.table(bed, sieves=False)
    assert rows["flatness"].mean() == pytest.approx(0.4, rel=0.02)
    assert rows["elongation"].mean() == pytest.approx(0.75, rel=0.02)
    assert gd.porosity(bed) == pytest.approx(0.4)
    assert gd.validate(bed).ok


@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({}, "give elongation, flatness or both"),
        ({"flatness": 0}, "flatness: .*0.02; got 0"),
        ({"elongation": 2}, "elongation: .*equal to 1; got 2"),
        (
            {"elongation": 0.5, "plunge": 1},
            "plunge: unknown key; allowed are elongation, flatness, classes, orientation, spread, trend, dip",
        ),
    ],
)
def test_axes_without_a_meaning_get_one_line(axes, words):
    with pytest.raises(InputError, match=words):
        recipes.make(seeds=SEEDS, grains={"porosity": 0.4, "axes": axes})


def test_the_command_grows_long_grains_and_draws_where_they_point(tmp_path):
    bed, net = tmp_path / "long.h5", tmp_path / "net.png"
    words = ["generate", bed, "--process", "poisson", "--count", 200, "--elongation", 0.6, "--trend", 1.0]
    result = CliRunner().invoke(app, [str(word) for word in (*words, "--porosity", 0.4, "--quiet")])
    assert result.exit_code == 0, result.output
    assert gd.table(gd.load(bed), sieves=False)["elongation"].mean() == pytest.approx(0.6, rel=0.02)
    result = CliRunner().invoke(app, ["measure", str(bed), "--net", str(net), "--quiet"])
    assert result.exit_code == 0, result.output
    assert net.read_bytes().startswith(b"\x89PNG")
