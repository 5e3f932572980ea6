"""Collapse: walls are taken away from a bed at rest, which runs out until it is at rest again."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.resting import Resting, pour
from grainsdem.dynamics.experiments.rig import RunReport, assemble
from grainsdem.dynamics.experiments.shared import Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import options_of
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.dynamics.mechanics.slopes import Slope, directions, run_out, surface
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

    Floats = NDArray[np.float64]


LOG = logging.getLogger(__name__)

LEAST_BINS = 8
"""Bins of the flank below which is warned. Slopes cut at 20 to 40° with eight or more were found 0.1° too steep in the
mean, with a standard deviation of 1.2°; those with fewer 0.5° and 1.7°."""

ONE_HEAP = (
    "A single run is one heap, and the error of its fit is not that of the angle of repose: heaps of the same grains "
    "differ by 5 to 10°. `grainsdem ensemble collapse BED` gives the mean of five and its 95 % interval."
)


class CollapseSample(NamedTuple):
    """One look at a collapse; lengths in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 between the walls, 1 without.
    kinetic_energy : float
        Mean of the grains that touch another one [m g d].
    height : float
        Highest point of the bed above the floor [d].
    run_out : float
        Distance [d] within which 95 % of the mass are, from the middle of the bed or from the wall that stays behind.
    """

    time: float
    stage: float
    kinetic_energy: float
    height: float
    run_out: float


@dataclass(frozen=True, slots=True)
class CollapseReport(RunReport):
    """What a collapse left.

    Parameters
    ----------
    repose_angle : float
        Slope of the surface [rad]; NaN where fewer than three points of the profile lie on it.
    repose_angle_fit_error : float
        Standard error of the line that was fitted to this one heap [rad]. Heaps of the same grains differ by more: the
        interval over several of them, `ensemble`, is that of the angle.
    n_bins : int
        Points of the profile, one d apart, that lie on the flank; below eight the angle is warned of.
    initial_height, final_height : float
        Highest point above the floor [m].
    initial_run_out, final_run_out : float
        Distance [m] within which 95 % of the mass are, from the middle or from the wall that stays behind the bed.
    relative_run_out : float
        Change of that distance over the initial one.
    at_rest : bool
        Whether the heap was at rest at the end: else its slope is no angle of repose.
    is_settled : bool
        Whether the bed was at rest when the walls were taken away.
    """

    repose_angle: float
    repose_angle_fit_error: float
    n_bins: int
    initial_height: float
    final_height: float
    initial_run_out: float
    final_run_out: float
    relative_run_out: float
    at_rest: bool
    is_settled: bool


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return height and run-out over time, and the surface that is left."""
    lengths = {name.replace("_", "-"): (series["time"], series[name]) for name in ("height", "run_out")}
    return [
        Panel("time  [s]", "length  [m]", lengths),
        Panel("distance  [m]", "height of the surface  [m]", {}, {"": (profile["distance"], profile["height"])}),
    ]


@experiment(panels=_panels, caution=ONE_HEAP)
def collapse(
    packing: Packing,
    *,
    release: Annotated[
        Sequence[str] | None,
        option("Walls to take away, such as wall_x1 for a slope towards +x; all by default.", min_length=1),
    ] = None,
    friction: Friction = None,
    wall_friction: WallFriction = None,
    gravity: Gravity = 9.81,
    max_time: Annotated[float, option("Time limit after the release.", "√(d/g)", gt=0)] = 100.0,
    **run: Unpack[Run],
) -> _Collapse:
    """Take walls away from a bed and let it run out to rest: angle of repose, run-out.

    Parameters
    ----------
    packing : Packing
        The bed, in a box; `settle` it first, or give ``rng``. A heap of spheres that roll may not come to rest.

    Returns
    -------
    Outcome
        Packing, history, `CollapseReport`, snapshot, and the ``profile`` of the surface: ``distance`` and ``height``
        [m].

    Raises
    ------
    InputError
        If an option is out of range, there is no such wall, or the packing is periodic or overlaps.

    Notes
    -----
    The bed is at rest where, at five samples 0.2 √(d/g) apart, the mean kinetic energy of the grains that touch
    another one is below 1e-5 m g d. The surface is found in bins one d wide of the distance from the middle (from the
    wall behind the bed where that stays): each bin is cut across into pieces about two d long, the highest point of the
    grains in each is taken, the floor where there are none, and the mean over the pieces is the height. The angle of
    repose is that of the least-squares line through the bins from the last one above 80 % to the first one below 20 %
    of the greatest height: neither crest nor toe.

    The angle of repose of a material is the mean over heaps: ``gd.ensemble(gd.collapse, bed, seeds=5)`` gives it with
    its 95 % interval. The error in the report is that of one line through one heap.
    """
    options = options_of(run, friction=friction, wall_friction=wall_friction, gravity=gravity)
    scene = assemble(pour(packing, run), options, spheres=run["spheres"])
    walls = _walls(scene)
    chosen = walls if release is None else list(release)
    unknown = [name for name in chosen if name not in walls]
    if unknown or not chosen:
        raise InputError(f"release must name some of {', '.join(walls)}; got {', '.join(chosen) or 'none'}")
    return _Collapse(scene, options, chosen, max_time)


