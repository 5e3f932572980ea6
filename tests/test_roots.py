from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grainsdem.errors import InputError
from grainsdem.roots import cube_roots, raised


@pytest.mark.property
@given(st.floats(1e-190, 1e100))
def test_a_cube_root_is_the_number_nearest_to_it(value):
    root = float(cube_roots(value))
    # Exact arithmetic: the cubes of the middles between the root and its neighbours lie on either side.
    below, above = (Fraction(1, 2) * (Fraction(root) + Fraction(float(np.nextafter(root, to)))) for to in (0.0, np.inf))
    assert below**3 <= Fraction(value) <= above**3


@pytest.mark.unit
def test_cube_roots_of_what_has_none_or_is_at_the_ends_are_numpys():
    values = np.array([0.0, -27.0, np.inf, -np.inf, np.nan, 5e-324, 1e300])
    np.testing.assert_allclose(cube_roots(values), np.cbrt(values), rtol=1e-15)
    assert cube_roots(8.0).shape == ()


@pytest.mark.unit
def test_values_are_raised_by_multiplication():
    assert raised([2.0, 3.0], 3).tolist() == [8.0, 27.0]
    assert raised([2.0], 1).tolist() == [2.0]
    with pytest.raises(InputError, match="1 or more; got 0"):
        raised([1.0], 0)
