"""Grains laid out loose: none overlap, sizes and shares are those asked for, and classes stay with their grains."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

import exporters
import grainsdem as gd
from grainsdem.errors import InputError, ShapeError
from grainsdem.model import Domain


@pytest.fixture(scope="module")
def kinds():
    return [gd.shapes.platonic("cube"), gd.shapes.ellipsoid(2.0, 1.0, 1.0), gd.shapes.rock(5, rng=1)]


@pytest.fixture(scope="module")
def bed(kinds):
    return gd.pack(kinds, stats.lognorm(s=0.3, scale=1e-3), Domain.box((8e-3, 9e-3, 5e-3)), n=300, rng=1)


def _filled(packing):
    """Return the solid fraction up to the highest corner."""
    top = gd.world_vertices(packing)[:, 2].max() - packing.domain.lower[2]
    return gd.volumes(packing).sum() / (top * packing.domain.lengths[:2].prod())


@pytest.mark.client
def test_manifold3d_finds_no_overlap_and_walls_are_kept(bed):
    assert gd.validate(bed, method="manifold3d").ok
    assert gd.validate(bed).ok
    gaps = gd.contacts(bed, within=2e-3).gaps
    assert gaps.min() >= 0.99e-3 * gd.diameters(bed).min()


@pytest.mark.unit
def test_sizes_are_a_laws_quantiles_and_kinds_have_their_shares(bed):
    law = stats.lognorm(s=0.3, scale=1e-3)
    wanted = law.ppf((np.arange(300) + 0.5) / 300)
    assert np.sort(gd.diameters(bed)) == pytest.approx(wanted, rel=1e-12)
    assert np.bincount(bed.classes).tolist() == [100, 100, 100]
    assert np.abs(gd.centroids(bed)).max() < 1e-12
    # The shapes are the kinds': a cube has eight corners, and rocks of five kinds are among the third.
    corners = np.diff(bed.grains.vertex_offsets)
    assert set(corners[bed.classes == 0]) == {8}
    assert set(corners[bed.classes == 1]) == {32}


@pytest.mark.unit
def test_a_list_of_sizes_is_kept_in_its_order_and_rng_decides_the_rest(kinds):
    sizes = np.linspace(1e-3, 2e-3, 40)
    one, again, other = (gd.pack(kinds, sizes, rng=seed) for seed in (1, 1, 2))
    assert gd.diameters(one) == pytest.approx(sizes, rel=1e-12)
    assert np.array_equal(one.positions, again.positions)
    assert np.array_equal(one.quaternions, again.quaternions)
    assert not np.array_equal(one.positions, other.positions)


@pytest.mark.unit
def test_shares_by_mass_are_had_within_a_small_grain(kinds):
    law = stats.loguniform(0.5e-3, 3e-3)
    bed = gd.pack(kinds, law, n=400, shares=[2, 1, 1], by="mass", density=[2650, 7800, 1100], rng=1)
    masses = gd.masses(bed)
    shares = np.bincount(bed.classes, masses) / masses.sum()
    assert shares == pytest.approx([0.5, 0.25, 0.25], abs=7800 * gd.volumes(bed).min() / masses.sum())
    assert bed.densities[bed.classes == 1] == pytest.approx(7800)
    # All kinds have the same sizes, about.
    medians = [np.median(gd.diameters(bed)[bed.classes == k]) for k in range(3)]
    assert max(medians) / min(medians) < 1.5


@pytest.mark.unit
def test_equant_shapes_are_laid_out_at_a_quarter_at_least(kinds):
    for shapes in (kinds, gd.shapes.platonic("cube"), gd.shapes.rock(9, rng=3)):
        bed = gd.pack(shapes, 1e-3, Domain.box((0.014, 0.014, 0.005)), n=1500, rng=1)
        assert gd.volumes(bed).sum() / bed.domain.volume > 0.25
        assert _filled(bed) < 0.31
        assert bed.domain.lengths[:2] == pytest.approx([0.014, 0.014])


@pytest.mark.unit
def test_unlike_sizes_make_no_tower(kinds):
    bed = gd.pack(kinds, stats.loguniform(1e-3, 1e-2), n=2000, rng=1)
    assert _filled(bed) > 0.28
    assert gd.validate(bed).ok
    reach = 2 * np.sqrt((bed.grains.vertices**2).sum(axis=1)).max()
    assert bed.domain.lengths[2] <= 1.05 * max(bed.domain.lengths[0], reach)


@pytest.mark.unit
def test_the_domains_walls_stay_periodic_axes_wrap_and_a_lid_that_is_high_enough_stays(kinds):
    across = Domain.box((6e-3, 6e-3, 0.1), periodic=(True, True, False))
    bed = gd.pack(kinds, 1e-3, across, n=200, rng=1)
    assert bed.domain.lengths[2] == pytest.approx(0.1)
    assert bed.domain.periodic.tolist() == [True, True, False]
    assert gd.world_vertices(bed)[:, 2].max() < 0.03
    assert gd.validate(bed).ok
    assert gd.world_vertices(bed)[:, 0].min() < 0  # some reach over an edge that wraps
    pipe = gd.pack(kinds, 1e-3, Domain.cylinder(4e-3, 6e-3), n=200, rng=1)
    assert gd.validate(pipe).ok
    assert len(pipe.domain.planes) == len(Domain.cylinder(4e-3, 6e-3).planes)


@pytest.mark.unit
def test_a_hopper_is_filled_from_its_floor(kinds):
    hopper = Domain.hopper((20e-3, 20e-3), (6e-3, 6e-3), 20e-3)
    bed = gd.pack(kinds, 1.5e-3, hopper, n=150, rng=1)
    assert gd.validate(bed).ok


@pytest.mark.unit
def test_shapes_that_single_precision_bent_are_packed_as_their_hulls():
    rock = gd.shapes.sized(gd.shapes.superellipsoid(1, 1, 1, exponents=(0.1, 0.1), n_vertices=60), 1.0)
    bent = replace(rock, vertices=rock.vertices.astype(np.float32).astype(float))
    assert gd.validate(gd.pack(bent, 1.0, n=5, rng=1)).ok


@pytest.mark.unit
def test_what_does_not_fit_is_refused_with_what_fits(kinds):
    with pytest.raises(InputError, match=r"do not fit: loose, at a solid fraction of 0\.300, they take"):
        gd.pack(kinds, 1e-3, Domain.cube(5e-3), n=500, higher=False, rng=1)
    fits = gd.pack(kinds, 1e-3, Domain.cube(5e-3), n=30, higher=False, rng=1)
    assert fits.domain.lengths == pytest.approx([5e-3] * 3)
    with pytest.raises(InputError, match="finds no place between walls"):
        gd.pack(gd.shapes.box(3, 3, 3), 1.2, Domain.cube(1.0), n=2, rng=1)


@pytest.mark.unit
def test_grains_of_a_pack_settle_and_keep_their_classes_everywhere(bed, tmp_path):
    by_size = {round(float(d), 12): k for d, k in zip(gd.diameters(bed), bed.classes, strict=True)}

    def is_kept(packing):
        return all(
            by_size[round(float(d), 12)] == k for d, k in zip(gd.diameters(packing), packing.classes, strict=True)
        )

    loaded = gd.load(gd.save(bed, tmp_path / "bed.h5"))
    assert np.array_equal(loaded.classes, bed.classes)
    assert is_kept(gd.shuffle(bed, rng=1))
    assert is_kept(gd.subset(bed, [200, 3, 77]))
    assert len(gd.subset(bed, [200, 3, 77]).classes) == 3
    assert np.array_equal(gd.table(bed, sieves=False)["class"], bed.classes)
    (written,) = exporters.files(bed, ".vtu").values()
    assert b'Name="class"' in written
    assert "class" not in gd.table(replace(bed, classes=None), sieves=False).dtype.names
    few = gd.subset(bed, range(20))
    settled = gd.settle(few, start="pour", rng=1, max_time=0.02)
    assert is_kept(settled.packing)


@pytest.mark.unit
def test_classes_are_whole_numbers_one_a_grain(bed):
    for classes, words in (([0.5] * 300, "whole numbers"), ([-1] * 300, "zero or more"), ([1, 2], r"shape \(300\)")):
        with pytest.raises(ShapeError, match=words):
            replace(bed, classes=classes)


@pytest.mark.property
@settings(max_examples=10)
@given(st.integers(0, 2**32), st.floats(1.0, 10.0), st.integers(1, 60))
def test_no_mixture_overlaps(seed, ratio, n):
    rng = np.random.default_rng(seed)
    shapes = [gd.shapes.rock(elongation=rng.uniform(0.3, 1), flatness=rng.uniform(0.3, 1), rng=rng) for _ in range(3)]
    bed = gd.pack(shapes, rng.uniform(1e-3, ratio * 1e-3, n), shares=rng.random(3), rng=rng)
    assert len(bed) == n
    assert gd.validate(bed).ok


@pytest.mark.unit
def test_odd_input_is_refused_in_a_line(kinds):
    cube = kinds[0]
    dented = replace(cube, vertices=cube.vertices * np.where(np.arange(8) == 0, 0.4, 1.0)[:, None])
    inward = replace(cube, face_vertices=cube.face_vertices[::-1])
    slab = Domain.slab((1.0, 1.0), 0.1)
    cases = [
        (([], 1.0), {"n": 2}, "shapes must be one or more"),
        ((["cube"], 1.0), {"n": 2}, r"a sequence, each of a Polyhedra or a Scans; got \['cube'\]"),
        ((dented, 1.0), {"n": 2}, "closed and convex.*not so: 0"),
        ((inward, 1.0), {"n": 2}, "volumes above zero"),
        ((cube, [1.0, -1.0]), {}, "sizes must be positive and finite; those of grains 1"),
        ((cube, [1.0, 2.0]), {"n": 3}, "one size for each of n = 3 grains; got 2"),
        ((cube, stats.norm(1, 0.1)), {}, "a law of sizes needs the number of grains"),
        ((cube, stats.norm(0, 1)), {"n": 9}, "sizes must be positive"),
        ((cube, 1.0), {"n": 0}, "one or more; got n = 0"),
        ((kinds, 1.0), {"n": 2, "shares": [0, 0, 0]}, "one above it"),
        ((kinds, 1.0), {"n": 2, "by": "volume"}, "by must be 'number' or 'mass'; got 'volume'"),
        ((cube, 1.0), {"n": 2, "density": -1}, "density must be positive"),
        ((cube, 1.0), {"n": 2, "solid_fraction": 0.7}, r"in \(0, 0.6\); got 0.7"),
        ((cube, 1.0, slab), {"n": 2}, "the domain is a slab"),
        ((cube, 1.0, Domain.cube(9.0, periodic=True)), {"n": 2}, "wraps around along it"),
        ((cube, 1.0, Domain.box((2.0, 9.0, 9.0), periodic=(True, False, False))), {"n": 2}, "twice as long"),
    ]
    for given_, options, words in cases:
        with pytest.raises(InputError, match=words) as caught:
            gd.pack(*given_, **options)
        assert "\n" not in str(caught.value)
    for options, words in (({"shares": [1, 2]}, "one for each of 3 kinds"), ({"density": [1, 2]}, "one for each of 3")):
        with pytest.raises(ShapeError, match=words):
            gd.pack(kinds, 1.0, n=3, **options)
    with pytest.raises(ShapeError, match="a list of diameters, or one diameter or law and n"):
        gd.pack(cube, 1.0)


@pytest.mark.unit
def test_scattered_grains_are_the_beds_and_take_little_room():
    domain = Domain.cube()
    wide = gd.Grading([0.5e-3, 1e-3, 2e-3, 4e-3], [0.0, 0.25, 0.6, 1.0])
    found = gd.graded_cells(domain, wide, n=500, keep="all", relaxations=1, rng=1)
    bed = gd.resize(gd.shrink(gd.carve(found.cells, keep="all"), porosity=0.45), diameters=found.diameters)
    bed = replace(bed, densities=np.linspace(1000.0, 3000.0, len(bed)), classes=np.arange(len(bed)) % 3)
    loose = gd.scatter(bed, rng=1)
    assert gd.validate(loose, method="manifold3d").ok
    assert loose.grains.vertices.tobytes() == bed.grains.vertices.tobytes()
    assert loose.densities.tolist() == bed.densities.tolist()
    assert loose.classes.tolist() == bed.classes.tolist()
    assert loose.links is None
    # At three tenths of solid where the bed has 0.55; a lattice of the largest grain is a tower.
    assert _filled(loose) > 0.25
    assert loose.domain.lengths[2] < 2.2 * bed.domain.lengths[2] < gd.shuffle(bed, rng=1).domain.lengths[2] / 5
    np.testing.assert_array_equal(gd.scatter(bed, rng=1).positions, loose.positions)
    assert (gd.scatter(bed, rng=2).positions != loose.positions).any()


@pytest.mark.unit
def test_nothing_and_prisms_are_not_scattered(bed):
    with pytest.raises(InputError, match="nothing to scatter"):
        gd.scatter(gd.subset(bed, []))
    slab = Domain.slab((1.0, 1.0), 0.1)
    with pytest.raises(InputError, match="the domain is a slab"):
        gd.scatter(gd.carve(gd.tessellate(gd.points.poisson(slab, 30, rng=1), slab)))
    with pytest.raises(InputError, match=r"solid_fraction must lie in \(0, 0\.6\); got 0\.7"):
        gd.scatter(bed, solid_fraction=0.7)


@pytest.mark.parametrize("diameter", ["sieve", "equal-volume"])
def test_a_mixture_of_shapes_has_a_sieve_sheet(diameter):
    curve = gd.Grading([0.5e-3, 1e-3, 1.4e-3, 2e-3], [0.0, 0.3, 0.6, 1.0], diameter)
    kinds = [gd.shapes.box(3.0, 2.0, 1.0), gd.shapes.rock(5, elongation=0.6, flatness=0.5, rng=1)]
    bed = gd.pack(kinds, curve, n=300, shares=[1, 3], by="mass", density=[2650, 4000], rng=1)
    masses = gd.masses(bed)
    sizes = gd.sieve_diameters(bed) if diameter == "sieve" else gd.diameters(bed)
    passing = [masses[sizes < opening].sum() / masses.sum() for opening in curve.openings]
    assert passing == pytest.approx(curve.passing, abs=5e-3)
    assert masses[bed.classes == 0].sum() / masses.sum() == pytest.approx(0.25, abs=0.01)
    with pytest.raises(InputError, match="needs the number of grains"):
        gd.pack(kinds, curve)
