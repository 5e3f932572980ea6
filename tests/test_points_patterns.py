from __future__ import annotations

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from grainsdem.errors import InputError, ShapeError
from grainsdem.model import Domain
from grainsdem.points import (
    clark_evans,
    cluster_poisson,
    describe,
    halton,
    nearest_distances,
    pair_correlation,
    poisson,
    ripley_k,
    strauss,
)

pytestmark = pytest.mark.unit

DOMAINS = {
    "3-D torus": Domain.cube(periodic=True),
    "2-D torus": Domain.slab((1.0, 1.0), 0.1, periodic=True),
    "box": Domain.box((1.0, 2.0, 0.5)),
    "slab": Domain.slab((2.0, 1.0), 0.3),
    "half torus": Domain(np.array([-1.0, 0.0, 2.0]), np.array([0.0, 1.0, 4.0]), np.array([False, True, False])),
}
EVERY = pytest.mark.parametrize("domain", DOMAINS.values(), ids=DOMAINS.keys())


def poisson_k(radii, domain):
    return np.pi * radii**2 if domain.is_planar else 4 / 3 * np.pi * radii**3


def steps(seeds, domain):
    """Return all vectors between two seeds, shape (n, n, d), to the nearest image; its memory is n²."""
    k = 2 if domain.is_planar else 3
    between = seeds[:, None, :k] - seeds[None, :, :k]
    size = domain.lengths[:k]
    return np.where(domain.periodic[:k], between - size * np.rint(between / size), between)


def assert_near(values, expected):
    """Assert that the mean of independent values is what it should be, within 5 standard errors."""
    values = np.array(values)
    error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    assert (np.abs(values.mean(axis=0) - expected) < 5 * error).all()


@pytest.mark.statistical
@EVERY
def test_k_of_poisson_seeds_is_the_volume_of_the_ball(domain):
    # Reaching nearly across the domain: without a correction for its walls K would be far too small.
    radii = domain.lengths[: 2 if domain.is_planar else 3].min() * np.array([0.1, 0.3, 0.49])
    found = [ripley_k(poisson(domain, 150, rng=k), domain, radii) for k in range(150)]
    assert_near(found, poisson_k(radii, domain))


@pytest.mark.slow
@pytest.mark.statistical
@pytest.mark.parametrize(
    "domain",
    [
        Domain.cylinder(0.5, 1.0, periodic=True),
        Domain.hopper((2.0, 2.0), (1.0, 1.0), 2.0),
        replace(Domain.slab((2.0, 1.0), 0.2), planes=[[1.0, 1.0, 0.0, 1.8]]),
    ],
    ids=["tube", "funnel", "cut slab"],
)
def test_k_and_g_of_poisson_seeds_are_right_where_planes_cut_the_domain(domain):
    radii = np.array([0.08, 0.16, 0.24])
    found = [poisson(domain, 400, rng=k) for k in range(150)]
    assert_near([ripley_k(seeds, domain, radii) for seeds in found], poisson_k(radii, domain))
    assert_near([pair_correlation(seeds, domain, [0, *radii]) for seeds in found], 1.0)
    # Without a correction K would be too small by far more than that.
    inner = [
        cKDTree(s[:, :d]).count_neighbors(cKDTree(s[:, :d]), 0.24) - 400 for s, d in with_dimensions(found, domain)
    ]
    size = domain.volume / (domain.lengths[2] if domain.is_planar else 1.0)
    assert np.mean(inner) * size / (400 * 399) < 0.9 * poisson_k(0.24, domain)
    assert describe(found[0], domain)["radii"][-1] > 0.05


def with_dimensions(patterns, domain):
    return [(seeds, 2 if domain.is_planar else 3) for seeds in patterns]


@pytest.mark.statistical
@EVERY
def test_g_of_poisson_seeds_is_one(domain):
    edges = domain.lengths[: 2 if domain.is_planar else 3].min() * np.array([0.0, 0.1, 0.2, 0.45])
    found = [pair_correlation(poisson(domain, 150, rng=k), domain, edges) for k in range(150)]
    assert_near(found, 1.0)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["3-D torus", "2-D torus"])
