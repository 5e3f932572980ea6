"""The contract of an engine: load a model's text, step it, and take and give its state as a value.

An engine is one module with ``load(text) -> Engine``. Everything that it says is in grain units
(`exporters.mjcf.units`); grains are those bodies that the exporter named ``g000000`` and so on, and everything else is
a part of the apparatus.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence
    from contextlib import AbstractContextManager

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


class Motion(NamedTuple):
    """Where the grains are and how they move, in grain units.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        Centroids [d].
    quaternions : ndarray, shape (n, 4)
        Rotations (w, x, y, z) of the grains' own frames.
    velocities : ndarray, shape (n, 3)
        Velocities of the centroids [d/t].
    spins : ndarray, shape (n, 3)
        Angular velocities in the world's frame [1/t].
    """

    positions: Floats
    quaternions: Floats
    velocities: Floats
    spins: Floats


class Contacts(NamedTuple):
    """Contact points that carry force, in grain units.

    Parameters
    ----------
    pairs : ndarray of int64, shape (m, 2)
        The two that touch, the first below the second: grains by number, part k of the apparatus as −1 − k.
    points : ndarray, shape (m, 3)
        Where they touch [d].
    normals : ndarray, shape (m, 3)
        Unit vectors from the first to the second.
    forces : ndarray, shape (m, 3)
        Force on the second [m g].
    gaps : ndarray, shape (m,)
        Gap between the two [d], negative where they overlap.
    frictions : ndarray, shape (m,)
        Coefficient of friction [1].
    """

    pairs: NDArray[np.int64]
    points: Floats
    normals: Floats
    forces: Floats
    gaps: Floats
    frictions: Floats


class EngineError(Exception):
    """The engine cannot go on; the run that meets it goes back to the last good state."""


class Engine(Protocol):
    """A simulation of one model."""

    name: str
    """Engine and version: states pass between engines of the same name only."""
    n_grains: int
    parts: tuple[str, ...]
    """Names of the parts of the apparatus that grains can touch."""
    masses: Floats
    """Mass of each grain, shape (n,)."""
    inertias: Floats
    """Tensor of inertia of each grain in its own frame, shape (n, 3, 3)."""
    is_glued: NDArray[np.bool_]
    """Which grains are fixed to a part of the apparatus, shape (n,)."""
    is_present: NDArray[np.bool_]
    """Which grains take part, shape (n,): all, unless `set_present` has said otherwise."""

    @property
    def time(self) -> float:
        """Simulated time [t]."""

    @property
    def time_step(self) -> float:
        """Time step [t]."""

    @property
    def gravity(self) -> Floats:
        """Acceleration [g], shape (3,)."""

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Change the acceleration [g], shape (3,), that acts on everything."""

    def set_friction(self, friction: float | None) -> None:
        """Give all grains that are not glued one coefficient of friction, or with None that of the model again."""

    def make_smooth(self, parts: Sequence[str]) -> None:
        """Let these parts be without friction until the next call, and give all others their own again."""

    def set_velocities(self, velocities: ArrayLike) -> None:
        """Set the velocities of the grains that are not glued [d/t], shape (n, 3); spins become zero."""

    def hold_up(self, shares: ArrayLike) -> None:
        """Take a share of its weight, 0 to 1, off each grain, shape (n,), until the next call."""

    def set_drag(self, rate: float) -> None:
        """Let grains lose velocity and spin at a rate [1/t] besides all else, as in a fluid; zero for none."""

    def remove(self, part: str) -> None:
        """Let grains pass through a part from now on, until it is put back."""

    def put_back(self, part: str) -> None:
        """Let a part that was removed stop grains again."""

    def set_present(self, is_present: ArrayLike) -> None:
        """Say which grains take part, shape (n,), until the next call: others touch nothing, and stay if `still`."""

    def still(self, grains: ArrayLike) -> None:
        """Let these grains, by number, stop where they are, weightless until they are inserted."""

    def insert(self, grains: ArrayLike, positions: ArrayLike, quaternions: ArrayLike, velocities: ArrayLike) -> None:
        """Put these grains, by number, somewhere [d], with their weight, moving at velocities [d/t] without spin."""

    def step(self, n_steps: int) -> None:
        """Go on by so many time steps, or raise `EngineError`."""

    def state(self) -> Floats:
        """Return everything that the next step depends on, as one array; what was set or removed is not part of it."""

    def restore(self, state: Floats) -> None:
        """Go back to a state that `state` gave."""

    def motion(self) -> Motion:
        """Return where the grains are and how they move."""

    def contacts(self) -> Contacts:
        """Return the contact points of the present state, with forces solved to convergence."""

    def last_contacts(self) -> Contacts:
        """Return the contact points of the last step, with forces as that step left them: fast, known to 10 %."""

    def accelerations(self) -> Floats:
        """Return the magnitude of each centroid's acceleration [g] in the last step, shape (n,)."""

    def deepest_overlap(self) -> tuple[float, tuple[str, str]]:
        """Return the depth [d] of the deepest overlap of the present state, and the names of the two; zero for none."""

    def hulls(self) -> dict[str, list[Floats]]:
        """Return the corners [d] of the convex shapes of each part, in its own frame; planes have none."""

    def places(self, parts: Sequence[str]) -> tuple[Floats, Floats]:
        """Return where the frames of parts are [d], shape (b, 3), and their rotations; NaN for one that is removed."""

    def axle(self, name: str) -> tuple[float, float]:
        """Return position and speed of a joint of the apparatus."""

    def push(self, name: str, force: float) -> None:
        """Let a force, or a torque, act along a joint of the apparatus until the next call."""

    def turn(self, name: str, speed: float) -> None:
        """Set the present speed of a joint of the apparatus; a heavy part keeps it through a step."""

    def place(self, name: str, position: float) -> None:
        """Put a joint of the apparatus at a position, with all that hangs on it."""

    def reaction(self, name: str) -> float:
        """Return the force, or torque, of contacts and limits along a joint of the apparatus in the last step."""

    def complaint(self) -> str:
        """Return what is wrong by the engine's own account, or nothing."""

    def muted(self) -> AbstractContextManager[list[str]]:
        """Collect what the engine says while a block lasts, instead of letting it write to the screen."""
