"""Profiles: porosity and velocity, layer by layer."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.measures.porosity import porosity

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


def porosity_profile(
    packing: Packing, *, layers: int = 10, axis: int = 2, box: tuple[ArrayLike, ArrayLike] | None = None
) -> tuple[Floats, Floats]:
    """Return the porosity of equal layers across an axis.

    Parameters
    ----------
    packing : Packing
        The grains; cut by the layers' planes, exactly.
    layers : int
        How many.
    axis : int
        Axis that they lie across: 0, 1 or 2.
    box : tuple of two array_like, shape (3,), optional
        Corners [m] of the region that is cut into layers; the domain by default.

    Returns
    -------
    middles, porosities : ndarray, shape (layers,)
        Where each layer's middle is [m], and its void fraction.
    """
    if layers < 1 or axis not in (0, 1, 2):
        raise InputError(f"layers must be 1 or more and axis 0, 1 or 2; got {layers} and {axis}")
    lower, upper = (packing.domain.lower, packing.domain.upper) if box is None else map(np.asarray, box)
    edges = np.linspace(lower[axis], upper[axis], layers + 1)
    values = np.empty(layers)
    for k in range(layers):
        low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
        low[axis], high[axis] = edges[k : k + 2]
        values[k] = porosity(packing, region=(low, high))
    return 0.5 * (edges[1:] + edges[:-1]), values


def velocity_profile(snapshot: Snapshot, *, along: ArrayLike, edges: ArrayLike, axis: int = 2) -> tuple[Floats, Floats]:
    """Return the mean velocity of layers across an axis, by mass.

    Parameters
    ----------
    snapshot : Snapshot
        The instant.
    along : array_like, shape (3,) or (n, 3)
        Unit vector that velocities are projected on, one for all or one a grain (rings).
    edges : array_like, shape (k + 1,)
        Borders [m] of the layers, ascending.
    axis : int
        Axis that they lie across.

    Returns
    -------
    middles, velocities : ndarray, shape (k,)
        Where each layer's middle is [m], and its velocity [m/s]; NaN in a layer without a grain.
    """
    borders = np.asarray(edges, dtype=float)
    speeds = np.einsum("ij,ij->i", snapshot.velocities, np.broadcast_to(along, snapshot.velocities.shape))
    where = np.digitize(snapshot.packing.positions[:, axis], borders) - 1
    counted = (where >= 0) & (where < borders.size - 1) & ~snapshot.is_glued
    weights = snapshot.masses()[counted]
    mass = np.bincount(where[counted], weights, minlength=borders.size - 1)
    momentum = np.bincount(where[counted], weights * speeds[counted], minlength=borders.size - 1)
    means = np.full(mass.size, np.nan)
    np.divide(momentum, mass, out=means, where=mass > 0)
    return 0.5 * (borders[1:] + borders[:-1]), means
