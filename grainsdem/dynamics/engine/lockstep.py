"""Many simulations at once: `mujoco.batch` steps those of several runs together, each run being written as if alone.

Runs are threads, of which one works at a time. One that wants to step waits until all others that are not over want to,
too; then the batch steps them all on all processors. A batch gives each simulation the bits that it would have alone.
"""

from __future__ import annotations

import threading
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING, Any

from grainsdem.dynamics.engine.contract import EngineError
from grainsdem.dynamics.engine.mujoco_engine import MujocoEngine
from grainsdem.errors import GrainsDEMError

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from contextlib import AbstractContextManager

    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.dynamics.engine.contract import Contacts

_HERE = threading.local()


class UnlikeError(GrainsDEMError):
    """The models of several runs are too different to be stepped together."""


class AbandonedError(BaseException):
    """The other runs are not needed any more; no run is to answer this with a smaller time step."""


def joined(engine: MujocoEngine) -> MujocoEngine:
    """Return the engine, or what stepping it together with others takes where this thread runs in lockstep."""
    lockstep: Lockstep | None = getattr(_HERE, "lockstep", None)
    return engine if lockstep is None else lockstep.join(engine)


class Lockstep:
    """Runs that step together.

    Parameters
    ----------
    n_runs : int
        How many.
    n_threads : int
        Threads that the batch steps them on; 0 for one for each processor.
    """

    def __init__(self, n_runs: int, n_threads: int = 0) -> None:
        self._n_threads = n_threads
        self._turn = threading.Condition()
        self._active = n_runs
        self._members: list[Member] = []
        self._wanted: dict[int, int] = {}
        self._errors: dict[int, Exception] = {}
        self._batch: Any = None
        self.is_stale = False
        self._is_abandoned = False

    def abandon(self) -> None:
        """Let every run end where it wants to step next."""
        self._is_abandoned = True

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let this thread be one of the runs while the block lasts; it has the turn but where it waits to step."""
        with self._turn:
            _HERE.lockstep = self
            try:
                yield
            finally:
                _HERE.lockstep = None
                self._active -= 1
                self._go_where_all_wait()

    def join(self, engine: MujocoEngine) -> Member:
        """Return an engine of the same model that steps together with the others."""
        member = Member(engine.model, self, len(self._members))
        self._members.append(member)
        self._batch = None
        return member

    def step(self, member: Member, n_steps: int) -> None:
        """Go on by so many steps when all others do, too."""
        self._wanted[member.number] = n_steps
        self._go_where_all_wait()
        while member.number in self._wanted:
            self._turn.wait()
        if self._is_abandoned:
            raise AbandonedError
        error = self._errors.pop(member.number, None)
        if error is not None:
            raise error

    def fetch(self, member: Member) -> None:
        """Copy all that the last step of a run left, contacts and warnings among it."""
        if self._batch is not None:
            self._batch.get_data(member.number, member.data)

    def _go_where_all_wait(self) -> None:
        """Step those that wait, once they are all that are left."""
        if not self._wanted or len(self._wanted) < self._active:
            return
        try:
            self._advance()
        except Exception as error:  # noqa: BLE001  (told to every run, which would wait for ever)
            self._errors = dict.fromkeys(self._wanted, error)
        self._wanted.clear()
        self._turn.notify_all()

    def _advance(self) -> None:
        batch = self._prepared()
        for member in self._members:
            if member.number in self._wanted:
                batch.state[member.number] = member.state()
        for n_steps in sorted(set(self._wanted.values())):
            ids = sorted(number for number, n in self._wanted.items() if n == n_steps)
            self._step_some(batch, ids, n_steps)
        for number in self._wanted:
            self._members[number].take(batch.state[number])

    def _step_some(self, batch: Any, ids: list[int], n_steps: int) -> None:
        from mujoco.batch import SimulationError

        try:
            batch.step(ids, n_steps)
        except SimulationError as error:
            for number in error.ids.tolist():
                self._errors[number] = EngineError(batch.error(number))

    def _prepared(self) -> Any:
        """Return the batch of all members' present models."""
        from mujoco.batch import Batch

        models = [member.model for member in self._members]
        if self._batch is None:
            self._batch = Batch(models[0], len(models), self._n_threads, persistent=True)
            self.is_stale = True
        if self.is_stale:
            try:
                self._batch.set_models(models)
            except Exception as error:
                raise UnlikeError(f"the runs cannot be stepped together: {error}") from error
            self.is_stale = False
        return self._batch


