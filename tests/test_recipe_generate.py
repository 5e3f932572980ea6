"""The command `generate`: the options that say what cells become."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem.cli import app

pytestmark = pytest.mark.unit

BED = ["--process", "poisson", "--relax", 1, "--periodic", "xyz"]


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def generated(path, *words):
    result = call("generate", path, *BED, *words, "--json")
    assert result.exit_code == 0, result.output
    return gd.load(path), json.loads(result.stdout)


@pytest.mark.parametrize(
    ("words", "porosity"),
    [
        (["--porosity", 0.3], 0.3),
        (["--solid-fraction", 0.7], 0.3),
        (["--void-ratio", 0.25], 0.2),
        (["--scale", 0.9, "--about", "seed"], 1 - 0.9**3),
        (["--porosity", 0.3, "--region", "domain"], 0.3),
        ([], 0.0),
    ],
)
def test_every_measure_of_void_is_an_option(tmp_path, words, porosity):
    bed, told = generated(tmp_path / "bed.h5", "--count", 120, *words)
    assert told["porosity"] == pytest.approx(porosity, abs=1e-12)
    assert gd.porosity(bed) == told["porosity"]


def test_a_box_in_metres_may_be_what_the_porosity_is_of(tmp_path):
    box = [2e-3, 2e-3, 2e-3, 8e-3, 8e-3, 7e-3]
    bed, _ = generated(tmp_path / "bed.h5", "--count", 120, "--side", 0.01, "--porosity", 0.4, "--box", *box)
    assert gd.porosity(bed, region=(box[:3], box[3:])) == pytest.approx(0.4, rel=1e-10)


def test_side_and_diameter_give_the_count_and_a_relation_the_porosity(tmp_path):
    words = ["--side", 0.006, "--mean-diameter", 1e-3, "--relation", "cho_2006_max"]
    bed, told = generated(tmp_path / "bed.h5", *words)
    assert bed.domain.lengths.tolist() == [0.006] * 3
    assert told["mean_diameter"] == pytest.approx(1e-3, rel=0.01)
    void = told["porosity"] / (1 - told["porosity"])
    assert void == pytest.approx(1.6 - 0.86 * told["mean_sphericity"], rel=1e-9)


def test_a_gap_and_throats_are_told_in_metres(tmp_path):
    bed, _ = generated(tmp_path / "bed.h5", "--count", 120, "--median-diameter", 1e-3, "--gap", 2e-5)
    np.testing.assert_allclose(gd.throat_widths(bed), 2e-5, rtol=1e-9)
    words = ["--count", 120, "--mean-diameter", 1e-3, "--porosity", 0.4, "--throats", 0.5, "--throat-axes", "x"]
    bed, told = generated(tmp_path / "bed.h5", *words)
    assert told["throats"]["after"]["std"] == pytest.approx(gd.throat_widths(bed).std())
    shown = call("generate", tmp_path / "bed.h5", *BED, *words).output
    assert "throat widths before grains were moved, mm" in shown


def test_sizes_are_those_of_a_law_or_of_a_file(tmp_path):
    law = ["--sizes", "uniform", "--size-parameter", "loc=1e-3", "--size-parameter", "scale=1e-3"]
    bed, _ = generated(tmp_path / "a.h5", "--count", 50, "--porosity", 0.4, *law, "--size-tolerance", 0.001)
    quantiles = 1e-3 + 1e-3 * (np.arange(50) + 0.5) / 50
    np.testing.assert_allclose(np.sort(gd.diameters(bed.grains)), quantiles, rtol=4e-4)
    np.savetxt(tmp_path / "sizes.csv", quantiles)
    bed, _ = generated(tmp_path / "b.h5", "--porosity", 0.4, "--sizes", tmp_path / "sizes.csv")
    np.testing.assert_allclose(gd.diameters(bed.grains), quantiles, rtol=4e-3)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--throat-axes", "xy"], "axes says how something is done that --throats asks for"),
        (["--size-tolerance", 0.1, "--size-parameter", "s=1"], "give --sizes too"),
        (["--porosity", 0.4, "--gap", 0.1], "got porosity = 0.4, gap = 0.1"),
        (["--porosity", 0.4, "--region", "domain", "--box", 0, 0, 0, 1, 1, 1], "give --region or --box"),
        (["--sizes", "foo.csv", "--porosity", 0.4], "foo.csv: no such file"),
        (["--sizes", "foo", "--porosity", 0.4], "got 'foo'"),
        (["--sizes", "lognorm", "--size-parameter", "s"], "key=value; got 's'"),
        (["--gap", 0.9], "half the gap must be below"),
        (["--relation", "wadell"], "one of cho_2006_max, cho_2006_min, terzaghi_1996; got 'wadell'"),
        (["--throats", 0.2], "no room to move"),
        (["--side", 0.01, "--mean-diameter", 1e-3], "got all three"),
        (["--side", 0.01, "--lengths", 1, 1, 1], "side is that of a cube"),
    ],
)
def test_what_makes_no_sense_is_one_line_and_leaves_no_file(tmp_path, words, expected):
    result = call("generate", tmp_path / "bed.h5", *BED, "--count", 40, *words)
    assert result.exit_code == 2, result.output
    assert expected in result.stderr
    assert len(result.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_units_in_brackets_are_shown_in_the_help():
    text = call("generate", "--help").output
    assert "[m]" in text
    assert "[kg/m³]" in text
