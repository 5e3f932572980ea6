"""What every experiment stands on: its units, its loop, what it gives back, and parts that are pushed or driven."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar

import numpy as np

from exporters import mjcf
from grainsdem.dynamics.budget import Budget, estimate
from grainsdem.dynamics.loop import Loop, Record
from grainsdem.dynamics.mechanics import energies
from grainsdem.dynamics.scene import Scene, equip, refuse_overlap, scene_of
from grainsdem.dynamics.watch import TroubleError, refuse_broken
from grainsdem.errors import name_offenders

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from exporters.mjcf import MjcfOptions
    from grainsdem.dynamics.engine import Apparatus
    from grainsdem.dynamics.experiments.cells.meter import Meter
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.model import Packing
    from grainsdem.panels import Panel

    Tell = Callable[[float, str], None]
    Series = Mapping[str, NDArray[np.float64]]

RUNAWAY = 100.0
"""Mean kinetic energy of a grain [P d³, m g d] that no fall and no loading gives: the run has gone wrong."""

Report = TypeVar("Report")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome(Generic[Report]):
    """What an experiment gives back.

    Parameters
    ----------
    packing : Packing
        The grains where they were at its end.
    history : dict of ndarray
        Series over time, in SI.
    report : dataclass
        What was measured; ``to_dict()`` gives it as JSON values.
    snapshot : Snapshot
        The last instant, that everything in `grainsdem.dynamics.mechanics` is a function of.
    profile : dict of ndarray
        What was measured along a line, in SI; empty where an experiment measures no such thing.
    panels : tuple of Panel
        Curves of all this, for `grainsdem.figures.curve_figure`; none where the run never came to its second stage.
    """

    packing: Packing
    history: dict[str, NDArray[Any]]
    report: Report
    snapshot: Snapshot
    profile: dict[str, NDArray[np.float64]]
    panels: tuple[Panel, ...] = ()


class JsonReport:
    """A report that can be told as JSON values."""

    __slots__ = ()

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON values; a number that was not measured is null."""
        values: dict[str, Any] = asdict(self)  # type: ignore[call-overload]  # every subclass is a dataclass
        # What a report has of its own comes first, then what all of its kind have.
        order = [name for kind in type(self).__mro__ for name in getattr(kind, "__annotations__", {})]
        values = {name: values[name] for name in order}
        return {k: None if isinstance(v, float) and not np.isfinite(v) else v for k, v in values.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class RunReport(JsonReport):
    """What the report of every run ends with.

    Parameters
    ----------
    time : float
        Simulated time [s].
    n_steps, halvings : int
        Steps taken, and how often the time step was halved to keep the run stable.
    """

    time: float
    n_steps: int
    halvings: int


def pressure_gravity(packing: Packing, pressure: float) -> float:
    """Return the acceleration [m/s²] that makes ``pressure`` [Pa] the unit: P = ρ g d."""
    units = mjcf.units(packing, 1.0)
    return pressure / (units.density * units.length)


class Trial(Loop, Generic[Report]):
    """A run under an apparatus: broken states, runaway energies and grains that got out are trouble.

    Parameters
    ----------
    scene : Scene
        What moves.
    meter : Meter
        The parts that are pushed.
    """

    is_driven = True

    def __init__(self, scene: Scene, meter: Meter) -> None:
        super().__init__(scene, Record())
        self.meter = meter
        self.tell: Tell = lambda _fraction, _words: None
        """Called with the fraction done and a few words at every sample."""

    def report(self) -> Report:
        """Return what the run measured, once it is over."""
        raise NotImplementedError

    def expected_time(self) -> float:
        """Return about how long [t] the run will last; 0 where nothing is known of it, and only memory is looked at."""
        return 0.0

    def budget(self) -> Budget:
        """Return what the run will take."""
        return estimate(self.scene.n_grains, duration=self.expected_time(), time_step=self.scene.engine.time_step)

    def in_si(self, row: Any) -> Any:
        """Return a sample as it is stored: in the units of the columns."""
        scales = self.scene.units
        factors = {
            "s": scales.time, "m": scales.length, "Pa": scales.stress, "m/s": scales.velocity, "N": scales.force,
            "N m": scales.energy, "J": scales.energy, "rad/s": 1 / scales.time, "kg": scales.mass,
        }  # fmt: skip
        return row._replace(
            **{name: getattr(row, name) * factors[unit] for name, unit in self.columns.items() if unit in factors}
        )

    def cost(self) -> dict[str, Any]:
        """Return what a `RunReport` ends with."""
        return {"time": self.time_in_si(), "n_steps": self.n_steps, "halvings": self.halvings}

    def packing(self) -> Packing:
        """Return the grains where they are."""
        return self.scene.packing()

    def profile(self) -> dict[str, NDArray[np.float64]]:
        """Return what the run measured along a line, in SI."""
        return {}

    def remarks(self) -> dict[str, Any]:
        """Return what provenance says of the run besides its options, as JSON values."""
        return {}

    def outside(self) -> NDArray[np.float64]:
        """Return how far [d] each centroid is outside what should hold it, shape (n,)."""
        raise NotImplementedError

    def kinetic_energy(self, now: Snapshot) -> float:
        """Return the mean kinetic energy of a grain that is not glued, over that of the units."""
        found, n_loose = energies(now), int((~now.is_glued).sum())
        return (found.translation + found.rotation) / n_loose / self.scene.units.energy

    def check(self, now: Any) -> None:
        """Raise `TroubleError` where something is wrong with the present state."""
        refuse_broken(self.scene)
        if not all(np.isfinite(value) for value in now):
            raise TroubleError("a measurement that is not finite")
        if now.kinetic_energy > RUNAWAY:
            raise TroubleError(f"a mean kinetic energy of {now.kinetic_energy:.3g} P d³ a grain")
        escaped = np.flatnonzero(self.outside() > 1.0)
        if escaped.size:
            raise TroubleError(f"{escaped.size} grains left the apparatus: {name_offenders(escaped)}")

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "loads": dict(self.meter.last)}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.meter.forget(memory["loads"])


def assemble(
    packing: Packing,
    options: MjcfOptions,
    furnish: Callable[[Apparatus], None] | None = None,
    *,
    spheres: bool = False,
    advice: str = "",
) -> Scene:
    """Return the scene of a packing in an apparatus.

    Parameters
    ----------
    packing : Packing
        The grains.
    options : MjcfOptions
        Friction and the like; its gravity sets the units.
    furnish : callable, optional
        Adds the apparatus, where there is one besides the packing's own container.
    spheres : bool
        Whether the grains, which are spheres as well as polyhedra can be, are simulated as perfect ones.
    advice : str
        What the error says besides where something overlaps.

    Raises
    ------
    InputError
        If the packing is periodic or overlaps at the start.
    """
    apparatus = equip(packing, options, are_spheres=spheres)
    if furnish is not None:
        furnish(apparatus)
    scene = scene_of(packing, apparatus.text(), options.gravity, are_spheres=spheres)
    refuse_overlap(scene, advice)
    return scene
