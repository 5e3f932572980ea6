"""Discharge: a silo or a hopper opens, and what flows out is weighed."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import units
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import pour
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of, wall_friction_of
from grainsdem.dynamics.experiments.streams.inlet import Inlet, inlet_box, seed_of
from grainsdem.dynamics.experiments.streams.outlet import GATE, Outlet
from grainsdem.dynamics.experiments.streams.stream import Stream
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from exporters.mjcf import MjcfOptions
    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.scene import Scene

PATIENCE = 10.0
"""Time [t] without a grain through the opening after which a flow has stopped: a grain falls 50 d in it."""

STEADY = 0.1, 0.8
"""Shares of the mass that flows out in all between which the rate is measured: neither the start nor the last cone."""

BLOCKS = 5
"""Parts of that time whose rates tell the error of their mean."""

FEWEST = 10
"""Grains that must have left for a rate."""

LAYER = 0.2, 0.8
"""Heights, over that of the bed, between which its density is taken."""

BEVERLOO = 1.4
"""Width of the rim that no grain passes, in diameters: k of Beverloo's law, of 1.3 to 1.5 for sand and seeds."""


class DischargeSample(NamedTuple):
    """One look at a silo, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while the outlet is closed, 1 while it is open.
    kinetic_energy : float
        Mean of the grains that touch another one [m g d].
    n_discharged : float
        How many grains have left, counted again each time where they are fed in again.
    discharged_mass : float
        What they weigh.
    inside_mass : float
        What the grains weigh that are inside.
    height : float
        Highest centroid above the floor [d].
    """

    time: float
    stage: float
    kinetic_energy: float
    n_discharged: float
    discharged_mass: float
    inside_mass: float
    height: float


