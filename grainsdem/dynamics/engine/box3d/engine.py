"""An engine of Box3D's: the contract's words for a world of grains and still walls."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from grainsdem.dynamics.engine.box3d.model import parse
from grainsdem.dynamics.engine.box3d.world import World
from grainsdem.dynamics.engine.contract import Contacts, Motion
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import from_matrices, to_matrices
from grainsdem.model import Domain, Packing
from grainsdem.packing.contacts import contacts as near_pairs
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

    from numpy.typing import ArrayLike

    from grainsdem.dynamics.engine.box3d.model import Model

    Floats = np.typing.NDArray[np.float64]

PARTS = 4
"""Parts in which each step is solved. Two leave twice the overlap at rest, in three quarters of the time."""


def load(text: str) -> Box3dEngine:
    """Make a world of a model's text.

    Raises
    ------
    InputError
        If it has what Box3D cannot do here, or a shape that it refuses.
    MissingPackageError
        If Robox3D is not installed.
    """
    return Box3dEngine(parse(text))


class Box3dEngine:
    """A world of Box3D and its state; see the contract for what each method does.

    Parameters
    ----------
    model : Model
        What is in it.
    """

    deepest_rest = np.inf  # no smaller step makes the overlaps of four points a contact shallower
    resumes_exactly = False

    def __init__(self, model: Model) -> None:
        self._world = World(model)
        self.name = f"Box3D {self._world.version}"
        self.n_grains = self._world.n
        self.parts = model.walls.names
        self.masses, self.inertias = model.masses, model.inertias
        self.is_glued = np.zeros(self.n_grains, dtype=bool)
        self.is_present = np.ones(self.n_grains, dtype=bool)
        self._model = model
        self._time, self._time_step = 0.0, model.time_step
        self._gravity = np.array(model.gravity)
        self._accelerations = np.zeros(self.n_grains)
        self._removed: set[str] = set()
        self._world.set_friction(model.friction, model.walls.frictions)

    @property
    def time(self) -> float:
        """Simulated time [t]."""
        return self._time

    @property
    def time_step(self) -> float:
        """Time step [t]."""
        return self._time_step

    @property
    def gravity(self) -> Floats:
        """Acceleration [g], shape (3,)."""
        return self._gravity.copy()

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""
        self._time_step = float(time_step)

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Change the acceleration [g], shape (3,), that acts on everything."""
        self._gravity = np.array(gravity, dtype=np.float64)
        self._world.set_gravity(self._gravity)

    def set_friction(self, friction: float | None) -> None:
        """Give all grains one coefficient of friction, or with None that of the model again."""
        value = self._model.friction if friction is None else friction
        walls = self._model.walls.frictions
        # Walls that are as rough as grains stay so.
        self._world.set_friction(value, np.where(walls == self._model.friction, value, walls))

    def make_smooth(self, parts: Sequence[str]) -> None:
        """Let these parts be without friction until the next call, and give all others their own again."""
        is_smooth = np.isin(self.parts, list(parts))
        self._world.set_friction(self._model.friction, np.where(is_smooth, 0.0, self._model.walls.frictions))

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set the velocities of the grains [d/t], shape (n, 3); spins become zero."""
        values = np.asarray(velocities, dtype=np.float64)
        self._world.move(values, np.zeros_like(values))

    def hold_up(self, shares: ArrayLike) -> None:
        """Take a share of its weight, 0 to 1, off each grain, shape (n,), until the next call."""
        self._world.set_weights(1.0 - np.asarray(shares, dtype=np.float64))

    def set_drag(self, rate: float) -> None:
        """Let grains lose velocity and spin at a rate [1/t] besides all else; zero for none."""
        self._world.set_damping(rate)

    def remove(self, part: str) -> None:
        """Let grains pass through a part from now on, until it is put back."""
        self._removed.add(part)
        self._world.enable(self.parts.index(part), is_there=False)

    def put_back(self, part: str) -> None:
        """Let a part that was removed stop grains again."""
        self._removed.discard(part)
        self._world.enable(self.parts.index(part), is_there=True)

    def set_present(self, is_present: ArrayLike) -> None:
        """Refuse to leave grains out."""
        if not np.asarray(is_present, dtype=bool).all():
            _refuse("grains that come and go")

    def still(self, grains: ArrayLike) -> None:
        """Refuse to hold single grains."""
        if np.asarray(grains).size:
            _refuse("grains that come and go")

    def insert(self, grains: ArrayLike, positions: ArrayLike, quaternions: ArrayLike, velocities: ArrayLike) -> None:
        """Refuse to put single grains somewhere."""
        del positions, quaternions, velocities
        self.still(grains)

    def step(self, n_steps: int) -> None:
        """Go on by so many time steps."""
        for _ in range(n_steps - 1):
            self._world.step(self._time_step, PARTS)
        before, _ = self._world.speeds()
        self._world.step(self._time_step, PARTS)
        after, _ = self._world.speeds()
        self._accelerations = np.linalg.norm(after - before, axis=1) / self._time_step
        self._time += n_steps * self._time_step

    def state(self) -> Floats:
        """Return clock, poses and speeds; what the solver remembers of the contacts cannot be had from Box3D."""
        rows = [*self._world.poses(), *self._world.speeds()]
        return np.concatenate([[self._time], *(values.ravel() for values in rows)])

    def restore(self, state: Floats) -> None:
        """Go back to a state that `state` gave; contacts begin anew."""
        n = self.n_grains
        self._time = float(state[0])
        positions, quaternions, velocities, spins = np.split(state[1:], np.cumsum([3 * n, 4 * n, 3 * n]))
        self._world.put(positions.reshape(n, 3), quaternions.reshape(n, 4))
        self._world.move(velocities.reshape(n, 3), spins.reshape(n, 3))

    def motion(self) -> Motion:
        """Return where the grains are and how they move."""
        return Motion(*self._world.poses(), *self._world.speeds())

    def contacts(self) -> Contacts:
        """Return the contact points of the last step, whose forces are as converged as Box3D makes them."""
        return self.last_contacts()

    def last_contacts(self) -> Contacts:
        """Return the contact points of the last step that bear something.

        The gap of the deepest point of two grains is their exact one, which Box3D may not see: it keeps four points.
        """
        told = self._world.touches()
        bears = np.einsum("ij,ij->i", told.impulses, told.normals) > 0
        shapes, arms, normals, gaps, impulses = (values[bears] for values in told)
        pairs = np.where(shapes < self.n_grains, shapes, self.n_grains - 1 - shapes)
        positions, quaternions = self._world.poses()
        centres = self._centres(positions, quaternions)
        # From the first that is a grain: a wall's arm begins in the middle of a slab.
        side = (pairs[:, 0] < 0).astype(np.int64)
        row = np.arange(len(pairs))
        points = centres[pairs[row, side]] + arms[row, side]
        turned = np.where(pairs[:, 0] > pairs[:, 1], -1.0, 1.0)[:, None]
        # Forces act for one part of a step.
        forces = impulses * turned * (PARTS / self._time_step)
        pairs = np.sort(pairs, axis=1)
        frictions = np.append(self._model.walls.frictions[::-1], self._model.friction)[np.minimum(pairs[:, 0], 0) - 1]
        return Contacts(pairs, points, normals * turned, forces, self._exact(pairs, gaps), frictions)

    def accelerations(self) -> Floats:
        """Return the magnitude of each centroid's acceleration [g] in the last step, shape (n,)."""
        return self._accelerations

    def deepest_overlap(self) -> tuple[float, tuple[str, str]]:
        """Return the depth [d] of the deepest overlap of the present state, and the names of the two; zero for none."""
        pairs, gaps = self._overlaps()
        if not gaps.size or gaps.min() >= 0:
            return 0.0, ("", "")
        worst = int(np.argmin(gaps))
        one, two = (f"g{k:06d}" if k >= 0 else self.parts[-1 - k] for k in pairs[worst].tolist())
        return float(-gaps[worst]), (one, two)

    def hulls(self) -> dict[str, list[Floats]]:
        """Return the corners of the convex shapes of each part: planes have none."""
        return {}

    def places(self, parts: Sequence[str]) -> tuple[Floats, Floats]:
        """Return where the walls are [d], and their rotations; NaN for one that is removed."""
        rows = [self.parts.index(part) for part in parts]
        walls = self._model.walls
        points, turns = walls.points[rows].copy(), from_matrices(walls.rotations[rows])
        gone = np.array([part in self._removed for part in parts], dtype=bool)
        points[gone] = turns[gone] = np.nan
        return points, turns

    def axle(self, name: str) -> tuple[float, float]:
        """Refuse: nothing moves but grains."""
        _refuse(f"joints such as {name}")

    def push(self, name: str, force: float) -> None:
        """Refuse: nothing moves but grains."""
        del force
        _refuse(f"joints such as {name}")

    def turn(self, name: str, speed: float) -> None:
        """Refuse: nothing moves but grains."""
        del speed
        _refuse(f"joints such as {name}")

    def place(self, name: str, position: float) -> None:
        """Refuse: nothing moves but grains."""
        del position
        _refuse(f"joints such as {name}")

    def reaction(self, name: str) -> float:
        """Refuse: nothing moves but grains."""
        _refuse(f"joints such as {name}")

    def complaint(self) -> str:
        """Return nothing: Box3D does not complain."""
        return ""

    def muted(self) -> AbstractContextManager[list[str]]:
        """Collect nothing: Box3D says nothing."""
        return nullcontext([])

    def _centres(self, positions: Floats, quaternions: Floats) -> Floats:
        """Return the centres of mass of the grains [d], shape (n, 3)."""
        return positions + np.einsum("nij,nj->ni", to_matrices(quaternions), self._model.centres)

    def _exact(self, pairs: np.typing.NDArray[np.int64], gaps: Floats) -> Floats:
        """Return gaps of contact points, that of the deepest point of a pair as it is in truth."""
        known, depths = self._overlaps()
        if not len(known):
            return gaps
        result = gaps.copy()
        # One number a pair; the deepest point of each comes first.
        width = self.n_grains + len(self.parts) + 1
        keys = (pairs[:, 0] + len(self.parts)) * width + pairs[:, 1]
        wanted = (known[:, 0] + len(self.parts)) * width + known[:, 1]
        order = np.lexsort((gaps, keys))
        starts = order[np.flatnonzero(np.append(True, np.diff(keys[order]) != 0))] if keys.size else order
        _, mine, theirs = np.intersect1d(keys[starts], wanted, return_indices=True)
        result[starts[mine]] = np.minimum(depths[theirs], gaps[starts[mine]])
        return result

    def _overlaps(self) -> tuple[np.typing.NDArray[np.int64], Floats]:
        """Return who overlaps with whom, and their exact gaps [d], all below zero."""
        positions, quaternions = self._world.poses()
        walls = [k for k, name in enumerate(self.parts) if name not in self._removed]
        heights = np.stack([self._clearances(positions, quaternions, k) for k in walls]) if walls else np.empty((0, 0))
        wall, grain = np.nonzero(heights < 0)
        pairs = [np.column_stack([-1 - np.array(walls, dtype=np.int64)[wall], grain])]
        gaps = [heights[wall, grain]]
        if self._model.grains is not None:
            lower, upper = positions.min(axis=0) - 1.0, positions.max(axis=0) + 1.0
            turns = quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)
            bed = Packing(self._model.grains, positions, turns, np.ones(self.n_grains), Domain(lower, upper))
            graph = near_pairs(bed, within=0.0)
            pairs.append(graph.pairs)
            gaps.append(graph.gaps)
        return np.concatenate(pairs), np.concatenate(gaps)

    def _clearances(self, positions: Floats, quaternions: Floats, wall: int) -> Floats:
        """Return how far each grain is from a wall [d], shape (n,)."""
        walls, model = self._model.walls, self._model
        normal, point = walls.rotations[wall][:, 2], walls.points[wall]
        if model.grains is None:
            centres = self._centres(positions, quaternions)
            return np.asarray((centres - point) @ normal - model.radii)
        # Seen from each grain's own frame.
        own = np.einsum("nji,j->ni", to_matrices(quaternions), normal)
        corners = model.grains.vertices
        heights = np.einsum("vi,vi->v", corners, own[owners(model.grains.vertex_offsets)])
        return np.minimum.reduceat(heights, model.grains.vertex_offsets[:-1]) + (positions - point) @ normal


def _refuse(what: str) -> NoReturn:
    raise InputError(f"Box3D has no {what} here; engine='mujoco' has them")