def test_g_of_thomas_clusters_is_the_closed_form(name):
    domain, sigma, parents = DOMAINS[name], 0.03, 60
    d = 2 if domain.is_planar else 3
    edges = sigma * np.linspace(0.0, 5.0, 11)
    found = [
        pair_correlation(cluster_poisson(domain, 600, parents=parents, spread=sigma, rng=k), domain, edges)
        for k in range(80)
    ]
    # The mean over each shell; with a fixed number of parents 1 − 1/m stands for 1.
    r = (edges[:-1, None] + np.diff(edges)[:, None] * (np.arange(200) + 0.5) / 200).T
    g = 1 - 1 / parents + np.exp(-(r**2) / (4 * sigma**2)) / (parents * (4 * np.pi * sigma**2) ** (d / 2))
    assert_near(found, (g * r ** (d - 1)).sum(axis=0) / (r ** (d - 1)).sum(axis=0))


@EVERY
def test_k_and_g_are_the_sums_over_all_pairs(domain):
    seeds = poisson(domain, 200, rng=3)
    size = domain.lengths[: 2 if domain.is_planar else 3]
    periodic = domain.periodic[: len(size)]
    edges = 0.45 * size.min() * np.linspace(0, 1, 7)
    between = steps(seeds, domain)
    distances = np.linalg.norm(between, axis=2)
    shared = np.prod(np.where(periodic, size, size - np.abs(between)), axis=2)
    pairs = ~np.eye(200, dtype=bool)
    k = [np.prod(size) ** 2 / (200 * 199) * (1 / shared)[pairs & (distances <= r)].sum() for r in edges]
    np.testing.assert_allclose(ripley_k(seeds, domain, edges[1:]), k[1:], rtol=1e-12)
    expected = np.diff(k) / np.diff(poisson_k(edges, domain))
    np.testing.assert_allclose(pair_correlation(seeds, domain, edges), expected, rtol=1e-10)


@EVERY
def test_nearest_distances_are_the_least_of_all(domain):
    seeds = poisson(domain, 200, rng=4)
    distances = np.linalg.norm(steps(seeds, domain), axis=2) + np.where(np.eye(200, dtype=bool), np.inf, 0.0)
    np.testing.assert_allclose(nearest_distances(seeds, domain), distances.min(axis=1))


def test_a_cubic_lattice_has_six_neighbours_then_twelve_then_eight():
    n = 6
    lattice = (np.stack(np.meshgrid(*[np.arange(n)] * 3), axis=-1).reshape(-1, 3) + 0.5) / n
    radii = np.array([0.99, 1.01, 1.42, 1.74]) / n
    counts = ripley_k(lattice, Domain.cube(periodic=True), radii) * (n**3 - 1)
    np.testing.assert_allclose(counts, [0, 6, 18, 26], atol=1e-9)
    np.testing.assert_allclose(nearest_distances(lattice, Domain.cube()), 1 / n)


def test_seeds_on_both_sides_of_a_periodic_wall_are_neighbours():
    seeds = [[0.0, 0.5, 0.5], [0.9, 0.5, 0.5], [0.5, 1.0, 0.0]]
    np.testing.assert_allclose(nearest_distances(seeds, DOMAINS["3-D torus"])[:2], 0.1)
    np.testing.assert_allclose(nearest_distances(seeds, Domain.cube())[:2], [np.sqrt(0.75), 0.9], rtol=0.2)


@pytest.mark.statistical
@pytest.mark.parametrize("name", ["3-D torus", "2-D torus"])
def test_clark_and_evanss_index_is_one_at_random_less_for_clusters_and_more_for_order(name):
    domain = DOMAINS[name]
    assert_near([clark_evans(poisson(domain, 2000, exact=False, rng=k), domain) for k in range(40)], 1.0)
    assert clark_evans(cluster_poisson(domain, 500, parents=20, spread=0.03, rng=1), domain) < 0.7
    assert clark_evans(halton(domain, 500), domain) > 1.1
    assert clark_evans(strauss(domain, 300, distance=0.03, inhibition=0.0, rng=1), domain) > 1.03


