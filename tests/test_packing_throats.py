from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import porosity
from grainsdem.model import Domain
from grainsdem.packing import carve, jitter_throats, rescale, shrink, throat_widths
from grainsdem.points import poisson
from grainsdem.storage import load, save
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate

pytestmark = pytest.mark.unit


def slab_cells(n=300, periodic=True):
    domain = Domain.slab((1.0, 1.0), 0.05, periodic=periodic)
    seeds = np.column_stack([np.random.default_rng(3).random((n, 2)), np.full(n, 0.025)])
    return tessellate(seeds, domain)


@pytest.fixture(scope="module")
def periodic():
    domain = Domain.cube(periodic=True)
    return shrink(carve(tessellate(poisson(domain, 400, rng=2), domain)), porosity=0.4)


@pytest.mark.parametrize("about", ["centroid", "seed", "vertex_mean"])
@pytest.mark.parametrize("strength", [0.3, 1.0])
def test_moved_grains_never_overlap_and_stay_within_their_own_cells(cells, about, strength):
    moved = jitter_throats(shrink(carve(cells), porosity=0.3, about=about), strength=strength, rng=1)
    assert validate(moved, overlap=0.0).ok
    # The oracle for "within the cell": its hull, by Qhull, holds every vertex of the grain.
    inside = carve(cells)
    for i in range(0, len(moved), 7):
        hull = ConvexHull(world_vertices(inside)[inside.grains.vertex_offsets[i] : inside.grains.vertex_offsets[i + 1]])
        mine = world_vertices(moved)[moved.grains.vertex_offsets[i] : moved.grains.vertex_offsets[i + 1]]
        assert (hull.equations[:, :3] @ mine.T + hull.equations[:, 3:]).max() < 1e-12 * 6e-3


def test_across_periodic_boundaries_nothing_overlaps_either_even_after_many_moves(periodic):
    moved = periodic
    for k in range(5):
        moved = jitter_throats(moved, rng=k)
    assert validate(moved, overlap=0.0).ok


def test_shapes_and_porosity_do_not_change(periodic):
    moved = jitter_throats(periodic, rng=1)
    assert moved.grains.vertices.tobytes() == periodic.grains.vertices.tobytes()
    assert porosity(moved) == porosity(periodic)
    # A periodic domain is its cells: no grain can have left it, and neither has any volume.
    assert porosity(moved, region="domain") == pytest.approx(porosity(periodic, region="domain"), rel=1e-12)


def test_throats_get_wider_and_narrower_with_strength_and_none_closes(periodic):
    spreads = [throat_widths(jitter_throats(periodic, strength=s, rng=1)).std() for s in (0.0, 0.25, 0.5, 1.0)]
    assert spreads[0] == throat_widths(periodic).std()
    assert (np.diff(spreads) > 0).all()
    assert throat_widths(jitter_throats(periodic, rng=1)).min() > 0


def test_the_spread_before_and_after_is_told(periodic):
    told = json.loads(jitter_throats(periodic, fraction=0.5, rng=1).provenance[-1])
    assert told["throats_before"]["std"] == pytest.approx(throat_widths(periodic).std())
    assert told["throats_after"]["std"] > told["throats_before"]["std"]
    assert told["n_moved"] == 200
    widths = throat_widths(periodic)
    assert (told["throats_before"]["min"], told["throats_before"]["max"]) == (widths.min(), widths.max())
    assert told["throats_before"]["d10"] == np.percentile(widths, 10)


@pytest.mark.parametrize("fraction", [0.0, 0.3, 1.0])
def test_just_the_fraction_asked_for_is_moved(periodic, fraction):
    moved = jitter_throats(periodic, fraction=fraction, rng=4)
    assert (moved.positions != periodic.positions).any(axis=1).sum() == round(fraction * 400)


@pytest.mark.parametrize("axes", ["x", "y", "z", "xz", "zyx"])
def test_only_the_coordinates_named_change(periodic, axes):
    changed = (jitter_throats(periodic, axes=axes, rng=4).positions != periodic.positions).any(axis=0)
    assert changed.tolist() == [axis in axes for axis in "xyz"]


def test_strength_can_differ_from_place_to_place(periodic):
    moved = jitter_throats(periodic, strength=lambda p: np.clip(p[:, 2], 0, 1) > 0.5, rng=4)
    still = (moved.positions == periodic.positions).all(axis=1)
    np.testing.assert_array_equal(still, ~(np.clip(periodic.positions[:, 2], 0, 1) > 0.5))
    every = jitter_throats(periodic, strength=np.full(400, 0.5), rng=4)
    assert every.positions.tobytes() == jitter_throats(periodic, strength=0.5, rng=4).positions.tobytes()


