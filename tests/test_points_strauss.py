from __future__ import annotations

import sys
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial import cKDTree

from grainsdem.errors import InputError
from grainsdem.geometry.inhibition.chains import ALL, fill
from grainsdem.geometry.inhibition.grid import count_near, insert, make_grid, remove
from grainsdem.model import Domain
from grainsdem.points import poisson, strauss, strauss_process

pytestmark = pytest.mark.unit

TORI = [Domain.cube(periodic=True), Domain.slab((1.0, 1.0), 0.1, periodic=True)]
BOTH = pytest.mark.parametrize("domain", TORI, ids=["3-D", "2-D"])
BOTH_SLOWLY = pytest.mark.parametrize(
    "domain", [pytest.param(TORI[0], marks=pytest.mark.slow), TORI[1]], ids=["3-D", "2-D"]
)
MIXED = Domain(np.array([1.0, -2.0, 0.5]), np.array([3.0, -1.0, 4.5]), np.array([True, False, True]))
DOMAINS = {
    "3-D torus": TORI[0],
    "2-D torus": TORI[1],
    "cube": Domain.cube(),
    "box that wraps twice": MIXED,
    "slab": Domain.slab((2.0, 1.0), 0.2),
    "cylinder": Domain.cylinder(0.5, 1.0, periodic=True),
}


def tree(points, domain):
    k = 2 if domain.is_planar else 3
    lower, size = domain.lower[:k], domain.lengths[:k]
    box = np.where(domain.periodic[:k], size, 0.0)
    unwrapped = points[:, :k] - lower
    return cKDTree(np.where(box > 0, np.mod(unwrapped, size), unwrapped), boxsize=box)


def close_pairs(points, domain, distance):
    """Return how many pairs are nearer than a distance, by a tree that knows nothing of the process."""
    return len(tree(points, domain).query_pairs(distance))


def ball(distance, domain):
    """Return the share of a torus of size 1 that lies within a distance."""
    return np.pi * distance**2 if domain.is_planar else 4 / 3 * np.pi * distance**3


def lens(r, distance, domain):
    """Return the share of a torus of size 1 within a distance of both of two points that are r apart."""
    r = np.minimum(r, 2 * distance)
    if domain.is_planar:
        half = np.arccos(r / (2 * distance))
        return 2 * distance**2 * half - 0.5 * r * np.sqrt(4 * distance**2 - r**2)
    return np.pi * (4 * distance + r) * (2 * distance - r) ** 2 / 12


def apart(r, domain):
    """Return the density of the distance between two uniform points, below half a period."""
    return 2 * np.pi * r if domain.is_planar else 4 * np.pi * r**2


@pytest.mark.statistical
@pytest.mark.parametrize("process", [strauss, strauss_process])
@BOTH_SLOWLY
def test_two_points_are_close_as_often_as_the_law_says(domain, process):
    distance, c, n = 0.35, 0.3, 3000
    p = ball(distance, domain)
    close = [
        close_pairs(process(domain, 2, distance=distance, inhibition=c, rng=k), domain, distance) for k in range(n)
    ]
    expected = c * p / (c * p + 1 - p)
    assert abs(np.mean(close) - expected) < 5 * np.sqrt(expected * (1 - expected) / n)


def pairs_among_three(domain, distance, c):
    """Return the mean number of close pairs among three points: of the sequential rule, and of Strauss's process."""
    p = ball(distance, domain)
    r = np.linspace(0, 2 * distance, 4001)
    shared = lens(r, distance, domain)
    near = r < distance
    # The third point is close to both, to one or to none of the first two, by the areas of two discs and their lens.
    one = 2 * (p - shared)
    chance = np.where(near, c, 1.0) / (c * p + 1 - p) * apart(r, domain)
    norm = 1 - one - shared + c * one + c**2 * shared
    third = (c * one + 2 * c**2 * shared) / norm
    farther = (1 - ball(2 * distance, domain)) / (c * p + 1 - p) * 2 * c * p / (1 - 2 * p + 2 * c * p)
    sequential = c * p / (c * p + 1 - p) + np.trapezoid(chance * third, r) + farther
    # Of three uniform points all are close with chance t; whatever the pattern, its weight is c to the close pairs.
    t = np.trapezoid(np.where(near, shared * apart(r, domain), 0.0), r)
    weights = np.array([1 - 3 * p + 3 * p**2 - t, 3 * (p - 2 * p**2 + t), 3 * (p**2 - t), t]) * c ** np.arange(4)
    return sequential, weights @ np.arange(4) / weights.sum()


