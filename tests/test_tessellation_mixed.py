from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import grainsdem as gd
from grainsdem.errors import ConvergenceError, InputError
from grainsdem.geometry.separation import bodies, offsets_between
from grainsdem.tessellation.ellipsoids import grown
from grainsdem.tessellation.forms import CLASSES, Forms, mean_square
from grainsdem.validation.intersections import intersection_volumes

WRAPPED = gd.Domain.cube(periodic=True)
SHARES = {"disc": 0.3, "spheroid": 0.4, "blade": 0.1, "rod": 0.2}


@pytest.fixture(scope="module")
def classes():
    return gd.mixed_cells(WRAPPED, Forms(SHARES), n=200, keep="all", rng=1)


@pytest.fixture(scope="module")
def aligned():
    forms = Forms(elongation=0.6, flatness=0.6, orientation="aligned", spread=0.3, trend=0.7, dip=0.4)
    return gd.mixed_cells(WRAPPED, forms, n=200, keep="all", rng=1)


def test_zingg_classes_have_their_shares(classes):
    bed = gd.carve(classes.cells, keep="all")
    found = gd.zingg(gd.box_axes(bed))
    for name, share in SHARES.items():
        # Within 5 % of the share, or one grain.
        assert abs(np.count_nonzero(found == name) - 200 * share) <= max(0.05 * 200 * share, 1)


def test_grains_that_lie_any_way_have_an_orientation_tensor_of_thirds(classes):
    bed = gd.carve(classes.cells, keep="all")
    for axis in "abc":
        # Diagonal entries of n axes at random have the variance 4 / 45 n, others 1 / 15 n.
        off = np.abs(gd.orientation_tensor(bed, axis) - np.eye(3) / 3)
        assert (off <= 5 * np.sqrt(np.where(np.eye(3) == 1, 4 / 45, 1 / 15) / len(bed))).all()


def test_mixed_grains_are_apart_and_have_the_porosity_of_the_domain_exactly(classes):
    assert 0.9 < classes.cells.fill < 1
    touching = gd.carve(classes.cells, keep="all")
    assert gd.porosity(touching) == pytest.approx(1 - classes.cells.fill, rel=1e-12)
    assert gd.validate(touching, overlap=1e-9).ok
    bed = gd.shrink(touching, porosity=0.4)
    assert gd.volumes(bed).sum() == pytest.approx(0.6 * WRAPPED.volume, rel=1e-12)
    assert gd.validate(bed).ok
    with pytest.raises(InputError, match=r"porosity can only grow: the packing has 0\.0"):
        gd.shrink(touching, porosity=0.01)


@pytest.mark.client
def test_manifold3d_finds_no_overlap_of_grains_that_fill_their_cells(aligned):
    bed = gd.carve(aligned.cells, keep="all")
    links = bed.links
    first = np.repeat(np.arange(len(bed)), np.diff(bed.grains.face_offsets))
    is_here = (links.shifts == 0).all(axis=1) & (links.neighbors > first)
    pairs = np.column_stack([first, links.neighbors])[is_here][:200].astype(np.int32)
    assert len(pairs) == 200
    shared = intersection_volumes(bed.grains, bodies(bed), pairs, offsets_between(bed, pairs))
    assert shared.max() <= 1e-9 * gd.volumes(bed).min()


def test_means_of_ratios_and_the_spread_of_axes_are_those_asked_for(aligned):
    bed = gd.carve(aligned.cells, keep="all")
    rows = gd.table(bed, sieves=False)
    assert rows["elongation"].mean() == pytest.approx(0.6, rel=0.02)
    assert rows["flatness"].mean() == pytest.approx(0.6, rel=0.02)
    long, short = np.array([np.cos(0.7) * np.cos(0.4), np.sin(0.7) * np.cos(0.4), np.sin(0.4)]), None
    short = np.array([-np.cos(0.7) * np.sin(0.4), -np.sin(0.7) * np.sin(0.4), np.cos(0.4)])
    for axis, direction in (("a", long), ("c", short)):
        values, vectors = np.linalg.eigh(gd.orientation_tensor(bed, axis))
        cosines = (gd.principal_axes(bed)[:, "abc".index(axis)] @ direction) ** 2
        # Cells lie a few degrees off what was asked of each: 0.03 of the mean square besides chance.
        assert cosines.mean() == pytest.approx(mean_square(0.3), abs=5 * cosines.std() / np.sqrt(200) + 0.03)
        assert abs(vectors[:, 2] @ direction) > np.cos(0.1)
        assert values[2] > 0.7


@pytest.mark.statistical
def test_axes_asked_for_have_the_mean_square_of_turns_by_normal_vectors():
    drawn = Forms(elongation=0.7, orientation="aligned", spread=0.5, trend=1.0).draw(20000, np.random.default_rng(3))
    for k, axis in enumerate(([np.cos(1), np.sin(1), 0], [-np.sin(1), np.cos(1), 0], [0, 0, 1])):
        squares = (drawn.axes[:, k] @ np.array(axis)) ** 2
        assert squares.mean() == pytest.approx(mean_square(0.5), abs=5 * squares.std() / np.sqrt(20000))
    assert np.abs(np.einsum("nij,nkj->nik", drawn.axes, drawn.axes) - np.eye(3)).max() < 1e-12
    assert mean_square(0.0) == 1


