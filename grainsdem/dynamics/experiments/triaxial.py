"""Triaxial compression: six smooth walls, four that hold a pressure and two that close in on the grains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import MjcfOptions, units
from grainsdem.dynamics.experiments.cells import SixWalls
from grainsdem.dynamics.experiments.cells.meter import LIMIT_SPEED
from grainsdem.dynamics.experiments.loading import (
    LoadingReport,
    Shear,
    Staged,
    columns_of,
    highest,
    smooth,
)
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import assemble, pressure_gravity
from grainsdem.dynamics.experiments.shared import CompactionFriction, Friction, InertialNumber, Run
from grainsdem.dynamics.experiments.start import in_block, options_of
from grainsdem.dynamics.mechanics import coordination, friction_angle, sliding_fraction, snapshot, stress
from grainsdem.dynamics.mechanics.slopes import directions
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain, Packing
from grainsdem.options import option
from grainsdem.panels import Panel, smoothed

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

PEAK_SPAN = 0.05
"""Axial strain over which stresses are averaged before their peak is looked for."""

LARGEST_RATIO = 20.0
"""Ratio σ1/σ3 that no bed of grains bears: an angle of friction of 65 degrees."""

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
class TriaxialReport(LoadingReport):
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
    confining_fluctuation : float
        Standard deviation of that pressure over the samples of the shear, relative to its mean. A sample is 0.2 t, or
        a two-hundredth of the shear where that is longer.
    coordination, sliding_fraction : float
        Mean number of grains that press on a grain, and share of the contact points that slide, over the last quarter
        of the strain: how far the bed is from one that is sheared infinitely slowly.
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
    confining_fluctuation: float
    coordination: float
    sliding_fraction: float


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return curves of angle and dilation over strain."""
    del profile
    strain, angles = series["axial_strain"], {}
    for name, suffix in (("walls", ""), ("contacts", "_contacts")):
        axial, lateral = (smoothed(series[f"{side}_stress{suffix}"]) for side in ("axial", "lateral"))
        angles[name] = smoothed(strain), np.degrees(np.arcsin((axial - lateral) / (axial + lateral)))
    return [
        Panel("axial strain", "mobilised friction angle  [°]", angles),
        Panel("axial strain", "volumetric strain (dilation)", {"": (strain, series["volumetric_strain"])}),
    ]


@experiment(panels=_panels)
def triaxial(
    packing: Packing,
    *,
    confining_pressure: Annotated[float, option("Pressure σ3 on the side walls.", "Pa", gt=0)] = 1e5,
    strain: Annotated[float, option("Axial strain to go to, the shortening over the height.", gt=0, lt=0.9)] = 0.4,
    inertial_number: InertialNumber = 1e-2,
    friction: Friction = None,
    compaction_friction: CompactionFriction = None,
    **run: Unpack[Run],
) -> _Triaxial:
    """Compress a bed between six smooth walls and shear it: angles of friction, dilation.

    The side walls hold a pressure while the bed is shortened along its height.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap. In planar work there are four walls and the height is along y: a biaxial test.

    Returns
    -------
    Outcome
        Packing, history, `TriaxialReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, or the packing is periodic or overlaps.

    Notes
    -----
    The walls that hold a pressure are pushed with that pressure times the present area between the others; the
    two across the height are then driven at ε̇ times the present height. Stresses on walls are means over time from the
    momentum that they took. The walls are smooth.
    """
    start = in_block(packing, run)
    cell_options = options_of(
        run,
        friction=friction,
        gravity=pressure_gravity(start, confining_pressure),
        walls="none",
    )
    scene, cell = _build(start, cell_options, spheres=run["spheres"])
    return _Triaxial(scene, cell, Shear(strain, inertial_number, compaction_friction))


def _build(packing: Packing, options: MjcfOptions, *, spheres: bool) -> tuple[Scene, SixWalls]:
    """Return the scene and the walls around it."""
    cell = SixWalls(packing, units(packing, options.gravity), driven=directions(packing)[0])
    return assemble(packing, options, cell.furnish, spheres=spheres), cell


class _Triaxial(Staged[TriaxialReport]):
    """Compression to rest, then shear."""

    columns: ClassVar[Mapping[str, str]] = columns_of(TriaxialSample._fields)

    def __init__(self, scene: Scene, cell: SixWalls, shear: Shear) -> None:
        self.cell, self.axis = cell, scene.up
        self.lateral = tuple(axis for axis in cell.axes if axis != self.axis)
        self._volume = float(volumes(scene.source.grains).sum()) / scene.units.length**3
        super().__init__(scene, cell.meter(scene.engine), shear)

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

    def held(self, row: TriaxialSample) -> float:
        """Return the pressure that is held at one while the bed is sheared."""
        return row.lateral_stress

    def fault(self) -> str:
        """Return why the last samples of the shear are of no test: no sand bears such a ratio."""
        rows = self.lately()
        ratio = sum(row.axial_stress for row in rows) / max(sum(row.lateral_stress for row in rows), 1e-9)
        told = f"σ1/σ3 was {ratio:.1f}, at a strain of {self.strain_of(rows[-1]):.3g}" if ratio > LARGEST_RATIO else ""
        return super().fault() or told

    def sides(self) -> Floats:
        """Return the present sides [d] of the sample."""
        return np.asarray(self.cell.lengths(self.scene.engine)[list(self.cell.axes)])

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
        series = dict(zip(TriaxialSample._fields, np.array(rows).T, strict=True))
        axial, lateral, strains = series["axial_stress"], series["lateral_stress"], series["axial_strain"]
        inner, dilation = series["axial_stress_contacts"], series["volumetric_strain"]
        span, peak = highest(axial / lateral, strains, PEAK_SPAN)
        last = strains >= (1 - CRITICAL_SHARE) * strains[-1]
        at_peak = friction_angle([smooth(axial, span)[peak], smooth(lateral, span)[peak]])
        slopes = (dilation[span:] - dilation[:-span]) / (strains[span:] - strains[:-span])
        slope = slopes.max() if slopes.size else np.nan
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
            confining_fluctuation=float(lateral.std() / lateral.mean()),
            coordination=float(series["coordination"][last].mean()),
            sliding_fraction=float(series["sliding_fraction"][last].mean()),
            **self.standing(),
        )
