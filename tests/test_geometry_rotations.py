from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from solids import place, polyhedra

from grainsdem.geometry.rotations import (
    from_matrices,
    identity_quaternions,
    multiply,
    random_quaternions,
    to_matrices,
    world_vertices,
)

seeds = st.integers(0, 2**31)


def scipys(quaternions):
    return Rotation.from_quat(np.roll(quaternions, -1, axis=1))  # scipy: scalar last


@pytest.mark.unit
def test_a_quarter_turn_about_z_takes_x_to_y():
    half = np.sqrt(0.5)
    matrix = to_matrices(np.array([[half, 0, 0, half]]))[0]
    np.testing.assert_allclose(matrix @ [1, 0, 0], [0, 1, 0], atol=1e-15)


@pytest.mark.unit
def test_identity_quaternions_turn_nothing():
    np.testing.assert_array_equal(to_matrices(identity_quaternions(3)), np.tile(np.eye(3), (3, 1, 1)))


@pytest.mark.unit
def test_a_half_turn_about_any_axis_survives_the_way_through_matrices():
    # w = 0: the branch where dividing by w would fail
    q = np.array([[0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], [0, 0.6, 0.8, 0], [0, 0, 0.6, -0.8]], float)
    back = from_matrices(to_matrices(q))
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", q, back)), 1, atol=1e-15)


@pytest.mark.unit
def test_no_rotations_at_all_are_allowed():
    assert to_matrices(np.empty((0, 4))).shape == (0, 3, 3)
    assert from_matrices(np.empty((0, 3, 3))).shape == (0, 4)


@pytest.mark.unit
def test_world_vertices_are_turned_then_moved():
    half = np.sqrt(0.5)
    shape = polyhedra([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 2], [0, 0, -2]])
    packing = place(shape, [[10.0, 20.0, 30.0]], quaternions=np.array([[half, half, 0, 0]]))
    turned = shape.vertices[:, [0, 2, 1]] * [1, -1, 1]  # a quarter turn about x takes y to z and z to −y
    np.testing.assert_allclose(world_vertices(packing) - [[10, 20, 30]], turned, atol=1e-14)


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(seeds)
def test_matrices_products_and_the_way_back_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    p, q = random_quaternions(20, rng), random_quaternions(20, rng)
    np.testing.assert_allclose(to_matrices(p), scipys(p).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(to_matrices(multiply(p, q)), (scipys(p) * scipys(q)).as_matrix(), atol=1e-14)
    back = from_matrices(to_matrices(p))
    assert (back[:, 0] >= 0).all()
    np.testing.assert_allclose(back, np.where(p[:, :1] < 0, -p, p), atol=1e-14)


@pytest.mark.statistical
def test_random_rotations_are_uniform_on_the_group():
    n = 20_000
    q = random_quaternions(n, np.random.default_rng(8))
    np.testing.assert_allclose(np.linalg.norm(q, axis=1), 1, atol=1e-14)
    # On the unit sphere in four dimensions E[q qᵀ] = 1/4, E[q_i⁴] = 1/8 and E[q_i² q_j²] = 1/24.
    moments = np.einsum("ni,nj->ij", q, q) / n
    error = 5 / np.sqrt(n) * np.where(np.eye(4, dtype=bool), np.sqrt(1 / 8 - 1 / 16), np.sqrt(1 / 24))
    assert (np.abs(moments - np.eye(4) / 4) < error).all()
    # The angle of a uniform rotation has density (1 − cos θ) / π: its mean is π/2 + 2/π.
    angles = scipys(q).magnitude()
    assert abs(angles.mean() - (np.pi / 2 + 2 / np.pi)) < 5 * angles.std() / np.sqrt(n)
