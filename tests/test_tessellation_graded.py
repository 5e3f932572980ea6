from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

import grainsdem as gd
from grainsdem.errors import InputError
from grainsdem.tessellation.graded import graded_cells

OPENINGS, PASSING = [0.5e-3, 1e-3, 2e-3, 4e-3], [0.0, 0.25, 0.7, 1.0]


def passing_of(bed, openings, sizes):
    """Return the share of a bed's mass that is finer than each opening, from the definition."""
    masses = gd.volumes(bed.grains)
    return [masses[sizes < opening].sum() / masses.sum() for opening in openings]


@pytest.mark.parametrize("diameter", ["equal-volume", "sieve"])
@pytest.mark.parametrize("keep", ["inside", "all"])
def test_the_grains_that_are_kept_have_the_curve_of_the_sieves(diameter, keep):
    grading = gd.Grading(OPENINGS, PASSING, diameter)
    found = graded_cells(gd.Domain.cube(1.0), grading, n=700, keep=keep, relaxations=2, rng=1)
    bed = gd.carve(found.cells, keep=keep)
    bed = gd.resize(gd.shrink(bed, porosity=0.5), diameters=found.diameters)
    sizes = gd.sieve_diameters(bed) if diameter == "sieve" else gd.diameters(bed)
    assert passing_of(bed, OPENINGS, sizes) == pytest.approx(PASSING, abs=5e-3)
    assert found.deviation <= 5e-3


def test_prisms_in_a_plane_have_it_too():
    domain = gd.Domain.slab((1.0, 1.0), 0.1)
    for diameter in ("equal-volume", "sieve"):
        grading = gd.Grading(OPENINGS, PASSING, diameter)
        found = graded_cells(domain, grading, n=600, relaxations=2, rng=1)
        bed = gd.carve(found.cells)
        scale = np.sqrt((found.diameters**2).sum() * np.pi / 4)
        areas = gd.volumes(bed.grains) / 0.1
        sizes = scale * (gd.sieve_diameters(bed) if diameter == "sieve" else np.sqrt(4 / np.pi * areas))
        assert passing_of(bed, OPENINGS, sizes) == pytest.approx(PASSING, abs=5e-3)


def test_kept_grains_have_a_law_by_number_and_by_mass():
    law = stats.uniform(1e-3, 2e-3)
    found = graded_cells(gd.Domain.cube(1.0), law, n=400, relaxations=2, rng=3)
    bed = gd.carve(found.cells)
    sizes = np.sort(gd.diameters(bed)) * np.cbrt((found.diameters**3).sum() * np.pi / 6)
    asked = law.ppf((np.arange(len(bed)) + 0.5) / len(bed))
    # Volumes are within half a per cent; sizes of neighbours in rank may be each other's.
    assert sizes == pytest.approx(asked, rel=0.02)
    # Had sizes been given to all cells alike, those at walls would have been larger: by 2 % and more in the mean.
    plain = gd.sized_cells(gd.Domain.cube(1.0), law, n=400, relaxations=2, rng=3)
    assert np.cbrt(gd.volumes(plain.cells))[plain.touch_walls()].mean() > np.cbrt(gd.volumes(plain.cells)).mean()


def test_periodic_cells_have_the_curve_at_once():
    rounds = []
    grading = gd.Grading(OPENINGS, PASSING)
    found = graded_cells(
        gd.Domain.cube(1.0, periodic=True),
        grading,
        n=300,
        relaxations=1,
        rng=1,
        progress=lambda *told: rounds.append(told),
    )
    assert rounds == [(1, found.deviation)]


def test_a_curve_that_cannot_be_had_is_refused():
    wide = gd.Grading(np.geomspace(1e-3, 1e-2, 11), np.linspace(0, 1, 11))
    with pytest.raises(InputError, match="grains are too few for this grading"):
        graded_cells(gd.Domain.cube(1.0), wide, n=100, relaxations=0, rng=1)
    with pytest.raises(InputError, match="touch a wall"):
        graded_cells(gd.Domain.cube(1.0), gd.Grading(OPENINGS, PASSING), n=4, rng=1)
    with pytest.raises(InputError, match="give n"):
        graded_cells(gd.Domain.cube(1.0), gd.Grading(OPENINGS, PASSING))
    with pytest.raises(InputError, match="between 0 and 1; got 1"):
        graded_cells(gd.Domain.cube(1.0), gd.Grading(OPENINGS, PASSING), n=10, tolerance=1)
    with pytest.raises(InputError, match="'inside' or 'all'; got 'some'"):
        graded_cells(gd.Domain.cube(1.0), gd.Grading(OPENINGS, PASSING), n=10, keep="some")
