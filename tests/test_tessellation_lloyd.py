"""Lloyd's relaxation and the light pass under it."""

import numpy as np
import pytest

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import integrate
from grainsdem.model import Domain
from grainsdem.points import poisson
from grainsdem.ragged import owners
from grainsdem.tessellation import relax, relaxation, tessellate
from grainsdem.tessellation.engine.frame import Frame
from grainsdem.tessellation.engine.light import moments
from grainsdem.tessellation.engine.tree import build


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
    with pytest.raises(InputError, match="iterations must be zero or more, at most 100000; got -1"):
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
    before, after = (integrate(tessellate(s, domain).cells) for s in (seeds, relax(seeds, domain, iterations=10)))
    assert after.volumes.std() < 0.4 * before.volumes.std()


@pytest.mark.unit
def test_a_planar_domain_stays_planar():
    domain = Domain.slab((1.0, 1.0), 0.2)
    relaxed = relax(np.random.default_rng(4).random((80, 2)), domain, iterations=5)
    assert relaxed[:, 2] == pytest.approx(np.full(80, 0.1), abs=1e-14)
    cells = tessellate(relaxed, domain)
    assert np.all(np.bincount(owners(cells.cells.face_offsets)[np.isin(cells.neighbors, (-5, -6))]) == 2)


@pytest.mark.unit
@pytest.mark.parametrize("periodic", [False, True])
def test_the_energy_never_rises_and_stays_above_that_of_bcc(periodic):
    domain = Domain.cube(0.01, periodic=periodic)
    found = relaxation(poisson(domain, 400, rng=5), domain, iterations=30)
    assert len(found.energies) == len(found.moves) == 30
    assert np.all(np.diff(found.energies) < 0)
    assert found.energies[-1] > 0.0785433
    assert found.energies[-1] < 1 / 12


@pytest.mark.unit
@pytest.mark.parametrize(("basis", "exact"), [([[0, 0, 0], [0.5, 0.5, 0.5]], 0.0785433), ([[0, 0, 0]], 1 / 12)])
def test_a_lattice_has_its_exact_energy_and_does_not_move(basis, exact):
    corners = np.stack(np.meshgrid(*[np.arange(4)] * 3, indexing="ij"), axis=-1).reshape(-1, 1, 3)
    seeds = ((corners + np.asarray(basis) + 0.3) / 4).reshape(-1, 3)
    found = relaxation(seeds, Domain.cube(periodic=True), iterations=5, tolerance=1e-9)
    assert found.energies == pytest.approx([exact], rel=1e-6)
    assert found.seeds == pytest.approx(seeds, abs=1e-12)


@pytest.mark.unit
def test_over_relaxation_comes_lower_in_as_many_iterations_and_keeps_the_seeds_inside():
    domain = Domain.cube()
    seeds = poisson(domain, 300, rng=7)
    plain, over = (relaxation(seeds, domain, iterations=12, over_relaxation=factor) for factor in (1.0, 1.6))
    assert over.energies[-1] < plain.energies[-1]
    assert domain.contains(over.seeds).all()


@pytest.mark.unit
def test_a_constant_density_changes_nothing():
    domain = Domain.cube(2.0, periodic=True)
    seeds = poisson(domain, 100, rng=7)
    plain = relax(seeds, domain, iterations=3)
    assert relax(seeds, domain, iterations=3, density=lambda x: np.full(len(x), 4.0)) == pytest.approx(plain, abs=1e-12)
    assert relax(seeds, domain, iterations=3, density=np.ones((2, 3, 4))) == pytest.approx(plain, abs=1e-12)


@pytest.mark.unit
def test_one_cell_moves_to_the_centroid_of_a_linear_density_exactly():
    # ∫ x · x dx / ∫ x dx over the unit interval is 2/3.
    found = relax([[0.3, 0.5, 0.5]], Domain.cube(), iterations=1, density=lambda x: x[:, 0])
    assert found == pytest.approx(np.array([[2 / 3, 0.5, 0.5]]), abs=1e-14)


@pytest.mark.unit
def test_a_stack_relaxes_to_the_graded_bed_of_one_dimension():
    from scipy.optimize import fsolve

    decay = 1.2

    def unbalanced(z):
        """Return how far each seed is from the centroid of its slab under the density exp(-decay z), exactly."""
        edges = np.concatenate([[0.0], 0.5 * (z[1:] + z[:-1]), [3.0]])
        mass = -np.diff(np.exp(-decay * edges)) / decay
        moment = -np.diff(np.exp(-decay * edges) * (edges / decay + 1 / decay**2))
        return z - moment / mass

    start = 0.5 + np.arange(6) * 0.4
    exact = fsolve(unbalanced, start)
    assert exact[-1] - exact[-2] > 2 * (exact[1] - exact[0])
    # The box is narrower than the slabs are thick: in a wide one the stack buckles.
    seeds = np.column_stack([np.full(6, 0.1), np.full(6, 0.1), start])
    found = relaxation(
        seeds,
        Domain.box((0.2, 0.2, 3.0)),
        iterations=300,
        over_relaxation=1.7,
        tolerance=2e-4,
        density=lambda x: np.exp(-decay * x[:, 2]),
    )
    assert len(found.moves) < 300
    # Four points in a tetrahedron are exact for quadratics; the exponential bends a little more.
    assert found.seeds[:, 2] == pytest.approx(exact, abs=0.01)


@pytest.mark.unit
def test_seeds_gather_where_the_voxels_are_high():
    domain = Domain.box((1.0, 1.0, 2.0))
    voxels = np.ones((1, 1, 2))
    voxels[..., 1] = 32.0
    seeds = poisson(domain, 200, rng=2)
    above = [
        np.count_nonzero(relax(seeds, domain, iterations=20, over_relaxation=1.5, density=density)[:, 2] > 1.0)
        for density in (None, voxels, voxels[..., ::-1])
    ]
    # Of some 100: without a density hardly a seed crosses the middle.
    assert above[1] > above[0] + 10
    assert above[2] < above[0] - 10


@pytest.mark.unit
def test_options_that_make_no_sense_are_refused():
    domain, seeds = Domain.cube(), [[0.5, 0.5, 0.5]]
    with pytest.raises(InputError, match="over_relaxation must lie between 0 and 2; got 2"):
        relax(seeds, domain, over_relaxation=2)
    with pytest.raises(InputError, match="tolerance must be zero or more; got -1"):
        relax(seeds, domain, tolerance=-1)
    with pytest.raises(InputError, match="density must be finite and not negative; got -1"):
        relax(seeds, domain, density=-np.ones((2, 2, 2)))
    with pytest.raises(InputError, match="density must not be zero everywhere"):
        relax(seeds, domain, density=np.zeros((2, 2, 2)))
    with pytest.raises(ShapeError, match=r"shape \(nx, ny, nz\); got shape \(2, 2\)"):
        relax(seeds, domain, density=np.ones((2, 2)))
    with pytest.raises(ShapeError, match="the density must return shape"):
        relax(seeds, domain, density=lambda x: x)
