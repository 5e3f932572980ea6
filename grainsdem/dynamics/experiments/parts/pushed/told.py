"""What is told of a body in a bed: samples, the report, and the curves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.dynamics.experiments.rig import RunReport
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from typing import Any

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series

    Floats = NDArray[np.float64]

LAST = 4
"""Samples at the end whose forces are averaged: the first of five at rest tells of the time before it, too."""


class PenetrationSample(NamedTuple):
    """One look at a body in a bed, in grain units; forces are means since the sample before.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 until the bed is at rest, then 1.
    kinetic_energy : float
        Mean of the grains that touch another one [m g d].
    depth : float
        Of the body's lowest point below the highest grain in its way, before it came [d]; 0 in the first stage.
    speed : float
        Downward [d/t].
    force_x, force_y, force_z : float
        What the bed exerts on the body [m g].
    torque : float
        What turns a wheel against the bed [m g d].
    travel : float
        How far a wheel has come [d].
    work : float
        Work that the body has done on the bed [m g d].
    bed_energy : float
        Kinetic and potential energy that the grains have gained since the second stage began [m g d].
    overlap : float
        Deepest overlap of two grains, or of a grain and anything else [d].
    """

    time: float
    stage: float
    kinetic_energy: float
    depth: float
    speed: float
    force_x: float
    force_y: float
    force_z: float
    torque: float
    travel: float
    work: float
    bed_energy: float
    overlap: float


UNITS = {
    "time": "s",
    "stage": "0 coming to rest, 1 with the body",
    "kinetic_energy": "m g d",
    "depth": "m",
    "speed": "m/s",
    "force_x": "N",
    "force_y": "N",
    "force_z": "N",
    "torque": "N m",
    "travel": "m",
    "work": "J",
    "bed_energy": "J",
    "overlap": "d",
}


@dataclass(frozen=True, slots=True)
class PenetrationReport(RunReport):
    """What a bed did to a body.

    Parameters
    ----------
    largest_force, final_force : float
        Largest upward force on it, and the mean over the last 0.8 √(d/g) [N].
    final_depth : float
        Of its lowest point below the highest grain in its way, before it came [m].
    force_along_x, force_along_y : float
        Mean level forces [N]; in planar work the second is the upward one. Zero by symmetry but for a wheel's along x.
    stiffness, stiffness_error : float
        Slope of force over depth from the first touch on, and its standard error [N/m], where it is pressed.
    exponent : float
        Slope of the logarithms of both: 1 where force rises with depth, 3 for an ideal cone.
    work, dissipated : float
        Work that it did on the bed, and that less what the grains gained of it [J].
    slip, sinkage, drawbar_pull, torque : float
        Of a wheel, means over the second half of its way: slip, depth [m], what the bed pushes it forward with [N], and
        what turns it [N m].
    wall_distance, floor_distance : float
        From the body to the nearest wall beside it, and at last to the floor [m].
    largest_overlap : float
        Deepest overlap while the body was in the bed [d].
    at_rest : bool
        Whether body and bed were at rest at the end.
    is_settled : bool
        Whether the bed was at rest before the body came.
    is_valid : bool
        Whether it was, walls and floor were a width of the body away, nothing overlapped by more than 0.05 d, and no
        jam threw grains where the body is pressed or rolls.
    reason : str
        Why not.
    """

    largest_force: float
    final_force: float
    final_depth: float
    force_along_x: float
    force_along_y: float
    stiffness: float
    stiffness_error: float
    exponent: float
    work: float
    dissipated: float
    slip: float
    sinkage: float
    drawbar_pull: float
    torque: float
    wall_distance: float
    floor_distance: float
    largest_overlap: float
    at_rest: bool
    is_settled: bool
    is_valid: bool
    reason: str


def line_through(x: Floats, y: Floats) -> tuple[float, float]:
    """Return slope and its standard error of the least-squares line; NaN of fewer than three points.

    Examples
    --------
    >>> line_through(np.array([0.0, 1.0, 2.0]), np.array([1.0, 3.0, 5.0]))
    (2.0, 0.0)
    """
    if len(x) < 3 or np.ptp(x) == 0:
        return float("nan"), float("nan")
    slope, level = np.polyfit(x, y, 1)
    left = y - slope * x - level
    spread = np.sqrt(left @ left / (len(x) - 2) / np.sum((x - x.mean()) ** 2))
    return round(float(slope), 12) if abs(slope) > 1e-6 else float(slope), float(spread) if spread > 1e-12 else 0.0


def summed(rows: Sequence[Any], mode: str, up: int) -> dict[str, Any]:
    """Return what the samples of the second stage say, in the units of the samples."""
    series = {name: np.array([getattr(row, name) for row in rows]) for name in PenetrationSample._fields}
    found = dict.fromkeys(("stiffness", "stiffness_error", "exponent", "sinkage", "drawbar_pull", "torque"), np.nan)
    lift = series["force_y" if up == 1 else "force_z"]
    touched = np.flatnonzero(lift > 0)
    if mode == "press" and touched.size:
        depth, force = series["depth"][touched[0] :], lift[touched[0] :]
        found["stiffness"], found["stiffness_error"] = line_through(depth, force)
        inside = (depth > 0) & (force > 0)
        found["exponent"], _ = line_through(np.log(depth[inside]), np.log(force[inside]))
    if mode == "roll" and len(rows):
        late = series["travel"] >= 0.5 * series["travel"][-1]
        for name, column in (("sinkage", "depth"), ("drawbar_pull", "force_x"), ("torque", "torque")):
            found[name] = float(series[column][late].mean())
    last = rows[-1] if rows else None
    return {
        "largest_force": float(lift.max()) if rows else np.nan,
        "final_force": float(lift[-LAST:].mean()) if rows else np.nan,
        "final_depth": last.depth if last else np.nan,
        "force_along_x": float(series["force_x"].mean()) if rows else np.nan,
        "force_along_y": float(series["force_y"].mean()) if rows else np.nan,
        "work": last.work if last else np.nan,
        "largest_overlap": float(series["overlap"].max()) if rows else np.nan,
        "dissipated": last.work - last.bed_energy if last else np.nan,
        **found,
    }


def panels_of(series: Series, profile: Mapping[str, Floats]) -> list[Panel]:
    """Return force over depth, or, of a wheel, forces and sinkage over its way."""
    del profile
    names = {"upward": "force_z", "along x": "force_x", "along y": "force_y"}
    forces = {label: series[name] for label, name in names.items()}
    if np.ptp(series["travel"]) > 0:
        way = series["travel"]
        return [
            Panel("travel  [m]", "force on the wheel  [N]", {label: (way, force) for label, force in forces.items()}),
            Panel("travel  [m]", "depth  [m]", {"": (way, series["depth"])}),
        ]
    return [
        Panel("depth  [m]", "force on the body  [N]", {k: (series["depth"], force) for k, force in forces.items()}),
        Panel("time  [s]", "depth  [m]", {"": (series["time"], series["depth"])}),
    ]
