from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import core_box, diameters, masses, percentiles, porosity
from grainsdem.model import Domain
from grainsdem.packing import carve, contacts, jitter_throats, rescale, resize, shrink, throat_widths
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate
from grainsdem.validation import validate

pytestmark = pytest.mark.unit


def slab_bed(n=200):
    slab = Domain.slab((1.0, 1.0), 0.05, periodic=True)
    return carve(tessellate(poisson(slab, n, rng=2), slab))


@pytest.mark.parametrize(
    ("options", "phi"),
    [({"porosity": 0.37}, 0.37), ({"solid_fraction": 0.6}, 0.4), ({"void_ratio": 0.85}, 0.85 / 1.85)],
)
def test_every_measure_of_void_is_reached_exactly_in_space_and_in_the_plane(cells, options, phi):
    for bed in (carve(cells), slab_bed()):
        assert porosity(shrink(bed, **options)) == pytest.approx(phi, rel=1e-12)


@pytest.mark.parametrize("about", ["centroid", "seed", "vertex_mean"])
def test_porosity_inside_a_box_is_reached_exactly(cells, about):
    bed = carve(cells)
    box = ([2e-3, 2e-3, 2e-3], [4e-3, 4.1e-3, 4.7e-3])
    assert porosity(shrink(bed, porosity=0.42, region=box, about=about), region=box) == pytest.approx(0.42, rel=1e-10)


def test_porosity_of_a_periodic_box_and_of_the_domain_is_reached_exactly():
    bed = slab_bed()
    box = ([0.1, 0.2, 0.0], [0.9, 0.7, 0.05])
    assert porosity(shrink(bed, porosity=0.42, region=box), region=box) == pytest.approx(0.42, rel=1e-10)
    assert porosity(shrink(bed, porosity=0.3, region="domain"), region="domain") == pytest.approx(0.3, rel=1e-10)


def test_a_region_already_emptier_than_asked_is_refused_with_what_it_has(cells):
    bed = carve(cells)
    emptiness = porosity(bed, region="domain")
    with pytest.raises(InputError, match=f"has {emptiness:.6g} already; got 0.1"):
        shrink(bed, porosity=0.1, region="domain")


def test_equation_5_holds_for_every_vertex(cells):
    bed = carve(cells)
    F = 0.8
    for about, centres in (
        ("centroid", bed.positions),
        ("seed", bed.links.sites),
        (
            "vertex_mean",
            np.array([v.mean(axis=0) for v in map(bed.grains.vertices_of, range(len(bed)))]) + bed.positions,
        ),
    ):
        counts = np.diff(bed.grains.vertex_offsets)
        expected = F * world_vertices(bed) + (1 - F) * np.repeat(centres, counts, axis=0)
        np.testing.assert_allclose(world_vertices(shrink(bed, scale=F, about=about)), expected, atol=1e-15)
        np.testing.assert_allclose(world_vertices(shrink(bed, scale=F, about=centres)), expected, atol=1e-15)


def test_prisms_keep_their_height_and_place_whatever_they_shrink_about():
    bed = slab_bed()
    for about in ("centroid", "seed", "vertex_mean"):
        z = world_vertices(shrink(bed, porosity=0.4, about=about))[:, 2]
        np.testing.assert_allclose(z, world_vertices(bed)[:, 2], atol=1e-15)


def test_a_point_outside_its_cell_is_refused_and_says_whose(cells):
    bed = carve(cells)
    points = bed.positions.copy()
    points[3] += 1e-2
    with pytest.raises(InputError, match=f"1 of {len(bed)} lie outside: 3"):
        shrink(bed, scale=0.9, about=points)


