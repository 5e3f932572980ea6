from __future__ import annotations

import json

import numpy as np
import pytest

from grainsdem import recipe as recipes
from grainsdem.dynamics import Progress
from grainsdem.errors import FileFormatError, InputError, MissingFileError, ValidationError
from grainsdem.measures import diameters, masses, percentiles, porosity
from grainsdem.model import Domain
from grainsdem.points import poisson

pytestmark = pytest.mark.unit

SMALL = {
    "rng": 4,
    "domain": {"lengths": [6, 6, 7]},
    "seeds": {"process": "poisson", "count": 250, "relax": 2},
    "grains": {"porosity": 0.4, "median_diameter": 0.72e-3},
}


def test_porosity_and_median_diameter_are_reached_exactly():
    packing = recipes.grow(recipes.make(**SMALL))
    (median,) = percentiles(diameters(packing.grains), (50,), weights=masses(packing))
    assert median == pytest.approx(0.72e-3, rel=1e-12)
    assert porosity(packing) == pytest.approx(0.4, rel=1e-12)


def test_the_recipe_is_the_first_step_of_the_provenance():
    packing = recipes.grow(recipes.make(**SMALL))
    steps = [json.loads(step) for step in packing.provenance]
    assert steps[0]["step"] == "recipe"
    assert steps[0]["seeds"]["count"] == 250
    assert [step["step"] for step in steps[1:]] == ["carve", "shrink", "rescale"]


def test_the_same_rng_grows_the_same_bytes_and_another_does_not():
    one, two = (recipes.grow(recipes.make(**SMALL)) for _ in range(2))
    other = recipes.grow(recipes.make(**{**SMALL, "rng": 5}))
    assert one.grains.vertices.tobytes() == two.grains.vertices.tobytes()
    assert one.positions.tobytes() != other.positions.tobytes()


def test_seeds_of_a_recipe_are_found_beside_it(tmp_path):
    recipe = recipes.make(**SMALL)
    domain = Domain.box(recipe.domain.lengths)
    np.savetxt(tmp_path / "mine.txt", poisson(domain, 300, rng=1), fmt="%.17g")
    (tmp_path / "mine.toml").write_text(
        'seeds = {process = "file", path = "mine.txt"}\ngrains = {scale = 0.8}\ndomain = {lengths = [6, 6, 7]}\n'
    )
    packing = recipes.grow(recipes.read(tmp_path / "mine.toml"))
    assert 30 < len(packing) < 300


def test_the_example_recipe_can_be_read():
    recipe = recipes.read(recipes.EXAMPLE)
    assert recipe.grains.median_diameter == 0.72e-3
    assert recipe.settle.start == "pour"


