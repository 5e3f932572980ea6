"""Recipes and the command that lay out shapes instead of growing cells."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.cli import app
from grainsdem.errors import InputError

TEXT = """
name = "mixture"
rng = 3

[domain]
lengths = [0.01, 0.01, 0.004]

[grains]
density = 2600.0

[grains.sizes]
law = "lognorm"
parameters = {s = 0.2, scale = 1e-3}

[grains.shapes]
count = 200
by = "mass"
kinds = [
    {shape = "rock", elongation = 0.7, flatness = 0.6, roundness = 0.5, share = 0.5, different = 5},
    {path = "scans", share = 0.25, density = 3000.0},
    {shape = "superellipsoid", exponents = [0.4, 1.0], share = 0.25},
]
"""


def run(*words):
    return CliRunner().invoke(app, words)


@pytest.fixture
def written(tmp_path):
    import trimesh

    (tmp_path / "scans").mkdir()
    trimesh.creation.box((3, 2, 2)).export(tmp_path / "scans" / "brick.stl")
    (tmp_path / "bed.toml").write_text(TEXT)
    return tmp_path / "bed.toml"


@pytest.mark.unit
def test_a_recipe_of_shapes_lays_out_the_mixture_beside_its_files(written):
    recipe = recipes.read(written)
    bed = recipes.grow(recipe)
    assert len(bed) == 200
    masses = gd.masses(bed)
    assert np.bincount(bed.classes, masses) / masses.sum() == pytest.approx([0.5, 0.25, 0.25], abs=2e-3)
    assert bed.densities[bed.classes == 1] == pytest.approx(3000)
    assert bed.densities[bed.classes != 1] == pytest.approx(2600)
    rocks = gd.box_axes(gd.subset(bed, np.flatnonzero(bed.classes == 0)))
    assert rocks[:, 1] / rocks[:, 0] == pytest.approx(np.full(len(rocks), 0.7), rel=1e-6)
    assert gd.roundness(gd.subset(bed, np.flatnonzero(bed.classes == 0))) == pytest.approx(0.5, abs=0.02)
    assert gd.validate(bed).ok
    assert np.array_equal(recipes.grow(recipe).positions, bed.positions)
    told = json.loads(bed.provenance[0])
    assert "seeds" not in told
    assert recipes.make(**{key: value for key, value in told.items() if key != "step"}).grains.shapes.count == 200


@pytest.mark.unit
def test_grains_of_one_diameter_get_a_box_of_their_own():
    bed = recipes.grow(recipes.make(grains={"shapes": {"kinds": [{"shape": "cube"}], "count": 50, "diameter": 1e-3}}))
    assert gd.diameters(bed) == pytest.approx(np.full(50, 1e-3))
    listed = recipes.make(grains={"sizes": {"diameters": [1e-3, 2e-3]}, "shapes": {"kinds": [{"shape": "box"}]}})
    assert sorted(gd.diameters(recipes.grow(listed))) == pytest.approx([1e-3, 2e-3])


@pytest.mark.unit
def test_tables_that_make_no_sense_are_refused_in_a_line():
    one = {"kinds": [{"shape": "cube"}], "count": 5, "diameter": 1e-3}
    sizes = {"law": "lognorm", "parameters": {"s": 0.2}}
    cases = [
        ({"seeds": {"count": 5}, "grains": {"shapes": one}}, "grow from no seeds"),
        ({"grains": {"porosity": 0.4, "shapes": one}}, "come from no cells: leave out porosity"),
        ({"grains": {"keep": "all", "throats": {}, "shapes": one}}, "leave out throats, keep"),
        ({"grains": {"shapes": {**one, "diameter": None}}}, "sizes, sieves, or all one shapes.diameter"),
        ({"grains": {"sizes": sizes, "shapes": one}}, "give one of them"),
        ({"grains": {"shapes": {**one, "count": None}}}, "give shapes.count"),
        ({"grains": {"sizes": {"diameters": [1.0]}, "shapes": {**one, "diameter": None}}}, "leave out shapes.count"),
        ({"grains": {"shapes": {**one, "kinds": []}}}, "grains.shapes.kinds: .*at least 1"),
        ({"grains": {"shapes": {**one, "kinds": [{}]}}}, "either a shape or a path"),
        ({"grains": {"shapes": {**one, "kinds": [{"shape": "egg"}]}}}, "'tetrahedron', 'cube'.*got 'egg'"),
        ({"grains": {"shapes": {**one, "kinds": [{"shape": "prism"}]}}}, "a prism needs sides"),
        (
            {"grains": {"shapes": {**one, "kinds": [{"shape": "cube", "sides": 3}]}}},
            "cube takes share, density; got sides",
        ),
        (
            {"grains": {"shapes": {**one, "kinds": [{"shape": "rock", "flatness": 2}]}}},
            "less than or equal to 1; got 2",
        ),
        ({"grains": {"shapes": {**one, "kinds": [{"shape": "rock", "size": 2}]}}}, "size: unknown key"),
        ({"grains": {"shapes": one}, "domain": {"periodic": "xy"}}, "give its lengths or side"),
    ]
    for tables, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            recipes.make(**tables)
        assert "\n" not in str(caught.value)


@pytest.mark.unit
def test_a_survey_of_what_does_not_grow_is_refused(written):
    with pytest.raises(InputError, match="grains of shapes lie loose"):
        list(gd.survey.read(written, vary={"grains.shapes.count": [20, 40]}).jobs())
    done = run("seeds", str(written))
    assert done.exit_code == 2
    assert "grow from no seeds" in done.output


@pytest.mark.unit
def test_the_command_packs_as_the_recipe_does(written, tmp_path):
    done = run(
        "pack", str(tmp_path / "out.h5"), "--count", "60", "--sizes", "lognorm", "--size-parameter", "s=0.2",
        "--size-parameter", "scale=1e-3", "--shape", "rock:elongation=0.7,flatness=0.6,share=2",
        "--shape", "superellipsoid:exponents=[0.3,0.3]", "--shape", str(tmp_path / "scans"), "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    bed = gd.load(tmp_path / "out.h5")
    assert np.bincount(bed.classes).tolist() == [30, 15, 15]
    assert json.loads(done.stdout)["n_grains"] == 60
    for given, words in (
        (["--shape", "egg"], "got 'egg'"),
        (["--shape", "rock:flat=1"], "flat: unknown key"),
        (["--shape", str(tmp_path / "gone.stl")], "gone.stl: no such file"),
    ):
        done = run("pack", str(tmp_path / "no.h5"), "--count", "5", "--diameter", "1e-3", *given)
        assert done.exit_code == 2
        assert words in done.output
        assert not (tmp_path / "no.h5").exists()


def test_shapes_have_the_sieve_sheet_of_a_recipe():
    bed = recipes.grow(
        recipes.make(
            name="sieved",
            grains={
                "sieves": {"openings": [0.5, 1.0, 2.0], "passing": [0, 40, 100]},
                "shapes": {"kinds": [{"shape": "cube"}, {"shape": "box", "flatness": 0.4}], "count": 120},
            },
        )
    )
    masses = gd.masses(bed)
    assert masses[gd.sieve_diameters(bed) < 1e-3].sum() / masses.sum() == pytest.approx(0.4, abs=5e-3)
