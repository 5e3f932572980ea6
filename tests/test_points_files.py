from __future__ import annotations

import numpy as np
import pytest

from grainsdem.errors import FileFormatError, InputError, ShapeError, WriteError
from grainsdem.model import Domain
from grainsdem.points import poisson, read, scaled, write

pytestmark = pytest.mark.unit

BOX = Domain(np.array([1.0, -2.0, 0.5]), np.array([3.0, -1.0, 4.5]))


def test_bounds_become_the_domain_to_the_corner():
    placed = scaled([[0, 0, 0], [10, 20, 30], [5, 5, 30]], BOX, bounds=[[0, 0, 0], [10, 20, 30]])
    np.testing.assert_allclose(placed, [[1, -2, 0.5], [3, -1, 4.5], [2, -1.75, 4.5]])


@pytest.mark.statistical
def test_without_bounds_the_box_of_uniform_points_is_estimated_without_bias():
    ends = []
    for seed in range(2000):
        points = poisson(BOX, 20, rng=seed)
        placed = scaled(points, BOX)
        # What was at 0.25 and 0.75 of the box should be there again, on the average.
        factor = np.ptp(placed, axis=0) / np.ptp(points, axis=0)
        ends.append((placed[0] - factor * (points[0] - BOX.lower) - BOX.lower) / BOX.lengths)
    error = np.std(ends, axis=0) / np.sqrt(len(ends))
    assert (np.abs(np.mean(ends, axis=0)) < 5 * error + 1 / 20**2).all()


def test_estimated_bounds_leave_the_share_that_uniform_points_leave():
    placed = scaled([[0, 0, 0], [4, 4, 4], [1, 2, 3], [2, 1, 1], [3, 3, 2]], Domain.cube())
    np.testing.assert_allclose(placed.min(axis=0), 1 / 6)
    np.testing.assert_allclose(placed.max(axis=0), 5 / 6)


def test_one_factor_for_all_axes_keeps_shapes():
    points = np.array([[0.0, 0, 0], [8, 1, 2], [4, 0.5, 1]])
    placed = scaled(points, BOX, stretch=False)
    distances = np.linalg.norm(np.diff(placed, axis=0), axis=1) / np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.ptp(distances) < 1e-12
    np.testing.assert_allclose((placed.min(axis=0) + placed.max(axis=0)) / 2, (BOX.lower + BOX.upper) / 2)


@pytest.mark.parametrize("stretch", [True, False])
def test_a_single_point_lies_in_the_middle(stretch):
    np.testing.assert_allclose(scaled([[7.0, 8.0, 9.0]], BOX, stretch=stretch), [[2.0, -1.5, 2.5]])


def test_planar_domains_take_points_of_two_or_three_columns():
    slab = Domain.slab((2.0, 1.0), 0.2)
    for points in ([[0, 0], [4, 2]], [[0, 0, 5], [4, 2, 6]]):
        placed = scaled(points, slab, bounds=[[0, 0], [4, 4]])
        np.testing.assert_allclose(placed, [[0, 0, 0.1], [2, 0.5, 0.1]])


@pytest.mark.parametrize(
    ("points", "bounds", "words"),
    [
        (np.empty((0, 3)), None, "one or more; 0 of 0 are not"),
        ([[0, 0, np.nan], [1, 1, 1]], None, "finite, .* 1 of 2 are not"),
        ([[1, 1, 1], [1, 1, 1], [2, 2, 2]], None, "1 pairs coincide: 0–1"),
        ([[0, 0, 0], [3, 3, 3]], [[0, 0, 0], [2, 2, 2]], "within their bounds; 1 of 2 do not: 1"),
        ([[0, 0, 0], [3, 3, 3]], [[0, 0, 0], [0, 2, 2]], "a lower and a higher corner"),
    ],
)
def test_points_that_cannot_be_placed_are_refused(points, bounds, words):
    with pytest.raises(InputError, match=words):
        scaled(points, BOX, bounds=bounds)


@pytest.mark.parametrize("points", [[1.0, 2.0, 3.0], [[1.0, 2.0]], "points"])
def test_points_of_another_shape_are_refused(points):
    with pytest.raises(ShapeError, match=r"points must (be an array of numbers|have shape)"):
        scaled(points, BOX)


def test_bounds_of_another_shape_are_refused():
    with pytest.raises(ShapeError, match=r"shape \(2, 3\) or \(2, 2\); got shape \(3,\)"):
        scaled([[0, 0, 0]], BOX, bounds=[1, 2, 3])


def test_points_that_a_plane_cuts_off_are_named():
    corners = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 1], [0.5, 0.5, 0.5]]
    with pytest.raises(InputError, match="4 of 5 lie outside: 0, 1, 2, 3"):
        scaled(corners, Domain.cylinder(1.0, 1.0), bounds=[[0, 0, 0], [1, 1, 1]])


@pytest.mark.parametrize("suffix", [".txt", ".dat", ".xyz", ".csv", ".npy"])
@pytest.mark.parametrize("columns", [2, 3])
def test_seeds_that_are_written_are_read_to_the_bit(tmp_path, suffix, columns):
    seeds = poisson(BOX, 40, rng=1)[:, :columns] / 3
    assert write(seeds, tmp_path / f"seeds{suffix}") == tmp_path / f"seeds{suffix}"
    np.testing.assert_array_equal(read(tmp_path / f"seeds{suffix}"), seeds)


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path):
    for name in ("a.npz", "a.h5", "a"):
        with pytest.raises(FileFormatError, match="seeds are written as"):
            write([[1, 2, 3]], tmp_path / name)
    with pytest.raises(ShapeError, match=r"\(n, 3\) or \(n, 2\); got shape \(3,\)"):
        write([1, 2, 3], tmp_path / "a.txt")
    with pytest.raises(WriteError, match="cannot be written"):
        write([[1, 2, 3]], tmp_path / "missing" / "a.txt")
    assert not list(tmp_path.iterdir())
