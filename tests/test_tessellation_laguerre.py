"""Laguerre cells: weights, empty cells, and volumes that are asked for."""

import numpy as np
import oracles
import pytest
from scipy import stats
from test_tessellation_voronoi import check_laws

from grainsdem.errors import ConvergenceError, InputError, ShapeError
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.model import Domain
from grainsdem.packing import carve
from grainsdem.points import halton, poisson
from grainsdem.tessellation import sized_cells, tessellate


@pytest.mark.unit
@pytest.mark.parametrize("spread", [0.002, 0.02, 0.2])
def test_volumes_are_those_of_intersected_half_spaces(spread):
    domain = Domain.box((1.0, 1.5, 0.8))
    seeds = poisson(domain, 80, rng=1)
    weights = spread * np.random.default_rng(2).random(80)
    cells = tessellate(seeds, domain, weights=weights)
    check_laws(cells)
    wanted = oracles.laguerre_volumes(seeds, weights, domain)
    assert volumes(cells.cells) == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    if spread == 0.2:
        assert np.count_nonzero(wanted == 0) > 5


@pytest.mark.unit
def test_an_empty_cell_has_no_vertices_and_no_faces_and_no_neighbour_sees_it():
    cells = tessellate([[0.5, 0.5, 0.4], [0.5, 0.5, 0.5], [0.5, 0.5, 0.6]], Domain.cube(), weights=[0.1, 0.0, 0.1])
    check_laws(cells)
    assert np.diff(cells.cells.face_offsets).tolist() == [6, 0, 6]
    assert np.diff(cells.cells.vertex_offsets).tolist() == [8, 0, 8]
    assert 1 not in cells.neighbors
    assert len(carve(cells, keep="all")) == 2


@pytest.mark.unit
def test_a_seed_may_lie_outside_its_own_cell():
    cells = tessellate([[0.4, 0.5, 0.5], [0.5, 0.5, 0.5]], Domain.cube(), weights=[0.03, 0.0])
    check_laws(cells)
    # The plane stands at 0.45 + (w0 - w1) / (2 d) = 0.6, beyond the second seed.
    assert volumes(cells.cells) == pytest.approx([0.6, 0.4], rel=1e-12)


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [False, True])
def test_only_differences_of_weights_matter(periodic):
    domain = Domain.cube(0.01, periodic=periodic)
    seeds = halton(domain, 300)
    weights = 1e-7 * np.random.default_rng(5).random(300)
    a = tessellate(seeds, domain, weights=weights)
    b = tessellate(seeds, domain, weights=weights + 3e-6)
    check_laws(a)
    assert volumes(a.cells) == pytest.approx(volumes(b.cells), rel=1e-9)
    plain = tessellate(seeds, domain, weights=7.0)
    assert np.array_equal(plain.neighbors, tessellate(seeds, domain).neighbors)


@pytest.mark.unit
def test_sized_cells_have_the_volumes_of_their_diameters():
    domain = Domain.cube(0.02)
    diameters = np.random.default_rng(3).lognormal(0.0, 0.4, 200)
    steps = []
    cells = sized_cells(
        domain, diameters, tolerance=1e-3, rng=1, progress=lambda step, worst: steps.append((step, worst))
    )
    check_laws(cells)
    wanted = domain.volume * diameters**3 / np.sum(diameters**3)
    assert np.abs(volumes(cells.cells) / wanted - 1).max() <= 1e-3
    assert [step for step, _ in steps] == list(range(1, len(steps) + 1))
    assert steps[-1][1] <= 1e-3
    again = tessellate(cells.sites, domain, weights=cells.weights)
    assert volumes(again.cells) == pytest.approx(volumes(cells.cells), rel=1e-9)


@pytest.mark.statistical
def test_the_cells_of_a_law_follow_it():
    law = stats.lognorm(0.3, scale=0.002)
    domain = Domain.cube(0.02, periodic=True)
    cells = sized_cells(domain, law, rng=4, relaxations=2)
    # As many as fill the domain: E[π d³ / 6] = π / 6 · scale³ · exp(9 σ² / 2).
    assert len(cells) == pytest.approx(domain.volume / (np.pi / 6 * 0.002**3 * np.exp(4.5 * 0.09)), rel=0.02)
    found = np.cbrt(6 * volumes(cells.cells) / np.pi)
    # Quantiles at the middles of n steps are within 1 / 2n of the law; 1 % of volume and the common scale move them
    # by less than a hundredth of σ each.
    assert stats.kstest(found, law.cdf).statistic < 0.5 / len(cells) + 0.02


@pytest.mark.unit
def test_planar_cells_have_the_areas_of_their_diameters():
    domain = Domain.slab((0.1, 0.1), 0.01)
    diameters = np.random.default_rng(3).uniform(1.0, 2.0, 60)
    cells = sized_cells(domain, diameters, rng=1)
    wanted = domain.volume * diameters**2 / np.sum(diameters**2)
    assert np.abs(volumes(cells.cells) / wanted - 1).max() <= 0.01


@pytest.mark.unit
def test_a_cell_that_nearly_vanished_as_its_seed_moved_comes_back():
    # Of some 1300 beds tried this one alone is left with a cell of almost no volume, from which no step leads away.
    law = stats.lognorm(s=0.9)
    cells = sized_cells(Domain.cube(), law, n=30, rng=105)
    wanted = np.sort(law.ppf((np.arange(30) + 0.5) / 30) ** 3)
    assert np.sort(volumes(cells.cells)) == pytest.approx(wanted / wanted.sum(), rel=0.01)


@pytest.mark.unit
def test_relaxation_makes_sized_cells_rounder():
    domain = Domain.cube(periodic=True)
    diameters = np.random.default_rng(3).lognormal(0.0, 0.3, 300)
    areas = [
        integrate(sized_cells(domain, diameters, rng=1, relaxations=relaxations).cells).areas.sum()
        for relaxations in (0, 8)
    ]
    assert areas[1] < 0.97 * areas[0]


@pytest.mark.unit
def test_sizes_that_cannot_be_had_are_refused():
    domain = Domain.cube()
    with pytest.raises(InputError, match="diameters must be positive and finite; 1 are not: 1"):
        sized_cells(domain, [1.0, -1.0])
    with pytest.raises(InputError, match="tolerance must lie between 0 and 1; got 0"):
        sized_cells(domain, [1.0, 1.0], tolerance=0)
    with pytest.raises(InputError, match="relaxations must be zero or more, at most 100000; got -1"):
        sized_cells(domain, [1.0, 1.0], relaxations=-1)
    with pytest.raises(ShapeError, match=r"got shape \(1, 3\) beside diameters of shape \(2,\)"):
        sized_cells(domain, [1.0, 1.0], seeds=[[0.5, 0.5, 0.5]])
    with pytest.raises(ShapeError, match=r"n is 3, but the diameters have shape \(2,\)"):
        sized_cells(domain, [1.0, 1.0], n=3)
    with pytest.raises(InputError, match="number of cells must be 1 or more; got 0"):
        sized_cells(domain, stats.lognorm(0.3), n=0)
    with pytest.raises(ConvergenceError, match="cells' volumes came within"):
        sized_cells(domain, [1.0, 1.0, 2.0], tolerance=1e-300, rng=1)
