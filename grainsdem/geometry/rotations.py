"""Unit quaternions (w, x, y, z), vectorised over axis 0."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.gate import gated

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


def identity_quaternions(n: int) -> Floats:
    """Return ``n`` quaternions of no rotation, shape (n, 4)."""
    result = np.zeros((n, 4))
    result[:, 0] = 1.0
    return result


def random_quaternions(n: int, rng: np.random.Generator) -> Floats:
    """Return ``n`` rotations, uniform on the rotation group, shape (n, 4)."""
    q = rng.standard_normal((n, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    return q


def multiply(p: Floats, q: Floats) -> Floats:
    """Return the rotation ``q`` followed by ``p``, shape (n, 4)."""
    pw, px, py, pz = np.moveaxis(p, -1, 0)
    qw, qx, qy, qz = np.moveaxis(q, -1, 0)
    return np.stack(
        [
            pw * qw - px * qx - py * qy - pz * qz,
            pw * qx + px * qw + py * qz - pz * qy,
            pw * qy - px * qz + py * qw + pz * qx,
            pw * qz + px * qy - py * qx + pz * qw,
        ],
        axis=-1,
    )


def to_matrices(q: Floats) -> Floats:
    """Return the rotation matrices, shape (n, 3, 3), of unit quaternions, shape (n, 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def from_matrices(matrices: Floats) -> Floats:
    """Return unit quaternions with w >= 0, shape (n, 4), of rotation matrices, shape (n, 3, 3).

    Notes
    -----
    The largest of the four candidates is divided by, so the result is stable for every rotation (Shepperd 1978).
    """
    m = matrices
    trace = m[:, 0, 0] + m[:, 1, 1] + m[:, 2, 2]
    squares = np.stack([trace, *(2 * m[:, k, k] - trace for k in range(3))], axis=1) + 1.0  # 4 w², 4 x², 4 y², 4 z²
    best = np.argmax(squares, axis=1)
    sums = [[None, (2, 1), (0, 2), (1, 0)], [None, None, (0, 1), (0, 2)], [None, None, None, (1, 2)]]
    products = np.zeros((len(m), 4, 4))
    for a in range(4):
        products[:, a, a] = squares[:, a]
        for b in range(a + 1, 4):
            i, j = sums[a][b]  # type: ignore[misc]
            products[:, a, b] = products[:, b, a] = m[:, i, j] - m[:, j, i] if a == 0 else m[:, i, j] + m[:, j, i]
    q = products[np.arange(len(m)), best]
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    positive: Floats = np.where(q[:, :1] < 0, -q, q)
    return positive


@gated
def world_vertices(packing: Packing) -> Floats:
    """Return every vertex [m] of a packing in the world, shape (n_vertices, 3), in the order of ``grains.vertices``."""
    counts = np.diff(packing.grains.vertex_offsets)
    matrices = np.repeat(to_matrices(packing.quaternions), counts, axis=0)
    turned: Floats = np.einsum("nij,nj->ni", matrices, packing.grains.vertices)
    turned += np.repeat(packing.positions, counts, axis=0)
    return turned
