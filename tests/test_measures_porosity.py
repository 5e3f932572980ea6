from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import InputError
from grainsdem.measures import core_box, porosity
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate


def lattice(n, *, domain, half=0.5):
    """Return cubes of edge 2 half on a lattice of unit pitch, n = (columns x, columns y, layers)."""
    places = np.array(list(np.ndindex(*n)), float) + 0.5
    return cube_packing(places, half=half, domain=domain)


@pytest.mark.unit
def test_shrunk_grains_leave_the_porosity_asked_for_in_their_cells(cells):
    assert porosity(shrink(carve(cells), porosity=0.37)) == pytest.approx(0.37, abs=1e-13)
    assert porosity(shrink(carve(cells), scale=0.8)) == pytest.approx(1 - 0.8**3, abs=1e-13)


@pytest.mark.unit
def test_unshrunk_cells_leave_no_void_in_the_domain_nor_in_any_box_of_it(cells):
    packing = carve(cells, keep="all")
    assert porosity(packing, region="domain") == pytest.approx(0, abs=1e-12)
    size = packing.domain.lengths
    assert porosity(packing, region=(0.13 * size, 0.71 * size)) == pytest.approx(0, abs=1e-12)


@pytest.mark.unit
def test_a_lattice_of_cubes_has_its_closed_form_porosity_in_any_whole_cell():
    packing = lattice((4, 4, 4), domain=Domain.cube(4.0), half=0.4)
    assert porosity(packing, region="domain") == pytest.approx(1 - 0.8**3, rel=1e-12)
    assert porosity(packing, region=([0.3, 0.7, 1.1], [2.3, 1.7, 3.1])) == pytest.approx(1 - 0.8**3, rel=1e-12)


@pytest.mark.unit
def test_only_the_part_of_a_grain_inside_the_region_counts():
    packing = cube_packing([[0.0, 2.0, 2.0]], domain=Domain.cube(4.0))  # half of it outside the container
    assert porosity(packing, region="domain") == pytest.approx(1 - 4 / 64, rel=1e-14)
    assert porosity(packing, region=([1.5, 1.5, 1.5], [2, 2, 2])) == 1


@pytest.mark.unit
def test_images_across_periodic_faces_count():
    domain = Domain.cube(4.0, periodic=True)
    packing = cube_packing([[0.2, 3.9, 2.0]], domain=domain)
    assert porosity(packing, region="domain") == pytest.approx(1 - 8 / 64, rel=1e-13)
    # The corner where only images reach: x in [3.2, 4], y in [0, 0.9]
    box = ([3.0, 0.0, 1.0], [4.0, 1.0, 3.0])
    assert porosity(packing, region=box) == pytest.approx(1 - 0.8 * 0.9, rel=1e-13)


@pytest.mark.unit
def test_a_periodic_tessellation_leaves_no_void_in_a_box_across_its_cells():
    domain = Domain.cube(1.0, periodic=True)
    packing = carve(tessellate(poisson(domain, 40, rng=2), domain))
    assert porosity(packing, region="domain") == pytest.approx(0, abs=1e-12)
    assert porosity(packing, region=([0, 0, 0], [0.3, 1, 0.2])) == pytest.approx(0, abs=1e-12)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("region", "match"),
    [
        ("cells", "left the cells"),
        ("hull", "region must be 'cells' or 'domain' or 2 values, each an array of numbers; got 'hull'"),
        (3.0, "each an array of numbers; got 3.0"),
        (([0, 0, 0], [1, 1, -1]), "upper corner must lie above"),
    ],
)
def test_a_region_that_is_none_is_refused(cube, region, match):
    with pytest.raises(InputError, match=match):
        porosity(cube, region=region)


@pytest.mark.unit
def test_a_box_that_reaches_out_of_a_periodic_domain_is_refused():
    packing = cube_packing([[2, 2, 2]], domain=Domain.cube(4.0, periodic=True))
    with pytest.raises(InputError, match="along a periodic axis the box must lie in the domain"):
        porosity(packing, region=([0, 0, 0], [1, 1, 5]))


@pytest.mark.unit
def test_the_core_of_a_level_bed_is_a_diameter_from_walls_floor_and_surface():
    packing = lattice((8, 8, 6), domain=Domain.box((8.0, 8.0, 40.0)))
    d = np.cbrt(6 / np.pi)
    lower, upper = core_box(packing)
    np.testing.assert_allclose(lower, [d, d, d])
    np.testing.assert_allclose(upper, [8 - d, 8 - d, 6 - d])
    assert porosity(packing, region=(lower, upper)) == pytest.approx(0, abs=1e-12)


