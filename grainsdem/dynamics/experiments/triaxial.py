"""Triaxial compression: six smooth walls, four that hold a pressure and two that close in on the grains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np

from exporters.mjcf import MjcfOptions, units
from grainsdem.dynamics.experiments.cells import SixWalls
from grainsdem.dynamics.experiments.cells.meter import LIMIT_SPEED
from grainsdem.dynamics.experiments.rig import (
    JsonReport,
    Outcome,
    Staged,
    assemble,
    check_frictions,
    check_ranges,
    columns_of,
    highest,
    pressure_gravity,
    smooth,
)
from grainsdem.dynamics.experiments.start import set_apart_in_block
from grainsdem.dynamics.loop import Record
from grainsdem.dynamics.mechanics import coordination, friction_angle, sliding_fraction, snapshot, stress
from grainsdem.dynamics.mechanics.slopes import directions
from grainsdem.dynamics.starting import as_spheres
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Tell
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PEAK_SPAN = 0.05
"""Axial strain over which stresses are averaged before their peak is looked for."""

CRITICAL_SHARE = 0.25
"""Last part of the strain that is averaged for the critical state."""


class TriaxialSample(NamedTuple):
    """One look at a triaxial test, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while the bed is compressed, 1 while it is sheared.
    axial_strain : float
        Shortening over the height at the beginning of shear.
    volumetric_strain : float
        Change of volume over the volume at the beginning of shear, positive where the bed dilates.
    axial_stress, lateral_stress : float
        Mean pressure on the walls since the last sample [P].
    axial_stress_contacts, lateral_stress_contacts : float
        Love–Weber's stress: means over the same time during shear, before it with converged forces at the instant [P].
    solid_fraction : float
        Volume of the grains over that between the walls.
    coordination : float
        Mean number of grains that press on a grain.
    sliding_fraction : float
        Share of the contact points that slide.
    kinetic_energy : float
        Mean of a grain [P d³].
    """

    time: float
    stage: float
    axial_strain: float
    volumetric_strain: float
    axial_stress: float
    lateral_stress: float
    axial_stress_contacts: float
    lateral_stress_contacts: float
    solid_fraction: float
    coordination: float
    sliding_fraction: float
    kinetic_energy: float


@dataclass(frozen=True, slots=True)
class TriaxialReport(JsonReport):
    """What a triaxial test measured.

    Parameters
    ----------
    peak_friction_angle, critical_friction_angle : float
        asin((σ1 − σ3)/(σ1 + σ3)) [rad]: the highest of the means over 0.05 of axial strain, and the mean over the last
        quarter of the strain.
    peak_strain : float
        Axial strain at the peak.
    volumetric_strain : float
        At the end, positive where the bed has dilated.
    dilatancy_angle : float
        Steepest slope of the volumetric strain over 0.05 of axial strain, as asin(s/(2 + s)) [rad]; NaN where the run
        was shorter.
    initial_solid_fraction, final_solid_fraction : float
        When shear began, and at the end.
    stress_mismatch : float
        Difference of the axial stress of the walls and that of the contacts, both averaged over the shear, relative.
    confining_pressure : float
        Pressure on the side walls [Pa], mean over the shear.
    inertial_number : float
        ε̇ d √(ρ/σ3).
    is_compressed : bool
        Whether the bed was at rest when shear began.
    time : float
        Simulated time [s].
    n_steps, halvings : int
        Steps taken, and how often the time step was halved to keep the run stable.
    """

    peak_friction_angle: float
    critical_friction_angle: float
    peak_strain: float
    volumetric_strain: float
    dilatancy_angle: float
    initial_solid_fraction: float
    final_solid_fraction: float
    stress_mismatch: float
    confining_pressure: float
    inertial_number: float
    is_compressed: bool
    time: float
    n_steps: int
    halvings: int


def triaxial(
    packing: Packing,
    *,
    confining_pressure: float = 1e5,
    strain: float = 0.4,
    inertial_number: float = 1e-2,
    friction: float = 0.5,
    compaction_friction: float | None = None,
    rng: np.random.Generator | int | None = None,
    spheres: bool = False,
    time_step: float = 0.01,
    history_path: str | os.PathLike[str] | None = None,
    resume: bool = False,
    progress: Tell | None = None,
) -> Outcome[TriaxialReport]:
    """Compress a bed by six smooth walls, then shorten it along its height while the side walls hold the pressure.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap. In planar work there are four walls and the height is along y: a biaxial test.
    confining_pressure : float
        σ3 [Pa].
    strain : float
        Axial strain to go to, the shortening over the height.
    inertial_number : float
        ε̇ d √(ρ/σ3); below 1e-3 loading is quasi-static, and 1e-2 raises the angles by a degree or so.
    friction : float
        Coefficient of friction among grains; the walls are smooth.
    compaction_friction : float, optional
        The same while the bed is compressed: less makes a denser bed. As in shear by default.
    rng : numpy.random.Generator, int or None
        Where given, grains are first turned at random, reordered and set apart on a lattice; it is the seed. Without
        it they start where they are, and cells left in place may lock like a jigsaw.
    spheres : bool
        Whether each grain is replaced by the sphere of equal volume.
    time_step : float
        Time step in units of d √(ρ/σ3).
    history_path : str or path-like, optional
        HDF5 file that the history is appended to while the run goes.
    resume : bool
        Whether to go on from the checkpoint of an interrupted run with that history.
    progress : callable, optional
        Called with the fraction done and a few words at every sample.

    Returns
    -------
    Outcome
        Packing, history, `TriaxialReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, or the packing is periodic or overlaps.
    UnstableError
        If the run goes wrong and three smaller time steps do not help.

    Notes
    -----
    The walls that hold a pressure are pushed with that pressure times the present area between the others; the
    two across the height are then driven at ε̇ times the present height. Stresses on walls are means over time from the
    momentum that they took.
    """
    check_ranges(confining_pressure=confining_pressure, strain=strain, inertial_number=inertial_number)
    check_ranges(time_step=time_step)
    check_frictions(friction=friction, compaction_friction=compaction_friction)
    if strain >= 0.9:
        raise InputError(f"strain must be below 0.9, the shortening over the height; got {strain}")
    grains = as_spheres(packing) if spheres else packing
    start = grains if rng is None else set_apart_in_block(grains, rng=rng)
    options = MjcfOptions(
        friction=friction,
        gravity=pressure_gravity(start, confining_pressure),
        time_step=time_step,
        walls="none",
    )
    scene, cell = _build(start, options, spheres=spheres)
    told = {
        "strain": strain,
        "inertial_number": inertial_number,
        "friction": friction,
        "compaction_friction": compaction_friction,
    }
    run = _Triaxial(scene, cell, Record(history_path, resume, told), progress, told)
    run.run()
    step = {"confining_pressure": confining_pressure, "time_step": time_step, "spheres": spheres, **told}
    return Outcome(
        run.packing().with_step("triaxial", **step),
        run.history(),
        run.report(),
        snapshot(scene),
        {},
    )


def _build(packing: Packing, options: MjcfOptions, *, spheres: bool) -> tuple[Scene, SixWalls]:
    """Return the scene and the walls around it."""
    cell = SixWalls(packing, units(packing, options.gravity), driven=directions(packing)[0])
    return assemble(packing, options, cell.furnish, spheres=spheres), cell


class _Triaxial(Staged):
    """Compression to rest, then shear."""

    experiment = "triaxial"
    columns: ClassVar[Mapping[str, str]] = columns_of(TriaxialSample._fields)

    def __init__(
        self, scene: Scene, cell: SixWalls, record: Record, tell: Tell | None, options: Mapping[str, Any]
    ) -> None:
        self.cell, self.axis = cell, scene.up
        self.lateral = tuple(axis for axis in cell.axes if axis != self.axis)
        self._volume = float(volumes(scene.source.grains).sum()) / scene.units.length**3
        super().__init__(scene, record, cell.meter(scene.engine), tell, options)

    def drive(self) -> None:
        """Push the walls, and drive two of them once the bed is compressed."""
        engine, cell = self.scene.engine, self.cell
        if self.begun is None:
            cell.hold(self.meter, engine, cell.axes, limit_speed=LIMIT_SPEED)
            return
        self.probe()
        cell.hold(self.meter, engine, self.lateral)
        height = float(cell.lengths(engine)[self.axis])
        for side in (0, 1):
            self.meter.drive(f"{'xyz'[self.axis]}{side}", -0.5 * self.rate * height * self.ramp())

    def measure(self) -> TriaxialSample:
        """Return the present sample."""
        engine, cell = self.scene.engine, self.cell
        lengths = cell.lengths(engine)
        pressures = cell.pressures(self.meter.read(), lengths)
        now, volume = snapshot(self.scene), float(np.prod(lengths))
        inner, lateral = self.mean_inner(now), list(self.lateral)
        first = lengths if self.begun is None else np.array(self.begun["lengths"])
        return TriaxialSample(
            time=engine.time,
            stage=float(self.begun is not None),
            axial_strain=1.0 - float(lengths[self.axis] / first[self.axis]),
            volumetric_strain=volume / float(np.prod(first)) - 1.0,
            axial_stress=float(pressures[self.axis]),
            lateral_stress=float(pressures[lateral].mean()),
            axial_stress_contacts=float(inner[self.axis]),
            lateral_stress_contacts=float(inner[lateral].mean()),
            solid_fraction=self._volume / volume,
            coordination=coordination(now),
            sliding_fraction=float(np.nan_to_num(sliding_fraction(now))),
            kinetic_energy=self.kinetic_energy(now),
        )

    def inner(self, now: Snapshot) -> tuple[float, ...]:
        """Return Love–Weber's normal stresses [P] across the three axes at one instant."""
        volume = float(np.prod(self.cell.lengths(self.scene.engine) * self.scene.units.length))
        return tuple((np.diag(stress(now, volume=volume)) / self.scene.units.stress).tolist())

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside the walls, shape (n,)."""
        positions, _ = self.scene.poses()
        lower, upper = self.cell.bounds(self.scene.engine)
        return np.asarray(np.maximum(lower - positions, positions - upper)[:, self.cell.axes].max(axis=1))

    def mark(self) -> dict[str, Any]:
        """Return the sides [d] of the sample as shear begins."""
        return {"lengths": self.cell.lengths(self.scene.engine).tolist()}

    def strain_of(self, row: TriaxialSample) -> float:
        """Return the axial strain."""
        return row.axial_strain

    def pressures_of(self, row: TriaxialSample) -> tuple[float, ...]:
        """Return the stresses that must be one in a compressed bed."""
        return row.axial_stress, row.lateral_stress, row.axial_stress_contacts, row.lateral_stress_contacts

    def words(self, row: TriaxialSample) -> str:
        """Return a few words on a sample of the shear."""
        angle = np.degrees(friction_angle([row.axial_stress, row.lateral_stress]))
        return f"strain {row.axial_strain:.3f}, {angle:.1f}°, {row.volumetric_strain:+.3f}"

    def packing(self) -> Packing:
        """Return the grains where they are, in a domain between the walls."""
        lower, upper = (corner * self.scene.units.length for corner in self.cell.bounds(self.scene.engine))
        found = self.scene.packing()
        return replace(found, domain=Domain(lower, upper, is_planar=found.domain.is_planar))

    def report(self) -> TriaxialReport:
        """Return what the shear measured."""
        rows = self.sheared()
        axial, lateral, inner, strains, dilation = (
            np.array([getattr(row, name) for row in rows])
            for name in (
                "axial_stress",
                "lateral_stress",
                "axial_stress_contacts",
                "axial_strain",
                "volumetric_strain",
            )
        )
        span, peak = highest(axial / lateral, strains, PEAK_SPAN)
        last = strains >= (1 - CRITICAL_SHARE) * strains[-1]
        at_peak = friction_angle([smooth(axial, span)[peak], smooth(lateral, span)[peak]])
        slopes = (dilation[span:] - dilation[:-span]) / (strains[span:] - strains[:-span])
        slope = slopes.max() if slopes.size else np.nan
        begun = self.begun or {"is_at_rest": False}
        return TriaxialReport(
            peak_friction_angle=float(at_peak),
            critical_friction_angle=float(friction_angle([axial[last].mean(), lateral[last].mean()])),
            peak_strain=float(smooth(strains, span)[peak]),
            volumetric_strain=float(dilation[-1]),
            dilatancy_angle=float(np.arcsin(slope / (2 + slope))),
            initial_solid_fraction=rows[0].solid_fraction,
            final_solid_fraction=rows[-1].solid_fraction,
            stress_mismatch=float(abs(inner.mean() / axial.mean() - 1)),
            confining_pressure=float(lateral.mean() * self.scene.units.stress),
            inertial_number=self.rate,
            is_compressed=begun["is_at_rest"],
            time=self.time_in_si(),
            n_steps=self.n_steps,
            halvings=self.halvings,
        )
