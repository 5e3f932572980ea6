"""MuJoCo behind the contract of an engine."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.mjcf.log import quiet
from grainsdem.dynamics.engine import cache
from grainsdem.dynamics.engine.contract import EngineError, Motion
from grainsdem.dynamics.engine.names import grain_numbers, name_of_coordinate, name_parts
from grainsdem.dynamics.engine.poses import set_poses
from grainsdem.dynamics.engine.reading import contacts_of
from grainsdem.dynamics.engine.shapes import hulls_of_parts, places_of_parts
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from contextlib import AbstractContextManager

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.engine.contract import Contacts

    Floats = NDArray[np.float64]

CONVERGED_ITERATIONS = 300
"""Iterations of conjugate gradients after which forces are known to 7e-7; those of a step are known to 10 % only."""

_COLLISIONS = ("geom_contype", "geom_conaffinity", "body_contype", "body_conaffinity")
"""What says who collides with whom; the bodies' is what spares the search for those that touch nothing."""


class _Surfaces(NamedTuple):
    """Sliding friction, priority and number of dimensions of each geom, as they were compiled, shape (n_geoms,)."""

    frictions: Floats
    priorities: NDArray[np.int32]
    dimensions: NDArray[np.int32]


def load(text: str) -> MujocoEngine:
    """Compile a model's text; a large one is kept compiled, and taken from there when the same text comes again.

    Raises
    ------
    InputError
        If MuJoCo refuses the text.
    """
    import mujoco

    place = cache.place_of(text, mujoco.__version__)
    with quiet():
        kept = cache.find(place)
        if kept is not None:
            return MujocoEngine(kept)
        try:
            model = mujoco.MjModel.from_xml_string(text)
        except ValueError as error:
            raise InputError(f"MuJoCo refuses the packing: {error}") from error
        cache.keep(model, place)
    return MujocoEngine(model)


