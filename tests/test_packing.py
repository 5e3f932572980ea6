from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import centroids, face_planes, volumes
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.model import DROPPED, Domain
from grainsdem.packing import carve, rescale, shrink, shuffle
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.unit


def test_carving_drops_just_the_cells_that_touch_a_wall(cells):
    owner = np.repeat(np.arange(len(cells)), np.diff(cells.cells.face_offsets))
    inside = sorted(set(range(len(cells))) - set(owner[cells.neighbors < 0].tolist()))
    packing = carve(cells)
    np.testing.assert_allclose(volumes(packing.grains), volumes(cells.cells)[inside], rtol=1e-12)
    assert len(carve(cells, keep="all")) == len(cells)


def test_carved_grains_sit_about_their_centroids_where_their_cells_were(cells):
    packing = carve(cells, keep="all")
    d = np.cbrt(volumes(packing.grains)).mean()
    np.testing.assert_allclose(centroids(packing.grains), 0, atol=1e-12 * d)
    np.testing.assert_allclose(packing.positions, cells.sites + centroids(cells.cells), atol=1e-12 * d)


def test_links_are_symmetric_and_dropped_cells_are_marked(cells):
    packing = carve(cells)
    owner = np.repeat(np.arange(len(packing)), np.diff(packing.grains.face_offsets))
    links = list(zip(owner.tolist(), packing.links.neighbors.tolist(), strict=True))
    kept = {(i, j) for i, j in links if j >= 0}
    assert kept == {(j, i) for i, j in kept}
    assert DROPPED in packing.links.neighbors
    assert all(j == DROPPED for _, j in links if j < 0)


def test_a_box_too_small_to_have_an_inner_cell_says_so():
    with pytest.raises(InputError, match="all 5 cells touch a wall"):
        carve(tessellate(poisson(Domain.cube(), 5, rng=1), Domain.cube()))


@pytest.mark.parametrize("density", [0.0, -1.0, np.nan])
def test_a_density_that_is_not_positive_is_refused(cells, density):
    with pytest.raises(InputError, match="density"):
        carve(cells, density=density)


def test_keeping_what_is_not_known_is_refused(cells):
    with pytest.raises(InputError, match="'inside' or 'all'"):
        carve(cells, keep="some")


@pytest.mark.parametrize("porosity", [0.0, 0.3, 0.6, 0.999])
def test_porosity_is_reached_exactly(cells, porosity):
    packing = shrink(carve(cells), porosity=porosity)
    solid = volumes(packing.grains).sum() / packing.links.cell_volumes.sum()
    assert solid == pytest.approx(1 - porosity, rel=1e-12)


def test_shrinking_twice_to_one_porosity_changes_nothing(cells):
    once = shrink(carve(cells), porosity=0.4)
    np.testing.assert_allclose(shrink(once, porosity=0.4).grains.vertices, once.grains.vertices, rtol=1e-12)


def test_scale_is_linear_so_that_volume_falls_by_its_cube(cells):
    packing = carve(cells)
    np.testing.assert_allclose(volumes(shrink(packing, scale=0.8).grains), 0.512 * volumes(packing.grains), rtol=1e-12)


def test_the_gap_of_shrunk_neighbours_is_one_minus_scale_times_their_heights(cells):
    packing = carve(cells)
    heights = face_planes(packing.grains).heights
    small = face_planes(shrink(packing, scale=0.7).grains).heights
    np.testing.assert_allclose(heights - small, 0.3 * heights, rtol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "give one of scale, porosity"),
        ({"scale": 0.5, "porosity": 0.5}, "give one of scale, porosity"),
        ({"scale": 0.0}, "scale must lie in"),
        ({"scale": 1.1}, "scale must lie in"),
        ({"porosity": 1.0}, r"porosity must lie in \[0, 1\)"),
        ({"porosity": -0.1}, r"porosity must lie in \[0, 1\); got -0.1"),
        ({"porosity": np.nan}, "porosity must lie in"),
        ({"porosity": 0.3}, "has 0.4 already; got 0.3"),
    ],
)
def test_impossible_shrinking_is_refused_with_what_is_allowed(fresh, options, words):
    with pytest.raises(InputError, match=words):
        shrink(fresh, **options)


def test_porosity_of_grains_that_left_their_cells_cannot_be_asked_for(poured):
    with pytest.raises(InputError, match="cells they grew in"):
        shrink(poured, porosity=0.5)


