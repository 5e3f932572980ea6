"""Feed: grains come in at a rate, into a container or onto a heap, and leave where walls are open."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import as_asked, options_of
from grainsdem.dynamics.experiments.streams.inlet import Inlet, inlet_box, reaching, seed_of
from grainsdem.dynamics.experiments.streams.stream import Stream
from grainsdem.errors import InputError
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from exporters.mjcf import MjcfOptions
    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

    Bools = NDArray[np.bool_]

USUAL_RATE = 2.0
"""Mean grains that come in in unit time [1/t], where no rate is given: a small inlet has room for them."""

ROUNDING = 1e-9
"""Mass [m] that rounding may hide of what is due."""


class FeedSample(NamedTuple):
    """One look at what is fed, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        1: a run has no other.
    kinetic_energy : float
        Mean of the grains that touch another one [m g d].
    n_inside : float
        How many grains are inside.
    fed_mass, removed_mass, inside_mass : float
        What has come in, what has left, and what is inside.
    height : float
        Highest centroid above the floor [d].
    """

    time: float
    stage: float
    kinetic_energy: float
    n_inside: float
    fed_mass: float
    removed_mass: float
    inside_mass: float
    height: float


@dataclass(frozen=True, slots=True)
class FeedReport(RunReport):
    """What was fed, and where it is.

    Parameters
    ----------
    n_fed, n_removed, n_inside : int
        Grains that came in, that left, and that are inside: the first less the second is the third.
    fed_mass, removed_mass, inside_mass : float
        The same [kg].
    rate : float
        Mass that came in over the time until the last of it did [kg/s].
    n_waiting : int
        Grains that were due at the end and found no room in the inlet.
    at_rest : bool
        Whether what is inside was at rest at the end.
    """

    n_fed: int
    n_removed: int
    n_inside: int
    fed_mass: float
    removed_mass: float
    inside_mass: float
    rate: float
    n_waiting: int
    at_rest: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return the masses, and the height of the bed, over time."""
    del profile
    time = series["time"]
    names = {"fed": "fed_mass", "removed": "removed_mass", "inside": "inside_mass"}
    return [
        Panel("time  [s]", "mass  [kg]", {label: (time, series[name]) for label, name in names.items()}),
        Panel("time  [s]", "height of the bed  [m]", {"": (time, series["height"])}),
    ]


@experiment(panels=_panels, whole=True, needs_seed=True)
def feed(
    packing: Packing,
    *,
    rate: Annotated[
        float | None, option("Mass that comes in in unit time; by default two mean grains in √(d/g).", "kg/s", gt=0)
    ] = None,
    inlet: Annotated[
        Sequence[float] | None,
        option(
            "Box where grains come in: its lower and its upper corner, x y z x y z; by default a third as wide as the "
            "container, and higher than any bed of all its grains.",
            "m",
            min_length=6,
            max_length=6,
        ),
    ] = None,
    speed: Annotated[float, option("Speed along gravity with which they come in.", "m/s", ge=0)] = 0.0,
    release: Annotated[
        Sequence[str] | None,
        option("Walls that are left out, such as wall_x1: a grain that has passed one is taken out.", min_length=1),
    ] = None,
    recirculate: Annotated[bool, option("Feed grains that were taken out in again, until time is up.")] = False,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    max_time: Annotated[
        float,
        option("Time limit, from when the last grain is due, or with recirculate from the start.", "√(d/g)", gt=0),
    ] = 100.0,
    **run: Unpack[Run],
) -> _Feed:
    """Let grains come in at a rate, into their container or onto a heap: filling, heaps from a stream, mass balance.

    Parameters
    ----------
    packing : Packing
        The grains, which come in one after another by number, at random places of the inlet and turned at random, and
        the container, which is empty at first.

    Returns
    -------
    Outcome
        Packing of the grains that are inside, history, `FeedReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, there is no such wall, the inlet has no room for the largest grain, or the packing
        is periodic.

    Notes
    -----
    A grain that is due comes in where no other one is near, and waits where there is no room; what has come in less
    what has left is what is inside, to the grain. A run is over when all grains have come in and are at rest.
    """
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    grains = as_asked(packing, run)
    corners = inlet_box(grains, inlet)
    scene = assemble(reaching(grains, corners), options, spheres=run["spheres"])
    scales = scene.units
    flow = USUAL_RATE * float(np.mean(scene.engine.masses)) if rate is None else rate * scales.time / scales.mass
    return _Feed(
        scene,
        Inlet(scene, corners, seed_of(run["rng"])),
        options,
        flow,
        speed=speed / scales.velocity,
        release=_released(scene, release),
        recirculates=recirculate,
        max_time=max_time,
    )


