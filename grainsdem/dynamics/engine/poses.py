"""Poses of grains as the coordinates of their joints."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def set_poses(model: Any, data: Any, bodies: NDArray[np.int64], positions: Floats, quaternions: Floats) -> None:
    """Put bodies of grains, free or planar, where positions [d], shape (k, 3), and quaternions, shape (k, 4), say."""
    first = model.jnt_qposadr[model.body_jntadr[bodies]]
    is_planar = model.body_dofnum[bodies] == 3
    free = first[~is_planar, None] + np.arange(7)
    data.qpos[free] = np.column_stack([positions, quaternions])[~is_planar]
    # A planar grain slides and turns from where it was written, along its own axes there.
    began, faced = model.body_pos[bodies], model.body_quat[bodies]
    moved = np.einsum("nji,nj->ni", to_matrices(faced), positions - began)[:, :2]
    turned = 2 * (np.arctan2(quaternions[:, 3], quaternions[:, 0]) - np.arctan2(faced[:, 3], faced[:, 0]))
    planar = first[is_planar, None] + np.arange(3)
    data.qpos[planar] = np.column_stack([moved, turned])[is_planar]
