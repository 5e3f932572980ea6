from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.stats import chi2

from grainsdem.errors import InputError, ShapeError
from grainsdem.model import Domain
from grainsdem.points import cluster_poisson, poisson

pytestmark = pytest.mark.unit

TORUS = Domain.cube(periodic=True)
PLANAR_TORUS = Domain.slab((1.0, 1.0), 0.1, periodic=True)


def pairs_within(seeds, domain, radii):
    """Return the ordered pairs nearer than each radius, by a tree that knows nothing of the process."""
    k = 2 if domain.is_planar else 3
    tree = cKDTree(np.mod(seeds[:, :k], 1.0), boxsize=1.0)
    return tree.count_neighbors(tree, radii) - len(seeds)


@pytest.mark.statistical
@pytest.mark.parametrize("domain", [TORUS, PLANAR_TORUS], ids=["3-D", "2-D"])
def test_pairs_follow_the_law_of_thomas(domain):
    m, children, sigma, k = 200, 5.0, 0.02, 2 if domain.is_planar else 3
    radii = sigma * np.array([1.0, 2.0, 4.0])
    counts = []
    for seed in range(60):
        seeds = cluster_poisson(
            domain, parents=poisson(domain, m, exact=False, rng=seed + 1000), children=children, spread=sigma, rng=seed
        )
        counts.append(pairs_within(seeds, domain, radii))
    # Siblings are √2 σ N(0, 1) apart along each axis, so r²/2σ² follows χ² of k degrees; the others are Poisson.
    siblings = m * children**2 * chi2.cdf(radii**2 / (2 * sigma**2), k)
    ball = np.pi * radii**2 if domain.is_planar else 4 / 3 * np.pi * radii**3
    expected = siblings + (m * children) ** 2 * ball
    error = np.std(counts, axis=0, ddof=1) / np.sqrt(len(counts))
    assert (np.abs(np.mean(counts, axis=0) - expected) < 5 * error).all()


@pytest.mark.statistical
def test_the_mean_count_is_parents_times_children_and_its_spread_is_poissons():
    counts = [len(cluster_poisson(TORUS, parents=50, children=8.0, spread=0.1, rng=k)) for k in range(400)]
    assert abs(np.mean(counts) - 400) < 5 * np.sqrt(400 / len(counts))
    assert abs(np.var(counts, ddof=1) / 400 - 1) < 5 * np.sqrt(2 / len(counts))


@pytest.mark.statistical
def test_poisson_counts_are_poissons_where_they_are_not_exact():
    counts = np.array([len(poisson(TORUS, 100, exact=False, rng=k)) for k in range(2000)])
    assert abs(counts.mean() - 100) < 5 * np.sqrt(100 / len(counts))
    assert abs(counts.var(ddof=1) / 100 - 1) < 5 * np.sqrt(2 / len(counts))


@pytest.mark.statistical
def test_a_clipped_count_lacks_what_fell_outside():
    wall = Domain.cube()
    # A parent on a wall loses half of its children, one in a corner all but an eighth.
    for parent, share in [((0.0, 0.5, 0.5), 1 / 2), ((1.0, 1.0, 1.0), 1 / 8)]:
        n = len(cluster_poisson(wall, parents=[parent], children=40_000.0, spread=0.05, rng=2))
        assert abs(n - 40_000 * share) < 5 * np.sqrt(40_000 * share)


@pytest.mark.statistical
def test_a_wall_that_reflects_mirrors_what_fell_outside():
    parents = [(0.02, 0.5, 0.5)]
    seeds = cluster_poisson(Domain.cube(), parents=parents, children=20_000.0, spread=0.05, walls="reflect", rng=5)
    # |N(0.02, 0.05²)| has this second moment about the wall, whatever was reflected.
    square = seeds[:, 0] ** 2
    assert abs(square.mean() - (0.02**2 + 0.05**2)) < 5 * square.std() / np.sqrt(len(seeds))


