from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import grainsdem as gd
from grainsdem import recipe as recipes
from grainsdem.errors import InputError, ShapeError
from grainsdem.tessellation.layered import Layer, layered_cells
from grainsdem.tessellation.lenses import Lens

FINE = gd.Grading([0.5e-3, 1e-3], [0.0, 1.0])
COARSE = gd.Grading([1e-3, 1.5e-3, 2e-3], [0.0, 0.5, 1.0], "sieve")
SEEDS = {"process": "poisson", "count": 700}
TABLES = [
    {"thickness": 2, "sieves": {"openings": [2, 1.5, 1], "passing": [100, 50, 0], "relaxations": 2}, "density": 3000.0},
    {"thickness": 1, "sizes": {"law": "uniform", "parameters": {"loc": 0.5e-3, "scale": 0.5e-3}, "relaxations": 2}},
]


@pytest.mark.parametrize("keep", ["inside", "all"])
def test_each_layer_has_its_curve_its_thickness_and_its_class(keep):
    domain = gd.Domain.box((1.0, 1.0, 1.2))
    found = layered_cells(domain, [Layer(FINE), Layer(COARSE, 2)], n=900, keep=keep, relaxations=2, rng=1)
    bed = gd.carve(found.cells, keep=keep, classes=found.classes)
    bed = gd.resize(gd.shrink(bed, porosity=0.4), diameters=found.diameters)
    sizes = {0: gd.diameters(bed), 1: gd.sieve_diameters(bed)}
    masses = gd.masses(bed)
    for k, curve in enumerate((FINE, COARSE)):
        rows = bed.classes == k
        for opening, share in zip(curve.openings, curve.passing, strict=True):
            passed = masses[rows][sizes[k][rows] < opening].sum() / masses[rows].sum()
            assert passed == pytest.approx(share, abs=0.02)
    # Interfaces lie where they were asked for, as rough as one grain of the coarser side.
    content = gd.volumes(found.cells.cells)
    assert content[found.classes == 0].sum() / domain.volume == pytest.approx(1 / 3, abs=0.03)
    widest = np.cbrt(6 / np.pi * content.max())
    centroids = found.cells.sites[:, 2]
    assert centroids[found.classes == 0].max() < 0.4 + widest
    assert centroids[found.classes == 1].min() > 0.4 - widest
    assert gd.validate(bed).ok


def test_planar_beds_are_layered_along_y():
    domain = gd.Domain.slab((1.0, 1.0), 0.05)
    law = stats.uniform(1e-3, 1e-3)
    layers = [Layer(law), Layer(stats.uniform(2e-3, 1e-3))]
    found = layered_cells(domain, layers, n=300, keep="all", relaxations=2, rng=1)
    heights = [found.cells.sites[found.classes == k, 1].mean() for k in (0, 1)]
    assert heights == pytest.approx([0.25, 0.75], abs=0.05)


def test_a_recipe_makes_layers_whose_class_and_density_stay_with_the_grains(tmp_path):
    made = recipes.make(seeds=SEEDS, grains={"porosity": 0.4, "layer": TABLES})
    bed = recipes.grow(made)
    assert set(bed.classes.tolist()) == {0, 1}
    assert set(bed.densities[bed.classes == 0].tolist()) == {3000.0}
    assert set(bed.densities[bed.classes == 1].tolist()) == {2650.0}
    holes, masses = gd.sieve_diameters(bed), gd.masses(bed)
    rows = bed.classes == 0
    assert masses[rows & (holes < 1.5e-3)].sum() / masses[rows].sum() == pytest.approx(0.5, abs=0.02)
    sizes = gd.diameters(bed)[~rows]
    assert (sizes > 0.49e-3).all()
    assert (sizes < 1.01e-3).all()
    gd.save(bed, tmp_path / "bed.h5")
    poured = gd.shuffle(gd.load(tmp_path / "bed.h5"), rng=1)
    assert np.bincount(poured.classes).tolist() == np.bincount(bed.classes).tolist()
    assert gd.table(poured, sieves=False)["class"].tolist() == poured.classes.tolist()
    assert sorted(gd.diameters(poured)[poured.classes == 1]) == pytest.approx(sorted(sizes), rel=1e-12)