def test_rescaling_scales_every_length_and_keeps_the_porosity(fresh):
    big = rescale(fresh, 3.0)
    np.testing.assert_allclose(world_vertices(big), 3 * world_vertices(fresh), rtol=1e-12)
    np.testing.assert_allclose(big.domain.upper, 3 * fresh.domain.upper)
    assert volumes(big.grains).sum() / big.links.cell_volumes.sum() == pytest.approx(0.6, rel=1e-12)
    with pytest.raises(InputError, match="positive and finite"):
        rescale(fresh, 0.0)


def test_inner_prisms_of_a_slab_are_kept_and_those_at_its_sides_dropped():
    slab = Domain.slab((1.0, 1.0), 0.05)
    seeds = np.column_stack([np.random.default_rng(3).random((200, 2)), np.full(200, 0.025)])
    inner = carve(tessellate(seeds, slab))
    corners = world_vertices(inner)
    assert 100 < len(inner) < 200
    assert corners[:, :2].min() > 0
    assert corners[:, :2].max() < 1
    wrapped = carve(tessellate(seeds, Domain.slab((1.0, 1.0), 0.05, periodic=True)))
    assert volumes(wrapped.grains).sum() == pytest.approx(0.05, rel=1e-12)


def test_a_planar_packing_shrinks_in_the_plane_only():
    slab = Domain.slab((1.0, 1.0), 0.1)
    packing = shrink(carve(tessellate(poisson(slab, 40, rng=2), slab), keep="all"), porosity=0.36)
    heights = np.ptp(packing.grains.vertices[:, 2])
    assert heights == pytest.approx(0.1)
    assert volumes(packing.grains).sum() == pytest.approx(0.64 * slab.volume)


def test_shuffled_grains_are_the_same_shapes_in_another_order(fresh, poured):
    before, after = volumes(fresh.grains), volumes(poured.grains)
    np.testing.assert_allclose(np.sort(after), np.sort(before), rtol=1e-12)
    assert not np.allclose(after, before, rtol=1e-6, atol=0)


def test_shuffled_grains_lie_inside_and_their_spheres_apart(poured):
    radii = np.sqrt((poured.grains.vertices**2).sum(axis=1))
    radius = np.maximum.reduceat(radii, poured.grains.vertex_offsets[:-1])
    distances = np.linalg.norm(poured.positions[:, None] - poured.positions[None], axis=2)
    np.fill_diagonal(distances, np.inf)
    assert (distances > radius[:, None] + radius[None]).all()
    corners = world_vertices(poured)
    assert (corners > poured.domain.lower).all()
    assert (corners < poured.domain.upper).all()


@pytest.mark.statistical
def test_shuffled_rotations_have_no_preferred_direction(fresh):
    axes = np.concatenate([to_matrices(shuffle(fresh, rng=k).quaternions)[:, :, 2] for k in range(40)])
    # Each component of a uniform direction has mean 0 and variance 1/3.
    assert (abs(axes.mean(axis=0)) < 5 * np.sqrt(1 / 3 / len(axes))).all()


def test_grains_shuffled_in_a_cylinder_stay_inside_its_planes(fresh):
    round_ = replace(fresh, domain=Domain.cylinder(3e-3, 7e-3, sides=16))
    lifted = shuffle(round_, rng=3)
    assert len(lifted) == len(fresh)
    for plane in lifted.domain.planes:
        assert (world_vertices(lifted) @ plane[:3] < plane[3]).all()


def test_a_cylinder_too_narrow_for_a_grain_is_refused(fresh):
    narrow = replace(fresh, domain=Domain.cylinder(6e-4, 7e-3, sides=16))
    with pytest.raises(InputError, match=r"(leave no room|wider than)"):
        shuffle(narrow)


def test_shuffling_is_reproducible_and_forgets_the_neighbours(fresh):
    one, two = shuffle(fresh, rng=9), shuffle(fresh, rng=9)
    assert one.positions.tobytes() == two.positions.tobytes()
    assert one.quaternions.tobytes() == two.quaternions.tobytes()
    assert one.links is None


def test_a_floor_narrower_than_a_grain_is_refused(fresh):
    narrow = replace(fresh, domain=Domain.box((3e-4, 6e-3, 7e-3)))
    with pytest.raises(InputError, match="wider than the largest grain"):
        shuffle(narrow)
