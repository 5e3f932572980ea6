"""Loading tests: a bed is compressed until it is at rest, then sheared to a strain, and judged while it is."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.dynamics.experiments.rig import Report, RunReport, Trial
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.dynamics.watch import TroubleError
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.panels import Panel, smoothed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.cells.meter import Meter
    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene

LOG = logging.getLogger(__name__)

RUNAWAY_GATHERED = 10.0
"""The same while walls of 2 d/t gather grains: it is 1.3 at most in beds without friction."""

RUNAWAY_SHEARED = 0.5
"""The same in a bed that is sheared, besides what is imposed: 1e-3 is usual, and 3e-3 the most, at I = 0.02."""

REST_PRESSURE = 0.03
"""How near one every pressure must be for a bed to count as compressed."""

REST_ENERGY = 1e-4
"""Mean kinetic energy of a grain [P d³] below which it does: flickering contacts leave 1e-5."""

REST_SAMPLES = 5
"""How many samples in a row must be so."""

GATHERED = 0.01, 10
"""How little, relative to itself, the solid fraction of grains that have been gathered changes, in how many samples."""

DRAG = 0.5
"""Rate [1/t] at which grains lose their velocity from then on until they are sheared: without gravity nothing else
stops rattlers and spheres that roll."""

COMPRESSION_LIMIT = 60.0
"""Time [t] from then on after which a bed is sheared although it has not come to rest."""

RAMP_TIME = 1.0
"""Time [t] in which driven parts get up to speed."""

N_SAMPLES = 200
"""Samples of a shearing run, or fewer where they would be closer than the loop's own."""

STEPS_PER_PROBE = 4
"""Steps between looks at the contacts of a sheared bed, whose stresses are averaged over a sample as those of walls."""

COMPRESSION_TIME = 20.0
"""Time [t] in which beds are compressed, most often, by which a run is estimated."""

VOID_TIME = 3.0
"""Time [t] of the shear that is averaged before a test is judged, in five samples at least: forces fluctuate, and of 27
grains the pressure was off by a fifth for 1 t in 2 of 20 runs."""

VOID_SAMPLES = 5
"""Those samples."""

HELD = 0.2
"""How far from one, on average, a pressure may be that is held."""

FEWEST = 5
"""Grains from which a bed has a porosity to be judged by: two blocks that slide on each other have none."""

LEAST_RATIO = 5.0
"""Least side of a sample over its largest grain below which is warned; standards of soil testing ask for six to ten."""

SMALLEST_RATIO = 3.0
"""The same below which a test is none."""

