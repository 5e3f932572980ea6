"""Small matrices in closed form, many at once: the same bytes on any processor, as LAPACK does not promise."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def product(a: Floats, b: Floats) -> Floats:
    """Return the product of matrices, row by row; not by BLAS, whose last bit is the processor's."""
    return np.asarray(sum(a[:, :, k, None] * b[:, None, k, :] for k in range(3)))


def adjugate(m: Floats) -> Floats:
    """Return the adjugates of matrices, shape (n, 3, 3)."""
    rows = [np.cross(m[:, 1], m[:, 2]), np.cross(m[:, 2], m[:, 0]), np.cross(m[:, 0], m[:, 1])]
    return np.stack(rows, axis=2)


def determinant(m: Floats) -> Floats:
    """Return the determinants of matrices, shape (n,)."""
    return np.asarray((m[:, 0] * np.cross(m[:, 1], m[:, 2])).sum(axis=1))


def inverse(m: Floats) -> Floats:
    """Return the inverses of matrices that have one, shape (n, 3, 3)."""
    return np.asarray(adjugate(m) / determinant(m)[:, None, None])


def unit(m: Floats) -> Floats:
    """Return matrices scaled to determinant one, those of no volume the unit matrix."""
    volume = determinant(m)
    is_good = volume > 0
    scaled = m / cube_roots(np.where(is_good, volume, 1.0))[:, None, None]
    return np.where(is_good[:, None, None], scaled, np.eye(3))
