"""One instant of a bed, in SI, that every measurement is a function of."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.dynamics.starting import sphere_radii
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model.arrays import Noun

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot(Noun):
    """Where grains are, how they move, and what forces their contacts carry, at one instant.

    Parameters
    ----------
    packing : Packing
        Shapes and poses.
    time : float
        Simulated time [s].
    gravity : array_like, shape (3,)
        Acceleration [m/s²].
    velocities : array_like, shape (n, 3)
        Of the centroids [m/s].
    spins : array_like, shape (n, 3)
        Angular velocities [1/s] in the world's frame.
    pairs : array_like of int64, shape (m, 2)
        The two that touch at each contact point, the first below the second: grains by number, part k as −1 − k.
    points : array_like, shape (m, 3)
        Where they touch [m].
    normals : array_like, shape (m, 3)
        Unit vectors from the first to the second.
    forces : array_like, shape (m, 3)
        Force [N] on the second.
    gaps : array_like, shape (m,)
        Gap [m], negative where they overlap.
    frictions : array_like, shape (m,)
        Coefficient of friction.
    parts : tuple of str
        Names of the walls and other parts that grains can touch.
    is_glued : array_like of bool, shape (n,), optional
        Grains that are fixed to a part, and do not count as grains in what is measured; none by default.
    are_spheres : bool
        Whether each grain was simulated as the sphere of equal volume.
    """

    packing: Packing
    time: float
    gravity: Floats
    velocities: Floats
    spins: Floats
    pairs: NDArray[np.int64]
    points: Floats
    normals: Floats
    forces: Floats
    gaps: Floats
    frictions: Floats
    parts: tuple[str, ...] = ()
    is_glued: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))
    are_spheres: bool = False

    def __post_init__(self) -> None:
        n = len(self.packing)
        self.freeze("gravity", np.float64, 3)
        self.freeze("velocities", np.float64, n, 3)
        self.freeze("spins", np.float64, n, 3)
        m = len(self.freeze("pairs", np.int64, None, 2))
        for name in ("points", "normals", "forces"):
            self.freeze(name, np.float64, m, 3)
        for name in ("gaps", "frictions"):
            self.freeze(name, np.float64, m)
        if n and not self.is_glued.size:
            object.__setattr__(self, "is_glued", np.zeros(n, dtype=bool))
        self.freeze("is_glued", np.bool_, n)

    @property
    def normal_forces(self) -> Floats:
        """Normal force [N] of each contact point, positive where it presses, shape (m,)."""
        return np.asarray(np.einsum("ij,ij->i", self.forces, self.normals))

    def masses(self) -> Floats:
        """Return the mass [kg] of each grain, shape (n,)."""
        return np.asarray(integrate(self.packing.grains).volumes * self.packing.densities)

    def inertias(self) -> Floats:
        """Return the tensor of inertia [kg m²] of each grain in the world's frame, shape (n, 3, 3)."""
        integrals = integrate(self.packing.grains)
        if self.are_spheres:
            shape = 0.5 if self.packing.domain.is_planar else 0.4
            moments = shape * integrals.volumes * self.packing.densities * sphere_radii(self.packing) ** 2
            return np.asarray(moments[:, None, None] * np.eye(3))
        turns = to_matrices(self.packing.quaternions)
        own = integrals.inertias * self.packing.densities[:, None, None]
        return np.asarray(turns @ own @ np.swapaxes(turns, 1, 2))


def snapshot(scene: Scene, *, converged: bool = True) -> Snapshot:
    """Return the present instant, of the grains that are present; the run goes on as if none had looked.

    Parameters
    ----------
    scene : Scene
        What moves.
    converged : bool
        Whether contact forces are solved to convergence. Else they are those of the last step: off by a tenth each, but
        what moved the grains, so that means over many steps are right, and cheap.
    """
    engine, units = scene.engine, scene.units
    motion, contacts = engine.motion(), engine.contacts() if converged else engine.last_contacts()
    is_present = engine.is_present
    numbers = np.cumsum(is_present) - 1  # of grains among those that are present, which alone touch something
    return Snapshot(
        scene.packing(),
        engine.time * units.time,
        np.asarray(engine.gravity) * units.acceleration,
        motion.velocities[is_present] * units.velocity,
        motion.spins[is_present] / units.time,
        np.where(contacts.pairs >= 0, numbers[np.maximum(contacts.pairs, 0)], contacts.pairs),
        contacts.points * units.length,
        contacts.normals,
        contacts.forces * units.force,
        contacts.gaps * units.length,
        contacts.frictions,
        engine.parts,
        engine.is_glued[is_present],
        scene.are_spheres,
    )
