"""A packing as a MuJoCo model: made from exported text, stepped, and read back in the grains' own frames.

Everything here is in grain units (`exporters.mjcf.units`); only `Scene.packing` and `Scene.contacts` speak SI.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters import mjcf
from exporters.mujoco_log import quiet
from grainsdem.errors import InputError
from grainsdem.model import ContactGraph, Packing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits, MjcfOptions

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A compiled model of a packing and its state.

    Parameters
    ----------
    source : Packing
        What the model was made from.
    units : GrainUnits
        Factors from grain units to SI.
    model : mujoco.MjModel
        The compiled model.
    data : mujoco.MjData
        Its state, which stepping changes.
    grain_of_body : ndarray of int32, shape (n_bodies,)
        Grain of each body, −1 for the world and the container.
    """

    source: Packing
    units: GrainUnits
    model: Any
    data: Any
    grain_of_body: NDArray[np.int32]

    @property
    def n_grains(self) -> int:
        """Number of grains."""
        return len(self.source)

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions, shape (n, 3), and quaternions, shape (n, 4), of the grains' own frames."""
        qpos = self.data.qpos.reshape(self.n_grains, 7)
        return qpos[:, :3].copy(), qpos[:, 3:].copy()

    def packing(self) -> Packing:
        """Return the grains where they are now, in SI; `Packing.links` is gone, since neighbours have changed."""
        positions, quaternions = self.poses()
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        return replace(
            self.source,
            positions=positions * self.units.length,
            quaternions=quaternions,
            links=None,
        )

    def contacts(self) -> ContactGraph:
        """Return the pairs of grains that press on each other now, in SI; one row a pair, the deepest point's gap."""
        return merge_contacts(self)

    def time(self) -> float:
        """Return the simulated time."""
        return float(self.data.time)

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""
        self.model.opt.timestep = time_step
        self.model.geom_solref[:, 0] = 2 * time_step

    def state(self) -> Floats:
        """Return everything that the next step depends on, as one array."""
        import mujoco

        kind = mujoco.mjtState.mjSTATE_INTEGRATION  # FULLPHYSICS misses the solver's warm start
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, self.data, state, kind)
        return state

    def restore(self, state: Floats) -> None:
        """Go back to a state that `state` gave; warnings, and the scraps of a step that failed, are forgotten."""
        import mujoco

        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
        mujoco.mj_forward(self.model, self.data)


def build(packing: Packing, options: MjcfOptions) -> Scene:
    """Compile the text that the MJCF exporter writes for a packing.

    Raises
    ------
    InputError
        If the packing is periodic, since MuJoCo has no periodic walls, or MuJoCo refuses the model.
    """
    import mujoco

    if packing.domain.periodic.any():
        raise InputError(
            "MuJoCo has no periodic walls; shuffle the packing into a box first, or use a domain with walls"
        )
    if packing.domain.is_planar:
        raise InputError("planar packings cannot be settled; use a domain that is not a slab")
    with quiet():
        try:
            model = mujoco.MjModel.from_xml_string(mjcf.text(packing, options))
        except ValueError as error:
            raise InputError(f"MuJoCo refuses the packing: {error}") from error
    # A state that turned NaN would otherwise be reset to the start without a word.
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    grain_of_body = np.full(model.nbody, -1, dtype=np.int32)
    free = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    grain_of_body[model.jnt_bodyid[free]] = np.arange(free.size)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return Scene(packing, mjcf.units(packing, options.gravity), model, data, grain_of_body)


def merge_contacts(scene: Scene) -> ContactGraph:
    """Return MuJoCo's contact points of grains with grains, merged to one row a pair, in SI."""
    contact = scene.data.contact
    touching = np.flatnonzero(np.asarray(contact.efc_address) >= 0)
    bodies = scene.model.geom_bodyid[np.asarray(contact.geom)[touching]]
    pairs = scene.grain_of_body[bodies].reshape(-1, 2)
    among_grains = (pairs >= 0).all(axis=1)
    touching, pairs = touching[among_grains], pairs[among_grains]
    normals = np.asarray(contact.frame)[touching, :3]
    swapped = pairs[:, 0] > pairs[:, 1]
    pairs = np.where(swapped[:, None], pairs[:, ::-1], pairs)
    normals = np.where(swapped[:, None], -normals, normals)
    unique, row = np.unique(pairs, axis=0, return_inverse=True)
    row = row.reshape(-1)
    gaps = np.full(len(unique), np.inf)
    np.minimum.at(gaps, row, np.asarray(contact.dist)[touching])
    counts = np.bincount(row, minlength=len(unique))[:, None]
    points, directions = np.zeros((len(unique), 3)), np.zeros((len(unique), 3))
    np.add.at(points, row, np.asarray(contact.pos)[touching])
    np.add.at(directions, row, normals)
    directions /= np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), np.finfo(float).tiny)
    length = scene.units.length
    return ContactGraph(
        scene.n_grains,
        unique,
        gaps * length,
        directions,
        points / np.maximum(counts, 1) * length,
        np.zeros(len(unique)),
    )
