"""Stress: Love–Weber's average over grains, the tractions through planes, and the forces on walls.

References
----------
.. [1] J. Christoffersen, M. M. Mehrabadi, S. Nemat-Nasser, "A micromechanical description of granular material
   behavior", Journal of Applied Mechanics 48 (1981) 339-344.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot

    Floats = NDArray[np.float64]


def stress(snapshot: Snapshot, *, volume: float, rows: NDArray[np.bool_] | None = None) -> Floats:
    """Return Love–Weber's mean stress [Pa], shape (3, 3), positive in compression.

    Parameters
    ----------
    snapshot : Snapshot
        The instant.
    volume : float
        Volume [m³] that the grains fill with their voids.
    rows : ndarray of bool, shape (n,), optional
        Grains to average over; all that are not glued by default.

    Notes
    -----
    σ = −1/V Σ_p Σ_c (x_c − x_p) ⊗ f, over the contacts c of the grains p with each other and with walls; f is the force
    on p. Where grains are at rest it is symmetric and, over a whole sample, equals the stress on its walls.
    """
    if not volume > 0:
        raise InputError(f"volume must be positive; got {volume}")
    counted = ~snapshot.is_glued if rows is None else np.asarray(rows, dtype=bool) & ~snapshot.is_glued
    total = np.zeros((3, 3))
    for side, sign in ((0, -1.0), (1, 1.0)):
        ids = snapshot.pairs[:, side]
        mine = np.flatnonzero(ids >= 0)
        mine = mine[counted[ids[mine]]]
        arms = snapshot.points[mine] - snapshot.packing.positions[ids[mine]]
        total -= sign * arms.T @ snapshot.forces[mine]
    return total / volume


def traction(snapshot: Snapshot, *, axis: int, lower: float, upper: float, area: float) -> Floats:
    """Return the traction [Pa] through the planes across ``axis`` between two heights, their mean, shape (3,).

    It is what the lower side exerts on the upper one: its component along the axis is positive in compression.

    Notes
    -----
    A plane carries the forces of the contacts whose grains have their centroids on either side of it. Where grains
    are at rest this is exact for every plane, whatever the volume that grains fill: Love–Weber's average with branches
    cut off at the two planes.
    """
    share = _crossings(snapshot, axis, lower, upper)
    return np.asarray(share @ snapshot.forces / area)


def torque_through(snapshot: Snapshot, *, lower: float, upper: float) -> float:
    """Return the torque [N m] about the z axis through the level planes between two heights, their mean.

    Exact for rings, where a mean of shear stress would depend on how it is weighted over the radius.
    """
    share = _crossings(snapshot, 2, lower, upper)
    return float(share @ _torques(snapshot.points, snapshot.forces))


def force_on(snapshot: Snapshot, part: str) -> Floats:
    """Return the force [N] of the grains on a part, shape (3,); zero where none touches it."""
    return np.asarray(-snapshot.forces[_touching(snapshot, part)].sum(axis=0))


def torque_on(snapshot: Snapshot, part: str) -> float:
    """Return the torque [N m] of the grains on a part about the z axis."""
    rows = _touching(snapshot, part)
    return float(-_torques(snapshot.points[rows], snapshot.forces[rows]).sum())


def friction_angle(principal_stresses: ArrayLike) -> Floats:
    """Return the mobilised angle of friction [rad], asin((σ1 − σ3)/(σ1 + σ3)), of stresses of shape (…, 2 or more)."""
    values = np.asarray(principal_stresses, dtype=np.float64)
    high, low = values.max(axis=-1), values.min(axis=-1)
    return np.asarray(np.arcsin((high - low) / (high + low)))


def _crossings(snapshot: Snapshot, axis: int, lower: float, upper: float) -> Floats:
    """Return the share of the planes between two heights that each contact's force crosses upward, shape (m,)."""
    if not upper > lower:
        raise InputError(f"upper must lie above lower; got {upper} and {lower}")
    heights = snapshot.packing.positions[:, axis]
    ends = np.empty(snapshot.pairs.shape)
    for side in range(2):
        ids = snapshot.pairs[:, side]
        # A wall begins at the contact.
        ends[:, side] = np.where(ids >= 0, heights[np.maximum(ids, 0)], snapshot.points[:, axis])
    cut = np.clip(ends, lower, upper)
    return np.asarray((cut[:, 1] - cut[:, 0]) / (upper - lower))


def _touching(snapshot: Snapshot, part: str) -> NDArray[np.intp]:
    if part not in snapshot.parts:
        raise InputError(f"part must be one of {', '.join(snapshot.parts) or 'none'}; got {part!r}")
    return np.flatnonzero(snapshot.pairs[:, 0] == -1 - snapshot.parts.index(part))


def _torques(points: Floats, forces: Floats) -> Floats:
    """Return the torques about the z axis."""
    return np.asarray(points[:, 0] * forces[:, 1] - points[:, 1] * forces[:, 0])