@pytest.mark.slow
@pytest.mark.statistical
@BOTH
def test_three_points_are_close_as_often_as_the_law_of_each_says(domain):
    distance, c, n = 0.245, 0.15, 3000
    expected = pairs_among_three(domain, distance, c)
    for process, mean in zip((strauss, strauss_process), expected, strict=True):
        found = [
            close_pairs(process(domain, 3, distance=distance, inhibition=c, rng=k), domain, distance) for k in range(n)
        ]
        assert abs(np.mean(found) - mean) < 5 * np.std(found) / np.sqrt(n)


@pytest.mark.statistical
@BOTH
def test_births_and_deaths_balance_as_georgii_nguyen_and_zessin_say(domain):
    # Σ h(x, rest) over the points has the mean of β ∫ h(u, all) c^b(u) du, for any h: here 1, and the points nearby.
    distance, c, activity = 0.2, 0.3, 40.0
    gaps = []
    generator = np.random.default_rng(0)
    for seed in range(400):
        points = strauss_process(domain, distance=distance, inhibition=c, intensity=activity, sweeps=30, rng=seed)
        anywhere = poisson(domain, 400, rng=generator)
        b = tree(points, domain).query_ball_point(tree(anywhere, domain).data, distance, return_length=True)
        own = close_pairs(points, domain, distance)
        gaps.append([len(points) - activity * np.mean(c**b), 2 * own - activity * np.mean(b * c**b)])
    assert (np.abs(np.mean(gaps, axis=0)) < 5 * np.std(gaps, axis=0) / np.sqrt(len(gaps))).all()


@pytest.mark.statistical
@BOTH
def test_without_inhibition_the_count_is_poissons(domain):
    counts = [
        len(strauss_process(domain, distance=0.1, inhibition=1.0, intensity=30.0, sweeps=20, rng=k)) for k in range(800)
    ]
    assert abs(np.mean(counts) - 30) < 5 * np.sqrt(30 / 800)
    assert abs(np.var(counts) / 30 - 1) < 5 * np.sqrt(2 / 800)


@pytest.mark.parametrize("name", DOMAINS)
def test_without_inhibition_points_are_those_of_poisson(name):
    domain = DOMAINS[name]
    ours = strauss(domain, 800, distance=0.3, inhibition=1.0, rng=4)
    if len(domain.planes):  # there batches are cut to length
        assert domain.contains(ours).all()
        ours = ours[:0]
    theirs = poisson(domain, 800, rng=4)[: len(ours)]
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.statistical
@BOTH
def test_without_inhibition_pairs_are_as_many_as_of_poisson(domain):
    n, distance = 400, 0.1
    found = [
        close_pairs(strauss_process(domain, n, distance=distance, inhibition=1.0, sweeps=3, rng=k), domain, distance)
        for k in range(40)
    ]
    expected = n * (n - 1) / 2 * ball(distance, domain)
    assert abs(np.mean(found) - expected) < 5 * np.sqrt(expected / 40)


@pytest.mark.parametrize("process", [strauss, strauss_process])
@pytest.mark.parametrize("name", DOMAINS)
def test_full_inhibition_is_a_hard_core(name, process):
    domain = DOMAINS[name]
    points = process(domain, 60, distance=0.09, inhibition=0.0, rng=2)
    assert len(points) == 60
    assert domain.contains(points).all()
    assert close_pairs(points, domain, 0.09) == 0
    assert close_pairs(poisson(domain, 60, rng=2), domain, 0.09) > 0 or name == "box that wraps twice"


@pytest.mark.parametrize("process", [strauss, strauss_process])
@BOTH
def test_close_pairs_are_fewer_where_inhibition_is_stronger(domain, process):
    n = 1500
    distance = 0.6 * n ** (-1 / (2 if domain.is_planar else 3))
    counts = [
        close_pairs(process(domain, n, distance=distance, inhibition=c, rng=1), domain, distance)
        for c in (1.0, 0.5, 0.2, 0.05, 0.0)
    ]
    assert all(more > fewer for more, fewer in pairwise(counts))
    assert counts[-1] == 0


def test_a_chain_with_an_intensity_and_full_inhibition_is_a_hard_core():
    points = strauss_process(TORI[0], distance=0.1, inhibition=0.0, intensity=400.0, rng=3)
    assert 100 < len(points) < 400
    assert close_pairs(points, TORI[0], 0.1) == 0


def test_the_count_may_be_left_to_chance_and_be_none():
    counts = {
        len(strauss_process(TORI[0], distance=0.1, inhibition=0.5, intensity=0.5, sweeps=50, rng=k)) for k in range(30)
    }
    assert 0 in counts
    assert len(counts) > 1


