"""Units of files: factors to SI by name or by length."""

from __future__ import annotations

import numpy as np
import pytest

import exporters
from exporters.units import check_units, chosen_units, units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes

pytestmark = pytest.mark.unit


def test_grain_units_make_the_median_grain_its_density_and_gravity_one(fresh):
    scales = units(fresh, gravity=3.0)
    diameters = np.cbrt(6 / np.pi * volumes(fresh.grains))
    assert np.median(diameters) / scales.length == pytest.approx(1.0)
    assert scales.density == pytest.approx(2650.0)
    assert scales.acceleration == pytest.approx(3.0)
    assert scales.velocity == pytest.approx(np.sqrt(3.0 * scales.length))
    assert scales.force == pytest.approx(scales.mass * 3.0)
    assert scales.inertia == pytest.approx(scales.mass * scales.length**2)


@pytest.mark.parametrize(("words", "length"), [("si", 1.0), ("mm", 1e-3), (0.0254, 0.0254), (2, 2.0)])
def test_other_units_change_the_length_and_keep_kilograms_and_seconds(fresh, words, length):
    scales = chosen_units(words, volumes(fresh.grains), fresh.densities)
    assert (scales.length, scales.mass, scales.time) == (length, 1.0, 1.0)
    assert scales.density == pytest.approx(length**-3)


def test_grain_units_by_name_are_those_of_the_packing(fresh):
    assert chosen_units("grain", volumes(fresh.grains), fresh.densities, 1.62) == units(fresh, 1.62)


@pytest.mark.parametrize("words", ["SI", "cm", "", 0.0, -1.0, np.nan, np.inf])
def test_what_are_no_units_is_refused(words):
    with pytest.raises(InputError, match="units must be"):
        check_units(words)


@pytest.mark.parametrize("suffix", [".xml", ".usdc", ".stl", ".obj"])
def test_every_format_with_units_says_in_the_module_what_it_wrote(fresh, suffix):
    module = exporters.module_for(suffix)
    for words in ("si", "mm", "grain", 0.01):
        found = module.factors(fresh, module.Options(units=words))
        assert found["length"] == chosen_units(words, volumes(fresh.grains), fresh.densities).length
        assert set(found) == {"length", "mass", "time"}
