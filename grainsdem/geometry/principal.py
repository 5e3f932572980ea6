"""Principal moments and axes of inertia."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.rotations import from_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray


def principal_inertia(inertias: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return principal moments and the rotations to the principal axes.

    Parameters
    ----------
    inertias : ndarray, shape (n, 3, 3)
        Symmetric inertia tensors [kg m²], or [m⁵] at unit density.

    Returns
    -------
    moments : ndarray, shape (n, 3)
        Principal moments in the unit of the tensors, smallest first.
    quaternions : ndarray, shape (n, 4)
        Rotation (w, x, y, z) from the principal axes to the frame of the tensor: I = R diag(moments) Rᵀ.

    Notes
    -----
    Axes have no sign: the largest component of each of the first two is made positive, and the third completes
    a right-handed frame. Axes of equal moments are any of the many.
    """
    moments, axes = np.linalg.eigh(inertias)
    largest = np.take_along_axis(axes, np.abs(axes).argmax(axis=1)[:, None, :], axis=1)
    axes = axes * np.where(largest < 0, -1.0, 1.0)
    axes[:, :, 2] = np.cross(axes[:, :, 0], axes[:, :, 1])
    return moments, from_matrices(axes)
