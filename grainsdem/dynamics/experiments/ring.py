"""Ring shear: a rough lid, pressed onto a ring of grains, is turned as far as one likes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, NamedTuple, Unpack

import numpy as np

from exporters.mjcf import units
from grainsdem.dynamics.experiments.cells import Annulus
from grainsdem.dynamics.experiments.loading import (
    LoadingReport,
    Shear,
    Staged,
    columns_of,
    crossing,
    highest,
    shear_panels,
    smooth,
)
from grainsdem.dynamics.experiments.registry import experiment
from grainsdem.dynamics.experiments.rig import assemble, pressure_gravity
from grainsdem.dynamics.experiments.shared import CompactionFriction, Friction, InertialNumber, NormalStress, Run
from grainsdem.dynamics.experiments.start import as_asked, options_of, plate_friction
from grainsdem.dynamics.mechanics import (
    coordination,
    sliding_fraction,
    snapshot,
    torque_through,
    traction,
    velocity_profile,
)
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Packing
from grainsdem.options import option
from grainsdem.panels import Panel

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.rig import Series
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]

PEAK_SPAN = 0.2
"""Shear strain over which stresses are averaged before their peak is looked for."""

STEADY_SHARE = 0.5
"""Last part of the strain that is averaged for the steady state."""

LAYERS = 12
"""Layers of the profile of velocity."""

MIDDLE = 0.25, 0.75
"""Heights, over that of the ring, between which the stress of the contacts is taken."""


class RingSample(NamedTuple):
    """One look at a ring shear test, in grain units.

    Parameters
    ----------
    time : float
        Simulated time [t].
    stage : float
        0 while the bed is compressed, 1 while it is sheared.
    shear_strain : float
        Way of the lid at the mean radius over the height at the beginning of shear.
    volumetric_strain : float
        Change of the height over that height, positive where the bed dilates.
    normal_stress, shear_stress : float
        Mean stresses on the lid since the last sample [P]; the shear stress is the one that, the same over the whole
        ring, has the lid's torque.
    normal_stress_contacts, shear_stress_contacts : float
        The same from the contacts that cross the level planes of the middle half: means over the same time during
        shear, before it with converged forces at the instant [P].
    friction : float
        Shear stress over normal stress of the lid.
    solid_fraction : float
        Volume of the grains over that of the ring between the plates; of glued grains half is counted.
    coordination : float
        Mean number of loose grains that press on a loose grain.
    sliding_fraction : float
        Share of the contact points that slide.
    kinetic_energy : float
        Mean of a grain [P d³].
    """

    time: float
    stage: float
    shear_strain: float
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
class RingReport(LoadingReport):
    """What a ring shear test measured.

    Parameters
    ----------
    peak_friction, steady_friction : float
        τ/σ of the lid: the highest of the means over 0.2 of shear strain, and the mean over the last half of it.
    steady_friction_contacts : float
        The latter from the contacts of grains.
    mismatch : float
        Difference of the two, relative.
    peak_strain : float
        Shear strain at the peak.
    dilation : float
        Rise of the lid over the height at the beginning of shear, mean over the last half of the strain.
    normal_stress : float
        Mean on the lid over the shear [Pa].
    half_height : float
        Where grains go round half as fast as the lid in the last half of the strain: height above the floor over that
        of the ring. 0.5 means that the shear is spread evenly, more that it is near the lid.
    initial_solid_fraction, final_solid_fraction : float
        When shear began, and the mean over the last half of the strain.
    """

    peak_friction: float
    steady_friction: float
    steady_friction_contacts: float
    mismatch: float
    peak_strain: float
    dilation: float
    normal_stress: float
    half_height: float
    initial_solid_fraction: float
    final_solid_fraction: float


def _panels(series: Series, profile: Series) -> list[Panel]:
    """Return curves of τ/σ and dilation over strain, and the profile of the velocity."""
    curve = {"": (profile["velocity"], profile["height"])}
    return [
        *shear_panels(series, "shear_strain", "shear strain", "lid"),
        Panel("speed around the axis / that of the lid", "height / that of the ring", {}, curve),
    ]


@experiment(panels=_panels, needs_seed=True)
def ring_shear(
    packing: Packing,
    *,
    normal_stress: NormalStress = 1e4,
    strain: Annotated[
        float,
        option("Shear strain to go to, of any size: the way of the lid at the mean radius over the height.", gt=0),
    ] = 2.0,
    inertial_number: InertialNumber = 1e-2,
    friction: Friction = None,
    compaction_friction: CompactionFriction = None,
    inner_radius: Annotated[float | None, option("Inner radius of the ring; by default as fits.", "m", gt=0)] = None,
    outer_radius: Annotated[
        float | None,
        option("Outer radius of the ring; by default such that it is about as high as it is wide.", "m", gt=0),
    ] = None,
    **run: Unpack[Run],
) -> _Ring:
    """Turn a rough lid on a ring of grains under a constant normal stress: friction, dilation, profile.

    Parameters
    ----------
    packing : Packing
        The grains; they are turned at random, reordered and set apart in the ring, always. The lowest and the topmost
        layer are glued to floor and lid, and fixed.

    Returns
    -------
    Outcome
        Packing, history, `RingReport`, snapshot, and the ``profile`` of the last half of the strain: ``height`` over
        that of the ring, and ``velocity`` of the grains around the axis over the lid's.

    Raises
    ------
    InputError
        If an option is out of range, there are too few grains for the ring, or the packing is planar.

    Notes
    -----
    Grains have the same friction with the two plates; the walls within and around are smooth.
    """
    grains = as_asked(packing, run)
    annulus = Annulus(grains, inner_radius, outer_radius, rng=run["rng"])
    options = options_of(
        run,
        friction=friction,
        wall_friction=0.0,
        gravity=pressure_gravity(grains, normal_stress),
    )
    scales, plates = units(annulus.packing, options.gravity), plate_friction(grains, friction)
    scene = assemble(
        annulus.packing,
        options,
        lambda apparatus: annulus.furnish(apparatus, scales, friction=plates),
        spheres=run["spheres"],
    )
    return _Ring(scene, annulus, Shear(strain, inertial_number, compaction_friction))


class _Ring(Staged[RingReport]):
    """Compression to rest, then shear."""

    columns: ClassVar[Mapping[str, str]] = columns_of(RingSample._fields)

    def __init__(self, scene: Scene, annulus: Annulus, shear: Shear) -> None:
        self.annulus = annulus
        sizes = volumes(scene.source.grains) / scene.units.length**3
        self._volume = float(sizes.sum() - 0.5 * sizes[: 2 * annulus.n_glued].sum())
        self._speeds = np.zeros(LAYERS)
        self._counts = np.zeros(LAYERS)
        super().__init__(scene, annulus.meter(scene.engine), shear)

    def drive(self) -> None:
        """Push the lid, and turn it once the bed is compressed."""
        engine = self.scene.engine
        if self.begun is None:
            self.annulus.gather(self.meter, engine)
            return
        self.probe()
        self.annulus.hold(self.meter, engine)
        self.meter.drive("turn", self.rate * self.begun["height"] / self.annulus.mean_radius * self.ramp())

    def measure(self) -> RingSample:
        """Return the present sample."""
        engine, ring = self.scene.engine, self.annulus
        forces, now = self.meter.read(), snapshot(self.scene)
        height = ring.height(engine)
        first = self.begun["height"] if self.begun else height
        normal, shear = forces["lift"] / ring.area, ring.shear_stress(-forces["turn"])
        inner_normal, inner_shear = self.mean_inner(now)
        if self.begun:
            self._watch(now, height)
        return RingSample(
            time=engine.time,
            stage=float(self.begun is not None),
            shear_strain=engine.axle("turn")[0] * ring.mean_radius / first,
            volumetric_strain=height / first - 1.0,
            normal_stress=normal,
            shear_stress=shear,
            normal_stress_contacts=float(inner_normal),
            shear_stress_contacts=float(inner_shear),
            friction=shear / normal if normal > 0 else 0.0,
            solid_fraction=self._volume / (ring.area * height),
            coordination=coordination(now) * len(now.is_glued) / float((~now.is_glued).sum()),
            sliding_fraction=float(np.nan_to_num(sliding_fraction(now))),
            kinetic_energy=self.kinetic_energy(now),
        )

    def inner(self, now: Snapshot) -> tuple[float, ...]:
        """Return normal and shear stress [P] of the contacts in the middle of the ring at one instant."""
        ring, scales = self.annulus, self.scene.units
        height = ring.height(self.scene.engine)
        lower, upper = ((ring.floor + share * height) * scales.length for share in MIDDLE)
        torque = -torque_through(now, lower=lower, upper=upper) / scales.energy
        pressing = traction(now, axis=2, lower=lower, upper=upper, area=ring.area * scales.length**2)[2]
        return float(pressing / scales.stress), ring.shear_stress(torque)

    def _watch(self, now: Snapshot, height: float) -> None:
        """Count the present velocities in the profile, once the last half of the strain has begun."""
        engine, ring, scales = self.scene.engine, self.annulus, self.scene.units
        angle, speed = engine.axle("turn")
        if not self.begun or angle * ring.mean_radius / self.begun["height"] < (1 - STEADY_SHARE) * self.strain:
            return
        x, y = now.packing.positions[:, :2].T
        around = np.column_stack([-y, x, np.zeros(len(x))]) / (x**2 + y**2)[:, None]
        edges = (ring.floor + np.linspace(0.0, 1.0, LAYERS + 1) * height) * scales.length
        _, turning = velocity_profile(now, along=around, edges=edges)
        seen = np.isfinite(turning)
        self._speeds[seen] += turning[seen] * scales.time / speed
        self._counts[seen] += 1

    def outside(self) -> Floats:
        """Return how far [d] each centroid is outside the ring, shape (n,)."""
        positions, _ = self.scene.poses()
        radii, heights = np.hypot(positions[:, 0], positions[:, 1]), positions[:, 2] - self.annulus.floor
        across = np.maximum(self.annulus.inner - radii, radii - self.annulus.outer)
        return np.asarray(np.maximum(across, np.maximum(-heights, heights - self.annulus.height(self.scene.engine))))

    def mark(self) -> dict[str, Any]:
        """Return the height [d] of the ring as shear begins."""
        return {"height": self.annulus.height(self.scene.engine)}

    def strain_of(self, row: RingSample) -> float:
        """Return the shear strain."""
        return row.shear_strain

    def pressures_of(self, row: RingSample) -> tuple[float, ...]:
        """Return the stresses that must be one in a compressed bed."""
        return row.normal_stress, row.normal_stress_contacts

    def held(self, row: RingSample) -> float:
        """Return the pressure that is held at one while the bed is sheared."""
        return row.normal_stress

    def sides(self) -> Floats:
        """Return the present sides [d] of the sample."""
        annulus = self.annulus
        return np.array([annulus.height(self.scene.engine), annulus.outer - annulus.inner])

    def words(self, row: RingSample) -> str:
        """Return a few words on a sample of the shear."""
        return f"strain {row.shear_strain:.2f}, τ/σ {row.friction:.2f}, {row.volumetric_strain:+.3f}"

    def memory(self) -> dict[str, Any]:
        """Return what the run remembers besides state and samples, as JSON values."""
        return {**super().memory(), "speeds": self._speeds.tolist(), "counts": self._counts.tolist()}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Take back what `memory` gave."""
        super().recall(memory)
        self._speeds, self._counts = np.array(memory["speeds"]), np.array(memory["counts"])

    def profile(self) -> dict[str, Floats]:
        """Return the profile of the velocity around the axis; layers that no grain was in are left out."""
        seen = self._counts > 0
        heights = (np.arange(LAYERS) + 0.5) / LAYERS
        return {"height": heights[seen], "velocity": self._speeds[seen] / self._counts[seen]}

    def report(self) -> RingReport:
        """Return what the shear measured."""
        rows = [row for row in self.sheared() if row.shear_strain > 0]
        normal, shear, inner_normal, inner_shear, strains, dilation, fractions = (
            np.array([getattr(row, name) for row in rows])
            for name in (
                "normal_stress",
                "shear_stress",
                "normal_stress_contacts",
                "shear_stress_contacts",
                "shear_strain",
                "volumetric_strain",
                "solid_fraction",
            )
        )
        span, peak = highest(shear / normal, strains, PEAK_SPAN)
        last = strains >= (1 - STEADY_SHARE) * strains[-1]
        steady = float(shear[last].mean() / normal[last].mean())
        steady_contacts = float(inner_shear[last].mean() / inner_normal[last].mean())
        profile = self.profile()
        return RingReport(
            peak_friction=float(smooth(shear, span)[peak] / smooth(normal, span)[peak]),
            steady_friction=steady,
            steady_friction_contacts=steady_contacts,
            mismatch=abs(steady_contacts / steady - 1),
            peak_strain=float(smooth(strains, span)[peak]),
            dilation=float(dilation[last].mean()),
            normal_stress=float(normal.mean() * self.scene.units.stress),
            half_height=crossing(profile["height"], profile["velocity"], 0.5),
            initial_solid_fraction=rows[0].solid_fraction,
            final_solid_fraction=float(fractions[last].mean()),
            **self.standing(),
        )
