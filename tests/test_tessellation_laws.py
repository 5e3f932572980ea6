"""Laws that hold whatever the seeds: small sets, most of them made to be difficult."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_tessellation_voronoi import check_edges, check_laws

from grainsdem.errors import GrainsDEMError, InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain
from grainsdem.tessellation import tessellate

pytestmark = pytest.mark.property

# Eighths meet in every degenerate way: collinear, coplanar, cospherical, on walls, on edges, symmetric.
eighths = st.integers(0, 8).map(lambda k: k / 8)
free = st.floats(0.0, 1.0, allow_subnormal=False)
flags = st.tuples(*[st.booleans()] * 3)


def seed_sets(coordinate):
    """Return a strategy for one to 24 seeds."""
    return st.lists(st.tuples(coordinate, coordinate, coordinate), min_size=1, max_size=24, unique=True).map(np.array)


def cells_of(seeds, domain, weights=None):
    """Return the cells, or None where two seeds coincide, which is refused."""
    try:
        return tessellate(seeds, domain, weights=weights)
    except InputError as error:
        if "coincide" not in str(error):
            raise
        return None


@settings(max_examples=80, deadline=None)
@given(seed_sets(eighths), flags)
def test_seeds_on_a_coarse_grid_obey_the_laws(seeds, periodic):
    cells = cells_of(seeds, Domain(periodic=np.array(periodic)))
    if cells is not None:
        check_laws(cells, lost=1e-11)
        assert np.all(volumes(cells.cells) > 0)


@settings(max_examples=80, deadline=None)
@given(seed_sets(eighths), flags, st.integers(0, 2**32 - 1), st.sampled_from([1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5]))
def test_seeds_a_little_off_a_coarse_grid_obey_the_laws(seeds, periodic, rng, off):
    moved = np.clip(seeds + off * np.random.default_rng(rng).standard_normal(seeds.shape), 0.0, 1.0)
    # Around a periodic axis two eighths may be one place: their distance is then what they are off.
    wrapped = np.where(periodic, seeds % 1.0, seeds)
    if len(np.unique(wrapped, axis=0)) == len(seeds):
        check_laws(tessellate(moved, Domain(periodic=np.array(periodic))), lost=1e-9)


@settings(max_examples=80, deadline=None)
@given(seed_sets(eighths), st.integers(0, 2**32 - 1), st.sampled_from([1e-13, 1e-11, 1e-9, 1e-7, 1e-5]))
def test_nearly_coincident_seeds_are_right_or_refused(seeds, rng, off):
    twins = np.clip(seeds + off * np.random.default_rng(rng).standard_normal(seeds.shape), 0.0, 1.0)
    try:
        cells = tessellate(np.concatenate([seeds, twins]), Domain.cube())
    except InputError as error:
        if "coincide" not in str(error):
            raise
    except GrainsDEMError as error:
        if "told apart" not in str(error) and "cells of seeds apart" not in str(error):
            raise
    else:
        assert volumes(cells.cells).sum() == pytest.approx(1.0, abs=1e-11)
        check_edges(cells.cells)


@settings(max_examples=60, deadline=None)
@given(seed_sets(free), flags, st.integers(0, 2**32 - 1), st.sampled_from([0.001, 0.1, 10.0]))
def test_weighted_seeds_obey_the_laws(seeds, periodic, rng, spread):
    weights = spread * np.random.default_rng(rng).random(len(seeds))
    cells = cells_of(seeds, Domain(periodic=np.array(periodic)), weights)
    if cells is not None:
        check_laws(cells, lost=1e-4)


@settings(max_examples=60, deadline=None)
@given(seed_sets(eighths), flags, st.sampled_from([2.0**-20, 3.0, 1e6]), st.integers(0, 2**32 - 1))
def test_scaling_and_permuting_change_nothing_else(seeds, periodic, scale, rng):
    cells = cells_of(seeds, Domain(periodic=np.array(periodic)))
    if cells is None:
        return
    order = np.random.default_rng(rng).permutation(len(seeds))
    domain = Domain(np.zeros(3), np.full(3, scale), np.array(periodic))
    other = tessellate(scale * seeds[order], domain)
    assert volumes(other.cells) == pytest.approx(scale**3 * volumes(cells.cells)[order], rel=1e-9, abs=1e-12 * scale**3)
