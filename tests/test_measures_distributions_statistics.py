from __future__ import annotations

import json

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.measures import diameters, fit_sizes, percentiles, size_distribution, size_statistics, table, to_phi
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve
from grainsdem.points import poisson
from grainsdem.tessellation import tessellate


def normal_in_phi(mean, sorting, n=100_000):
    """Return sizes at the middles of n equal shares of a normal distribution of φ."""
    return 1e-3 * 2.0 ** -(mean + sorting * norm.ppf((np.arange(n) + 0.5) / n))


@pytest.mark.unit
def test_statistics_of_a_normal_distribution_of_phi_are_its_closed_forms():
    found = size_statistics(normal_in_phi(1.4, 0.45))
    z = norm.ppf([0.75, 0.84, 0.95])
    sorting = 0.45 * (z[1] / 2 + z[2] / 3.3)
    assert found.folk_ward.mean == pytest.approx(1.4, abs=1e-6)
    assert found.folk_ward.sorting == pytest.approx(sorting, rel=1e-4)
    assert found.folk_ward.skewness == pytest.approx(0, abs=1e-6)
    assert found.folk_ward.kurtosis == pytest.approx(z[2] / (2.44 * z[0]), rel=1e-4)
    assert found.moments.mean == pytest.approx(1.4, abs=1e-6)
    assert found.moments.sorting == pytest.approx(0.45, rel=1e-3)
    assert found.moments.kurtosis == pytest.approx(3, rel=1e-2)  # a hundred thousand shares cut the tails
    names = (found.size_class, found.sorting_class, found.skewness_class, found.kurtosis_class)
    assert names == ("medium sand", "well sorted", "symmetrical", "mesokurtic")
    np.testing.assert_allclose(found.percentiles["d50"], 1e-3 * 2**-1.4, rtol=1e-6)


@pytest.mark.unit
def test_graphic_statistics_of_five_grains_are_those_worked_by_hand():
    # Hazen: φ = 0, 1, 2, 3, 8 stand at 10, 30, 50, 70 and 90 %; φ5 = 0, φ16 = 0.3, φ25 = 0.75, φ75 = 4.25, φ84 = 6.5.
    found = size_statistics(1e-3 * 2.0 ** -np.array([3.0, 0, 8, 1, 2])).folk_ward
    assert found.mean == pytest.approx((0.3 + 2 + 6.5) / 3)
    assert found.sorting == pytest.approx(6.2 / 4 + 8 / 6.6)
    assert found.skewness == pytest.approx((0.3 + 6.5 - 4) / (2 * 6.2) + (0 + 8 - 4) / (2 * 8))
    assert found.kurtosis == pytest.approx(8 / (2.44 * 3.5))


@pytest.mark.unit
def test_by_volume_a_lognormal_distribution_is_coarser_by_hatch_and_choate():
    d = normal_in_phi(0.0, 0.5)
    s = 0.5 * np.log(2)
    shifted = size_statistics(d, weights=d**3)
    assert shifted.moments.mean == pytest.approx(-3 * s**2 / np.log(2), rel=1e-2)
    assert shifted.moments.sorting == pytest.approx(0.5, rel=1e-2)
    assert shifted.percentiles["d50"] == pytest.approx(1e-3 * np.exp(3 * s**2), rel=1e-3)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("sorting", "name"),
    [
        (0.2, "very well sorted"),
        (0.6, "moderately well sorted"),
        (0.9, "moderately sorted"),
        (1.5, "poorly sorted"),
        (3.0, "very poorly sorted"),
        (5.0, "extremely poorly sorted"),
    ],
)
def test_sorting_has_the_names_of_folk_and_ward(sorting, name):
    assert size_statistics(normal_in_phi(2.0, sorting, 2000)).sorting_class == name