class Member(MujocoEngine):
    """The engine of one run among several.

    Parameters
    ----------
    model : mujoco.MjModel
        Its model.
    lockstep : Lockstep
        Who steps it.
    number : int
        Which of them it is.
    """

    def __init__(self, model: Any, lockstep: Lockstep, number: int) -> None:
        super().__init__(model)
        self.number = number
        self._lockstep = lockstep
        self._lacks_all = False

    def step(self, n_steps: int) -> None:
        """Go on by so many time steps together with the others, or raise `EngineError`."""
        self._lockstep.step(self, n_steps)
        self._lacks_all = True

    def take(self, state: NDArray[np.float64]) -> None:
        """Take the state that a step led to, and no more: all that the step left is copied when it is asked for."""
        import mujoco

        mujoco.mj_setState(self.model, self.data, state, mujoco.mjtState.mjSTATE_INTEGRATION)

    def restore(self, state: NDArray[np.float64]) -> None:
        """Go back to a state that `state` gave; warnings, and the scraps of a step that failed, are forgotten."""
        super().restore(state)
        self._lacks_all = False

    def last_contacts(self) -> Contacts:
        """Return the contact points of the last step, with forces as that step left them: fast, known to 10 %."""
        self._fetch()
        return super().last_contacts()

    def accelerations(self) -> NDArray[np.float64]:
        """Return the magnitude of each centroid's acceleration [g] in the last step, shape (n,)."""
        self._fetch()
        return super().accelerations()

    def deepest_overlap(self) -> tuple[float, tuple[str, str]]:
        """Return the depth [d] of the deepest overlap of the present state, and the names of the two; zero for none."""
        self._fetch()
        return super().deepest_overlap()

    def reaction(self, name: str) -> float:
        """Return the force, or torque, of contacts and limits along a joint of the apparatus in the last step."""
        self._fetch()
        return super().reaction(name)

    def place(self, name: str, position: float) -> None:
        """Put a joint of the apparatus at a position, with all that hangs on it."""
        self._fetch()  # which would put it back later
        super().place(name, position)

    def turn(self, name: str, speed: float) -> None:
        """Set the present speed of a joint of the apparatus; a heavy part keeps it through a step."""
        self._fetch()
        super().turn(name, speed)

    def complaint(self) -> str:
        """Return what is wrong by MuJoCo's own account, or nothing."""
        self._fetch()
        return super().complaint()

    def _fetch(self) -> None:
        if self._lacks_all:
            self._lockstep.fetch(self)
            self._lacks_all = False

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""
        super().set_time_step(time_step)
        self._lockstep.is_stale = True

    def set_gravity(self, gravity: ArrayLike) -> None:
        """Change the acceleration [g], shape (3,), that acts on everything."""
        super().set_gravity(gravity)
        self._lockstep.is_stale = True

    def set_friction(self, friction: float | None) -> None:
        """Give all grains that are not glued one coefficient of friction, or with None that of the model again."""
        super().set_friction(friction)
        self._lockstep.is_stale = True

    def make_smooth(self, parts: Sequence[str]) -> None:
        """Let these parts be without friction until the next call, and give all others their own again."""
        super().make_smooth(parts)
        self._lockstep.is_stale = True

    def set_drag(self, rate: float) -> None:
        """Let grains lose velocity and spin at a rate [1/t] besides all else, as in a fluid; zero for none."""
        super().set_drag(rate)
        self._lockstep.is_stale = True

    def remove(self, part: str) -> None:
        """Let grains pass through a part from now on, until it is put back."""
        super().remove(part)
        self._lockstep.is_stale = True

    def put_back(self, part: str) -> None:
        """Let a part that was removed stop grains again."""
        super().put_back(part)
        self._lockstep.is_stale = True

    def set_present(self, is_present: ArrayLike) -> None:
        """Say which grains take part, shape (n,), until the next call: others touch nothing, and stay if `still`."""
        super().set_present(is_present)
        self._lockstep.is_stale = True

    def muted(self) -> AbstractContextManager[list[str]]:
        """Return nothing: what the engine says is collected around all runs."""
        return nullcontext([])
