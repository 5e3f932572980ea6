from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError
from grainsdem.model import Domain
from grainsdem.points import from_density, read_density

pytestmark = pytest.mark.unit

BOX = Domain(np.array([1.0, -2.0, 0.5]), np.array([3.0, -1.0, 4.5]))
SLAB = Domain.slab((2.0, 1.0), 0.2)
N = 40_000


def counts(seeds, domain, shape):
    edges = [(low, high) for low, high in zip(domain.lower, domain.upper, strict=True)][: len(shape)]
    return np.histogramdd(seeds[:, : len(shape)], bins=shape, range=edges)[0]


def assert_follows(found, density):
    """Assert that counts are multinomial in the given proportions."""
    expected = found.sum() * density / density.sum()
    assert (found[density == 0] == 0).all()
    some = density > 0
    statistic = ((found[some] - expected[some]) ** 2 / expected[some]).sum()
    low, high = chi2.ppf([1e-5, 1 - 1e-5], some.sum() - 1)
    assert low < statistic < high


@pytest.mark.statistical
def test_counts_follow_a_density_in_three_dimensions():
    density = np.random.default_rng(1).gamma(2.0, size=(4, 5, 6))
    density[2, 3] = 0.0
    seeds = from_density(BOX, N, density, rng=2)
    assert seeds.shape == (N, 3)
    assert_follows(counts(seeds, BOX, (4, 5, 6)), density)


@pytest.mark.statistical
def test_counts_follow_a_density_in_the_plane():
    density = np.random.default_rng(1).gamma(2.0, size=(7, 5))
    density[-1, -1] = density[0, 0] = 0.0
    seeds = from_density(SLAB, N, density, rng=2)
    assert (seeds[:, 2] == 0.1).all()
    assert_follows(counts(seeds, SLAB, (7, 5)), density)


@pytest.mark.statistical
@pytest.mark.parametrize(("along", "axis"), [("x", 0), ("y", 1), ("z", 2)])
def test_a_density_of_two_axes_is_extruded_along_the_third(along, axis):
    density = np.array([[1.0, 0.0, 3.0], [2.0, 5.0, 0.5]])
    shape = np.insert([2, 3], axis, 4)
    whole = np.broadcast_to(np.expand_dims(density, axis), shape)
    assert_follows(counts(from_density(BOX, N, density, along=along, rng=3), BOX, shape), whole)


@pytest.mark.statistical
def test_seeds_are_uniform_inside_their_voxel():
    density = np.array([[[1.0, 4.0], [0.5, 2.0]], [[3.0, 0.0], [1.0, 1.0]]])
    seeds = from_density(Domain.cube(), N, density, rng=1)
    inside = np.mod(2 * seeds, 1.0)
    for axis in range(3):
        assert kstest(inside[:, axis], "uniform").pvalue > 1e-5
    assert len(np.unique(seeds, axis=0)) == N


@pytest.mark.statistical
def test_a_domain_cut_by_planes_keeps_the_density_inside():
    tube = Domain.cylinder(1.0, 1.0)
    seeds = from_density(tube, 20_000, np.array([[1.0], [3.0]]), rng=1)
    assert len(seeds) == 20_000
    assert tube.contains(seeds).all()
    right = (seeds[:, 0] > 0).mean()
    assert abs(right - 0.75) < 5 * np.sqrt(0.75 * 0.25 / 20_000)


def test_only_proportions_count():
    density = np.random.default_rng(1).random((4, 4, 4))
    small, large = (from_density(BOX, 50, density * factor, rng=1) for factor in (2.0**-1000, 2.0**1000))
    assert small.tobytes() == large.tobytes() == from_density(BOX, 50, density, rng=1).tobytes()
    assert small.tobytes() != from_density(BOX, 50, density, rng=2).tobytes()


def test_one_voxel_is_a_whole_domain_and_booleans_will_do():
    assert len(from_density(BOX, 10, [[[3]]], rng=1)) == 10
    seeds = from_density(SLAB, 100, np.array([[True], [False]]), rng=1)
    assert (seeds[:, 0] < 1.0).all()


@pytest.mark.parametrize(
    ("density", "words"),
    [
        ([[1.0, -2.0], [3.0, 4.0]], r"nowhere negative; 1 voxels are not: \(0, 1, 0\)"),
        ([[1.0, np.nan], [np.inf, 4.0]], r"2 voxels are not: \(0, 1, 0\), \(1, 0, 0\)"),
        (np.zeros((3, 3, 3)), "above zero somewhere"),
    ],
)
def test_values_that_are_no_density_are_refused(density, words):
    with pytest.raises(InputError, match=words):
        from_density(BOX, 5, density)


@pytest.mark.parametrize("density", [[1.0, 2.0], np.ones((2, 2, 2, 2)), np.empty((0, 3)), "much", [[1], [2, 3]]])
def test_arrays_of_another_shape_are_refused(density):
    with pytest.raises(ShapeError, match=r"density must be an array of numbers|two or three axes"):
        from_density(BOX, 5, density)


def test_a_planar_domain_takes_two_axes():
    with pytest.raises(ShapeError, match=r"two axes; got shape \(2, 2, 2\)"):
        from_density(SLAB, 5, np.ones((2, 2, 2)))
    assert len(from_density(SLAB, 5, np.ones((2, 2, 1)))) == 5


def test_other_axes_and_empty_corners_are_refused():
    with pytest.raises(InputError, match="'x', 'y' or 'z'; got 'w'"):
        from_density(BOX, 5, np.ones((2, 2)), along="w")
    corner = np.zeros((64, 64))
    corner[0, 0] = 1.0
    with pytest.raises(InputError, match="28 planes leave of the domain"):
        from_density(Domain.cylinder(1.0, 1.0), 1000, corner)
    with pytest.raises(InputError, match="1 or more; got 0"):
        from_density(BOX, 0, np.ones((2, 2)))


def test_a_density_comes_back_from_its_file(tmp_path):
    density = np.random.default_rng(1).random((3, 4, 5))
    np.save(tmp_path / "a.npy", density)
    np.savez(tmp_path / "b.npz", density=density, other=np.ones(3))
    np.testing.assert_array_equal(read_density(tmp_path / "a.npy"), density)
    np.testing.assert_array_equal(read_density(tmp_path / "b.npz"), density)


def test_files_that_hold_no_density_get_one_clear_error(tmp_path):
    with pytest.raises(MissingFileError, match="no such file"):
        read_density(tmp_path / "none.npy")
    with pytest.raises(FileFormatError, match=r"read from \.npy or \.npz; got '\.txt'"):
        read_density(tmp_path / "a.txt")
    np.save(tmp_path / "line.npy", np.ones(5))
    with pytest.raises(FileFormatError, match=r"two or three axes; got an array of shape \(5,\)"):
        read_density(tmp_path / "line.npy")
    np.savez(tmp_path / "two.npz", a=np.ones((2, 2)), b=np.ones((2, 2)))
    with pytest.raises(FileFormatError, match="one named 'density'; got a, b"):
        read_density(tmp_path / "two.npz")
    (tmp_path / "broken.npy").write_bytes(b"\x93NUMPY broken")
    with pytest.raises(FileFormatError, match=r"broken\.npy: not an array"):
        read_density(tmp_path / "broken.npy")
