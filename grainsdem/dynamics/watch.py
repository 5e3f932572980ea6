"""What is wrong with a run, told before it is believed: warnings, NaN, gained energy, escaped grains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import name_offenders

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics import Sample
    from grainsdem.dynamics.scene import Scene

ENERGY_SLACK = 1e-3
"""Energy [m g d a grain] that may seem to be gained at rest: soft contacts give back what they stored."""

STORED_SHARE = 0.1
"""Share of the kinetic energy that contacts may hold for a moment during impacts; the energy of a `Sample` lacks it."""

ESCAPE_DISTANCE = 1.0
"""A grain's centroid farther than this many diameters outside the container has escaped."""


class TroubleError(Exception):
    """What is wrong with a state; the run that meets it goes back to the last good one."""


def refuse_broken(scene: Scene) -> None:
    """Raise `TroubleError` where the state holds numbers that are not finite, or the engine complains."""
    troubles = [scene.engine.complaint()]
    positions, quaternions = scene.poses()
    bad = np.flatnonzero(~(np.isfinite(positions).all(axis=1) & np.isfinite(quaternions).all(axis=1)))
    if bad.size or not np.isfinite(scene.state()).all():
        troubles.append(f"numbers that are not finite, grains {name_offenders(bad) or 'unknown'}")
    if any(troubles):
        raise TroubleError("; ".join(filter(None, troubles)))


def find_trouble(scene: Scene, now: Sample, before: Sample, lowest: float) -> None:
    """Raise `TroubleError` where something is wrong with the present state.

    Parameters
    ----------
    scene : Scene
        The state to look at.
    now, before : Sample
        The present sample and the last good one.
    lowest : float
        Lowest total energy of all good samples [m g d a grain]: with walls at rest it cannot rise.
    """
    refuse_broken(scene)
    if not np.isfinite(now.total_energy):
        raise TroubleError("an energy that is not finite")
    if now.total_energy > lowest + ENERGY_SLACK + STORED_SHARE * before.kinetic_energy:
        fastest = int(np.argmax(np.linalg.norm(scene.engine.motion().velocities, axis=1)))
        raise TroubleError(
            f"energy rose from {lowest:.4g} to {now.total_energy:.4g} m g d a grain, grain {fastest} the fastest"
        )
    escaped = np.flatnonzero(distance_outside(scene) > ESCAPE_DISTANCE)
    if escaped.size:
        raise TroubleError(f"{escaped.size} grains left the container: {name_offenders(escaped)}")


def stored_energy(scene: Scene) -> float:
    """Return what contacts hold and may give back, in the mean of the grains [m g d]: the work of springs, f δ/2."""
    told = scene.engine.last_contacts()
    pressing = np.abs(np.einsum("ij,ij->i", told.forces, told.normals))
    return float(0.5 * (pressing * np.maximum(-told.gaps, 0.0)).sum() / scene.engine.masses.sum())


def distance_outside(scene: Scene) -> NDArray[np.float64]:
    """Return how far each centroid lies outside the floor and the side walls, in diameters, shape (n,)."""
    positions, _ = scene.poses()
    domain = scene.source.domain.scaled(1 / scene.units.length)
    upper = domain.upper.copy()
    upper[scene.up] = np.inf  # there is no lid
    distances: NDArray[np.float64] = np.maximum(domain.lower - positions, positions - upper).max(axis=1)
    for plane in domain.planes:
        distances = np.maximum(distances, positions @ plane[:3] - plane[3])
    return distances
