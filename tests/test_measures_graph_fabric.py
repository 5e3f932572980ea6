from __future__ import annotations

import numpy as np
import pytest
from conftest import cube_packing
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grainsdem.errors import InputError, ShapeError
from grainsdem.measures.graph.fabric import anisotropy, branch_vectors, fabric_tensor
from grainsdem.model import Domain
from grainsdem.packing import contacts


def spread(a, n, rng):
    """Directions spread about z as (1 + a (3 cos² θ − 1)) / 4π, by rejection."""
    directions = rng.standard_normal((6 * n, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    density = 1 + a * (3 * directions[:, 2] ** 2 - 1)
    return directions[rng.random(len(density)) * (1 + 2 * a) < density][:n]


@pytest.mark.unit
def test_directions_along_three_axes_are_isotropic_and_along_one_are_not():
    assert fabric_tensor(np.eye(3)) == pytest.approx(np.eye(3) / 3)
    assert anisotropy(fabric_tensor(np.eye(3))) == pytest.approx(0, abs=1e-15)
    np.testing.assert_allclose(fabric_tensor([[0, 0, 2.0], [0, 0, -1]]), np.diag([0, 0, 1.0]), atol=1e-15)
    np.testing.assert_allclose(fabric_tensor(np.eye(3), weights=[0, 1, 1]), np.diag([0, 0.5, 0.5]), atol=1e-15)


@pytest.mark.statistical
@pytest.mark.parametrize("a", [0.0, 0.2, 0.4])
def test_the_anisotropy_of_a_known_distribution_is_its_amplitude(a):
    n = 40_000
    tensor = fabric_tensor(spread(a, n, np.random.default_rng(3)))
    # Each component has a standard error below that of a mean of numbers in [0, 1].
    error = 5 * 2.5 * np.sqrt(1.5 * 6) * 0.3 / np.sqrt(n)
    assert anisotropy(tensor) == pytest.approx(a, abs=error)


@pytest.mark.property
@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**31))
def test_turning_all_directions_turns_the_tensor_and_keeps_its_anisotropy(seed):
    rng = np.random.default_rng(seed)
    directions = rng.standard_normal((20, 3)) * [1, 2, 3]
    turn = Rotation.random(rng=rng).as_matrix()
    plain, turned = fabric_tensor(directions), fabric_tensor(directions @ turn.T)
    np.testing.assert_allclose(turned, turn @ plain @ turn.T, atol=1e-14)
    assert np.trace(plain) == pytest.approx(1)
    assert anisotropy(turned) == pytest.approx(anisotropy(plain))


@pytest.mark.unit
def test_directions_that_are_none_are_refused_and_no_direction_has_no_fabric():
    assert np.isnan(fabric_tensor(np.empty((0, 3)))).all()
    with pytest.raises(InputError, match="1 have none"):
        fabric_tensor([[1.0, 0, 0], [0, 0, 0]])
    with pytest.raises(ShapeError, match=r"\(m, 3\)"):
        fabric_tensor([1.0, 0, 0])


@pytest.mark.unit
def test_branch_vectors_run_between_centroids_across_boundaries_and_leave_walls_out():
    domain = Domain.box((8.0, 8, 8), periodic=(True, False, False))
    packing = cube_packing([[0.5, 1, 4], [6.25, 1, 4.5]], domain=domain)
    graph = contacts(packing, within=0.5, walls=True)
    assert graph.pairs.tolist() == [[-3, 0], [-3, 1], [0, 1]]
    np.testing.assert_allclose(branch_vectors(graph, packing), [[-2.25, 0, 0.5]], atol=1e-14)
    with pytest.raises(ShapeError, match="1 grains; got 2"):
        branch_vectors(graph, cube_packing([[5.0, 5, 5]]))