@pytest.mark.slow
def test_files_of_layers_are_beside_the_recipe_and_the_count_follows_from_the_domain(tmp_path):
    (tmp_path / "coarse.csv").write_text("mm,passing\n1,0\n1.5,50\n2,100\n", encoding="utf-8")
    (tmp_path / "bed.toml").write_text(
        '[domain]\nside = 6e-3\n[seeds]\nprocess = "poisson"\n[grains]\nporosity = 0.4\nkeep = "all"\n'
        '[[grains.layer]]\nsieves = {path = "coarse.csv", relaxations = 1}\n'
        '[[grains.layer]]\nsizes = {law = "uniform", parameters = {loc = 0.5e-3, scale = 0.5e-3}, relaxations = 1}\n',
        encoding="utf-8",
    )
    bed = recipes.grow(recipes.read(tmp_path / "bed.toml"))
    assert bed.domain.lengths == pytest.approx(6e-3)
    assert gd.diameters(bed)[bed.classes == 1].max() == pytest.approx(1e-3, rel=0.02)


@pytest.mark.parametrize(
    ("tables", "words"),
    [
        ({"grains": {"layer": [{}]}}, "a layer has sizes or sieves, one of the two"),
        ({"grains": {"layer": [{"sizes": {"diameters": [1.0]}}]}}, "a layer's sizes follow a law"),
        ({"grains": {"layer": [{**TABLES[0], "thickness": 0}]}}, "thickness: .*greater than 0; got 0"),
        ({"grains": {"layer": TABLES, "sieves": TABLES[0]["sieves"]}}, "sizes, sieves and layers; got sieves, layer"),
        ({"grains": {"layer": TABLES, "mean_diameter": 1e-3}}, "layers say how large grains are"),
        ({"grains": {"layer": TABLES, "axes": {"flatness": 0.5, "dip": 0.1}}}, "layers are level"),
        ({"grains": {"layer": TABLES}, "seeds": {"process": "halton", "count": 9}}, "each layer has seeds of its own"),
        ({"grains": {"layer": TABLES}, "seeds": {**SEEDS, "relax": 2}}, "each layer has seeds of its own.* relax = 2"),
    ],
)
def test_layers_without_a_meaning_get_one_line(tables, words):
    grains = {"porosity": 0.4, **tables.pop("grains")}
    with pytest.raises(InputError, match=words):
        recipes.make(**{"seeds": SEEDS, "grains": grains, **tables})


def test_layers_that_cannot_be_had_are_refused():
    with pytest.raises(InputError, match="layer 2 is thinner than its largest grain"):
        layered_cells(gd.Domain.cube(), [Layer(FINE), Layer(COARSE, 0.05)], n=500, rng=1)
    with pytest.raises(InputError, match=r"layer 2 would have \d of 40 grains, at least 8"):
        layered_cells(gd.Domain.box((1.0, 1.0, 4.0)), [Layer(FINE), Layer(COARSE)], n=40, rng=1)
    with pytest.raises(InputError, match="a layer or more; got none"):
        layered_cells(gd.Domain.cube(), [], n=40, rng=1)
    with pytest.raises(InputError, match="positive and finite; got -1"):
        Layer(FINE, -1)
    cells = gd.tessellate(gd.points.poisson(gd.Domain.cube(), 20, rng=1), gd.Domain.cube())
    with pytest.raises(ShapeError, match="one class for each of the 20 cells"):
        gd.carve(cells, keep="all", classes=[1, 2])


def test_a_lens_replaces_what_is_there_with_an_interface_sharp_to_one_grain():
    domain = gd.Domain.box((1.0, 1.0, 0.8))
    lens = Lens((0.5, 0.5, 0.4), (0.45, 0.4, 0.22), trend=0.5, dip=0.1)
    found = layered_cells(domain, [Layer(COARSE), Layer(FINE, lens=lens)], n=1200, keep="all", relaxations=2, rng=1)
    content = gd.volumes(found.cells.cells)
    share = 4 / 3 * np.pi * 0.45 * 0.4 * 0.22 / domain.volume
    assert content[found.classes == 1].sum() / domain.volume == pytest.approx(share, abs=0.02)
    # Every fine grain's cell has its seed within a coarse grain of the lens, and no coarse one is deeper in it.
    widest = np.cbrt(6 / np.pi * content.max())
    wider, narrower = (Lens(lens.center, tuple(half + by for half in lens.half_axes), trend=0.5, dip=0.1)
                       for by in (widest, -0.4 * widest))  # fmt: skip
    assert wider.contains(found.cells.sites[found.classes == 1], domain).all()
    assert not narrower.contains(found.cells.sites[found.classes == 0], domain).any()
    bed = gd.resize(gd.carve(found.cells, keep="all", classes=found.classes), diameters=found.diameters)
    masses, holes, sizes = gd.masses(bed), gd.sieve_diameters(bed), gd.diameters(bed)
    coarse, fine = bed.classes == 0, bed.classes == 1
    assert masses[coarse & (holes < 1.5e-3)].sum() / masses[coarse].sum() == pytest.approx(0.5, abs=0.02)
    middle = FINE.percentile(50)
    assert masses[fine & (sizes < middle)].sum() / masses[fine].sum() == pytest.approx(0.5, abs=0.02)


