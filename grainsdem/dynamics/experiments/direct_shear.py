"""Direct shear: the upper half of a box is driven over the lower one under a lid that is pressed down."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import units
from grainsdem.dynamics.experiments.cells import ShearBox
from grainsdem.dynamics.experiments.loading import (
    LoadingReport,
    Shear,
    Staged,
    columns_of,
    highest,
    shear_panels,
    smooth,
)
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import assemble, pressure_gravity
from grainsdem.dynamics.experiments.shared import CompactionFriction, Friction, InertialNumber, NormalStress, Run
from grainsdem.dynamics.experiments.start import as_asked, options_of, plate_friction
from grainsdem.dynamics.mechanics import coordination, sliding_fraction, snapshot, traction
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Packing
from grainsdem.options import option

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene
    from grainsdem.panels import Panel

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

LEAST_LENGTH, LEAST_HEIGHT = 10.0, 6.0
"""Length and height of the box in largest grains that standards of soil testing ask for, such as ASTM D3080; below them
is warned."""

PEAK_SPAN = 0.02
"""Displacement, over the length of the box, over which stresses are averaged before their peak is looked for."""

STEADY_SHARE = 0.25
"""Last part of the displacement that is averaged for the steady state."""

BAND = 0.1
"""Half the height [d] about the plane between the halves in which the stress of the contacts is taken."""


class DirectShearSample(NamedTuple):
    """One look at a direct shear test, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while the bed is compressed, 1 while it is sheared.
    displacement : float
        Way of the upper half over the length of the box.
    volumetric_strain : float
        Change of the height over the height at the beginning of shear, positive where the bed dilates.
    normal_stress, shear_stress : float
        Mean force on the upper half with its lid since the last sample, up and along, over the area that the halves
        have in common [P].
    normal_stress_contacts, shear_stress_contacts : float
        The same from the contacts that cross the plane between the halves: means over the same time during shear,
        before it with converged forces at the instant [P].
    friction : float
        Shear force over normal force of the box.
    solid_fraction : float
        Volume of the grains over that between floor and lid.
    coordination : float
        Mean number of grains that press on a grain.
    sliding_fraction : float
        Share of the contact points that slide.
    kinetic_energy : float
        Mean of a grain [P d³].
    """

    time: float
    stage: float
    displacement: float
    volumetric_strain: float
    normal_stress: float
    shear_stress: float
    normal_stress_contacts: float
    shear_stress_contacts: float
    friction: float
    solid_fraction: float
    coordination: float
    sliding_fraction: float
    kinetic_energy: float


@dataclass(frozen=True, slots=True)
class DirectShearReport(LoadingReport):
    """What a direct shear test measured.

    Parameters
    ----------
    peak_friction, steady_friction : float
        τ/σ of the box: the highest of the means over 0.02 of the length, and the mean over the last quarter of the way.
    steady_friction_contacts : float
        The latter from the contacts of grains across the plane between the halves.
    mismatch : float
        Difference of the two, relative.
    peak_displacement : float
        Way at the peak, over the length of the box.
    dilation : float
        Rise of the lid at the end over the height at the beginning of shear.
    normal_stress : float
        Mean over the shear of the force on lid and upper walls over the whole floor [Pa].
    initial_solid_fraction, final_solid_fraction : float
        When shear began, and at the end.
    """

    peak_friction: float
    steady_friction: float
    steady_friction_contacts: float
    mismatch: float
    peak_displacement: float
    dilation: float
    normal_stress: float
    initial_solid_fraction: float
    final_solid_fraction: float


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return curves of τ/σ and dilation over the displacement."""
    del profile
    return shear_panels(series, "displacement", "displacement over length of the box", "box")