class _Feed(Stream[FeedReport]):
    """Grains that come in, one after another."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "1",
        "kinetic_energy": "m g d",
        "n_inside": "1",
        "fed_mass": "kg",
        "removed_mass": "kg",
        "inside_mass": "kg",
        "height": "m",
    }

    def __init__(
        self,
        scene: Scene,
        inlet: Inlet,
        options: MjcfOptions,
        flow: float,
        *,
        speed: float,
        release: list[str],
        recirculates: bool,
        max_time: float,
    ) -> None:
        super().__init__(scene, max_time, inlet, speed)
        self.options, self.release, self.recirculates, self._flow = options, release, recirculates, flow
        self._sides = _sides(scene, release)
        self._limit = max_time + (0.0 if recirculates else float(self.masses.sum()) / flow)
        self.begun = {"time": 0.0, "is_at_rest": True}
        scene.engine.set_present(np.zeros(scene.n_grains, dtype=bool))
        scene.engine.still(np.arange(scene.n_grains))
        self.act()

    def act(self) -> None:
        """Leave walls out."""
        for wall in self.release:
            self.scene.engine.remove(wall)

    def has_left(self) -> Bools:
        """Return which grains have passed a wall that was left out, shape (n,)."""
        positions, _ = self.scene.poses()
        gone = np.zeros(len(positions), dtype=bool)
        for normal, offset in self._sides:
            gone |= positions @ normal > offset
        return gone

    def due(self) -> NDArray[np.int64]:
        """Return the grains that should be inside by now and have not come in."""
        fresh = np.flatnonzero(self.n_entered == 0)
        again = np.flatnonzero(~self.is_present & (self.n_entered > 0)) if self.recirculates else fresh[:0]
        waiting = np.concatenate([again, fresh])
        owed = self._flow * self.scene.engine.time - float(self.masses @ self.n_entered)
        return waiting[np.cumsum(self.masses[waiting]) <= owed + ROUNDING]

    def measure(self) -> FeedSample:
        """Return the present sample."""
        inside, engine = self.inside(), self.scene.engine
        heights = self.scene.poses()[0][inside, self.scene.up]
        floor = self.scene.source.domain.lower[self.scene.up] / self.scene.units.length
        return FeedSample(
            time=engine.time,
            stage=1.0,
            kinetic_energy=self.energy(),
            n_inside=float(inside.sum()),
            fed_mass=float(self.masses @ self.n_entered),
            removed_mass=float(self.masses @ self.counts_left()),
            inside_mass=float(self.masses @ inside),
            height=float((heights - floor).max(initial=0.0)),
        )

    def is_over(self) -> bool:
        """Return whether all grains have come in and are at rest, or time is up."""
        all_in = not self.recirculates and bool((self.n_entered > 0).all())
        return self.since() >= self._limit or (all_in and self.is_at_rest())

    def expected_time(self) -> float:
        """Return the time limit [t]; grains may rest before."""
        return self._limit

    def share_done(self, now: FeedSample) -> float:
        """Return the share of the grains that have come in, or of the time where they go round."""
        return now.time / self.max_time if self.recirculates else now.fed_mass / float(self.masses.sum())

    def words(self, now: FeedSample) -> str:
        """Return a few words on a sample."""
        return f"{now.n_inside:.0f} grains inside, {now.height:.1f} d high"

    def remarks(self) -> dict[str, Any]:
        """Return how what is inside came to rest, where it did."""
        return dict(self.scene.rest(self.options)) if self.is_at_rest() else {}

    def report(self) -> FeedReport:
        """Return what was fed, and where it is."""
        scales, last = self.scene.units, self.samples[-1]
        risen = [row.time for before, row in pairwise(self.samples) if row.fed_mass > before.fed_mass]
        took = max(risen, default=np.nan)
        return FeedReport(
            n_fed=int(self.n_entered.sum()),
            n_removed=int(self.counts_left().sum()),
            n_inside=int(self.inside().sum()),
            fed_mass=last.fed_mass * scales.mass,
            removed_mass=last.removed_mass * scales.mass,
            inside_mass=last.inside_mass * scales.mass,
            rate=last.fed_mass / took * scales.mass / scales.time,
            n_waiting=len(self.due()),
            at_rest=self.is_at_rest(),
            **self.cost(),
        )


def _released(scene: Scene, names: Sequence[str] | None) -> list[str]:
    """Return the walls to leave out, or raise `InputError` where there is no such wall."""
    walls = [name for name in scene.engine.parts if name.startswith("wall") and name != scene.floor]
    chosen = list(names or ())
    unknown = [name for name in chosen if name not in walls]
    if unknown:
        raise InputError(f"release must name some of {', '.join(walls)}; got {', '.join(chosen)}")
    return chosen


def _sides(scene: Scene, release: list[str]) -> list[tuple[NDArray[np.float64], float]]:
    """Return outward normal and offset [d] of each wall that is left out."""
    domain = scene.source.domain.scaled(1 / scene.units.length)
    sides = []
    for name in release:
        kind, number = name.removeprefix("wall_")[0], int(name.removeprefix("wall_")[1:])
        if kind == "p":
            sides.append((domain.planes[number, :3], float(domain.planes[number, 3])))
            continue
        axis = "xyz".index(kind)
        sign = 2.0 * number - 1.0
        sides.append((sign * np.eye(3)[axis], sign * float((domain.lower, domain.upper)[number][axis])))
    return sides