@pytest.mark.parametrize("walls", ["clip", "reflect"])
@pytest.mark.parametrize(
    "domain", [Domain.cylinder(1.0, 2.0), Domain.hopper((2, 2), (1, 1), 2)], ids=["tube", "funnel"]
)
def test_domains_cut_by_planes_hold_all_children(domain, walls):
    seeds = cluster_poisson(domain, 3000, parents=20, spread=0.6, walls=walls, rng=4)
    assert len(seeds) == 3000
    assert domain.contains(seeds).all()


def test_a_reflecting_domain_loses_no_child_however_far_it_is_thrown():
    generator = np.random.default_rng(6)
    generator.random((10, 3))
    sent = generator.poisson(50.0, 10).sum()
    seeds = cluster_poisson(Domain.cube(), parents=10, children=50.0, spread=30.0, walls="reflect", rng=6)
    assert len(seeds) == sent


def test_periodic_axes_wrap_and_periodic_walls_wrap_all():
    parents = [(0.0, 0.0, 0.0)]
    half = Domain.box((1, 1, 1), periodic=(True, False, False))
    for domain, walls, ends in [(half, "clip", 1), (Domain.cube(), "periodic", 3)]:
        seeds = cluster_poisson(domain, 4000, parents=parents, spread=0.05, walls=walls, rng=1)
        both = ((seeds < 0.3).any(axis=0)) & ((seeds > 0.7).any(axis=0))
        assert both.sum() == ends


def test_an_exact_count_is_reached_and_parents_may_follow_from_children():
    assert len(cluster_poisson(Domain.cube(), 777, parents=6, spread=0.2, rng=1)) == 777
    assert len(cluster_poisson(Domain.cube(), 777, children=10.0, spread=0.2, rng=1)) == 777


def test_the_same_rng_gives_the_same_bytes_and_another_gives_others():
    one, two, other = (cluster_poisson(TORUS, 300, parents=9, spread=0.1, rng=k).tobytes() for k in (3, 3, 4))
    assert one == two != other


def test_planar_children_lie_in_the_mid_plane_about_parents_of_two_coordinates():
    domain = Domain.slab((2.0, 1.0), 0.2)
    seeds = cluster_poisson(domain, 500, parents=[(0.5, 0.5)], spread=0.01, rng=1)
    assert (seeds[:, 2] == 0.1).all()
    np.testing.assert_allclose(seeds[:, :2].mean(axis=0), 0.5, atol=5 * 0.01 / np.sqrt(500))


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"parents": 3}, "two of n, parents and children"),
        ({"n": 5, "parents": 3, "children": 2.0}, "two of n, parents and children"),
        ({"n": 0, "parents": 3}, "1 or more; got 0"),
        ({"n": 5, "parents": 0}, "parents must be 1 or more; got 0"),
        ({"parents": 3, "children": -1.0}, "above 0; got -1.0"),
        ({"n": 5, "parents": 3, "spread": 0.0}, "above 0 m; got 0.0"),
        ({"n": 5, "parents": 3, "spread": np.nan}, "above 0 m; got nan"),
        ({"n": 5, "parents": 3, "walls": "open"}, "'clip', 'reflect' or 'periodic'; got 'open'"),
        ({"n": 5, "parents": [(9.0, 9.0, 9.0)], "spread": 0.01}, "do not reach the domain"),
        ({"n": 5, "parents": [(0.0, np.inf, 0.0)]}, "1 of 1 are not: 0"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(options, words):
    with pytest.raises(InputError, match=words):
        cluster_poisson(Domain.cube(), **{"spread": 0.1, **options})


def test_periodic_walls_are_refused_where_planes_cut():
    with pytest.raises(InputError, match="cannot be periodic in a domain cut by 28 planes"):
        cluster_poisson(Domain.cylinder(1.0, 1.0), 5, parents=2, spread=0.1, walls="periodic")


@pytest.mark.parametrize("parents", [[(0.1, 0.2)], [], [0.1, 0.2, 0.3]])
def test_parents_of_another_shape_are_refused(parents):
    with pytest.raises(ShapeError, match=r"shape \(m, 3\)"):
        cluster_poisson(Domain.cube(), 5, parents=parents, spread=0.1)
