"""Domains cut by planes: cylinders, hoppers, and planes that make no sense."""

import numpy as np
import oracles
import pytest
from test_tessellation_voronoi import check_laws

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import halton, poisson
from grainsdem.tessellation import relax, tessellate

DOMAINS = {
    "cylinder": Domain.cylinder(0.02, 0.05),
    "endless cylinder": Domain.cylinder(3.0, 5.0, sides=8, periodic=True),
    "hopper": Domain.hopper(1.0, 0.2, 0.7),
    "tetrahedron": Domain(planes=[[1.0, 1.0, 1.0, 1.0]]),
}


@pytest.mark.unit
def test_volumes_have_their_closed_forms():
    assert DOMAINS["cylinder"].volume == pytest.approx(np.pi * 0.02**2 * 0.05, rel=1e-12)
    assert DOMAINS["hopper"].volume == pytest.approx(0.7 * (1 + 0.04 + 0.2) / 3, rel=1e-12)
    assert DOMAINS["tetrahedron"].volume == pytest.approx(1 / 6, rel=1e-12)


@pytest.mark.unit
@pytest.mark.parametrize("sides", [8, 32, 64])
def test_a_porosity_in_a_cylinder_is_that_of_the_round_pipe(sides):
    pipe = Domain.cylinder(2.0, 3.0, sides=sides)
    bed = shrink(carve(tessellate(poisson(pipe, 40, rng=1), pipe), keep="all"), porosity=0.4)
    assert 1 - integrate(bed.grains).volumes.sum() / (np.pi * 2.0**2 * 3.0) == pytest.approx(0.4, abs=1e-9)


@pytest.mark.unit
def test_facets_of_a_cylinder_lie_all_as_far_from_its_axis():
    pipe = Domain.cylinder(2.0, 3.0, sides=12)
    apothem = 2.0 * np.sqrt(np.pi / 12 / np.tan(np.pi / 12))
    assert pipe.planes[:, 3] == pytest.approx(apothem)
    assert pipe.upper[:2] == pytest.approx(apothem)
    assert pipe.lower[:2] == pytest.approx(-apothem)


@pytest.mark.unit
@pytest.mark.parametrize("name", DOMAINS)
@pytest.mark.parametrize("n", [1, 2, 300])
def test_cells_fill_the_domain_and_know_its_walls(name, n):
    domain = DOMAINS[name]
    seeds = poisson(domain, n, rng=6)
    assert domain.contains(seeds).all()
    cells = tessellate(seeds, domain)
    check_laws(cells)
    if n == 1:
        box = {-1 - wall for wall in range(6)} if name != "endless cylinder" else {-1, -2, -3, -4}
        lost = {"hopper": {-1, -2, -3, -4}, "tetrahedron": {-2, -4, -6}}.get(name, set())
        planes = {-7 - wall for wall in range(len(domain.planes))}
        assert set(cells.neighbors[cells.neighbors < 0].tolist()) == (box - lost) | planes


@pytest.mark.unit
def test_cells_in_a_cylinder_are_those_of_intersected_half_spaces():
    domain = DOMAINS["cylinder"]
    seeds = halton(domain, 60)
    volumes = integrate(tessellate(seeds, domain).cells).volumes
    assert volumes == pytest.approx(oracles.laguerre_volumes(seeds, np.zeros(60), domain), rel=1e-9)


@pytest.mark.unit
def test_relaxed_seeds_stay_inside():
    domain = DOMAINS["hopper"]
    relaxed = relax(poisson(domain, 100, rng=1), domain, iterations=5)
    assert domain.contains(relaxed).all()


@pytest.mark.unit
def test_a_scaled_domain_has_the_scaled_volume_and_planes():
    domain = DOMAINS["hopper"].scaled(3.0)
    assert domain.volume == pytest.approx(27 * DOMAINS["hopper"].volume, rel=1e-12)


@pytest.mark.unit
def test_planes_and_shapes_that_make_no_domain_are_refused():
    with pytest.raises(InputError, match="planes leave nothing of the box"):
        Domain(planes=[[1.0, 0.0, 0.0, -0.5]])
    with pytest.raises(InputError, match="planes must be finite and have a normal; rows 1 are not"):
        Domain(planes=[[1.0, 0.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]])
    with pytest.raises(InputError, match="parallel to every periodic axis; rows 0 are not"):
        Domain(periodic=[True, False, False], planes=[[1.0, 0.0, 0.0, 0.5]])
    with pytest.raises(InputError, match="sides must be a multiple of 4, from 8 to 1024; got 9"):
        Domain.cylinder(1.0, 1.0, sides=9)
    with pytest.raises(InputError, match="wider at the top"):
        Domain.hopper(0.2, 0.3, 1.0)
    with pytest.raises(InputError, match=r"seeds must lie in the domain .* 1 planes; 1 of 2 lie outside: 1"):
        tessellate([[0.1, 0.1, 0.1], [0.9, 0.9, 0.9]], DOMAINS["tetrahedron"])