@experiment(panels=_panels)
def direct_shear(
    packing: Packing,
    *,
    normal_stress: NormalStress = 1e4,
    displacement: Annotated[
        float, option("Way of the upper half to go to, over the length of the box.", gt=0, le=0.5)
    ] = 0.2,
    inertial_number: InertialNumber = 1e-2,
    aspect: Annotated[
        float, option("Length of the box over its height and depth, where grains are set apart in one.", ge=1)
    ] = 3.0,
    gap: Annotated[
        float | None,
        option("Distance of the walls of the two halves; half a median diameter by default.", "m", ge=0),
    ] = None,
    friction: Friction = None,
    compaction_friction: CompactionFriction = None,
    **run: Unpack[Run],
) -> _DirectShear:
    """Drive the upper half of a box over the lower one under a constant load: friction, dilation.

    Parameters
    ----------
    packing : Packing
        Grains free of overlap. In planar work the height is along y. With a seed they are set apart in a box of
        ``aspect``; without, they start where they are, in the box that their domain is.

    Returns
    -------
    Outcome
        Packing, history, `DirectShearReport`, snapshot.

    Raises
    ------
    InputError
        If an option is out of range, or the packing is periodic or overlaps.

    Notes
    -----
    The inertial number is v/h d √(ρ/σ), v being the speed of the upper half and h the height of the bed. Grains have
    the same friction with floor and lid; the walls of the halves are smooth.
    """
    grains = as_asked(packing, run)
    opening = 0.5 * units(grains, 1.0).length if gap is None else gap
    box = ShearBox(grains, rng=run["rng"], aspect=aspect, gap=opening)
    options = options_of(
        run,
        friction=friction,
        gravity=pressure_gravity(grains, normal_stress),
        walls="none",
    )
    scales, plates = units(box.packing, options.gravity), plate_friction(grains, friction)
    scene = assemble(
        box.packing,
        options,
        lambda apparatus: box.furnish(apparatus, scales, friction=plates),
        spheres=run["spheres"],
    )
    return _DirectShear(scene, box, Shear(displacement, inertial_number, compaction_friction))


