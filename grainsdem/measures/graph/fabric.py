"""Fabric: how contacts are oriented.

References
----------
.. [1] M. Satake, "Fabric tensor in granular materials", IUTAM Symposium on Deformation and Failure of Granular
   Materials (1982) 63-68.
.. [2] E. Azéma, F. Radjai, G. Saussine, "Quasistatic rheology, force transmission and fabric properties of a packing
   of irregular polyhedral particles", Mechanics of Materials 41 (2009) 729-741.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import ContactGraph, Packing

    Floats = NDArray[np.float64]


MOST = 1e100
"""Largest component of a tensor, whose squares are numbers still."""


@gated
def fabric_tensor(directions: ArrayLike, *, weights: ArrayLike | None = None) -> Floats:
    """Return the mean of n ⊗ n over unit vectors: symmetric, of trace one, 1/3 of the identity where isotropic.

    Parameters
    ----------
    directions : array_like, shape (m, 3)
        Contact normals (``graph.normals``) or branch vectors; brought to unit length here.
    weights : array_like, shape (m,), optional
        Weight of each, such as its area; equal by default.

    Returns
    -------
    ndarray, shape (3, 3)
        The tensor; NaN without any direction.

    Raises
    ------
    ShapeError
        If the directions are not of shape (m, 3).
    InputError
        If a direction has no finite length, or a weight is negative or not finite, or all are zero.
    """
    vectors = np.asarray(directions, dtype=np.float64)
    if vectors.ndim != 2 or vectors.shape[1] != 3:
        raise ShapeError(f"directions must have shape (m, 3); got {vectors.shape}")
    if not len(vectors):
        return np.full((3, 3), np.nan)
    # The largest component first: squares of very long or short vectors are no numbers any more.
    largest = np.abs(vectors).max(axis=1, keepdims=True)
    has_none = ~((largest > 0) & np.isfinite(largest))
    if has_none.any():
        raise InputError(f"directions must have a finite length; {int(has_none.sum())} have none")
    unit = vectors / largest
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    share = np.full(len(unit), 1.0) if weights is None else np.asarray(weights, dtype=np.float64)
    if not (np.isfinite(share).all() and (share >= 0).all() and share.any()):
        raise InputError("weights must be finite and zero or more, and one above it")
    share = share / share.max()
    return np.asarray(np.einsum("m,mi,mj->ij", share / share.sum(), unit, unit))


@gated
def anisotropy(tensor: ArrayLike) -> float:
    """Return the amplitude of a fabric tensor's deviator: zero where directions are isotropic.

    Parameters
    ----------
    tensor : array_like, shape (3, 3)
        Such as `fabric_tensor` returns.

    Raises
    ------
    ShapeError
        If it is of another shape.
    InputError
        If it is not finite, or a component is larger than 1e100.

    Notes
    -----
    a = 5/2 √(3/2 D : D) with D the deviator. Where directions spread about one axis as
    (1 + a (3 cos² θ − 1)) / 4π, this is their a, and 5/2 (F₁ − F₃) (Azéma, Radjai and Saussine 2009).
    """
    tensor = np.asarray(tensor, dtype=np.float64)
    if not (np.abs(tensor) <= MOST).all():
        raise InputError(f"the tensor must be finite, its components at most {MOST:g}; got {tensor.tolist()}")
    deviator = tensor - np.trace(tensor) / 3 * np.eye(3)
    return float(2.5 * np.sqrt(1.5 * np.sum(deviator * deviator)))


@gated
def branch_vectors(graph: ContactGraph, packing: Packing) -> Floats:
    """Return the vector [m] from the centroid of i to that of j's image, one a contact of two grains, shape (m, 3).

    Contacts with walls are left out. The lengths of these are the contact lengths of the literature.

    Raises
    ------
    ShapeError
        If the graph is of another number of grains than the packing.
    """
    if graph.n_grains != len(packing):
        raise ShapeError(f"the contacts must be those of the packing's {len(packing)} grains; got {graph.n_grains}")
    inner = graph.among_grains()
    i, j = inner.pairs.T
    return np.asarray(packing.positions[j] - packing.positions[i] + inner.shifts * packing.domain.lengths)