class MujocoEngine:
    """A compiled model and its state.

    Parameters
    ----------
    model : mujoco.MjModel
        The compiled model.
    """

    def __init__(self, model: Any) -> None:
        import mujoco

        self.name = f"MuJoCo {mujoco.__version__}"
        self.model = model
        # A state that turned NaN would otherwise be reset to the start without a word.
        model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = mujoco.MjData(model)
        self._probe: Any = None
        names = [model.body(b).name for b in range(model.nbody)]
        self.grain_of_body = grain_numbers(names)
        is_grain = self.grain_of_body >= 0
        order = np.argsort(self.grain_of_body[is_grain], kind="stable")
        self.body_of_grain = np.flatnonzero(is_grain)[order]
        self.n_grains = int(is_grain.sum())
        self.masses = np.array(model.body_mass[self.body_of_grain])
        turns = to_matrices(model.body_iquat[self.body_of_grain])
        moments = model.body_inertia[self.body_of_grain]
        self.inertias = np.einsum("nij,nj,nkj->nik", turns, moments, turns)
        self.is_glued = np.asarray(model.body_dofnum[self.body_of_grain] == 0)
        self.parts, self._id_of_geom = name_parts(model, names, self.grain_of_body)
        places = zip(model.jnt_qposadr.tolist(), model.jnt_dofadr.tolist(), strict=True)
        self._axles = {model.joint(j).name: place for j, place in enumerate(places)}
        self.is_present = np.ones(self.n_grains, dtype=bool)
        self._collisions = [(kind, getattr(model, kind).copy()) for kind in _COLLISIONS]
        self._surfaces = _Surfaces(
            model.geom_friction[:, 0].copy(), model.geom_priority.copy(), model.geom_condim.copy()
        )
        self._steps_of_contacts = np.round(model.geom_solref[:, 0] / model.opt.timestep, 6)
        # To the bit as it will be when a run goes on.
        model.geom_solref[:, 0] = self._steps_of_contacts * model.opt.timestep
        mujoco.mj_forward(model, self.data)

    @property
    def time(self) -> float:
        """Simulated time [t]."""
        return float(self.data.time)

    @property
    def time_step(self) -> float:
        """Time step [t]."""
        return float(self.model.opt.timestep)

    @property
    def gravity(self) -> Floats:
        """Acceleration [g], shape (3,)."""
        return np.array(self.model.opt.gravity)

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""
        self.model.opt.timestep = time_step
        self.model.geom_solref[:, 0] = self._steps_of_contacts * time_step

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Change the acceleration [g], shape (3,), that acts on everything."""
        self.model.opt.gravity[:] = gravity

    def set_friction(self, friction: float | None) -> None:
        """Give all grains that are not glued one coefficient of friction, or with None that of the model again."""
        loose = self._is_loose()
        values, priorities, dimensions = (surface[loose] for surface in self._surfaces)
        if friction is not None:
            # Walls that are as rough as the grain that touches them stay below all grains.
            values, priorities = np.full(values.size, friction), np.minimum(priorities, 1)
            dimensions = np.maximum(dimensions, 3 if friction > 0 else 1)
        self.model.geom_friction[loose, 0] = values
        self.model.geom_priority[loose] = priorities
        self.model.geom_condim[loose] = dimensions

    def make_smooth(self, parts: Sequence[str]) -> None:
        """Let these parts be without friction until the next call, and give all others their own again."""
        chosen = np.isin(self._id_of_geom, [-1 - self.parts.index(part) for part in parts])
        fixed, (frictions, priorities, _) = self._id_of_geom < 0, self._surfaces
        self.model.geom_friction[fixed, 0] = np.where(chosen, 0.0, frictions)[fixed]
        # MuJoCo takes the larger friction of a pair unless one has priority.
        self.model.geom_priority[fixed] = np.where(chosen, 1 + priorities.max(), priorities)[fixed]

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set the velocities of the grains that are not glued [d/t], shape (n, 3); spins become zero."""
        self._set_velocities(np.arange(self.n_grains), np.asarray(velocities, dtype=np.float64))

    def _set_velocities(self, grains: NDArray[np.int64], velocities: Floats) -> None:
        """Set the velocities of some grains, by number; spins become zero."""
        values = np.zeros((self.n_grains, 3))
        values[grains] = velocities
        for rows, dofs, axes in self._loose_dofs():
            mine = np.isin(rows, grains)
            own, along = dofs[mine], values[rows[mine], :axes]
            self.data.qvel[own] = 0.0
            if axes == 2:  # each slides along axes of its own, turned with it at the start
                joints = self.model.dof_jntid[own[:, :2]]
                along = np.einsum("nki,ni->nk", self.data.xaxis[joints], values[rows[mine]])
            self.data.qvel[own[:, :axes]] = along

    def hold_up(self, shares: ArrayLike) -> None:
        """Take a share of its weight, 0 to 1, off each grain, shape (n,), until the next call."""
        lift = -self.masses[:, None] * self.gravity * np.asarray(shares, dtype=np.float64)[:, None]
        self.data.xfrc_applied[self.body_of_grain, :3] = lift

    def set_drag(self, rate: float) -> None:
        """Let grains lose velocity and spin at a rate [1/t] besides all else, as in a fluid; zero for none."""
        moments = np.trace(self.inertias, axis1=1, axis2=2) / 3
        for rows, dofs, axes in self._loose_dofs():
            self.model.dof_damping[dofs[:, :axes]] = rate * self.masses[rows, None]
            self.model.dof_damping[dofs[:, axes:]] = rate * moments[rows, None]

    def remove(self, part: str) -> None:
        """Let grains pass through a part from now on, until it is put back."""
        chosen = self._id_of_geom == -1 - self.parts.index(part)
        self.model.geom_contype[chosen] = self.model.geom_conaffinity[chosen] = 0

    def put_back(self, part: str) -> None:
        """Let a part that was removed stop grains again."""
        chosen = self._id_of_geom == -1 - self.parts.index(part)
        for kind, before in self._collisions[:2]:
            getattr(self.model, kind)[chosen] = before[chosen]

    def set_present(self, is_present: ArrayLike) -> None:
        """Say which grains take part, shape (n,), until the next call: others touch nothing, and stay if `still`."""
        self.is_present = np.array(is_present, dtype=bool)
        geoms = np.flatnonzero(self._is_loose())
        bodies, numbers = self.model.geom_bodyid[geoms], self._id_of_geom[geoms]
        for kind, before in self._collisions:
            rows = geoms if kind.startswith("geom") else bodies
            getattr(self.model, kind)[rows] = np.where(self.is_present[numbers], before[rows], 0)

    def still(self, grains: ArrayLike) -> None:
        """Let these grains, by number, stop where they are, weightless until they are inserted."""
        ids = np.asarray(grains, dtype=np.int64)
        for rows, dofs, _ in self._loose_dofs():
            self.data.qvel[dofs[np.isin(rows, ids)]] = 0.0
        self.data.xfrc_applied[self.body_of_grain[ids], :3] = -self.masses[ids, None] * self.gravity

    def insert(self, grains: ArrayLike, positions: ArrayLike, quaternions: ArrayLike, velocities: ArrayLike) -> None:
        """Put these grains, by number, somewhere [d], with their weight, moving at velocities [d/t] without spin."""
        ids = np.asarray(grains, dtype=np.int64)
        bodies = self.body_of_grain[ids]
        set_poses(self.model, self.data, bodies, np.asarray(positions, np.float64), np.asarray(quaternions, np.float64))
        self._set_velocities(ids, np.asarray(velocities, np.float64))
        self.data.xfrc_applied[bodies, :3] = 0.0

    def step(self, n_steps: int) -> None:
        """Go on by so many time steps, or raise `EngineError`."""
        import mujoco

        step, model, data = mujoco.mj_step, self.model, self.data
        try:
            # Short calls: an interrupt is answered between them.
            for _ in range(n_steps):
                step(model, data)
        except mujoco.FatalError as error:  # for want of memory, as a rule
            raise EngineError(str(error)) from error

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

        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        mujoco.mj_resetData(self.model, self.data)
        mujoco.mj_setState(self.model, self.data, state, kind)
        mujoco.mj_forward(self.model, self.data)
        # The forward pass has solved from the warm start and written its own: give the next step the one it had.
        mujoco.mj_setState(self.model, self.data, state, kind)

    def motion(self) -> Motion:
        """Return where the grains are and how they move."""
        import mujoco

        probe, model = self._copy(), self.model
        mujoco.mj_kinematics(model, probe)
        mujoco.mj_comPos(model, probe)
        mujoco.mj_comVel(model, probe)
        at = self.body_of_grain
        spins = probe.cvel[at, :3].copy()
        # Spatial velocities refer to the centre of mass of the tree that the body hangs on.
        arms = probe.xipos[at] - probe.subtree_com[model.body_rootid[at]]
        velocities = probe.cvel[at, 3:] + np.cross(spins, arms)
        return Motion(probe.xpos[at].copy(), probe.xquat[at].copy(), velocities, spins)

    def contacts(self) -> Contacts:
        """Return the contact points of the present state, with forces solved to convergence."""
        import mujoco

        probe = self._copy()
        with self._converging():
            mujoco.mj_forward(self.model, probe)
        return contacts_of(probe, self._id_of_geom)

    def last_contacts(self) -> Contacts:
        """Return the contact points of the last step, with forces as that step left them: fast, known to 10 %."""
        return contacts_of(self.data, self._id_of_geom)

    def accelerations(self) -> Floats:
        """Return the magnitude of each centroid's acceleration [g] in the last step, shape (n,)."""
        result = np.zeros(self.n_grains)
        for rows, dofs, axes in self._loose_dofs():
            result[rows] = np.linalg.norm(self.data.qacc[dofs[:, :axes]], axis=1)
        return result

    def deepest_overlap(self) -> tuple[float, tuple[str, str]]:
        """Return the depth [d] of the deepest overlap of the present state, and the names of the two; zero for none."""
        distances = np.asarray(self.data.contact.dist)
        if not distances.size or distances.min() >= 0:
            return 0.0, ("", "")
        worst = int(np.argmin(distances))
        one, two = (self._name_of_shape(geom) for geom in self.data.contact.geom[worst].tolist())
        return float(-distances[worst]), (one, two)

    def _name_of_shape(self, geom: int) -> str:
        """Return the name of the grain or part that a shape belongs to."""
        number = int(self._id_of_geom[geom])
        return f"g{number:06d}" if number >= 0 else self.parts[-1 - number]

    def hulls(self) -> dict[str, list[Floats]]:
        """Return the corners [d] of the convex shapes of each part, in its own frame; planes have none."""
        return hulls_of_parts(self.model, self.parts, self._id_of_geom)

    def places(self, parts: Sequence[str]) -> tuple[Floats, Floats]:
        """Return where the frames of parts are [d], and their rotations; NaN for one that is removed."""
        return places_of_parts(self.model, self._copy(), [self.parts.index(part) for part in parts], self._id_of_geom)

    def axle(self, name: str) -> tuple[float, float]:
        """Return position and speed of a joint of the apparatus."""
        at, dof = self._axles[name]
        return float(self.data.qpos[at]), float(self.data.qvel[dof])

    def push(self, name: str, force: float) -> None:
        """Let a force, or a torque, act along a joint of the apparatus until the next call."""
        self.data.qfrc_applied[self._axles[name][1]] = force

    def turn(self, name: str, speed: float) -> None:
        """Set the present speed of a joint of the apparatus; a heavy part keeps it through a step."""
        self.data.qvel[self._axles[name][1]] = speed

    def place(self, name: str, position: float) -> None:
        """Put a joint of the apparatus at a position, with all that hangs on it."""
        self.data.qpos[self._axles[name][0]] = position

    def reaction(self, name: str) -> float:
        """Return the force, or torque, of contacts and limits along a joint of the apparatus in the last step."""
        return float(self.data.qfrc_constraint[self._axles[name][1]])

    def muted(self) -> AbstractContextManager[list[str]]:
        """Collect MuJoCo's warnings while a block lasts."""
        return quiet()

    def complaint(self) -> str:
        """Return what is wrong by MuJoCo's own account, or nothing."""
        import mujoco

        warning = mujoco.mjtWarning
        moving = (warning.mjWARN_BADQPOS, warning.mjWARN_BADQVEL, warning.mjWARN_BADQACC)
        for kind in map(warning, range(warning.mjNWARNING)):
            if self.data.warning[kind].number:
                at = int(self.data.warning[kind].lastinfo)
                where = (
                    name_of_coordinate(self.model, self.grain_of_body, at, is_speed=kind != moving[0])
                    if kind in moving
                    else str(at)
                )
                return f"MuJoCo's warning {kind.name}, {where}"
        return ""

    def _loose_dofs(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp], int]]:
        """Return numbers, places of all speeds, and how many of these are the centroid's, of free and planar grains."""
        counts = self.model.body_dofnum[self.body_of_grain]
        found = []
        # Free joints have six speeds, planar ones three; the first three or two are those of the centroid.
        for count, axes in ((6, 3), (3, 2)):
            rows = np.flatnonzero(counts == count)
            first = self.model.body_dofadr[self.body_of_grain[rows]]
            found.append((rows, first[:, None] + np.arange(count), axes))
        return found

    def _is_loose(self) -> NDArray[np.bool_]:
        """Return which geoms are grains that move by themselves."""
        mask: NDArray[np.bool_] = self._id_of_geom >= 0
        return mask

    def _copy(self) -> Any:
        """Return a second set of data in the present state: reading it leaves the run as it was, to the bit."""
        import mujoco

        if self._probe is None:
            self._probe = mujoco.MjData(self.model)
        mujoco.mj_setState(self.model, self._probe, self.state(), mujoco.mjtState.mjSTATE_INTEGRATION)
        return self._probe

    @contextmanager
    def _converging(self) -> Iterator[None]:
        """Solve with conjugate gradients to convergence while the block lasts."""
        import mujoco

        option = self.model.opt
        before = option.solver, option.iterations, option.tolerance, option.noslip_iterations
        option.solver, option.iterations = mujoco.mjtSolver.mjSOL_CG, CONVERGED_ITERATIONS
        option.tolerance, option.noslip_iterations = 0.0, 0
        try:
            yield
        finally:
            option.solver, option.iterations, option.tolerance, option.noslip_iterations = before