def test_a_layer_fines_upward_from_one_sheet_to_another():
    domain = gd.Domain.box((1.0, 1.0, 2.0))
    bottom, top = gd.Grading([1e-3, 2e-3], [0.0, 1.0]), gd.Grading([0.5e-3, 1e-3], [0.0, 1.0])
    found = layered_cells(domain, [Layer(bottom, top=top)], n=900, keep="all", relaxations=2, rng=1)
    assert set(found.classes.tolist()) == {0}
    bed = gd.resize(gd.carve(found.cells, keep="all"), diameters=found.diameters)
    heights = (bed.positions[:, 2] / bed.domain.lengths[2]).clip(0, 1)
    sizes, masses = gd.diameters(bed), gd.masses(bed)
    for low in (0.0, 0.25, 0.5, 0.75):
        rows = (heights >= low) & (heights < low + 0.25)
        order = np.argsort(sizes[rows])
        running = np.cumsum(masses[rows][order]) / masses[rows].sum()
        found_median = sizes[rows][order][np.searchsorted(running, 0.5)]
        # In steps of a sixth of the height, each with its own curve; strata of a quarter cut through grains.
        assert found_median == pytest.approx(bottom.toward(top, low + 0.125).percentile(50), rel=0.12)


@pytest.mark.slow
def test_a_recipe_has_lenses_and_layers_that_fine_upward():
    lens = {"center": [0.5, 0.5, 0.5], "half_axes": [0.4, 0.4, 0.2], "form": "box"}
    law = {"law": "uniform", "parameters": {"loc": 0.8e-3, "scale": 0.2e-3}, "relaxations": 1}
    sheet, top = ({"openings": sizes, "passing": [100, 0], "relaxations": 1, "diameter": "equal-volume"}
                  for sizes in ([2.0, 1.4], [1.4, 1.0]))  # fmt: skip
    layers = [{"sieves": sheet, "top": top}, {"sizes": law, "lens": lens}]
    bed = recipes.grow(
        recipes.make(seeds={**SEEDS, "count": 900}, grains={"porosity": 0.3, "keep": "all", "layer": layers})
    )
    places = bed.positions / bed.domain.lengths
    assert (np.abs(places[bed.classes == 1] - 0.5) < [0.5, 0.5, 0.3]).all()
    coarse = bed.classes == 0
    halves = [gd.diameters(bed)[coarse & rows].mean() for rows in (places[:, 2] < 0.4, places[:, 2] > 0.6)]
    assert halves[1] < 0.92 * halves[0]


@pytest.mark.unit
@pytest.mark.parametrize(
    ("layers", "words"),
    [
        ([Layer(FINE, lens=Lens((0.5, 0.5, 0.5), (0.3, 0.3, 0.3)))], "a layer or more besides its lenses"),
        (
            [Layer(FINE), Layer(FINE, lens=Lens((5, 5, 5), (0.3, 0.3, 0.3)))],
            r"lens 2 lies outside of the bed.*\[5.0, 5.0, 5.0\]",
        ),
        (
            [Layer(FINE), Layer(COARSE, lens=Lens((0.5, 0.5, 0.5), (0.3, 0.3, 0.01)))],
            "lens 2 is thinner than its largest",
        ),
    ],
)
def test_lenses_that_cannot_be_had_are_refused(layers, words):
    with pytest.raises(InputError, match=words):
        layered_cells(gd.Domain.cube(), layers, n=500, rng=1)


@pytest.mark.unit
def test_lenses_without_a_meaning_are_refused():
    with pytest.raises(InputError, match="half axes of a lens must be positive"):
        Lens((0, 0, 0), (1, 0, 1))
    with pytest.raises(InputError, match="form must be 'ellipsoid' or 'box'; got 'egg'"):
        Lens((0, 0, 0), (1, 1, 1), "egg")
    with pytest.raises(InputError, match="a lens has one curve"):
        Layer(FINE, top=FINE, lens=Lens((0, 0, 0), (1, 1, 1)))
    with pytest.raises(InputError, match="two gradings of one diameter"):
        Layer(FINE, top=COARSE)
    with pytest.raises(InputError, match="no lenses"):
        layered_cells(gd.Domain.slab((1, 1), 0.1), [Layer(FINE), Layer(FINE, lens=Lens((0, 0, 0), (1, 1, 1)))], n=99)
