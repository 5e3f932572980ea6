"""The forces of contacts as a graph and its columns, for files and pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.dynamics.mechanics.networks import force_chains, merge_points
from grainsdem.measures.graph.edges import write_edges
from grainsdem.model import ContactGraph

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot


def contact_forces(snapshot: Snapshot) -> tuple[ContactGraph, dict[str, NDArray[Any]]]:
    """Return who presses on whom, walls and other parts included, and the forces.

    Parameters
    ----------
    snapshot : Snapshot
        The instant.

    Returns
    -------
    graph : ContactGraph
        One row a pair; part k of ``snapshot.parts`` has the id −1 − k.
    columns : dict of ndarray
        ``force`` [N] on the second of each pair, shape (m, 3); ``normal_force`` [N], positive where it presses, and
        ``tangential_force`` [N], its size, shape (m,); ``chain``, the number of the force chain that both are in (see
        `force_chains`), the largest being 0, and −1 where they are in none.
    """
    pairs, points, normals, forces, gaps = merge_points(snapshot)
    pressing = np.einsum("ij,ij->i", forces, normals)
    chain_of = np.full(len(snapshot.packing), -1)
    for number, grains in enumerate(force_chains(snapshot)):
        chain_of[grains] = number
    ends = np.where(pairs >= 0, chain_of[np.maximum(pairs, 0)] if len(chain_of) else -1, -1)
    graph = ContactGraph(len(snapshot.packing), pairs.astype(np.int32), gaps, normals, points, np.zeros(len(pairs)))
    return graph, {
        "force": forces,
        "normal_force": pressing,
        "tangential_force": np.linalg.norm(forces - pressing[:, None] * normals, axis=1),
        "chain": np.where(ends[:, 0] == ends[:, 1], ends[:, 0], -1),
    }


def write_forces(snapshot: Snapshot, path: str | os.PathLike[str]) -> Path:
    """Write the contacts and their forces, walls and other parts included, as a table, a graph or lines.

    Parameters
    ----------
    snapshot : Snapshot
        The instant.
    path : str or path-like
        ``.csv``, ``.parquet``, ``.graphml``, or ``.vtp`` for ParaView (see `write_edges`), with the columns of
        `contact_forces`.
    """
    graph, columns = contact_forces(snapshot)
    return write_edges(graph, path, packing=snapshot.packing, columns=columns)
