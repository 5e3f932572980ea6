"""What a state says: energies, contact forces and overlaps, in grain units."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from grainsdem.dynamics.scene import Scene


class Sample(NamedTuple):
    """One look at a moving bed, in grain units and numbers without dimension.

    Parameters
    ----------
    time : float
        Simulated time [√(d/g)].
    kinetic_energy : float
        Mean kinetic energy of a grain [m g d].
    total_energy : float
        Mean kinetic and potential energy of a grain [m g d].
    unbalanced_force : float
        Mean resultant force on a grain over mean contact force.
    n_contacts : int
        Number of contact points that carry force, walls included.
    overlap_mean, overlap_max : float
        Depth of the contacts that overlap [d].
    floor_force, wall_force : float
        What floor and side walls bear: force on them along gravity over the weight of all grains. Walls that push the
        grains down bear less than nothing. At rest both together are one.
    height : float
        Mean height of the centroids [d].
    """

    time: float
    kinetic_energy: float
    total_energy: float
    unbalanced_force: float
    n_contacts: int
    overlap_mean: float
    overlap_max: float
    floor_force: float
    wall_force: float
    height: float


SAMPLE_UNITS = {
    "time": "s",
    "kinetic_energy": "m g d",
    "total_energy": "m g d",
    "unbalanced_force": "1",
    "n_contacts": "1",
    "overlap_mean": "d",
    "overlap_max": "d",
    "floor_force": "weight",
    "wall_force": "weight",
    "height": "m",
}
"""Units of a `Sample` as it is stored: m is the mean mass of a grain, d the median diameter, g gravity."""


def sample(scene: Scene) -> Sample:
    """Return what the state of the last step says.

    Notes
    -----
    The unbalanced force is the usual one of discrete elements: with the resultant m_i a_i of every force on grain i
    (gravity included) and the normal force f_c of contact c, it is mean |m_i a_i| over mean f_c.
    """
    engine = scene.engine
    loose = ~engine.is_glued
    motion, contacts = engine.motion(), engine.last_contacts()
    masses, v = engine.masses[loose], motion.velocities[loose]
    spins = np.einsum("nji,nj->ni", to_matrices(motion.quaternions[loose]), motion.spins[loose])
    turning = np.einsum("ni,nij,nj->n", spins, engine.inertias[loose], spins)
    kinetic = 0.5 * (masses * np.einsum("ij,ij->i", v, v) + turning)
    heights = motion.positions[loose] @ -engine.gravity
    mean_mass = masses.mean()
    resultants = masses * engine.accelerations()[loose]
    normal_forces = np.einsum("ij,ij->i", contacts.forces, contacts.normals)
    depths = -contacts.gaps[contacts.gaps < 0]
    mean_force = normal_forces.mean() if normal_forces.size else 0.0
    parts = -1 - contacts.pairs[:, 0]
    borne = -(contacts.forces @ engine.gravity) / masses.sum()
    is_floor = parts == (engine.parts.index(scene.floor) if scene.floor in engine.parts else np.inf)
    return Sample(
        time=engine.time,
        kinetic_energy=float(kinetic.mean() / mean_mass),
        total_energy=float((kinetic + masses * heights).mean() / mean_mass),
        unbalanced_force=float(resultants.mean() / mean_force) if mean_force > 0 else float("inf"),
        n_contacts=normal_forces.size,
        overlap_mean=float(depths.mean()) if depths.size else 0.0,
        overlap_max=float(depths.max()) if depths.size else 0.0,
        floor_force=float(borne[is_floor].sum()),
        wall_force=float(borne[(parts >= 0) & ~is_floor].sum()),
        height=float(motion.positions[loose, scene.up].mean()),
    )