@dataclass(frozen=True, slots=True)
class DischargeReport(RunReport):
    """How a silo emptied.

    Parameters
    ----------
    rate : float
        Mass that leaves in unit time [kg/s], between a tenth and eight tenths of what left in all (from a tenth to the
        end where grains are fed in again); NaN where fewer than ten grains left.
    rate_error : float
        Its standard error, from five parts of that time.
    grain_rate : float
        The same as a number of grains [1/s].
    opening : float
        Diameter of the outlet, or width of a slot [m]; of a hopper's bottom the side of the square of equal area.
    beverloo : float
        Rate over ρ √g (D − 1.4 d)^(5/2), or ρ √g (D − 1.4 d)^(3/2) times the thickness in planar work; ρ is
        ``bulk_density`` and d the median diameter. 0.55 to 0.65 for round holes in flat floors.
    bulk_density : float
        Mass over volume [kg/m³] of the bed before, without a fifth at its bottom and at its top.
    n_discharged : int
        How many grains left.
    discharged_mass, inside_mass : float
        What left, and what stayed [kg].
    is_jammed : bool
        Whether the flow stopped with grains over the opening: an arch bears them.
    is_drained : bool
        Whether the flow stopped with none there: what is left cannot flow.
    stop_time : float
        When the last grain left, after the opening [s]; NaN where the flow went on.
    is_settled : bool
        Whether the bed was at rest when the outlet was opened.
    """

    rate: float
    rate_error: float
    grain_rate: float
    opening: float
    beverloo: float
    bulk_density: float
    n_discharged: int
    discharged_mass: float
    inside_mass: float
    is_jammed: bool
    is_drained: bool
    stop_time: float
    is_settled: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return the mass that has left, and the height of the bed, over time."""
    del profile
    time = series["time"]
    return [
        Panel("time  [s]", "discharged mass  [kg]", {"": (time, series["discharged_mass"])}),
        Panel("time  [s]", "height of the bed  [m]", {"": (time, series["height"])}),
    ]


@experiment(panels=_panels)
def discharge(
    packing: Packing,
    *,
    opening: Annotated[
        float | None,
        option(
            "Diameter of a round hole in the middle of a box's floor, or width of a slot in planar work; by default "
            "five median diameters, or half the floor where that is narrower. A hopper opens its whole bottom.",
            "m",
            gt=0,
        ),
    ] = None,
    refill: Annotated[bool, option("Feed grains that have left in again, above the bed, for a steady flow.")] = False,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    max_time: Annotated[float, option("Time limit after the opening.", "√(d/g)", gt=0)] = 200.0,
    **run: Unpack[Run],
) -> _Discharge:
    """Open the bottom of a silo or a hopper and weigh what flows out: rate, jams.

    Parameters
    ----------
    packing : Packing
        The bed, in a box (a silo with a flat floor) or in a hopper; `settle` it first, or, in a box, give ``rng``.

    Returns
    -------
    Outcome
        Packing of the grains that are left inside, history, `DischargeReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, the opening is narrower than the largest grain or wider than the floor, or the
        packing is periodic or overlaps.

    Notes
    -----
    A grain has left when its centroid is a diameter below the floor; it is taken out then. The flow has stopped when no
    grain has left for 10 √(d/g): jammed if some are still over the opening, else drained. Beverloo's law says that the
    rate goes with (D − 1.4 d)^(5/2), whatever the height of the bed; it wants a silo 2.5 D wide or more [1]_.

    .. [1] W. A. Beverloo, H. A. Leniger, J. van de Velde, The flow of granular solids through orifices, Chem. Eng. Sci.
       15, 260-269 (1961).
    """
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    grains = pour(packing, run)
    outlet = Outlet(grains, opening)
    rough = wall_friction_of(grains, friction, wall_friction)
    scales = units(grains, options.gravity)
    scene = assemble(
        grains, options, lambda apparatus: outlet.furnish(apparatus, scales, friction=rough), spheres=run["spheres"]
    )
    inlet = Inlet(scene, inlet_box(grains, share=1.0), seed_of(run["rng"])) if refill else None
    return _Discharge(scene, outlet, options, max_time, inlet)


class _Discharge(Stream[DischargeReport]):
    """A bed that comes to rest over a closed outlet, which is then opened."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "0 closed, 1 open",
        "kinetic_energy": "m g d",
        "n_discharged": "1",
        "discharged_mass": "kg",
        "inside_mass": "kg",
        "height": "m",
    }

    def __init__(
        self, scene: Scene, outlet: Outlet, options: MjcfOptions, max_time: float, inlet: Inlet | None
    ) -> None:
        super().__init__(scene, max_time, inlet)
        self.outlet, self.options = outlet, options

    def act(self) -> None:
        """Open the outlet."""
        self.scene.engine.remove(GATE)

    def mark(self, now: DischargeSample) -> dict[str, Any]:
        """Return the density of the bed before the outlet is opened."""
        del now
        return {"bulk_density": self._bulk_density()}

    def has_left(self) -> NDArray[np.bool_]:
        """Return which grains have fallen through the outlet, shape (n,)."""
        return self.outlet.below(self.scene.poses()[0])

    def due(self) -> NDArray[np.int64]:
        """Return the grains that have left and are to come in again."""
        return np.flatnonzero(~self.is_present)

    def measure(self) -> DischargeSample:
        """Return the present sample."""
        engine, up = self.scene.engine, self.scene.up
        counts, inside = self.counts_left(), self.inside()
        heights = self.scene.poses()[0][inside, up] - self.outlet.floor
        return DischargeSample(
            time=engine.time,
            stage=float(self.begun is not None),
            kinetic_energy=self.energy(),
            n_discharged=float(counts.sum()),
            discharged_mass=float(self.masses @ counts),
            inside_mass=float(self.masses @ inside),
            height=float(heights.max(initial=0.0)),
        )

    def is_over(self) -> bool:
        """Return whether the flow has stopped, or time is up."""
        return super().is_over() or self._has_stopped()

    def words(self, now: DischargeSample) -> str:
        """Return a few words on a sample of the flow."""
        return f"{now.n_discharged:.0f} grains out, {now.inside_mass / self.masses.sum():.0%} of the mass inside"

    def remarks(self) -> dict[str, Any]:
        """Return the opening [m], and how what is left came to rest where it did."""
        found = {"opening": self.outlet.width}
        return {**found, **self.scene.rest(self.options)} if self._has_stopped() else found

    def report(self) -> DischargeReport:
        """Return how the silo emptied."""
        scales, last = self.scene.units, self.samples[-1]
        begun = self.begun or {"time": np.nan, "bulk_density": np.nan, "is_at_rest": False}
        rate, error, grain_rate = self._rates()
        has_stopped, is_over_hole = self._has_stopped(), bool(self._over_hole().any())
        density = begun["bulk_density"]
        return DischargeReport(
            rate=rate * scales.mass / scales.time,
            rate_error=error * scales.mass / scales.time,
            grain_rate=grain_rate / scales.time,
            opening=self.outlet.width,
            beverloo=rate / (density * self._law()),
            bulk_density=density * scales.density,
            n_discharged=int(last.n_discharged),
            discharged_mass=last.discharged_mass * scales.mass,
            inside_mass=last.inside_mass * scales.mass,
            is_jammed=has_stopped and is_over_hole,
            is_drained=has_stopped and not is_over_hole,
            stop_time=(self._last_exit() - begun["time"]) * scales.time if has_stopped else float("nan"),
            is_settled=begun["is_at_rest"],
            **self.cost(),
        )

    def _open(self) -> list[DischargeSample]:
        """Return the samples since the outlet was opened."""
        return [row for row in self.samples if row.stage == 1.0]

    def _last_exit(self) -> float:
        """Return the time [t] at which the last grain left, or the outlet was opened."""
        rows = self._open()
        began = float(self.begun["time"]) if self.begun else np.nan
        exits = [row.time for before, row in pairwise(rows) if row.n_discharged > before.n_discharged]
        return max(exits, default=began)

    def _has_stopped(self) -> bool:
        """Return whether no grain has left for long."""
        if self.begun is None:
            return False
        return not self.inside().any() or self.scene.engine.time - self._last_exit() > PATIENCE

    def _over_hole(self) -> NDArray[np.bool_]:
        """Return which grains are inside and over the opening, shape (n,)."""
        return self.outlet.above(self.scene.poses()[0]) & self.inside()

    def _law(self) -> float:
        """Return √g (D − k d)^(5/2) of Beverloo, or what stands for it in planar work, in grain units."""
        width = self.outlet.width / self.scene.units.length - BEVERLOO
        if width <= 0:
            return float("nan")
        if self.scene.up == 2:
            return float(width**2.5)
        return float(width**1.5 * self.scene.source.domain.lengths[2] / self.scene.units.length)

    def _rates(self) -> tuple[float, float, float]:
        """Return mass that leaves in unit time, its standard error, and the same as a number of grains."""
        rows = self._open()
        out = np.array([row.n_discharged for row in rows])
        if len(rows) < BLOCKS + 1 or out[-1] < FEWEST:
            return np.nan, np.nan, np.nan
        mass, time = np.array([row.discharged_mass for row in rows]), np.array([row.time for row in rows])
        first = int(np.searchsorted(mass, STEADY[0] * mass[-1]))
        last = len(rows) - 1 if self.inlet is not None else int(np.searchsorted(mass, STEADY[1] * mass[-1]))
        if last - first < BLOCKS:
            return np.nan, np.nan, np.nan
        edges = np.linspace(first, last, BLOCKS + 1).round().astype(int)
        blocks = np.diff(mass[edges]) / np.diff(time[edges])
        span = time[last] - time[first]
        error = float(blocks.std(ddof=1) / np.sqrt(BLOCKS))
        return float((mass[last] - mass[first]) / span), error, float((out[last] - out[first]) / span)

    def _bulk_density(self) -> float:
        """Return mass over volume [ρ] between a fifth and four fifths of the bed's height, NaN where no grain is."""
        heights = self.scene.poses()[0][:, self.scene.up] - self.outlet.floor
        low, high = (share * float(heights.max()) for share in LAYER)
        mass = float(self.masses[(heights >= low) & (heights < high)].sum())
        return mass / self.outlet.volume(low, high) if mass > 0 else float("nan")
