from __future__ import annotations

import numpy as np
import pytest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.errors import InputError

WRAPPED = {"side": 0.01, "periodic": "xyz"}
SEEDS = {"process": "poisson", "count": 150, "relax": 3}


def made(axes, **grains):
    return recipes.make(domain=WRAPPED, seeds=SEEDS, grains={"porosity": 0.4, "axes": axes, **grains})


def test_a_recipe_has_zingg_classes():
    bed = recipes.grow(made({"classes": {"rod": 0.4, "disc": 0.6}, "orientation": "aligned", "spread": 0.4}))
    found = gd.zingg(gd.box_axes(bed))
    assert np.count_nonzero(found == "rod") == pytest.approx(60, abs=3)
    assert np.count_nonzero(found == "disc") == pytest.approx(90, abs=4.5)
    assert gd.porosity(bed, region="domain") == pytest.approx(0.4, rel=1e-9)


def test_a_list_of_sizes_is_had_by_grains_of_forms_of_their_own():
    sizes = np.linspace(1e-3, 1.5e-3, 150)
    axes = {"elongation": {"mean": 0.7, "std": 0.05}, "flatness": 0.7}
    grains = {"porosity": 0.4, "axes": axes, "sizes": {"diameters": sizes.tolist()}}
    bed = recipes.grow(recipes.make(domain={"periodic": "xyz"}, seeds=SEEDS, grains=grains))
    # A few cells are smaller than their size, and none is larger; the bed is scaled to all of them.
    assert np.median(np.abs(gd.diameters(bed) / sizes - 1)) < 5e-3
    assert gd.table(bed, sieves=False)["elongation"].mean() == pytest.approx(0.7, rel=0.02)


def test_the_command_grows_forms_of_their_own(tmp_path):
    path = tmp_path / "bed.h5"
    words = "--count 80 --periodic xyz --relax 3 --elongation 0.7 --elongation-std 0.05 --spread 0.3 --quiet"
    done = CliRunner().invoke(app, ["generate", str(path), *words.split()])
    assert done.exit_code == 0, done.output
    assert gd.table(gd.load(path), sieves=False)["elongation"].mean() == pytest.approx(0.7, rel=0.02)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("axes", "words"),
    [
        ({}, "elongation, flatness or both, or classes"),
        ({"classes": {"disc": 0.5, "rod": 0.4}}, r"must sum up to 1; those of disc, rod sum up to 0\.9"),
        ({"classes": {"disc": 1.0}, "flatness": 0.5}, "forms have classes, or an elongation"),
        ({"classes": {"plate": 1.0}}, "plate"),
        ({"elongation": 1.4}, r"elongation: .*less than or equal to 1; got 1\.4"),
        ({"elongation": {"mean": 0.5}}, r"grains\.axes\.elongation\.std: missing"),
        (
            {"elongation": {"mean": 0.5, "std": 0.1, "sd": 1}},
            r"elongation\.sd: unknown key; allowed are law, mean, std",
        ),
        ({"elongation": {"mean": 0.5, "std": 0.6, "law": "beta"}}, r"no beta law of mean 0\.5 and std 0\.6"),
        ({"elongation": {"mean": 0.9, "std": 0.2, "law": "uniform"}}, "lies from 0.2 to 1; got a law from"),
        ({"elongation": 0.5, "orientation": "uniform", "dip": 0.2}, "have no spread, trend and dip"),
    ],
)
def test_axes_without_a_meaning_get_one_line(axes, words):
    with pytest.raises(InputError, match=words):
        made(axes)


@pytest.mark.unit
def test_layers_have_no_forms_of_each_grain():
    layer = {"sizes": {"law": "uniform", "parameters": {"loc": 1e-3, "scale": 1e-3}}}
    with pytest.raises(InputError, match="no classes"):
        made({"classes": {"disc": 1.0}}, layer=[layer])
    done = CliRunner().invoke(app, ["generate", "bed.h5", "--count", "9", "--elongation-std", "0.1"])
    assert done.exit_code == 2
    assert "give --elongation too" in done.output
