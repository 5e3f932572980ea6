"""Energies, how far from rest a bed is, and how grains have moved between two instants."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.rotations import multiply

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


class Energies(NamedTuple):
    """Energies of all grains [J].

    Parameters
    ----------
    translation, rotation : float
        Kinetic energy.
    potential : float
        In the field of gravity, zero at the world's origin.
    """

    translation: float
    rotation: float
    potential: float

    @property
    def total(self) -> float:
        """Kinetic and potential energy [J]; what a closed run loses of it was dissipated in contacts."""
        return self.translation + self.rotation + self.potential


def energies(snapshot: Snapshot) -> Energies:
    """Return the energies of the grains that are not glued."""
    loose = ~snapshot.is_glued
    masses, v, w = snapshot.masses()[loose], snapshot.velocities[loose], snapshot.spins[loose]
    return Energies(
        float(0.5 * masses @ np.einsum("ij,ij->i", v, v)),
        float(0.5 * np.einsum("ni,nij,nj->", w, snapshot.inertias()[loose], w)),
        float(-masses @ (snapshot.packing.positions[loose] @ snapshot.gravity)),
    )


def unbalanced_force(snapshot: Snapshot) -> float:
    """Return the mean resultant force on a grain, gravity included, over the mean normal force of a contact point."""
    total = snapshot.masses()[:, None] * snapshot.gravity
    for side, sign in ((0, -1.0), (1, 1.0)):
        ids = snapshot.pairs[:, side]
        mine = ids >= 0
        np.add.at(total, ids[mine], sign * snapshot.forces[mine])
    if not len(snapshot.pairs):
        return np.inf
    resultants = np.linalg.norm(total[~snapshot.is_glued], axis=1)
    return float(resultants.mean() / snapshot.normal_forces.mean())


def inertial_number(rate: float, *, diameter: float, density: float, pressure: float) -> float:
    """Return I = γ̇ d √(ρ/P) of a shear rate [1/s]: below 1e-3 a flow is quasi-static.

    Examples
    --------
    >>> round(inertial_number(1.0, diameter=1e-3, density=2500.0, pressure=1e3), 6)
    0.001581
    """
    if not (diameter > 0 and density > 0 and pressure > 0):
        raise InputError(f"diameter, density and pressure must be positive; got {diameter}, {density} and {pressure}")
    return float(rate * diameter * np.sqrt(density / pressure))


def displacements(before: Packing, after: Packing) -> Floats:
    """Return how far [m] each grain's centroid has moved, shape (n, 3).

    Raises
    ------
    InputError
        If the two have different numbers of grains.
    """
    _refuse_others(before, after)
    return np.asarray(after.positions - before.positions)


def rotations(before: Packing, after: Packing) -> Floats:
    """Return the rotation vector [rad] that turns each grain from the first pose to the second, shape (n, 3).

    Of the turns that lead there it is the shortest, at most π.
    """
    _refuse_others(before, after)
    back = before.quaternions * np.array([1.0, -1.0, -1.0, -1.0])
    q = multiply(after.quaternions, back)
    q = np.where(q[:, :1] < 0, -q, q)
    sines = np.linalg.norm(q[:, 1:], axis=1)
    angles = 2 * np.arctan2(sines, q[:, 0])
    # Towards no rotation the factor goes to two.
    factors = np.where(sines > 1e-12, angles / np.maximum(sines, 1e-12), 2.0)
    return np.asarray(q[:, 1:] * factors[:, None])


def _refuse_others(before: Packing, after: Packing) -> None:
    if len(before) != len(after):
        raise InputError(f"both packings must have the same grains; got {len(before)} and {len(after)}")