def test_grains_in_cells_that_are_not_known_can_shrink_about_points_in_themselves(poured):
    assert validate(shrink(poured, scale=0.5, about=poured.positions)).ok
    with pytest.raises(InputError, match="lie outside"):
        shrink(poured, scale=0.5, about=poured.positions + 1e-2)
    with pytest.raises(InputError, match="does not know its seeds"):
        shrink(poured, scale=0.5, about="seed")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"void_ratio": -0.1}, "void_ratio must be zero or more"),
        ({"void_ratio": np.inf}, "void_ratio must be zero or more and finite; got inf"),
        ({"solid_fraction": 0.0}, r"solid_fraction must lie in \(0, 1\]; got 0"),
        ({"solid_fraction": 0.5, "void_ratio": 1.0}, "got solid_fraction=0.5, void_ratio=1.0"),
        ({"scale": 0.5, "about": "middle"}, "'centroid', 'seed' or 'vertex_mean' or an array of numbers; got 'middle'"),
        ({"scale": 0.5, "about": [[0, 0, 0]]}, "finite points"),
        ({"porosity": 0.5, "region": "hull"}, "'cells' or 'domain' or 2 values"),
        ({"porosity": 0.5, "region": 3}, "'cells' or 'domain' or 2 values"),
    ],
)
def test_what_cannot_be_is_refused_with_what_is_allowed(fresh, options, words):
    with pytest.raises(InputError, match=words):
        shrink(fresh, **options)


def lattice(planar):
    """Return the cells of a square or cubic lattice of unit spacing, which wraps around."""
    side = 6
    domain = Domain.slab((side, side), 0.25, periodic=True) if planar else Domain.cube(float(side), periodic=True)
    axes = [np.arange(side) + 0.5] * 2 + [[0.125] if planar else np.arange(side) + 0.5]
    return carve(tessellate(np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 3), domain))


@pytest.mark.parametrize(("planar", "solid"), [(False, 0.8**3), (True, 0.8**2)])
def test_a_gap_takes_half_of_itself_off_every_face(planar, solid):
    bed = shrink(lattice(planar), gap=0.2)
    assert porosity(bed) == pytest.approx(1 - solid, rel=1e-12)
    np.testing.assert_allclose(throat_widths(bed), 0.2, rtol=1e-12)


def periodic_bed(n=300):
    domain = Domain.cube(6e-3, periodic=True)
    return carve(tessellate(relax(poisson(domain, n, rng=2), domain, iterations=2), domain))


@pytest.mark.parametrize("bed", [periodic_bed(), slab_bed(50)], ids=["space", "plane"])
def test_all_throats_are_as_wide_as_the_gap_and_no_grains_are_nearer(bed):
    gap = 0.05 * float(diameters(bed.grains).mean())
    apart = shrink(bed, gap=gap)
    np.testing.assert_allclose(throat_widths(apart), gap, rtol=1e-9)
    assert len(contacts(apart, within=gap * (1 - 1e-9))) == 0
    assert len(contacts(apart, within=gap * (1 + 1e-9))) > len(bed)
    assert json.loads(apart.provenance[-1]) == {"step": "shrink", "gap": gap}


def test_a_gap_does_not_depend_on_what_was_done_to_the_grains_before():
    bed = periodic_bed()
    gap = 0.05 * float(diameters(bed.grains).mean())
    at_once = shrink(bed, gap=gap)
    for before in (
        shrink(bed, scale=0.985),
        shrink(bed, scale=0.985, about="seed"),
        shrink(bed, gap=0.3 * gap),
        jitter_throats(shrink(bed, scale=0.985), rng=1, strength=0.5),
    ):
        after = shrink(before, gap=gap)
        np.testing.assert_allclose(volumes(after.grains), volumes(at_once.grains), rtol=1e-6)
        np.testing.assert_allclose(after.positions, at_once.positions, atol=1e-6 * gap)
    np.testing.assert_allclose(volumes(shrink(at_once, gap=gap).grains), volumes(at_once.grains), rtol=1e-12)


def test_walls_keep_half_the_gap():
    domain = Domain.cube()
    bed = shrink(carve(tessellate(relax(poisson(domain, 60, rng=1), domain), domain), keep="all"), gap=0.02)
    vertices = world_vertices(bed)
    np.testing.assert_allclose([vertices.min(axis=0), vertices.max(axis=0)], [[0.01] * 3, [0.99] * 3], atol=1e-12)