POROSITIES = (0.3, 0.8), (0.05, 0.6)
"""Porosities between which a sheared bed is one, in space and in a plane: a jigsaw lies below, and above grains fly."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadingReport(RunReport):
    """What the report of every loading test has besides.

    Parameters
    ----------
    inertial_number : float
        Rate of strain times d √(ρ/σ).
    size_ratio : float
        Least side of the sample, before or after the shear, over the diameter of its largest grain. Below five, walls
        and single grains rule what is measured.
    is_compressed : bool
        Whether the bed was at rest when shear began.
    is_valid : bool
        Whether the test is one: the bed was compressed; while it was sheared the pressure was held within a fifth, the
        void stayed between 0.3 and 0.8 and nothing else left its bounds, or else the shear ended there; and the sample
        was three of its largest grains across.
    reason : str
        Why it is none; empty where it is.
    """

    inertial_number: float
    size_ratio: float
    is_compressed: bool
    is_valid: bool
    reason: str


class Shear(NamedTuple):
    """How a bed is sheared.

    Parameters
    ----------
    strain : float
        To go to.
    rate : float
        Inertial number.
    compaction_friction : float or None
        Coefficient of friction among grains while the bed is compressed, where that is another than afterwards.
    """

    strain: float
    rate: float
    compaction_friction: float | None


class Staged(Trial[Report]):
    """A run in two stages: the bed is compressed until it is at rest, then sheared to a strain.

    Parameters
    ----------
    scene, meter
        As in `Trial`.
    shear : Shear
        How.
    """

    def __init__(self, scene: Scene, meter: Meter, shear: Shear) -> None:
        super().__init__(scene, meter)
        self.strain, self.rate = shear.strain, shear.rate
        self._compaction_friction = shear.compaction_friction
        self.gathered: float | None = None
        """When [t] the grains had been gathered."""
        self.begun: dict[str, Any] | None = None
        """What is remembered of the moment when shear began."""
        self.void = ""
        """Why the test is none, and was ended."""
        self._probes: list[tuple[float, ...]] = []
        self._n_probed = 0
        self._enter_stage()

    def mark(self) -> dict[str, Any]:
        """Return what to remember of the present state when shear begins, as JSON values."""
        raise NotImplementedError

    def inner(self, now: Snapshot) -> tuple[float, ...]:
        """Return the stresses [P] that the contacts bear at one instant."""
        raise NotImplementedError

    def probe(self) -> None:
        """Look at the contacts of the last step, now and then; called before each step of the shear."""
        self._n_probed += 1
        if self._n_probed % STEPS_PER_PROBE == 0:
            self._probes.append(self.inner(snapshot(self.scene, converged=False)))

    def mean_inner(self, now: Snapshot) -> NDArray[np.float64]:
        """Return the mean of the looks since the last sample, or the present stresses where there were none."""
        found = np.mean(self._probes, axis=0) if self._probes else np.array(self.inner(now))
        self._forget_probes()
        return np.asarray(found)

    def strain_of(self, row: Any) -> float:
        """Return the strain of a sample."""
        raise NotImplementedError

    def pressures_of(self, row: Any) -> tuple[float, ...]:
        """Return what must be one in a sample of a compressed bed."""
        raise NotImplementedError

    def held(self, row: Any) -> float:
        """Return the pressure that is held at one while the bed is sheared."""
        raise NotImplementedError

    def lately(self) -> list[Any]:
        """Return the samples of the shear that it is judged by now; none before there are enough."""
        rows = self.sheared()
        first = next((k for k, row in enumerate(rows) if row.time > rows[-1].time - VOID_TIME - 1e-9), 0)
        chosen = rows[min(first, len(rows) - VOID_SAMPLES) :] if len(rows) >= VOID_SAMPLES else []
        return chosen if chosen and rows[-1].time - rows[0].time >= VOID_TIME - 1e-9 else []

    def fault(self) -> str:
        """Return why the last samples of the shear are of no test; nothing where they are."""
        rows = self.lately()
        if not rows:
            return ""
        held = float(np.mean([self.held(row) for row in rows]))
        porosity = 1.0 - float(np.mean([row.solid_fraction for row in rows]))
        where = f"at a strain of {self.strain_of(rows[-1]):.3g}"
        if abs(held - 1.0) > HELD:
            return f"the pressure was {held:.2f} of what it was to be held at, {where}"
        least, most = POROSITIES[self.scene.source.domain.is_planar]
        if self.scene.n_grains >= FEWEST and not least <= porosity <= most:
            return f"the porosity was {porosity:.2f}, {where}"
        return ""

    def sides(self) -> NDArray[np.float64]:
        """Return the present sides [d] of the sample."""
        raise NotImplementedError

    def largest(self) -> float:
        """Return the diameter [d] of the largest grain."""
        return float(grain_diameters(self.scene.source.grains).max()) / self.scene.units.length

    def size_ratio(self) -> float:
        """Return the least side of the sample so far over the diameter of its largest grain."""
        least = float(self.sides().min())
        return min(least, self.begun["least_side"] if self.begun else least) / self.largest()

    def standing(self) -> dict[str, Any]:
        """Return what a `LoadingReport` has besides what was measured."""
        is_compressed, size_ratio = bool(self.begun and self.begun["is_at_rest"]), self.size_ratio()
        reason = self.void
        if not reason and not is_compressed:
            reason = "the bed was not at rest when shear began"
        elif not reason and size_ratio < SMALLEST_RATIO:
            reason = f"the sample was only {size_ratio:.1f} of its largest grains across"
        return {
            "inertial_number": self.rate,
            "size_ratio": size_ratio,
            "is_compressed": is_compressed,
            "is_valid": not reason,
            "reason": reason,
            **self.cost(),
        }

    def check(self, now: Any) -> None:
        """Raise `TroubleError` where something is wrong with the present state."""
        super().check(now)
        imposed = self.rate * float(self.sides().max())
        limit = RUNAWAY_GATHERED if self.begun is None else RUNAWAY_SHEARED + imposed**2
        if now.kinetic_energy > limit:
            raise TroubleError(
                f"a mean kinetic energy of {now.kinetic_energy:.3g} P d³ a grain; {limit:.3g} is too much"
            )

    def words(self, row: Any) -> str:
        """Return a few words on a sample of the shear."""
        raise NotImplementedError

    def duration(self) -> float:
        """Return how long [t] the shear takes."""
        return float(self.strain / self.rate)

    def expected_time(self) -> float:
        """Return about how long [t] the run will last."""
        return COMPRESSION_TIME + self.duration()

    def ramp(self) -> float:
        """Return the share of its speed that a driven part has, 0 before shear begins."""
        return min(1.0, (self.scene.engine.time - self.begun["time"]) / RAMP_TIME) if self.begun else 0.0

    def sheared(self) -> list[Any]:
        """Return the samples of the shear."""
        return [row for row in self.samples if row.stage == 1.0]

    def is_over(self) -> bool:
        """Return whether the strain is reached, or the test is void."""
        return bool(self.void) or (self.begun is not None and self.strain_of(self.samples[-1]) >= self.strain)

    def keep(self, now: Any) -> None:
        """Begin to shear once the bed is compressed, and tell how far the run is."""
        if self.begun is not None:
            self.tell(self.strain_of(now) / self.strain, self.words(now))
            self.void = self.fault()
            return
        self.tell(0.0, f"compressing: solid fraction {now.solid_fraction:.3f}, {now.kinetic_energy:.0e} P d³")
        if self.gathered is None:
            change, n = GATHERED
            if len(self.samples) > n and abs(self.samples[-n].solid_fraction / now.solid_fraction - 1) < change:
                self.gathered = now.time
                self._enter_stage()
            return
        is_at_rest = all(map(self._is_at_rest, self.samples[-REST_SAMPLES:]))
        if is_at_rest or now.time > self.gathered + COMPRESSION_LIMIT:
            least_side = float(self.sides().min())
            self.begun = {"time": now.time, "is_at_rest": bool(is_at_rest), "least_side": least_side, **self.mark()}
            if (ratio := self.size_ratio()) < LEAST_RATIO:
                LOG.warning(
                    "the sample is only %.1f of its largest grains across: below %g, walls and single grains rule what "
                    "it bears; take more grains",
                    ratio,
                    LEAST_RATIO,
                )
            self.sample_time = max(self.sample_time, self.duration() / N_SAMPLES)
            self._enter_stage()

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {
            **super().memory(),
            "gathered": self.gathered,
            "begun": self.begun,
            "sample_time": self.sample_time,
            "void": self.void,
        }

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self.gathered, self.begun = memory["gathered"], memory["begun"]
        self.sample_time, self.void = memory["sample_time"], memory["void"]
        self._forget_probes()
        self._enter_stage()

    def _forget_probes(self) -> None:
        """Begin a mean of the contacts' stresses anew."""
        self._probes.clear()
        self._n_probed = 0

    def _is_at_rest(self, row: Any) -> bool:
        """Return whether a bed is compressed: its apparatus bears the pressure, and grains hardly move."""
        near = all(abs(pressure - 1) < REST_PRESSURE for pressure in self.pressures_of(row))
        return near and row.kinetic_energy < REST_ENERGY

    def _enter_stage(self) -> None:
        """Give the grains the friction and the drag of the present stage."""
        self.scene.engine.set_friction(None if self.begun else self._compaction_friction)
        self.scene.engine.set_drag(DRAG if self.gathered is not None and self.begun is None else 0.0)


