from __future__ import annotations

import mujoco
import numpy as np
import pytest
from loading import grow

from exporters import mjcf
from exporters.mjcf import MjcfOptions

SOLVERS = ("PGS", "CG", "Newton")


@pytest.fixture(scope="module")
def bed():
    """Twelve grains in their box, free to fall together."""
    return grow(12)


def compiled(bed, solver, jacobian="sparse"):
    text = mjcf.text(bed, MjcfOptions(solver=solver, tolerance=1e-10))
    assert 'jacobian="sparse"' in text
    return mujoco.MjModel.from_xml_string(text.replace('jacobian="sparse"', f'jacobian="{jacobian}"'))


@pytest.mark.client
def test_newton_finds_the_same_forces_with_the_sparse_jacobian_as_with_a_dense_one(bed):
    # MuJoCo 4.0.0 factors some sparse Hessians wrongly; those of free grains are not among them.
    sparse, dense = compiled(bed, "Newton"), compiled(bed, "Newton", "dense")
    moving, one, two = mujoco.MjData(sparse), mujoco.MjData(sparse), mujoco.MjData(dense)
    n_compared = 0
    for _ in range(30):
        mujoco.mj_step(sparse, moving, 10)
        for model, data in ((sparse, one), (dense, two)):
            mujoco.mj_resetData(model, data)
            data.qpos[:], data.qvel[:] = moving.qpos, moving.qvel
            mujoco.mj_forward(model, data)
        n_compared += one.ncon > 20
        # Sums in another order: some 1e-14 of the largest.
        assert np.abs(one.qacc - two.qacc).max() < 1e-9 * max(1.0, np.abs(two.qacc).max())
    assert n_compared > 20


@pytest.mark.client
@pytest.mark.parametrize("solver", SOLVERS)
def test_every_solver_holds_the_weight_of_the_bed_and_lets_nothing_drift(bed, solver):
    model = compiled(bed, solver)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 600)
    before = data.qpos.reshape(-1, 7)[:, :3].copy()
    weight, forces = float(model.body_mass.sum()), []
    for _ in range(200):
        mujoco.mj_step(model, data)
        forces.append(float(data.qfrc_constraint.reshape(-1, 6)[:, 2].sum()))
    # Over 2 t the momentum that is left changes the mean by the speed over the time: below 1e-2 of the weight.
    assert np.mean(forces) == pytest.approx(weight, rel=0.01)
    moved = np.linalg.norm(data.qpos.reshape(-1, 7)[:, :3] - before, axis=1)
    # It is no rest that settle would call one: a grain may still swing.
    assert np.median(moved) < 5e-3
