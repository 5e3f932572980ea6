"""Which way grains lie: their principal axes, and trend and plunge of these.

References
----------
.. [1] N. H. Woodcock, "Specification of fabric shapes using an eigenvalue method", Geological Society of America
   Bulletin 88 (1977) 1231-1236.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.principal import principal_inertia
from grainsdem.geometry.rotations import multiply, to_matrices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

AXES = ("a", "b", "c")


@gated
def principal_axes(packing: Packing, *, measured: Integrals | None = None) -> Floats:
    """Return the directions of each grain's long, middle and short axis, where it lies in the bed.

    Parameters
    ----------
    packing : Packing
        Any packing.
    measured : Integrals, optional
        What `integrate` returned for its grains, where it is known already.

    Returns
    -------
    ndarray, shape (n, 3, 3)
        Unit vectors: row k of grain i is axis k, a, b or c. They are axes of inertia; one and its opposite are the
        same, and of a grain as symmetric as a cube they are any.
    """
    found = measured or integrate(packing.grains)
    _, turned = principal_inertia(found.inertias)
    matrices = to_matrices(multiply(packing.quaternions, turned))
    return np.ascontiguousarray(matrices.transpose(0, 2, 1))


@gated
def trend_and_plunge(directions: ArrayLike) -> tuple[Floats, Floats]:
    """Return trend and plunge [rad] of lines in space, shape (n,) each.

    Parameters
    ----------
    directions : array_like, shape (n, 3)
        Vectors along the lines, of any length and of either sense.

    Returns
    -------
    trend : ndarray
        Direction in which the line goes down, counter-clockwise from +x, from 0 to 2 π; of level lines, from 0 to π.
    plunge : ndarray
        Angle below the level, from 0 to π/2.

    Examples
    --------
    >>> trend, plunge = trend_and_plunge([[1, 0, 1], [0, -2, 0]])
    >>> np.degrees(trend).round().tolist(), np.degrees(plunge).round().tolist()
    ([180.0, 90.0], [45.0, 0.0])
    """
    v = np.asarray(directions, dtype=np.float64)
    if v.ndim != 2 or v.shape[1] != 3:
        raise ShapeError(f"directions must have shape (n, 3); got {v.shape}")
    level = np.hypot(v[:, 0], v[:, 1])
    is_flat = np.abs(v[:, 2]) <= 1e-12 * level
    is_up = np.where(is_flat, (v[:, 1] < 0) | ((v[:, 1] == 0) & (v[:, 0] < 0)), v[:, 2] > 0)
    v = np.where(is_up[:, None], -v, v)
    trend = np.arctan2(v[:, 1], v[:, 0]) % (2 * np.pi)
    return np.where(level > 0, trend, 0.0), np.where(is_flat, 0.0, np.arctan2(-v[:, 2], level))


@gated
def orientation_tensor(packing: Packing, axis: str = "a") -> Floats:
    """Return the mean of the dyads of an axis over the grains, shape (3, 3): of trace 1, a third each where isotropic.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    axis : {"a", "b", "c"}
        The long, the middle or the short axis.

    Notes
    -----
    Its eigenvectors are the fabric's own directions, its eigenvalues S1 >= S2 >= S3 Woodcock's: clusters have S1 near
    one, girdles S1 and S2 near a half [1]_.
    """
    if axis not in AXES:
        raise InputError(f"axis must be 'a', 'b' or 'c'; got {axis!r}")
    if len(packing) == 0:
        raise InputError("an orientation tensor needs at least one grain; the packing has none")
    v = principal_axes(packing)[:, AXES.index(axis)]
    return np.asarray(np.einsum("ni,nj->ij", v, v) / len(v))
