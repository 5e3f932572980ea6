"""What a state says: energies, contact forces and overlaps, in grain units."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    floor_force : float
        Force on the container along gravity over the weight of all grains.
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
    model, data = scene.model, scene.data
    n = scene.n_grains
    bodies = np.flatnonzero(scene.grain_of_body >= 0)
    masses = model.body_mass[bodies]
    qvel = data.qvel.reshape(n, 6)
    # A free joint's first three velocities are those of the body frame, which is the centroid; the last three turn
    # in that frame, whose axes are not the principal ones.
    spin = np.einsum("ni,nij,nj->n", qvel[:, 3:], _inertias(scene, bodies), qvel[:, 3:])
    kinetic = 0.5 * (masses * np.einsum("ij,ij->i", qvel[:, :3], qvel[:, :3]) + spin)
    heights = data.qpos.reshape(n, 7)[:, 2]
    mean_mass = masses.mean()
    acceleration = np.linalg.norm(data.qacc.reshape(n, 6)[:, :3], axis=1)
    address = np.asarray(data.contact.efc_address)
    active = address >= 0
    normal_forces = data.efc_force[address[active]] if active.any() else np.zeros(0)
    depths = np.maximum(-np.asarray(data.contact.dist)[active], 0.0)
    depths = depths[depths > 0]
    mean_force = normal_forces.mean() if normal_forces.size else 0.0
    return Sample(
        time=float(data.time),
        kinetic_energy=float(kinetic.mean() / mean_mass),
        total_energy=float((kinetic + masses * heights).mean() / mean_mass),
        unbalanced_force=float((masses * acceleration).mean() / mean_force) if mean_force > 0 else float("inf"),
        n_contacts=int(np.count_nonzero(normal_forces > 0)),
        overlap_mean=float(depths.mean()) if depths.size else 0.0,
        overlap_max=float(depths.max()) if depths.size else 0.0,
        floor_force=float(_force_on_container(scene) / masses.sum()),
        height=float(heights.mean()),
    )


def _inertias(scene: Scene, bodies: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the inertia tensors of the grains in their own frames, shape (n, 3, 3)."""
    turns = to_matrices(scene.model.body_iquat[bodies])
    tensors: NDArray[np.float64] = np.einsum("nij,nj,nkj->nik", turns, scene.model.body_inertia[bodies], turns)
    return tensors


def _force_on_container(scene: Scene) -> float:
    """Return the downward force on the container, from the normal and frictional forces of its contacts."""
    contact, data = scene.data.contact, scene.data
    address = np.asarray(contact.efc_address)
    grains = scene.grain_of_body[scene.model.geom_bodyid[np.asarray(contact.geom)]].reshape(-1, 2)
    at_wall = np.flatnonzero((address >= 0) & (grains < 0).any(axis=1))
    if at_wall.size == 0:
        return 0.0
    frames = np.asarray(contact.frame)[at_wall].reshape(-1, 3, 3)
    dims = np.asarray(contact.dim)[at_wall]
    down = np.zeros(at_wall.size)
    for k in range(3):  # rows of the frame are the axes that the components refer to; frictionless contacts have one
        has = dims > k
        down[has] -= data.efc_force[address[at_wall[has]] + k] * frames[has, k, 2]
    # The force acts on the contact's second geom: turn it round where that is the grain.
    return float(np.where(grains[at_wall, 1] < 0, down, -down).sum())
