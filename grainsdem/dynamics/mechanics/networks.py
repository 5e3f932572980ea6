"""The network of contacts: fabric, strong contacts, how forces are distributed, chains, sliding, coordination.

References
----------
.. [1] F. Radjai, D. E. Wolf, M. Jean, J.-J. Moreau, "Bimodal character of stress transmission in granular packings",
   Physical Review Letters 80 (1998) 61-64.
.. [2] J. F. Peters, M. Muthuswamy, J. Wibowo, A. Tordesillas, "Characterization of force chains in granular material",
   Physical Review E 72 (2005) 041307.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.measures import fabric_tensor, mean_coordination
from grainsdem.model import ContactGraph

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot

    Floats = NDArray[np.float64]

SLIDING = 1e-3
"""How near the cone of friction, relative to it, the force of a contact that slides is: the solver's precision."""

CHAIN_ANGLE = np.pi / 4
"""Widest angle between the most compressive stress of a grain and the contact to the next one of a chain."""

CHAIN_LENGTH = 3
"""Fewest grains of a chain."""


def merge_points(snapshot: Snapshot) -> tuple[NDArray[np.int64], Floats, Floats, Floats, Floats]:
    """Return the contact points merged to one row a pair.

    Returns
    -------
    pairs : ndarray of int64, shape (k, 2)
        The two that touch, sorted.
    points : ndarray, shape (k, 3)
        Centre [m] of the normal forces.
    normals : ndarray, shape (k, 3)
        Mean normal, weighted by force.
    forces : ndarray, shape (k, 3)
        Force [N] on the second.
    gaps : ndarray, shape (k,)
        The deepest point's gap [m].
    """
    pairs, row = np.unique(snapshot.pairs, axis=0, return_inverse=True)
    row = row.reshape(-1)
    weights = snapshot.normal_forces
    normals, points, forces = (np.zeros((len(pairs), 3)) for _ in range(3))
    np.add.at(normals, row, snapshot.normals * weights[:, None])
    np.add.at(points, row, snapshot.points * weights[:, None])
    np.add.at(forces, row, snapshot.forces)
    gaps = np.full(len(pairs), np.inf)
    np.minimum.at(gaps, row, snapshot.gaps)
    points /= np.bincount(row, weights, minlength=len(pairs))[:, None]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return pairs, points, normals, forces, gaps


def contact_graph(snapshot: Snapshot) -> ContactGraph:
    """Return the pairs of grains that press on each other, one row a pair, in SI."""
    pairs, points, normals, _, gaps = merge_points(snapshot)
    among = (pairs >= 0).all(axis=1)
    areas = np.zeros(int(among.sum()))
    return ContactGraph(
        len(snapshot.packing),
        pairs[among].astype(np.int32),
        gaps[among],
        normals[among],
        points[among],
        areas,
    )


def coordination(snapshot: Snapshot, *, without_rattlers: bool = False, least: int = 2) -> float:
    """Return the mean number of grains that press on a grain; parts do not count.

    Parameters
    ----------
    snapshot : Snapshot
        The instant.
    without_rattlers : bool
        Whether grains that carry no force are left out (see `measures.rattlers`).
    least : int
        Fewest contacts of a grain that carries force.
    """
    return mean_coordination(contact_graph(snapshot), without_rattlers=without_rattlers, least=least)


def fabric(snapshot: Snapshot, *, of: Literal["all", "strong", "weak"] = "all") -> Floats:
    """Return the fabric tensor ⟨n ⊗ n⟩ of the contacts of grains with each other, shape (3, 3); NaN without any.

    Strong contacts carry more than the mean normal force, weak ones less (Radjai and others 1998).
    """
    pairs, _, normals, forces, _ = merge_points(snapshot)
    among = (pairs >= 0).all(axis=1)
    normals, pressing = normals[among], np.einsum("ij,ij->i", forces, normals)[among]
    if of != "all" and pressing.size:
        is_strong = pressing > pressing.mean()
        normals = normals[is_strong if of == "strong" else ~is_strong]
    return fabric_tensor(normals)


def normalized_forces(snapshot: Snapshot) -> Floats:
    """Return the normal forces of the pairs of grains over their mean, ascending, shape (k,)."""
    pairs, _, normals, forces, _ = merge_points(snapshot)
    among = (pairs >= 0).all(axis=1)
    pressing = np.sort(np.einsum("ij,ij->i", forces, normals)[among])
    return pressing / pressing.mean() if pressing.size else pressing


def sliding_fraction(snapshot: Snapshot) -> float:
    """Return the share of contact points of grains with each other that slide; NaN without any."""
    among = (snapshot.pairs >= 0).all(axis=1)
    if not among.any():
        return np.nan
    pressing = snapshot.normal_forces[among]
    tangential = np.linalg.norm(snapshot.forces[among] - pressing[:, None] * snapshot.normals[among], axis=1)
    return float(np.mean(tangential >= (1 - SLIDING) * snapshot.frictions[among] * pressing))


def force_chains(snapshot: Snapshot) -> list[NDArray[np.int64]]:
    """Return the chains of grains that carry more than the mean stress, the largest first, each an array of numbers.

    Notes
    -----
    A grain is in a chain where its most compressive principal stress is above the mean over all grains, and it is
    linked to another one that lies within 45° of that stress's direction, seen from both (Peters and others 2005).
    """
    from scipy.sparse import coo_array  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  (the same)

    values, axes = np.linalg.eigh(_moments(snapshot))
    largest, directions = values[:, -1], axes[:, :, -1]
    carries = largest > largest.mean()
    pairs, _, normals, _, _ = merge_points(snapshot)
    among = (pairs >= 0).all(axis=1)
    (i, j), normals = pairs[among].T, normals[among]
    linked = carries[i] & carries[j]
    for end in (i, j):
        linked &= np.abs(np.einsum("ij,ij->i", directions[end], normals)) >= np.cos(CHAIN_ANGLE)
    n = len(snapshot.packing)
    graph = coo_array((np.ones(int(linked.sum())), (i[linked], j[linked])), shape=(n, n))
    labels = connected_components(graph, directed=False)[1]
    sizes = np.bincount(labels)
    chosen = np.flatnonzero(sizes >= CHAIN_LENGTH)
    return [np.flatnonzero(labels == label) for label in chosen[np.argsort(-sizes[chosen], kind="stable")]]


def _moments(snapshot: Snapshot) -> Floats:
    """Return each grain's symmetric stress times its volume [J], positive in compression, shape (n, 3, 3)."""
    result = np.zeros((len(snapshot.packing), 3, 3))
    for side, sign in ((0, 1.0), (1, -1.0)):
        ids = snapshot.pairs[:, side]
        mine = np.flatnonzero(ids >= 0)
        arms = snapshot.points[mine] - snapshot.packing.positions[ids[mine]]
        np.add.at(result, ids[mine], sign * arms[:, :, None] * snapshot.forces[mine, None, :])
    return 0.5 * (result + np.swapaxes(result, 1, 2))
