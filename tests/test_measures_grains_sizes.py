from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import place, polyhedra, solid

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures import diameters, masses, percentiles

finite = st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=40)


@pytest.mark.unit
def test_the_diameter_of_a_cube_is_that_of_the_sphere_of_its_volume():
    d = diameters(solid("cube", 2.0))[0]
    assert np.pi * d**3 / 6 == pytest.approx(8, rel=1e-14)


@pytest.mark.unit
def test_mass_is_density_times_volume():
    packing = cube_packing([[1, 1, 1], [5, 5, 5]], half=0.5, density=2650.0)
    np.testing.assert_allclose(masses(packing), 2650.0)


@pytest.mark.unit
def test_half_of_the_mass_lies_below_a_grain_that_is_half_of_it():
    # One grain of half the mass between two of a quarter: it stands at 50 %, they at 12.5 and 87.5 %.
    found = percentiles([3.0, 1.0, 2.0], [12.5, 50, 87.5, 0, 100], weights=[1, 1, 2])
    np.testing.assert_allclose(found, [1, 2, 3, 1, 3])


@pytest.mark.unit
def test_by_mass_large_grains_count_for_more_than_by_number():
    d = diameters(polyhedra(*(s * solid("cube").vertices for s in (1.0, 1.0, 1.0, 2.0))))
    assert percentiles(d, 50, weights=d**3) > percentiles(d, 50)


@pytest.mark.unit
def test_values_of_no_weight_change_nothing():
    with_them = percentiles([1.0, 5.0, 2.0, 9.0], [10, 50, 90], weights=[1, 0, 2, 0])
    np.testing.assert_array_equal(with_them, percentiles([1.0, 2.0], [10, 50, 90], weights=[1, 2]))


@pytest.mark.unit
@pytest.mark.parametrize(
    ("values", "q", "weights", "error", "match"),
    [
        ([], 50, None, InputError, "at least one value"),
        ([[1.0]], 50, None, ShapeError, r"of shape \(n,\); got shape \(1, 1\)"),
        ([1.0, 2.0], 50, [1.0], ShapeError, r"got shape \(1,\) beside values of shape \(2,\)"),
        ([1.0, np.nan], 50, None, InputError, "1 of 2 are not"),
        ([1.0], 101, None, InputError, r"lie in \[0, 100\]; got 101"),
        ([1.0], [np.nan], None, InputError, r"lie in \[0, 100\]"),
        ([1.0, 2.0], 50, [1.0, -1.0], InputError, "the least is -1"),
        ([1.0, 2.0], 50, [0.0, 0.0], InputError, "not all zero"),
    ],
)
def test_what_has_no_percentiles_is_refused(values, q, weights, error, match):
    with pytest.raises(error, match=match):
        percentiles(values, q, weights=weights)


@pytest.mark.property
@settings(max_examples=100, deadline=None)
@given(finite, st.floats(0, 100))
def test_percentiles_by_number_are_hazens(values, q):
    expected = np.percentile(values, q, method="hazen")
    assert percentiles(values, q) == pytest.approx(expected, rel=1e-9, abs=1e-6)


@pytest.mark.property
@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(st.floats(0.1, 10), st.floats(1e-3, 1e3)), min_size=1, max_size=30), st.randoms())
def test_percentiles_rise_stay_within_the_values_and_know_neither_order_nor_unit_of_weight(pairs, random):
    x, w = map(np.array, zip(*pairs, strict=True))
    q = np.linspace(0, 100, 23)
    found = percentiles(x, q, weights=w)
    assert (np.diff(found) >= 0).all()
    assert found[0] == x.min()
    assert found[-1] == x.max()
    order = random.sample(range(len(x)), len(x))
    np.testing.assert_allclose(percentiles(x[order], q, weights=7e-9 * w[order]), found, rtol=1e-6)


@pytest.mark.statistical
def test_weighting_by_mass_gives_the_percentiles_of_the_mass():
    # Lognormal by number with spread s: by mass it is lognormal too, with its median
    # moved by exp(3 s²) (Hatch and Choate 1929).
    rng, s, n = np.random.default_rng(4), 0.2, 40_000
    d = np.exp(s * rng.standard_normal(n))
    found = percentiles(d, 50, weights=d**3)
    w = d**3 / np.mean(d**3)
    # standard error of a weighted median: √(E[w² (1/2 − 1{x<m})²]/n) over the density,
    # here of a lognormal at its median
    error = 0.5 * np.sqrt(np.mean(w**2) / n) * np.exp(3 * s**2) * s * np.sqrt(2 * np.pi)
    assert abs(found - np.exp(3 * s**2)) < 5 * error


@pytest.mark.unit
def test_an_empty_packing_has_no_sizes():
    from grainsdem.model import Polyhedra

    nothing = place(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)))
    assert len(diameters(nothing.grains)) == len(masses(nothing)) == 0