class _Collapse(Resting[CollapseReport]):
    """A bed that comes to rest between its walls, and then without."""

    columns: ClassVar[Mapping[str, str]] = {
        "time": "s",
        "stage": "0 between walls, 1 without",
        "kinetic_energy": "m g d",
        "height": "m",
        "run_out": "m",
    }

    def __init__(self, scene: Scene, options: MjcfOptions, release: list[str], max_time: float) -> None:
        super().__init__(scene, max_time)
        self.options, self.release = options, release
        self._origin = _origin(scene.source, self.release, _walls(scene))

    def act(self) -> None:
        """Take the walls away."""
        for wall in self.release:
            self.scene.engine.remove(wall)

    def mark(self, now: CollapseSample) -> dict[str, Any]:
        """Return the size of the bed before its collapse."""
        return {"height": now.height, "run_out": now.run_out}

    def measure(self) -> CollapseSample:
        """Return the present sample."""
        now = snapshot(self.scene)
        height, distance = run_out(now.packing, self._origin)
        scale = self.scene.units.length
        return CollapseSample(
            time=self.scene.engine.time,
            stage=float(self.begun is not None),
            kinetic_energy=self.touching_energy(now),
            height=height / scale,
            run_out=distance / scale,
        )

    def is_over(self) -> bool:
        """Return whether the heap is at rest, or time is up."""
        return self.begun is not None and (self.is_at_rest() or self.since() >= self.max_time)

    def words(self, now: CollapseSample) -> str:
        """Return a few words on a sample after the release."""
        return f"{now.kinetic_energy:.0e} m g d, height {now.height:.1f} d, run-out {now.run_out:.1f} d"

    def slope(self) -> Slope:
        """Return the surface of the heap."""
        return surface(snapshot(self.scene), self._origin, width=self.scene.units.length)

    def profile(self) -> dict[str, Floats]:
        """Return the surface that is left."""
        found = self.slope()
        return {"distance": found.distances, "height": found.heights}

    def remarks(self) -> dict[str, Any]:
        """Return the walls that were taken away, and how the heap came to rest."""
        return {"release": self.release, **self.scene.rest(self.options)}

    def report(self) -> CollapseReport:
        """Return what the collapse left."""
        found = self.slope()
        if found.n_bins < LEAST_BINS:
            LOG.warning(
                "the flank of the heap is %d bins of a diameter long, and below %d its angle is uncertain by some "
                "degrees: take more grains",
                found.n_bins,
                LEAST_BINS,
            )
        begun = self.begun or {"height": np.nan, "run_out": np.nan, "is_at_rest": False}
        last, scale = self.samples[-1], self.scene.units.length
        return CollapseReport(
            repose_angle=found.angle,
            repose_angle_fit_error=found.error,
            n_bins=found.n_bins,
            initial_height=begun["height"] * scale,
            final_height=last.height * scale,
            initial_run_out=begun["run_out"] * scale,
            final_run_out=last.run_out * scale,
            relative_run_out=last.run_out / begun["run_out"] - 1,
            at_rest=self.is_at_rest(),
            is_settled=begun["is_at_rest"],
            **self.cost(),
        )


def _walls(scene: Scene) -> list[str]:
    """Return the names of the walls of the container; in planar work the lower y wall is the floor."""
    floor = "wall_y0" if scene.source.domain.is_planar else "floor"
    return [name for name in scene.engine.parts if name.startswith("wall") and name != floor]


def _origin(packing: Packing, release: list[str], walls: list[str]) -> dict[int, tuple[float, float]]:
    """Return, for each level axis along which the bed runs out, where from [m] and which way: −1, 1, or 0 for both."""
    _, level = directions(packing)
    lower, upper = packing.domain.lower, packing.domain.upper
    if set(release) == set(walls) or any(name.startswith("wall_p") for name in release):
        return {axis: (0.5 * float(lower[axis] + upper[axis]), 0.0) for axis in level}
    origin = {}
    for axis in level:
        low, high = (f"wall_{'xy'[axis]}{side}" in release for side in (0, 1))
        if low and high:
            origin[axis] = 0.5 * float(lower[axis] + upper[axis]), 0.0
        elif high:
            origin[axis] = float(lower[axis]), 1.0
        elif low:
            origin[axis] = float(upper[axis]), -1.0
    return origin
