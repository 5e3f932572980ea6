from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from solids import SOLIDS, blob, polyhedra, solid

from grainsdem.measures import diameters, sphericities
from grainsdem.model import Polyhedra


@pytest.mark.unit
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        # (π / 6)^(1/3) and its kin; the values of the paper's figure 14
        ("tetrahedron", (np.pi / (6 * np.sqrt(3))) ** (1 / 3)),
        ("cube", (np.pi / 6) ** (1 / 3)),
        ("octahedron", (np.pi / (3 * np.sqrt(3))) ** (1 / 3)),
        ("dodecahedron", 0.910453),
        ("icosahedron", 0.939326),
        ("truncated octahedron", 0.909918),
    ],
)
def test_named_solids_have_their_known_sphericity(name, expected):
    assert sphericities(solid(name, 0.7))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.unit
def test_sphericity_is_one_for_what_comes_near_a_sphere():
    k = np.arange(800) + 0.5  # Fibonacci's lattice on the sphere
    polar, turn = np.arccos(1 - 2 * k / 800), np.pi * (1 + np.sqrt(5)) * k
    ball = np.column_stack([np.cos(turn) * np.sin(polar), np.sin(turn) * np.sin(polar), np.cos(polar)])
    assert 0.99 < sphericities(polyhedra(ball))[0] < 1


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31), st.floats(1e-4, 1e3))
def test_sphericity_is_below_one_and_knows_no_size_while_diameters_scale(seed, s):
    a = polyhedra(blob(np.random.default_rng(seed)))
    b = Polyhedra(a.vertices * s, a.vertex_offsets, a.face_offsets, a.face_vertices, a.face_vertex_offsets)
    assert 0 < sphericities(a)[0] < 1
    assert sphericities(b)[0] == pytest.approx(sphericities(a)[0], rel=1e-12)
    assert diameters(b)[0] == pytest.approx(s * diameters(a)[0], rel=1e-12)


@pytest.mark.unit
def test_every_named_solid_is_tested_in_its_circumscribed_order():
    # More faces, rounder: the order that the paper's figure 14 marks.
    values = [sphericities(solid(name))[0] for name in SOLIDS if not name.startswith("truncated")]
    assert values == sorted(values)
