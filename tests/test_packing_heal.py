from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing
from solids import SOLIDS, place, polyhedra

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import surface_areas, volumes
from grainsdem.model import Domain
from grainsdem.packing import carve, contacts
from grainsdem.packing.contacts import mean_diameter
from grainsdem.packing.heal import heal
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate


@pytest.mark.unit
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_two_cubes_pressed_together_lose_half_of_the_depth_each(each):
    packing = cube_packing([[2.0, 5, 5], [4 - 0.02, 5, 5], [8, 5, 5]])
    healed = heal(packing, each=each)
    expected = [0.99, 0.99, 1.0 if each == "grain" else 0.99]
    np.testing.assert_allclose(healed.scales, expected, rtol=1e-12)
    assert contacts(healed.packing, within=0.1).gaps[0] == pytest.approx(0, abs=1e-13)
    assert (contacts(healed.packing, within=0.1).gaps >= 0).all()


@pytest.mark.unit
@pytest.mark.parametrize("by", ["scale", "inset"])
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_a_pressed_bed_is_healed_with_the_gap_asked_for_and_the_change_it_says(cells, each, by):
    rng = np.random.default_rng(2)
    grains = carve(cells)
    d = mean_diameter(grains)
    pressed = replace(grains, positions=grains.positions + 2e-4 * d * rng.standard_normal((len(grains), 3)), links=None)
    assert not validate(pressed).ok
    healed = heal(pressed, gap=1e-5 * d, each=each, by=by)
    report = validate(healed.packing)
    assert report.ok, report.failed
    gaps = contacts(healed.packing, within=1e-2 * d).gaps
    assert gaps.min() >= 1e-5 * d * (1 - 1e-9)
    if each == "uniform":
        # The smallest inset is found to a millionth of itself, and gaps move by as much.
        most = 1e-6 if by == "scale" else 4e-6 * healed.insets[0] / (1e-5 * d)
        assert gaps.min() == pytest.approx(1e-5 * d, rel=most)
    before, after = volumes(pressed.grains).sum(), volumes(healed.packing.grains).sum()
    assert healed.volume_change == pytest.approx(after / before - 1, rel=1e-9)
    areas = surface_areas(healed.packing.grains).sum() / surface_areas(pressed.grains).sum()
    assert healed.area_change == pytest.approx(areas - 1, rel=1e-9)
    assert healed.porosity_change == pytest.approx((before - after) / pressed.domain.volume, rel=1e-9)
    assert 0 < healed.porosity_change < 0.01


@pytest.mark.unit
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_two_cubes_pressed_together_are_inset_by_half_of_the_depth_each(each):
    packing = cube_packing([[2.0, 5, 5], [4 - 0.02, 5, 5], [8, 5, 5]])
    healed = heal(packing, each=each, by="inset")
    last = 0.0 if each == "grain" else 0.01
    np.testing.assert_allclose(healed.insets, [0.01, 0.01, last], rtol=2e-6)
    np.testing.assert_array_equal(healed.scales, 1)
    lost = 2 * (8 - 1.98**3) + 8 - (2 - 2 * last) ** 3
    assert healed.volume_change == pytest.approx(-lost / 24, rel=1e-5)
    assert healed.porosity_change == pytest.approx(lost / 1000, rel=1e-5)
    assert contacts(healed.packing, within=0.1).gaps[0] == pytest.approx(0, abs=1e-7)
    assert (contacts(healed.packing, within=0.1).gaps >= 0).all()


@pytest.mark.unit
def test_a_sharp_tip_needs_a_smaller_uniform_inset_than_half_of_its_depth():
    # The tip of an octahedron recedes by √3 t, the face that it presses on by t.
    shapes = polyhedra(SOLIDS["octahedron"][0], SOLIDS["cube"][0])
    packing = place(shapes, [[5.0, 5, 6.98], [5, 5, 5]])
    by_grain, uniform = (heal(packing, each=each, by="inset") for each in ("grain", "uniform"))
    np.testing.assert_allclose(by_grain.insets, 0.01, rtol=1e-9)
    np.testing.assert_allclose(uniform.insets, 0.02 / (1 + np.sqrt(3)), rtol=2e-6)
    for healed in (by_grain, uniform):
        assert validate(healed.packing).ok


@pytest.mark.unit
def test_an_inset_takes_less_from_long_grains_than_scaling_does():
    rod = polyhedra(SOLIDS["cube"][0] * [4.0, 1, 1], SOLIDS["cube"][0] * [4.0, 1, 1])
    end_to_end = place(rod, [[6.0, 5, 5], [14 - 0.1, 5, 5]], domain=Domain.cube(20.0))
    side_by_side = place(rod, [[6.0, 5, 5], [6, 7 - 0.1, 5]], domain=Domain.cube(20.0))
    assert heal(end_to_end, by="inset").volume_change == pytest.approx(7.9 * 1.9**2 / 32 - 1)
    assert heal(side_by_side, by="inset").volume_change == pytest.approx(7.9 * 1.9**2 / 32 - 1)
    assert heal(side_by_side, by="scale").volume_change == pytest.approx(0.95**3 - 1)


@pytest.mark.unit
@pytest.mark.parametrize("by", ["scale", "inset"])
def test_prisms_of_a_planar_bed_are_healed_in_their_plane(by):
    domain = Domain.slab((1.0, 1.0), 0.1)
    prisms = carve(tessellate(poisson(domain, 40, rng=3), domain))
    d = mean_diameter(prisms)
    rng = np.random.default_rng(1)
    steps = 1e-3 * d * rng.standard_normal((len(prisms), 3)) * [1, 1, 0]
    pressed = replace(prisms, positions=prisms.positions + steps, links=None)
    healed = heal(pressed, gap=1e-4 * d, by=by)
    assert contacts(healed.packing, within=1e-2 * d).gaps.min() >= 1e-4 * d * (1 - 1e-9)
    np.testing.assert_allclose(np.abs(healed.packing.grains.vertices[:, 2]), 0.05, rtol=1e-12)


@pytest.mark.unit
def test_grains_that_are_far_enough_apart_are_left_as_they_are(fresh):
    healed = heal(fresh)
    np.testing.assert_array_equal(healed.scales, 1)
    np.testing.assert_array_equal(healed.packing.grains.vertices, fresh.grains.vertices)
    assert healed.volume_change == 0


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"gap": -1.0}, "gap must be"),
        ({"each": "all"}, "got 'all'"),
        ({"by": "cut"}, "got 'cut'"),
        ({"gap": 9.0}, "too far"),
        ({"gap": 9.0, "by": "inset"}, "too far to be healed by an inset: .*2 of 2 would vanish by"),
    ],
)
def test_healing_that_cannot_be_done_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        heal(cube_packing([[2.0, 5, 5], [4, 5, 5]]), **options)


@pytest.mark.unit
@pytest.mark.parametrize("by", ["scale", "inset"])
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_a_grain_that_reaches_through_a_wall_is_healed_too(each, by):
    packing = cube_packing([[1 - 0.02, 5, 5], [5, 5, 5]])
    assert not validate(packing).ok
    healed = heal(packing, gap=0.01, each=each, by=by)
    assert validate(healed.packing).ok
    expected = np.array([0.03, 0.0 if each == "grain" else 0.03])
    if by == "scale":
        np.testing.assert_allclose(healed.scales, 1 - expected, rtol=1e-12)
    else:
        np.testing.assert_allclose(healed.insets, expected, rtol=2e-6)
