"""Lloyd's relaxation and the light pass under it."""

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.model import Domain
from grainsdem.points import poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import relax, tessellate
from grainsdem.tessellation.frame import Frame
from grainsdem.tessellation.light import moments
from grainsdem.tessellation.tree import build


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [False, True])
def test_the_light_pass_measures_what_the_full_cells_have(periodic):
    domain = Domain(np.array([1.0, 2.0, 3.0]), np.array([3.0, 3.0, 3.7]), np.full(3, periodic))
    seeds = poisson(domain, 500, rng=2)
    frame = Frame.of(domain)
    light = moments(build(frame.inward(seeds), np.zeros(500)), frame)
    full = integrate(tessellate(seeds, domain).cells)
    assert light.volumes == pytest.approx(full.volumes, rel=1e-12)
    assert light.centroids == pytest.approx(full.centroids, abs=1e-12)
    # ∫ |x|² = tr(I) / 2 about the centroid, and the parallel axes.
    second = np.trace(full.inertias, axis1=1, axis2=2) / 2 + full.volumes * np.sum(full.centroids**2, axis=1)
    assert light.energies == pytest.approx(second, rel=1e-10)


@pytest.mark.unit
def test_no_iteration_leaves_the_seeds_and_a_negative_number_is_refused():
    domain = Domain.cube()
    seeds = poisson(domain, 20, rng=1)
    assert np.array_equal(relax(seeds, domain, iterations=0), seeds)
    with pytest.raises(InputError, match="iterations must be zero or more; got -1"):
        relax(seeds, domain, iterations=-1)


@pytest.mark.unit
def test_two_seeds_relax_to_the_centres_of_two_halves():
    domain = Domain.box((2.0, 1.0, 1.0))
    relaxed = relax([[0.4, 0.5, 0.5], [0.6, 0.5, 0.5]], domain, iterations=60)
    assert relaxed == pytest.approx(np.array([[0.5, 0.5, 0.5], [1.5, 0.5, 0.5]]), abs=1e-9)


@pytest.mark.unit
def test_one_iteration_moves_every_seed_to_the_centroid_of_its_cell_around_periodic_axes_too():
    domain = Domain.cube(0.5, periodic=True)
    seeds = poisson(domain, 200, rng=9)
    cells = tessellate(seeds, domain).cells
    wanted = np.mod(seeds + integrate(cells).centroids, 0.5)
    ticks = []
    assert relax(seeds, domain, iterations=1, progress=ticks.append) == pytest.approx(wanted, abs=1e-14)
    assert ticks == [1]


@pytest.mark.unit
def test_relaxed_cells_are_more_alike():
    domain = Domain.cube(periodic=True)
    seeds = poisson(domain, 300, rng=3)
    before, after = (
        integrate(tessellate(s, domain).cells) for s in (seeds, relax(seeds, domain, iterations=10))
    )
    assert after.volumes.std() < 0.4 * before.volumes.std()


@pytest.mark.unit
def test_a_planar_domain_stays_planar():
    domain = Domain.slab((1.0, 1.0), 0.2)
    relaxed = relax(np.random.default_rng(4).random((80, 2)), domain, iterations=5)
    assert relaxed[:, 2] == pytest.approx(np.full(80, 0.1), abs=1e-14)
    cells = tessellate(relaxed, domain)
    assert np.all(np.bincount(owners(cells.cells.face_offsets)[np.isin(cells.neighbors, (-5, -6))]) == 2)
