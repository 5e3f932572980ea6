from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import cube_packing

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import surface_areas, volumes
from grainsdem.packing import carve, contacts
from grainsdem.packing.contacts import mean_diameter
from grainsdem.packing.heal import heal
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
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_a_pressed_bed_is_healed_with_the_gap_asked_for_and_the_change_it_says(cells, each):
    rng = np.random.default_rng(2)
    grains = carve(cells)
    d = mean_diameter(grains)
    pressed = replace(grains, positions=grains.positions + 2e-4 * d * rng.standard_normal((len(grains), 3)), links=None)
    assert not validate(pressed).ok
    healed = heal(pressed, gap=1e-5 * d, each=each)
    report = validate(healed.packing)
    assert report.ok, report.failed
    gaps = contacts(healed.packing, within=1e-2 * d).gaps
    assert gaps.min() >= 1e-5 * d * (1 - 1e-9)
    if each == "uniform":
        assert gaps.min() == pytest.approx(1e-5 * d, rel=1e-6)
    before, after = volumes(pressed.grains).sum(), volumes(healed.packing.grains).sum()
    assert healed.volume_change == pytest.approx(after / before - 1, rel=1e-9)
    areas = surface_areas(healed.packing.grains).sum() / surface_areas(pressed.grains).sum()
    assert healed.area_change == pytest.approx(areas - 1, rel=1e-9)
    assert healed.porosity_change == pytest.approx((before - after) / pressed.domain.volume, rel=1e-9)
    assert 0 < healed.porosity_change < 0.01


@pytest.mark.unit
def test_grains_that_are_far_enough_apart_are_left_as_they_are(fresh):
    healed = heal(fresh)
    np.testing.assert_array_equal(healed.scales, 1)
    np.testing.assert_array_equal(healed.packing.grains.vertices, fresh.grains.vertices)
    assert healed.volume_change == 0


@pytest.mark.unit
@pytest.mark.parametrize(
    ("options", "message"), [({"gap": -1.0}, "gap must be"), ({"each": "all"}, "got 'all'"), ({"gap": 9.0}, "too far")]
)
def test_healing_that_cannot_be_done_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        heal(cube_packing([[2.0, 5, 5], [4, 5, 5]]), **options)


@pytest.mark.unit
@pytest.mark.parametrize("each", ["grain", "uniform"])
def test_a_grain_that_reaches_through_a_wall_is_healed_too(each):
    packing = cube_packing([[1 - 0.02, 5, 5], [5, 5, 5]])
    assert not validate(packing).ok
    healed = heal(packing, gap=0.01, each=each)
    assert validate(healed.packing).ok
    np.testing.assert_allclose(healed.scales, [0.97, 1.0 if each == "grain" else 0.97], rtol=1e-12)