@pytest.mark.parametrize("count", range(1, 8))
@pytest.mark.parametrize("name", DOMAINS)
def test_the_grid_finds_the_neighbours_that_a_tree_finds(name, count):
    domain = DOMAINS[name]
    points = poisson(domain, 150, rng=count)
    # Just above a whole fraction of the edge: as few cells along it as can be.
    distance = domain.lengths[0] / (count + 0.001)
    grid, links = make_grid(domain, distance, len(points)), np.empty(len(points), dtype=np.int64)
    fill(grid, links, points, len(points))
    expected = tree(points, domain).query_ball_point(tree(points, domain).data, distance, return_length=True) - 1
    found = [count_near(grid, links, points, points[k], k, ALL) for k in range(len(points))]
    reach = 0.5 * domain.lengths[domain.periodic].min(initial=np.inf)
    if distance <= reach:
        np.testing.assert_array_equal(found, expected)
    else:  # the tree counts images beyond half a period; the nearest image is what a torus knows
        assert (np.array(found) <= expected).all()


def test_points_that_leave_the_grid_are_not_found():
    domain, points = TORI[0], poisson(TORI[0], 200, rng=1)
    grid, links = make_grid(domain, 0.2, 200), np.empty(200, dtype=np.int64)
    fill(grid, links, points, 200)
    for k in range(1, 200, 2):
        remove(grid, links, points, k)
    insert(grid, links, points, 7)
    left = np.append(points[::2], points[7:8], axis=0)
    found = [count_near(grid, links, points, place, -1, ALL) for place in points]
    expected = tree(left, domain).query_ball_point(points, 0.2, return_length=True)
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("process", [strauss, strauss_process])
def test_more_hard_points_than_fit_end_with_the_number_that_did(process):
    with pytest.raises(
        InputError, match=r"only \d+ of 1000 points fit .* 100000 candidates in a row .*refused"
    ) as error:
        process(TORI[0], 1000, distance=0.2, inhibition=0.0, rng=1)
    placed = int(str(error.value).split()[1])
    # Random sequential adsorption of spheres ends near a solid fraction of 0.384.
    assert 0.34 < placed * np.pi / 6 * 0.2**3 < 0.40


def test_a_domain_that_fills_too_slowly_ends_too(monkeypatch):
    monkeypatch.setattr(sys.modules["grainsdem.points.strauss"], "MOST_CANDIDATES", 2000)
    with pytest.raises(InputError, match=r"only \d+ of 40 points fit .*: \d+ candidates were refused"):
        strauss(TORI[1], 40, distance=0.21, inhibition=0.0, rng=1)


@pytest.mark.parametrize("process", [strauss, strauss_process])
def test_the_same_rng_gives_the_same_bytes_and_another_gives_others(process):
    one, two, other = (process(MIXED, 500, distance=0.2, inhibition=0.2, rng=k).tobytes() for k in (3, 3, 4))
    assert one == two != other


def test_planar_points_lie_in_the_mid_plane():
    for process in (strauss, strauss_process):
        assert (process(DOMAINS["slab"], 30, distance=0.1, inhibition=0.1, rng=1)[:, 2] == 0.1).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n": 0}, "1 or more; got 0"),
        ({"distance": 0.0}, "above 0 m; got 0.0"),
        ({"distance": np.inf}, "finite length above 0 m; got inf"),
        ({"inhibition": -0.1}, "between 0, .* and 1, all; got -0.1"),
        ({"inhibition": 1.5}, "between 0, .* and 1, all; got 1.5"),
        ({"inhibition": np.nan}, "got nan"),
    ],
)
@pytest.mark.parametrize("process", [strauss, strauss_process])
def test_numbers_out_of_range_are_refused(process, options, words):
    with pytest.raises(InputError, match=words):
        process(Domain.cube(), **{"n": 5, "distance": 0.1, "inhibition": 0.5, **options})


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"n": 5, "intensity": 3.0}, "either n or an intensity; got n = 5, intensity = 3.0"),
        ({}, "either n or an intensity; got n = None, intensity = None"),
        ({"intensity": -1.0}, "the intensity must be finite and above 0; got -1.0"),
        ({"n": 5, "sweeps": 0}, "sweeps must be 1 or more; got 0"),
    ],
)
def test_a_chain_needs_to_know_what_it_is_for(options, words):
    with pytest.raises(InputError, match=words):
        strauss_process(Domain.cube(), distance=0.1, inhibition=0.5, **options)