@pytest.mark.parametrize("most", [1, 7, 1000])
def test_pairs_taken_a_few_at_a_time_are_the_same_pairs(monkeypatch, most):
    domain = DOMAINS["half torus"]
    seeds = poisson(domain, 300, rng=1)
    whole = ripley_k(seeds, domain, [0.1, 0.2, 0.3])
    monkeypatch.setattr("grainsdem.points.patterns.PAIRS_AT_ONCE", most)
    np.testing.assert_allclose(ripley_k(seeds, domain, [0.1, 0.2, 0.3]), whole, rtol=1e-12)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_pairs():
    domain = Domain.cube(periodic=True)
    crowded = cluster_poisson(domain, 3000, parents=1, spread=0.02, rng=1)  # 9 million ordered pairs
    tracemalloc.start()
    ripley_k(crowded, domain, [0.3])
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 250e6


@EVERY
def test_a_description_is_what_its_parts_say(domain):
    seeds = poisson(domain, 300, rng=1)
    said = describe(seeds, domain, reach=0.2, shells=4)
    radii = np.array([0.05, 0.1, 0.15, 0.2])
    assert said["seeds"] == 300
    assert said["nearest_mean"] == pytest.approx(nearest_distances(seeds, domain).mean())
    assert said["nearest_least"] == pytest.approx(nearest_distances(seeds, domain).min())
    assert said["intensity"] == pytest.approx(300 / np.prod(domain.lengths[: 2 if domain.is_planar else 3]))
    np.testing.assert_allclose(said["radii"], radii)
    np.testing.assert_allclose(said["ripley_k"], ripley_k(seeds, domain, radii))
    np.testing.assert_allclose(said["poisson_k"], poisson_k(radii, domain))
    np.testing.assert_allclose(said["pair_correlation"], pair_correlation(seeds, domain, [0, *radii]))
    assert len(describe(seeds, domain)["radii"]) == 12


@pytest.mark.parametrize(
    ("radii", "words"),
    [
        ([], "one row of finite numbers"),
        ([[0.1]], r"shape \(m,\); got shape \(1, 1\)"),
        ([np.nan], "one row of finite numbers"),
        ([0.0, 0.1], "rise from above 0 m"),
        ([0.2, 0.1], "rise from above 0 m"),
        ([0.6], "along y the domain is 1 m long, and radii may be half of it, as it is periodic; got 0.6 m"),
    ],
)
def test_radii_that_do_not_rise_or_reach_too_far_are_refused(radii, words):
    domain = DOMAINS["half torus"]
    with pytest.raises(InputError, match=words):
        ripley_k(poisson(domain, 5, rng=1), domain, radii)


def test_patterns_that_cannot_be_measured_are_refused():
    cube = Domain.cube()
    with pytest.raises(InputError, match="less than it; got 1 m"):
        ripley_k(poisson(cube, 5, rng=1), cube, [1.0])
    with pytest.raises(InputError, match="two seeds or more; got 1"):
        nearest_distances([[0.5, 0.5, 0.5]], cube)
    with pytest.raises(InputError, match="a shell lies between two radii"):
        pair_correlation(poisson(cube, 5, rng=1), cube, [0.1])
    with pytest.raises(InputError, match="must rise from 0 m"):
        pair_correlation(poisson(cube, 5, rng=1), cube, [-0.1, 0.1])
    with pytest.raises(InputError, match="1 of 2 lie outside"):
        clark_evans([[0.5, 0.5, 0.5], [2, 2, 2]], cube)
    with pytest.raises(ShapeError, match="shape"):
        describe([[0.5, 0.5]], cube)
    with pytest.raises(InputError, match="a shell or more; got 0"):
        describe(poisson(cube, 5, rng=1), cube, shells=0)
    tube = Domain.cylinder(1.0, 1.0)
    with pytest.raises(InputError, match=r"no seed is farther than 0\.\d+ m from all walls, .* got 0.8 m"):
        ripley_k(poisson(tube, 50, rng=1), tube, [0.1, 0.8])
