"""Contacts read from MuJoCo's data."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.dynamics.engine.contract import Contacts

if TYPE_CHECKING:
    from numpy.typing import NDArray


def contacts_of(data: Any, id_of_geom: NDArray[np.int64]) -> Contacts:
    """Return the contact points that carry force in ``data``, as the last solve left them.

    Parameters
    ----------
    data : mujoco.MjData
        A state whose contacts are solved.
    id_of_geom : ndarray of int64, shape (n_geoms,)
        Which grain each shape is, or −1 − k of part k.
    """
    contact = data.contact
    address = np.asarray(contact.efc_address)
    rows = np.flatnonzero(address >= 0)
    rows = rows[data.efc_force[address[rows]] > 0]
    address = address[rows]
    frames = np.asarray(contact.frame)[rows].reshape(-1, 3, 3)
    dims = np.asarray(contact.dim)[rows]
    forces = np.zeros((rows.size, 3))
    for k in range(3):  # rows of the frame are the axes; a contact without friction has only the first
        has = dims > k
        forces[has] += data.efc_force[address[has] + k, None] * frames[has, k]
    pairs = id_of_geom[np.asarray(contact.geom)[rows]].reshape(-1, 2)
    turned = np.where(pairs[:, 0] > pairs[:, 1], -1.0, 1.0)
    return Contacts(
        np.sort(pairs, axis=1),
        np.asarray(contact.pos)[rows].reshape(-1, 3).copy(),
        frames[:, 0] * turned[:, None],
        forces * turned[:, None],
        np.asarray(contact.dist)[rows].copy(),
        np.where(dims > 1, np.asarray(contact.friction)[rows].reshape(-1, 5)[:, 0], 0.0),
    )