@pytest.mark.statistical
def test_along_one_axis_a_cube_is_anywhere_in_its_cell_with_equal_chance():
    # Seeds on a cubic lattice: cells of edge 1, grains of edge 1/2, so each may go 1/4 either way.
    side = 12
    domain = Domain.cube(float(side), periodic=True)
    seeds = np.stack(np.meshgrid(*[np.arange(side) + 0.5] * 3), axis=-1).reshape(-1, 3)
    packing = shrink(carve(tessellate(seeds, domain)), scale=0.5)
    t = (jitter_throats(packing, axes="x", rng=1).positions - packing.positions)[:, 0]
    assert abs(t).max() <= 0.25
    n = t.size
    assert abs(t.mean()) < 5 * 0.25 / np.sqrt(3 * n)
    # variance of a uniform on ±1/4, and the standard error of a variance: √((μ4 − σ⁴)/n), μ4 = (1/4)⁴/5
    error = np.sqrt((0.25**4 / 5 - (0.25**2 / 3) ** 2) / n)
    assert abs(t.var() - 0.25**2 / 3) < 5 * error


@pytest.mark.parametrize("wraps", [True, False])
def test_prisms_of_a_planar_bed_move_in_their_plane_only(wraps):
    bed = shrink(carve(slab_cells(periodic=wraps)), porosity=0.3)
    moved = jitter_throats(bed, rng=2)
    assert (moved.positions[:, 2] == bed.positions[:, 2]).all()
    assert (moved.positions[:, :2] != bed.positions[:, :2]).any(axis=1).mean() > 0.99
    assert validate(moved, overlap=0.0).ok
    assert throat_widths(moved).std() > 1.2 * throat_widths(bed).std()
    with pytest.raises(InputError, match="planar bed"):
        jitter_throats(bed, axes="z")


def test_grains_that_fill_their_cells_cannot_move(cells):
    packing = carve(cells)
    d = 6e-3
    np.testing.assert_allclose(jitter_throats(packing, rng=1).positions, packing.positions, atol=1e-12 * d)


def test_the_slack_is_known_after_rescaling_and_after_a_file(periodic, tmp_path):
    back = load(save(rescale(periodic, 3.0), tmp_path / "bed.h5"))
    one = jitter_throats(back, rng=6).positions
    np.testing.assert_allclose(one, 3 * jitter_throats(periodic, rng=6).positions, rtol=1e-12)


def test_the_same_seed_moves_the_same_grains(periodic):
    assert jitter_throats(periodic, rng=6).positions.tobytes() == jitter_throats(periodic, rng=6).positions.tobytes()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"fraction": 1.1}, InputError, r"fraction must lie in \[0, 1\]; got 1.1"),
        ({"fraction": np.nan}, InputError, "fraction must lie in"),
        ({"strength": -0.1}, InputError, "strength must lie in .*; got -0.1"),
        ({"strength": [0.1, 0.2]}, ShapeError, "one for each of 400 grains"),
        ({"axes": ""}, InputError, "one to three of 'xyz'"),
        ({"axes": "xx"}, InputError, "each once; got 'xx'"),
        ({"axes": "xw"}, InputError, "got 'xw'"),
    ],
)
def test_impossible_moves_are_refused_with_what_is_allowed(periodic, options, error, words):
    with pytest.raises(error, match=words):
        jitter_throats(periodic, **options)


def test_grains_that_left_their_cells_have_no_slack(poured, fresh):
    with pytest.raises(InputError, match="cells are not known"):
        jitter_throats(poured)
    old = replace(fresh, links=replace(fresh.links, sites=None, heights=None, rooms=None))
    with pytest.raises(InputError, match="cells are not known"):
        jitter_throats(old)


@pytest.mark.property
@pytest.mark.parametrize("about", ["centroid", "seed", "vertex_mean"])
def test_whatever_grains_shrink_about_the_porosity_is_exact_and_nothing_overlaps(cells, about):
    packing = shrink(carve(cells), void_ratio=0.85, about=about)
    assert porosity(packing) == pytest.approx(0.85 / 1.85, rel=1e-12)
    assert validate(packing, overlap=0.0).ok
    shared = carve(cells)
    np.testing.assert_allclose(volumes(packing.grains) / volumes(shared.grains), 1 / 1.85, rtol=1e-9)
