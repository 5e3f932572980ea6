from __future__ import annotations

import numpy as np
import pytest

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.errors import InputError
from grainsdem.geometry.separation import bodies, offsets_between
from grainsdem.packing.infill import coarse_solid_fraction
from grainsdem.validation.intersections import intersection_volumes


def coarse(domain, n=40, keep="all", **void):
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=5)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep=keep), **(void or {"porosity": 0.4}))


@pytest.fixture(scope="module", params=["walls", "wrapped"])
def filled(request):
    bed = coarse(gd.Domain.cube(0.01, periodic=request.param == "wrapped"))
    return bed, gd.infill(bed, share=0.2, diameter=1e-3, density=3000.0, relaxations=4, rng=1)


def test_an_infill_has_its_share_of_the_mass_and_leaves_the_porosity_that_follows(filled):
    bed, found = filled
    masses = gd.masses(found)
    fine = found.classes == 1
    assert masses[fine].sum() / masses.sum() == pytest.approx(0.2, rel=1e-12)
    solid = gd.volumes(bed).sum() + 0.25 * gd.masses(bed).sum() / 3000
    assert gd.porosity(found, region="domain") == pytest.approx(1 - solid / bed.domain.volume, rel=1e-9)
    # The diameter of the mean volume, to half a grain of so many.
    mean = np.cbrt(6 / np.pi * gd.volumes(found)[fine].mean())
    assert mean == pytest.approx(1e-3, rel=1 / np.count_nonzero(fine))
    assert found.positions[~fine].tobytes() == bed.positions.tobytes()


def test_no_grain_of_an_infill_overlaps_another_by_planes_and_by_manifold3d(filled):
    _, found = filled
    assert gd.validate(found).ok
    away = found.positions[:, None] - found.positions[found.classes == 0]
    nearest = np.argmin((away**2).sum(axis=2), axis=1)
    fine = np.flatnonzero(found.classes == 1)[:100]
    pairs = np.column_stack([nearest[fine], fine]).astype(np.int32)
    shared = intersection_volumes(found.grains, bodies(found), pairs, offsets_between(found, pairs))
    assert shared.max() <= 1e-9 * gd.volumes(found).min()


def test_a_recipe_and_a_command_make_an_infill_with_the_porosity_of_the_whole(tmp_path):
    made = recipes.make(
        domain={"side": 0.01},
        seeds={"process": "poisson", "count": 40, "relax": 3},
        grains={"porosity": 0.25, "keep": "all", "infill": {"share": 0.2, "diameter": 1e-3, "relaxations": 2}},
    )
    bed = recipes.grow(made)
    assert gd.porosity(bed, region="domain") == pytest.approx(0.25, rel=1e-9)
    assert set(bed.classes.tolist()) == {0, 1}
    from typer.testing import CliRunner

    from grainsdem.cli import app

    told = [
        "--count",
        "30",
        "--side",
        "0.01",
        "--keep",
        "all",
        "--porosity",
        "0.3",
        "--infill",
        "0.1",
        "--infill-diameter",
        "1e-3",
        "--quiet",
    ]
    done = CliRunner().invoke(app, ["generate", str(tmp_path / "bed.h5"), *told])
    assert done.exit_code == 0, done.output
    masses, classes = gd.masses(gd.load(tmp_path / "bed.h5")), gd.load(tmp_path / "bed.h5").classes
    assert masses[classes == 1].sum() / masses.sum() == pytest.approx(0.1, rel=1e-9)


@pytest.mark.unit
def test_the_solid_fraction_of_coarse_grains_is_what_the_infill_leaves():
    assert coarse_solid_fraction(0.4, 0.25, 2650, 2650) == pytest.approx(0.45)
    # As much mass of twice the density takes half of the volume.
    assert coarse_solid_fraction(0.4, 0.5, 2000, 4000) == pytest.approx(0.4)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"share": 0.9}, r"cannot hold an infill of 0\.9 of the mass: the most .* is 0\.4"),
        ({"share": 0.36, "relaxations": 0}, r"cannot hold an infill of 0\.36 of the mass: the most .* is 0\.\d"),
        ({"share": 0.0}, "between 0 and 1; got 0"),
        ({"diameter": -1}, "diameter must be 1e-30 to 1e.30 m; got -1"),
        ({"diameter": 1e-9}, "at most 1000000 are allowed"),
        ({"density": 0}, "density must be positive and finite; got 0"),
        ({"relaxations": -1}, "relaxations must be zero or more, at most 100000; got -1"),
    ],
)
def test_infills_that_cannot_be_had_get_one_line(filled, options, words):
    with pytest.raises(InputError, match=words):
        gd.infill(filled[0], **{"share": 0.1, "diameter": 1e-3, "rng": 1, **options})


@pytest.mark.unit
def test_an_infill_goes_into_the_voids_of_a_whole_domain():
    bed = coarse(gd.Domain.cube(0.01), n=120, keep="inside")
    with pytest.raises(InputError, match="carve with keep='all'"):
        gd.infill(bed, share=0.1, diameter=1e-3)
    with pytest.raises(InputError, match="have left their cells"):
        gd.infill(gd.shuffle(bed, rng=1), share=0.1, diameter=1e-3)
    with pytest.raises(InputError, match="one grain thick"):
        gd.infill(coarse(gd.Domain.slab((1, 1), 0.1)), share=0.1, diameter=0.1)
    seeds = {"process": "poisson", "count": 40}
    one = {"share": 0.2, "diameter": 1e-3}
    for grains, words in (
        ({"scale": 0.8, "infill": one}, "porosity, solid_fraction or void_ratio of the whole"),
        ({"porosity": 0.4, "throats": {}, "infill": one}, "have no throats"),
        ({"porosity": 0.4, "infill": {**one, "share": 1.5}}, "share: .*less than 1; got 1.5"),
    ):
        with pytest.raises(InputError, match=words):
            recipes.make(seeds=seeds, grains=grains)