@pytest.mark.unit
def test_a_tail_of_fine_grains_is_a_fine_skew_and_one_size_has_no_skewness():
    fine = size_statistics(np.concatenate([normal_in_phi(1.0, 0.3, 800), normal_in_phi(2.5, 0.3, 200)]))
    assert "fine skewed" in fine.skewness_class
    assert fine.folk_ward.skewness > 0.1
    assert fine.moments.skewness > 0
    one = size_statistics(np.full(7, 0.3e-3))
    assert np.isnan([one.folk_ward.skewness, one.moments.kurtosis]).all()
    assert (one.folk_ward.sorting, one.skewness_class) == (0.0, "")
    assert json.loads(json.dumps(one.to_dict(), allow_nan=False))["moments"]["skewness"] is None


@pytest.mark.property
@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(1e-6, 10.0), min_size=3, max_size=40), st.floats(1e-3, 1e3))
def test_a_change_of_scale_moves_the_mean_and_keeps_the_rest(sizes, s):
    one, other = size_statistics(sizes), size_statistics(s * np.array(sizes))
    for kind in ("folk_ward", "moments"):
        a, b = getattr(one, kind), getattr(other, kind)
        assert b.mean == pytest.approx(a.mean - np.log2(s), abs=1e-9)
        assert b.sorting == pytest.approx(a.sorting, abs=1e-9)
    assert other.percentiles["d50"] == pytest.approx(s * one.percentiles["d50"], rel=1e-12)


@pytest.mark.unit
def test_sizes_without_a_logarithm_are_refused():
    with pytest.raises(InputError, match="1 of 2 are not"):
        size_statistics([0.0, 1.0])
    with pytest.raises(InputError, match="at least one value"):
        size_statistics([])
    assert to_phi(4e-3) == -2


@pytest.mark.unit
def test_the_distribution_of_a_bed_has_its_percentiles_by_number_and_volume_and_its_fits(fresh):
    found = json.loads(json.dumps(size_distribution(fresh), allow_nan=False))
    d, v = diameters(fresh.grains), volumes(fresh.grains)
    assert found["by_number"]["percentiles"]["d10"] == pytest.approx(percentiles(d, 10))
    assert found["by_volume"]["percentiles"]["d90"] == pytest.approx(percentiles(d, 90, weights=v))
    assert found["fits"]["log-hyperbolic"] == json.loads(json.dumps(fit_sizes(d).to_dict()))
    assert found["fits"]["normal"]["aic"] == fit_sizes(d, "normal").aic
    sieve = size_distribution(fresh, diameter="sieve")
    assert sieve["by_number"]["percentiles"]["d50"] == pytest.approx(np.median(table(fresh)["sieve_diameter"]))


@pytest.mark.unit
def test_equal_or_few_grains_have_statistics_and_no_fit(cube):
    assert size_distribution(cube)["fits"] is None
    assert size_distribution(cube_packing([[1, 1, 1]] * 20))["fits"] is None
    nothing = Packing(Polyhedra(np.empty((0, 3)), [0], [0], [], [0]), np.empty((0, 3)), np.empty((0, 4)), [], Domain())
    with pytest.raises(InputError, match="at least one grain"):
        size_distribution(nothing)
    with pytest.raises(InputError, match="'volume' or 'sieve'; got 'mesh'"):
        size_distribution(cube, diameter="mesh")
    with pytest.raises(InputError, match="between 0 and 1; got 2"):
        size_distribution(cube_packing([[1, 1, 1]] * 20), confidence=2)


@pytest.mark.unit
def test_a_planar_bed_has_the_sizes_of_its_plane_and_no_sieves():
    domain = Domain.slab((1.0, 1.0), 0.01)
    bed = carve(tessellate(poisson(domain, 80, rng=3), domain), keep="all")
    areas = volumes(bed.grains) / 0.01
    found = size_distribution(bed)
    assert found["diameter"] == "area"
    assert found["by_number"]["percentiles"]["d50"] == pytest.approx(np.median(np.sqrt(4 * areas / np.pi)))
    with pytest.raises(InputError, match="no sieve diameters"):
        size_distribution(bed, diameter="sieve")