class _DirectShear(Staged[DirectShearReport]):
    """Compression to rest, then shear."""

    columns: ClassVar[Mapping[str, str]] = columns_of(DirectShearSample._fields)

    def __init__(self, scene: Scene, box: ShearBox, shear: Shear) -> None:
        self.box = box
        self._volume = float(volumes(scene.source.grains).sum()) / scene.units.length**3
        super().__init__(scene, box.meter(scene.engine), shear)

    def duration(self) -> float:
        """Return how long [t] the shear takes."""
        return super().duration() * self.box.length / self.box.height(self.scene.engine)

    def drive(self) -> None:
        """Push the lid, and drive the upper half once the bed is compressed."""
        engine = self.scene.engine
        if self.begun is None:
            self.box.gather(self.meter, engine)
            return
        self.probe()
        self.box.hold(self.meter, engine)
        self.meter.drive("shear", self.rate * self.begun["height"] * self.ramp())

    def measure(self) -> DirectShearSample:
        """Return the present sample."""
        engine, box = self.scene.engine, self.box
        forces, now = self.meter.read(), snapshot(self.scene)
        height, way = box.height(engine), engine.axle("shear")[0] / box.length
        area = box.area * (1.0 - way)
        inner_normal, inner_shear = self.mean_inner(now)
        normal, shear = (forces["lift"] + forces["walls"]) / area, -forces["shear"] / area
        return DirectShearSample(
            time=engine.time,
            stage=float(self.begun is not None),
            displacement=way,
            volumetric_strain=height / (self.begun["height"] if self.begun else height) - 1.0,
            normal_stress=normal,
            shear_stress=shear,
            normal_stress_contacts=float(inner_normal),
            shear_stress_contacts=float(inner_shear),
            friction=shear / normal if normal > 0 else 0.0,
            solid_fraction=self._volume / (box.area * height),
            coordination=coordination(now),
            sliding_fraction=float(np.nan_to_num(sliding_fraction(now))),
            kinetic_energy=self.kinetic_energy(now),
        )

    def inner(self, now: Snapshot) -> tuple[float, ...]:
        """Return normal and shear stress [P] of the contacts across the plane between the halves at one instant."""
        box, scales = self.box, self.scene.units
        area = box.area * (1.0 - self.scene.engine.axle("shear")[0] / box.length) * scales.length**2
        lower, upper = ((box.split + side * BAND) * scales.length for side in (-1, 1))
        found = traction(now, axis=box.up, lower=lower, upper=upper, area=area) / scales.stress
        return float(found[box.up]), float(-found[0])

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside both halves, shape (n,)."""
        positions, _ = self.scene.poses()
        lower, upper = self.box.lower.copy(), self.box.upper.copy()
        upper[0] += max(0.0, self.scene.engine.axle("shear")[0])
        upper[self.box.up] = lower[self.box.up] + self.box.height(self.scene.engine)
        return np.asarray(np.maximum(lower - positions, positions - upper)[:, : self.box.up + 1].max(axis=1))

    def mark(self) -> dict[str, Any]:
        """Return the height [d] of the bed as shear begins, and warn of a box that is small for its grains."""
        height, largest = self.box.height(self.scene.engine), self.largest()
        if self.box.length < LEAST_LENGTH * largest or height < LEAST_HEIGHT * largest:
            LOG.warning(
                "the box is %.1f of its largest grains long and %.1f high, and standards of soil testing ask for %g "
                "and %g: end walls bear the shear, and the bed looks stronger than it is; take more grains, or a ring",
                self.box.length / largest,
                height / largest,
                LEAST_LENGTH,
                LEAST_HEIGHT,
            )
        return {"height": height}

    def strain_of(self, row: DirectShearSample) -> float:
        """Return the way of the upper half."""
        return row.displacement

    def pressures_of(self, row: DirectShearSample) -> tuple[float, ...]:
        """Return the stresses that must be one in a compressed bed."""
        return row.normal_stress, row.normal_stress_contacts

    def held(self, row: DirectShearSample) -> float:
        """Return the pressure that is held at one while the bed is sheared: that on the whole floor."""
        return float(row.normal_stress * (1.0 - row.displacement))

    def sides(self) -> Floats:
        """Return the present sides [d] of the sample."""
        height, box = self.box.height(self.scene.engine), self.box
        return np.array([height, box.length, *([] if self.scene.source.domain.is_planar else [box.area / box.length])])

    def words(self, row: DirectShearSample) -> str:
        """Return a few words on a sample of the shear."""
        return f"displacement {row.displacement:.3f}, τ/σ {row.friction:.2f}, {row.volumetric_strain:+.3f}"

    def report(self) -> DirectShearReport:
        """Return what the shear measured."""
        rows = [row for row in self.sheared() if row.displacement > 0]
        normal, shear, inner_normal, inner_shear, ways = (
            np.array([getattr(row, name) for row in rows])
            for name in (
                "normal_stress",
                "shear_stress",
                "normal_stress_contacts",
                "shear_stress_contacts",
                "displacement",
            )
        )
        span, peak = highest(shear / normal, ways, PEAK_SPAN)
        last = ways >= (1 - STEADY_SHARE) * ways[-1]
        steady = float(shear[last].mean() / normal[last].mean())
        steady_contacts = float(inner_shear[last].mean() / inner_normal[last].mean())
        return DirectShearReport(
            peak_friction=float(smooth(shear, span)[peak] / smooth(normal, span)[peak]),
            steady_friction=steady,
            steady_friction_contacts=steady_contacts,
            mismatch=abs(steady_contacts / steady - 1),
            peak_displacement=float(smooth(ways, span)[peak]),
            dilation=rows[-1].volumetric_strain,
            normal_stress=float((normal * (1 - ways)).mean() * self.scene.units.stress),
            initial_solid_fraction=rows[0].solid_fraction,
            final_solid_fraction=rows[-1].solid_fraction,
            **self.standing(),
        )