def shear_panels(series: Series, strain: str, label: str, part: str) -> list[Panel]:
    """Return curves of τ/σ and dilation over a strain; ``part`` is what the stresses of the walls are those of."""
    ratios = {
        who: (
            smoothed(series[strain]),
            smoothed(series[f"shear_stress{end}"]) / smoothed(series[f"normal_stress{end}"]),
        )
        for who, end in ((part, ""), ("contacts", "_contacts"))
    }
    return [
        Panel(label, "τ / σ", ratios),
        Panel(label, "volumetric strain (dilation)", {"": (series[strain], series["volumetric_strain"])}),
    ]


def columns_of(names: tuple[str, ...]) -> dict[str, str]:
    """Return the units in which the columns of a loading test are stored."""
    units = {"time": "s", "stage": "0 compression, 1 shear", "kinetic_energy": "P d3"}
    return {name: units.get(name, "Pa" if "_stress" in name else "1") for name in names}


def smooth(values: NDArray[np.float64], span: int) -> NDArray[np.float64]:
    """Return the running mean over ``span`` samples, shape (n − span + 1,); of all of them where there are fewer."""
    span = max(1, min(span, len(values)))
    return np.convolve(values, np.full(span, 1.0 / span), mode="valid")


def highest(values: NDArray[np.float64], strains: NDArray[np.float64], width: float) -> tuple[int, int]:
    """Return how many samples a width of strain spans, and where their running mean is highest."""
    span = max(1, min(len(values), round(width / float(strains[-1]) * len(values))))
    return span, int(np.argmax(smooth(values, span)))


def crossing(heights: NDArray[np.float64], values: NDArray[np.float64], level: float) -> float:
    """Return the height above which a profile stays over a level, between the layers; NaN where it never does."""
    below = np.flatnonzero(values < level)
    if not below.size or below[-1] == len(values) - 1:
        return float("nan")
    k = below[-1]
    share = (level - values[k]) / (values[k + 1] - values[k])
    return float(heights[k] + share * (heights[k + 1] - heights[k]))