def test_cells_of_one_form_fill_space_as_laguerre_cells_of_a_stretched_one_do():
    seeds = gd.points.poisson(gd.Domain.cube(), 60, rng=1)
    weights = np.random.default_rng(2).uniform(0, 0.001, 60)
    metric = gd.Metric.along((0.6, 0.5), trend=0.4, dip=0.2)
    plain = gd.tessellate(metric.back(seeds), metric.unstretched(gd.Domain.cube()), weights=weights)
    inverse = np.linalg.inv(metric.matrix)
    form = np.repeat((inverse @ inverse)[None], 60, axis=0)
    cells, reach = grown(gd.Domain.cube(), seeds, weights, form, np.full((60, 3), 0.1))
    assert gd.volumes(cells.cells) == pytest.approx(gd.volumes(plain.cells), abs=1e-9)
    assert gd.volumes(cells.cells).sum() == pytest.approx(1, rel=1e-9)
    assert (reach > 0).any()


def test_a_curve_of_sizes_is_had_by_mixed_grains_that_are_kept():
    law = stats.lognorm(s=0.2, scale=1e-3)
    forms = Forms(elongation=0.7, flatness=0.7)
    found = gd.mixed_cells(gd.Domain.cube(), forms, n=250, curve=law, rng=1)
    bed = gd.resize(gd.carve(found.cells), diameters=found.diameters)
    sizes = np.sort(gd.diameters(bed))
    asked = law.ppf((np.arange(sizes.size) + 0.5) / sizes.size)
    # Three in a hundred are trimmed to no size, being too small.
    assert np.median(np.abs(sizes / asked - 1)) < 1e-3
    assert gd.validate(bed).ok
    # No warning of sizes that are missed: those that are kept have the curve.
    assert not found.cells.weights.any()


@pytest.mark.unit
def test_ratios_of_a_law_are_its_quantiles_whichever_grains_are_kept():
    forms = Forms(elongation=stats.uniform(0.5, 0.3), flatness=stats.uniform(0.4, 0.4))
    drawn = forms.draw(50, np.random.default_rng(1))
    kept = np.arange(50) % 3 > 0
    ratios = forms.ratios(forms.dealt(drawn, kept, forms.shares))[kept]
    m = np.count_nonzero(kept)
    assert np.sort(ratios[:, 0]) == pytest.approx(0.5 + 0.3 * (np.arange(m) + 0.5) / m)
    mixed = Forms(SHARES)
    drawn = mixed.dealt(mixed.draw(50, np.random.default_rng(1)), kept, mixed.shares)
    names = np.array(mixed.names)[drawn.kinds][kept]
    assert {name: np.count_nonzero(names == name) for name in SHARES} == {
        "disc": 10, "spheroid": 13, "blade": 3, "rod": 7
    }  # fmt: skip
    for row, name in zip(mixed.ratios(drawn)[kept], names, strict=True):
        assert all(low <= value <= high for value, (low, high) in zip(row, CLASSES[name], strict=True))


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "have classes, or an elongation, a flatness or both"),
        ({"classes": SHARES, "flatness": 0.5}, "have classes, or an elongation"),
        ({"classes": {"disc": 0.3, "rod": 0.6}}, r"must sum up to 1; those of disc, rod sum up to 0\.9"),
        ({"classes": {"disc": 1.3, "rod": -0.3}}, "zero or more and finite"),
        ({"classes": {"pancake": 1.0}}, "classes are blade, rod, disc, spheroid; got pancake"),
        ({"elongation": 1.2}, r"elongation of grains that differ lies from 0\.2 to 1; got 1\.2"),
        ({"flatness": 0.1}, r"flatness of grains that differ lies from 0\.2 to 1; got 0\.1"),
        ({"elongation": stats.norm(0.8, 0.2)}, "got a law from"),
        ({"elongation": 0.5, "orientation": "up"}, "'uniform' or 'aligned'; got 'up'"),
        ({"elongation": 0.5, "spread": 0.2}, "have no spread, trend and dip"),
        ({"elongation": 0.5, "orientation": "aligned", "spread": -1}, "spread .* from 0 to 1, .*got -1"),
    ],
)
def test_forms_that_are_none_get_one_line(options, words):
    with pytest.raises(InputError, match=words):
        Forms(**options)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("domain", "options", "words"),
    [
        (gd.Domain.slab((1, 1), 0.1), {"n": 20}, "grains of a slab are prisms"),
        (gd.Domain.cube(), {}, "give n"),
        (gd.Domain.cube(), {"n": 20, "keep": "some"}, "keep must be"),
        (gd.Domain.cube(), {"n": 6}, "touch a wall"),
    ],
)
def test_mixed_cells_that_cannot_be_had_get_one_line(domain, options, words):
    with pytest.raises(InputError, match=words):
        gd.mixed_cells(domain, Forms(elongation=0.6), rng=1, **options)


@pytest.mark.slow
def test_forms_out_of_reach_are_told_with_how_near_they_came():
    with pytest.raises(ConvergenceError, match="times what is allowed"):
        gd.mixed_cells(gd.Domain.cube(), Forms(elongation=0.98, flatness=0.98), n=100, rng=1)
