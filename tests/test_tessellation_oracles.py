"""Thousands of cells of each kind against Qhull and Voro++."""

import numpy as np
import oracles
import pytest
from test_tessellation_voronoi import check_laws

from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.model import Domain
from grainsdem.points import halton, poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import tessellate

DOMAIN = Domain.cube()
SIZES = pytest.mark.parametrize("n", [2000, pytest.param(10_000, marks=pytest.mark.slow)])


def clusters(n, parents, spread, rng):
    """Return a Thomas process around the domain's periodic axes: so many parents, children at a normal distance."""
    generator = np.random.default_rng(rng)
    centres = generator.random((parents, 3))[generator.integers(0, parents, n)]
    return np.mod(centres + spread * generator.standard_normal((n, 3)), 1.0)


SEEDS = {
    "poisson": lambda n: poisson(DOMAIN, n, rng=1),
    "halton": lambda n: halton(DOMAIN, n),
    # Densest over mean density, 1 / (parents (4 π spread²)^(3/2)) = 140.
    "clusters": lambda n: clusters(n, 20, 0.02, 3),
}


@pytest.mark.unit
@SIZES
@pytest.mark.parametrize("name", SEEDS)
def test_every_cell_is_that_of_qhull(name, n):
    seeds = SEEDS[name](n)
    cells = tessellate(seeds, DOMAIN)
    check_laws(cells)
    owner = owners(cells.cells.face_offsets)
    at_wall = {-1 - wall: owner[cells.neighbors == -1 - wall] for wall in range(6)}
    areas, wanted = oracles.voronoi_faces(seeds, DOMAIN, at_wall)
    assert np.abs(volumes(cells.cells) / wanted - 1).max() < 1e-9
    rows = zip(owner.tolist(), cells.neighbors.tolist(), map(tuple, cells.shifts.tolist()), strict=True)
    ours = dict(zip(rows, face_planes(cells.cells).areas.tolist(), strict=True))
    assert ours.keys() == areas.keys()
    difference = np.array([ours[key] - areas[key] for key in areas])
    assert np.abs(difference).max() < 1e-11


@pytest.mark.client
@SIZES
@pytest.mark.parametrize("name", ["poisson", "halton", "laguerre"])
def test_every_cell_is_that_of_voropp(name, n):
    seeds = poisson(DOMAIN, n, rng=2) if name == "laguerre" else SEEDS[name](n)
    # Half a squared spacing at most, which leaves some seeds without a cell.
    weights = 0.5 * n ** (-2 / 3) * np.random.default_rng(4).random(n) if name == "laguerre" else np.zeros(n)
    cells = tessellate(seeds, DOMAIN, weights=weights)
    check_laws(cells)
    wanted, neighbors = oracles.voropp(seeds, DOMAIN, weights)
    found = volumes(cells.cells)
    assert np.array_equal(found == 0, wanted == 0)
    if name == "laguerre":
        assert np.count_nonzero(wanted == 0) > n / 200
    full = wanted > 0
    assert np.abs(found[full] / wanted[full] - 1).max() < 1e-9
    ours = np.split(cells.neighbors, cells.cells.face_offsets[1:-1])
    assert [sorted(mine.tolist()) for mine in ours] == neighbors


@pytest.mark.client
@SIZES
def test_clustered_cells_are_those_of_voropp_but_for_faces_that_it_drops(n):
    seeds = SEEDS["clusters"](n)
    cells = tessellate(seeds, DOMAIN)
    wanted, neighbors = oracles.voropp(seeds, DOMAIN)
    owner = owners(cells.cells.face_offsets)
    areas = face_planes(cells.cells).areas
    theirs = np.zeros(len(owner), dtype=bool)
    for i, listed in enumerate(neighbors):
        span = slice(cells.cells.face_offsets[i], cells.cells.face_offsets[i + 1])
        theirs[span] = np.isin(cells.neighbors[span], listed)
        assert set(listed) <= set(cells.neighbors[span].tolist())
    # Voro++ knows a vertex to some 1e-8 of the box only. Qhull sees every one of these faces (above).
    assert np.count_nonzero(~theirs) < 10
    assert areas[~theirs].max(initial=0) < 1e-7
    assert np.abs(volumes(cells.cells) - wanted).max() < 1e-9