@pytest.mark.unit
def test_a_grain_lying_on_the_bed_does_not_lift_its_surface_but_a_missing_layer_lowers_it():
    domain = Domain.box((12.0, 12.0, 40.0))
    bed = lattice((12, 12, 6), domain=domain)
    with_one = cube_packing(np.vstack([bed.positions, [[6.5, 6.5, 6.5]]]), half=0.5, domain=domain)
    np.testing.assert_allclose(core_box(with_one), core_box(bed))
    lower_half = bed.positions[(bed.positions[:, 2] < 5) | (bed.positions[:, 0] < 6)]
    stepped = cube_packing(lower_half, half=0.5, domain=domain)
    assert core_box(stepped)[1][2] == pytest.approx(core_box(bed)[1][2] - 1)


@pytest.mark.unit
def test_a_thin_scatter_of_grains_on_the_bed_is_not_its_surface():
    # One grain in nine places of the topmost layer: wide columns would find one in each and call that the surface.
    domain = Domain.box((12.0, 12.0, 40.0))
    bed = lattice((12, 12, 6), domain=domain)
    scatter = [[x, y, 6.5] for x in (1.5, 4.5, 7.5, 10.5) for y in (1.5, 4.5, 7.5, 10.5)]
    rough = cube_packing(np.vstack([bed.positions, scatter]), half=0.5, domain=domain)
    np.testing.assert_allclose(core_box(rough), core_box(bed))


@pytest.mark.unit
def test_the_core_takes_the_whole_of_a_periodic_axis():
    domain = Domain(np.zeros(3), [8.0, 8.0, 40.0], [True, False, False])
    packing = lattice((8, 8, 6), domain=domain)
    lower, upper = core_box(packing, margin=0.5)
    assert (lower[0], upper[0]) == (0, 8)
    assert lower[1] == pytest.approx(0.5 * np.cbrt(6 / np.pi))
    assert porosity(packing, region=(lower, upper)) == pytest.approx(0, abs=1e-12)


@pytest.mark.unit
def test_a_bed_too_small_for_a_core_is_refused_with_its_size():
    narrow = lattice((2, 2, 6), domain=Domain.box((2.0, 2.0, 9.0)))
    with pytest.raises(InputError, match=r"too small for a core 1 diameters inside it.* 1\.241 m"):
        core_box(narrow)
    shallow = lattice((8, 8, 2), domain=Domain.box((8.0, 8.0, 9.0)))
    with pytest.raises(InputError, match="too small for a core"):
        core_box(shallow)


@pytest.mark.unit
def test_a_core_needs_grains_and_a_margin_that_is_not_negative(cube):
    with pytest.raises(InputError, match="margin must be zero or more"):
        core_box(cube, margin=-1)
    nothing = Packing(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], Domain())
    with pytest.raises(InputError, match="no grains"):
        core_box(nothing)


@pytest.mark.unit
def test_the_void_of_a_cylinder_is_measured_against_the_cylinder():
    domain = Domain.cylinder(3.0, 4.0, sides=8)
    packing = cube_packing([[0, 0, 1.0]], domain=domain)
    assert porosity(packing, region="domain") == pytest.approx(1 - 8 / (4 * np.pi * 3.0**2), rel=1e-9)


@pytest.mark.unit
def test_the_core_of_a_cylinder_keeps_its_corners_off_the_wall():
    domain = Domain.cylinder(8.0, 30.0, sides=16)
    places = np.array(list(np.ndindex(16, 16, 8)), float) + np.array([-7.5, -7.5, 0.5])
    places = places[np.hypot(places[:, 0], places[:, 1]) < 7]
    packing = cube_packing(places, half=0.5, domain=domain)
    lower, upper = core_box(packing)
    d = np.cbrt(6 / np.pi)
    corners = np.array([[x, y, 1.0] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])])
    gaps = domain.planes[:, 3] - corners @ domain.planes[:, :3].T
    assert gaps.min() == pytest.approx(d)
    assert upper[2] == pytest.approx(8 - d)
    assert porosity(packing, region=(lower, upper)) == pytest.approx(0, abs=1e-12)


@pytest.mark.unit
def test_a_hopper_is_cored_where_its_funnel_is_wide_enough():
    domain = Domain.hopper([12.0, 12.0], [6.0, 6.0], 20.0)
    places = np.array(list(np.ndindex(6, 6, 8)), float) + np.array([-2.5, -2.5, 0.5])
    lower, upper = core_box(cube_packing(places, half=0.5, domain=domain))
    corners = np.array(
        [[x, y, z] for x in (lower[0], upper[0]) for y in (lower[1], upper[1]) for z in (lower[2], upper[2])]
    )
    assert (domain.planes[:, 3] - corners @ domain.planes[:, :3].T).min() > np.cbrt(6 / np.pi) * (1 - 1e-12)