def test_grains_apart_by_a_gap_can_be_scaled_and_moved_within_their_cells_without_overlap():
    bed = periodic_bed()
    gap = 0.05 * float(diameters(bed.grains).mean())
    moved = shrink(bed, gap=gap)
    for k in range(3):
        moved = jitter_throats(shrink(moved, scale=0.98, about="seed"), rng=k)
    assert validate(moved, overlap=0.0).ok


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"gap": -1e-6}, "gap must be zero or more and finite; got -1e-06"),
        ({"gap": np.nan}, "gap must be zero or more"),
        ({"gap": 1e-5, "about": "seed"}, "leave out about"),
        ({"gap": 1e-5, "about": [[0, 0, 0]]}, "leave out about"),
        ({"gap": 1e-5, "region": "domain"}, "leave out region"),
        ({"gap": 1e-5, "porosity": 0.4}, "got porosity=0.4, gap=1e-05"),
        ({"gap": 1.0}, "half the gap must be below the radius of the largest ball inside each grain; .* by "),
        ({"gap": 0.0}, "a gap can only grow: .* than half of 0.0 already: 0, 1, 2"),
    ],
)
def test_a_gap_that_cannot_be_is_refused(fresh, options, words):
    with pytest.raises(InputError, match=words):
        shrink(fresh, **options)


def test_only_grains_that_know_their_cells_can_be_set_apart(poured, fresh):
    for bed in (poured, replace(fresh, links=replace(fresh.links, sites=None, heights=None, rooms=None))):
        with pytest.raises(InputError, match="only while grains are in the cells they grew in"):
            shrink(bed, gap=1e-5)


def test_size_in_metres_is_reached_exactly_and_the_rest_follows(fresh):
    by_mean, by_median = resize(fresh, mean_diameter=1e-3), resize(fresh, median_diameter=1e-3)
    assert diameters(by_mean.grains).mean() == pytest.approx(1e-3, rel=1e-13)
    assert percentiles(diameters(by_median.grains), 50, weights=masses(by_median)) == pytest.approx(1e-3, rel=1e-13)
    large = resize(fresh, side=0.02)
    assert large.domain.lengths[0] == pytest.approx(0.02, rel=1e-14)
    assert porosity(large) == pytest.approx(porosity(fresh), rel=1e-12)


def test_in_a_planar_bed_diameters_are_of_circles_of_equal_area():
    bed = resize(shrink(slab_bed(), porosity=0.2), mean_diameter=2e-3)
    area = np.asarray([np.ptp(bed.grains.vertices[:, 2])])
    base = masses(bed) / 2650 / area
    assert np.sqrt(4 * base / np.pi).mean() == pytest.approx(2e-3, rel=1e-12)


def test_links_follow_the_size(fresh):
    big = rescale(fresh, 3.0)
    np.testing.assert_allclose(big.links.sites, 3 * fresh.links.sites)
    np.testing.assert_allclose(big.links.heights, 3 * fresh.links.heights)
    bare = replace(fresh, links=replace(fresh.links, sites=None, heights=None, rooms=None))
    assert rescale(bare, 3.0).links.sites is None


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give one of mean_diameter, median_diameter, side and diameters; got none"),
        ({"side": 1.0, "mean_diameter": 1e-3}, "got mean_diameter=0.001, side=1.0"),
        ({"side": 0.0}, "side must be positive and finite; got 0.0"),
        ({"mean_diameter": np.nan}, "mean_diameter must be positive"),
    ],
)
def test_a_size_that_is_given_twice_or_not_at_all_is_refused(fresh, options, words):
    with pytest.raises(InputError, match=words):
        resize(fresh, **options)


def test_the_core_of_a_bed_is_a_region_like_any_other(cells):
    bed = carve(cells, keep="all")
    box = core_box(bed)
    assert porosity(shrink(bed, void_ratio=0.6, region=box), region=box) == pytest.approx(0.375, rel=1e-10)