def test_a_settling_takes_two_materials_and_walls_by_name():
    table = recipes.parse(
        """
        domain = {side = 3e-3}
        seeds = {count = 27}
        grains = {porosity = 0.4}
        [settle]
        friction = {"0.3" = 0.5, "0.6" = 0.5}
        wall_friction = {floor = 0.6, wall_x0 = 0}
        mixing = "min"
        """
    ).settle
    assert table.friction == {0.3: 0.5, 0.6: 0.5}
    assert table.wall_friction == {"floor": 0.6, "wall_x0": 0.0}
    assert table.mixing == "min"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sedes": {}}, "sedes: unknown key; allowed are name, rng, domain, seeds"),
        ({"grains": {"porosty": 0.4}}, "grains.porosty: unknown key; allowed are keep, porosity, solid_fraction"),
        (
            {"settle": {"wall_friction": {"floor": -1}}},
            "settle.wall_friction: must be zero or more and finite, or such",
        ),
        ({"settle": {"friction": {}}}, "settle.friction"),
        ({"settle": {"frictoin": 0.4}}, "settle.frictoin: unknown key; allowed are start, spheres, friction"),
        ({"settle": {"drop_height": 0.01}}, "settle: drop_height needs start = 'rain'; got start = 'pour'"),
        ({"settle": {"start": "rain", "drop_height": 0}}, "settle.drop_height: .*greater than 0; got 0"),
        ({"grains": {"porosity": -0.1}}, "grains.porosity: .*greater than or equal to 0; got -0.1"),
        ({"grains": {"porosity": 0.4, "scale": 0.5}}, "grains: give one of porosity, .*got porosity = 0.4, scale"),
        ({"grains": {}}, "grains: give one of porosity, .* relation; got none"),
        ({"seeds": {"process": "file"}}, "seeds: process 'file' needs path, and no count"),
        (
            {"seeds": {"process": "gibbs", "count": 3}},
            "seeds.process: .*'halton', 'poisson', .*'image' or 'file'; got 'gibbs'",
        ),
        ({"seeds": {"count": 0}}, "seeds.count: .*greater than or equal to 1; got 0"),
        ({"domain": {"lengths": [1, 2]}}, "domain.lengths.2: missing"),
        ({"output": {"formats": ["gltf"]}}, "output: formats must be among xml, usdc, .*stl.*; got gltf"),
        ({"output": {"options": {"hulls": "no"}}}, "output: hulls must be one of any, physx; got 'no'"),
        (
            {"output": {"formats": ["stl"], "options": {"hulls": "any"}}},
            r"output: \.stl has no option hulls; it has binary",
        ),
    ],
)
def test_wrong_keys_and_values_are_refused_with_what_is_allowed(change, words):
    with pytest.raises(InputError, match=words):
        recipes.make(**{**SMALL, **change})


def test_a_recipe_without_seeds_says_what_is_missing():
    with pytest.raises(InputError, match="seeds: missing; grains: missing"):
        recipes.make()


def test_files_that_are_no_recipes_get_one_clear_error(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        recipes.read(tmp_path / "none.toml")
    with pytest.raises(FileFormatError, match=r"\.toml file; got '\.yaml'"):
        recipes.read(tmp_path / "bed.yaml")
    (tmp_path / "bed.toml").write_text("seeds = [\n")
    with pytest.raises(FileFormatError, match="not TOML"):
        recipes.read(tmp_path / "bed.toml")
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(FileFormatError, match=r"bytes\.toml"):
        recipes.read(tmp_path / "bytes.toml")


def test_each_format_gets_the_options_that_it_has(tmp_path):
    options = {"units": "mm", "hulls": "physx"}
    output = {"formats": ["obj", "usda"], "options": options, "figures": False}
    recipes.run(recipes.make(**SMALL, output=output), tmp_path)
    assert (tmp_path / "bed.obj").read_text().startswith("# unit 0.001 m\n")
    assert "metersPerUnit = 0.001" in (tmp_path / "bed.usda").read_text()


@pytest.mark.slow
def test_a_bed_that_fails_validation_is_not_written(tmp_path):
    few = {"domain": {"lengths": [3, 3, 3]}, "seeds": {"process": "poisson", "count": 27, "relax": 2}}
    few["grains"] = {**SMALL["grains"], "keep": "all"}
    recipe = recipes.make(**few, settle={"overlap": 1e-12}, output={"figures": False})
    with pytest.raises(ValidationError, match="overlaps"):
        recipes.run(recipe, tmp_path)
    assert (tmp_path / "bed.xml").exists()
    assert not (tmp_path / "settled.h5").exists()
    assert not (tmp_path / "settled.xml").exists()


def test_settling_is_told_as_a_fraction_that_never_falls():
    told = []
    hear = recipes.settling_words(lambda fraction, words: told.append((fraction, words)))
    energies = [1e-3, 5.0, 8.0, 1e-1, 3e-1, 1e-4, 1e-6]
    for k, energy in enumerate(energies):
        hear(Progress(time=0.01 * k, limit=10.0, energy=energy, goal=1e-6, n_contacts=k))
    fractions = [fraction for fraction, _ in told]
    assert fractions == sorted(fractions)
    assert fractions[-1] == pytest.approx(1.0)
    assert "1e-04 → 1e-06 mgd, 5 contacts" in told[5][1]
