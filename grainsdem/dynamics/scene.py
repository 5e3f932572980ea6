"""A packing as a simulated scene: made from exported text, stepped, and read back in the grains' own frames.

Everything here is in grain units (`exporters.mjcf.units`); only `Scene.packing` speaks SI.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters import mjcf
from exporters.rest import Rest, frictions, mixing, resting, restitution, rolling_friction
from grainsdem.dynamics.budget import estimate, refuse_memory
from grainsdem.dynamics.engine import Apparatus, load
from grainsdem.dynamics.engine.lockstep import joined
from grainsdem.dynamics.starting import sphere_radii
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.packing.carve import subset

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.mjcf import GrainUnits, MjcfOptions
    from grainsdem.dynamics.engine import Engine
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

START_OVERLAP = 1e-2
"""Deepest overlap at the start [d]; a deeper one explodes."""


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A packing in an engine.

    Parameters
    ----------
    source : Packing
        What the model was made from.
    units : GrainUnits
        Factors from grain units to SI.
    engine : Engine
        The model and its state, which stepping changes.
    fingerprint : str
        What tells the model's text from any other.
    are_spheres : bool
        Whether each grain is simulated as the sphere of equal volume.
    """

    source: Packing
    units: GrainUnits
    engine: Engine
    fingerprint: str
    are_spheres: bool = False

    @property
    def n_grains(self) -> int:
        """Number of grains."""
        return len(self.source)

    @property
    def up(self) -> int:
        """The axis against gravity: y in planar work, else z."""
        return 1 if self.source.domain.is_planar else 2

    @property
    def floor(self) -> str:
        """Name of the part that is the floor; in planar work it is the lower y wall."""
        return "wall_y0" if self.source.domain.is_planar else "floor"

    @property
    def upright_walls(self) -> list[str]:
        """Names of the container's walls that a bed can slip up along without leaving them."""
        leaning = np.flatnonzero(np.abs(self.source.domain.planes[:, self.up]) > 1e-9)  # of unit normals: round-off
        others = {self.floor, *(f"wall_p{k}" for k in leaning.tolist())}
        return [name for name in self.engine.parts if name.startswith("wall") and name not in others]

    def poses(self) -> tuple[Floats, Floats]:
        """Return positions, shape (n, 3), and quaternions, shape (n, 4), of the grains' own frames."""
        motion = self.engine.motion()
        return motion.positions, motion.quaternions

    def packing(self) -> Packing:
        """Return the grains where they are now, in SI; `Packing.links` is gone, since neighbours have changed.

        Those that are not present are left out.
        """
        positions, quaternions = self.frame()
        moved = replace(self.source, positions=positions, quaternions=quaternions, links=None)
        is_present = self.engine.is_present
        return moved if is_present.all() else subset(moved, np.flatnonzero(is_present))

    def frame(self) -> tuple[Floats, Floats]:
        """Return positions [m], shape (n, 3), and quaternions, shape (n, 4), of all grains: NaN where one is absent."""
        positions, quaternions = self.poses()
        positions = positions * self.units.length
        quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
        absent = ~self.engine.is_present
        positions[absent] = quaternions[absent] = np.nan
        return positions, quaternions

    def rest(self, options: MjcfOptions) -> dict[str, Any]:
        """Return what the provenance of grains at rest keeps: files of the packing say the same.

        Parameters
        ----------
        options : MjcfOptions
            Those that the scene was made with.
        """
        made_of = replace(self.source, provenance=())  # as the model was: `equip`
        given = frictions(made_of, options.friction, options.wall_friction)
        friction = given.grains if given.own is None else None
        gravity = self.engine.gravity
        x, y, z = (gravity / np.linalg.norm(gravity)).tolist()
        return resting(
            Rest(
                self.engine.time_step,
                friction,
                given.by_wall or (friction if given.walls is None else given.walls),
                (x, y, z),
                self.are_spheres,
                rolling_friction(made_of, options.rolling_friction),
                mixing(made_of, options.mixing),
                restitution(made_of, options.restitution),
            )
        )

    def time(self) -> float:
        """Return the simulated time."""
        return self.engine.time

    def set_time_step(self, time_step: float) -> None:
        """Change the time step, and the contact stiffness that follows from it."""
        self.engine.set_time_step(time_step)

    def state(self) -> Floats:
        """Return everything that the next step depends on, as one array."""
        return self.engine.state()

    def restore(self, state: Floats) -> None:
        """Go back to a state that `state` gave."""
        self.engine.restore(state)


def build(packing: Packing, options: MjcfOptions) -> Scene:
    """Load the text that the MJCF exporter writes for a packing.

    Raises
    ------
    InputError
        If the packing is periodic, since MuJoCo has no periodic walls, or MuJoCo refuses the model.
    """
    refuse_periodic(packing)
    return scene_of(packing, mjcf.text(packing, options), options.gravity)


def equip(packing: Packing, options: MjcfOptions, *, are_spheres: bool = False) -> Apparatus:
    """Return the text that the MJCF exporter writes for a packing, ready for what an experiment adds to it.

    Parameters
    ----------
    packing : Packing
        The grains, spheres already where they are to be (`starting.as_spheres`).
    options : MjcfOptions
        Friction and the like; its gravity sets the units.
    are_spheres : bool
        Whether the model has perfect spheres instead of the grains' meshes: discs in planar work.

    Raises
    ------
    InputError
        If the packing is periodic.
    """
    refuse_periodic(packing)
    # What an experiment is like follows from its own options, not from how the grains came to rest before.
    apparatus = Apparatus(mjcf.text(replace(packing, provenance=()), options))
    if are_spheres:
        units = mjcf.units(packing, options.gravity)
        radii, masses = sphere_radii(packing) / units.length, volumes(packing.grains) * packing.densities / units.mass
        apparatus.make_spheres(radii, (0.5 if packing.domain.is_planar else 0.4) * masses * radii**2)
    return apparatus


def scene_of(packing: Packing, text: str, gravity: float, *, are_spheres: bool = False) -> Scene:
    """Return the scene of a text made from a packing, in which ``gravity`` [m/s²] is one."""
    refuse_memory(estimate(len(packing), duration=0.0))
    fingerprint = hashlib.sha256(text.encode()).hexdigest()
    return Scene(packing, mjcf.units(packing, gravity), joined(load(text)), fingerprint, are_spheres)


def refuse_periodic(packing: Packing) -> None:
    """Raise `InputError` where a packing has periodic axes."""
    if packing.domain.periodic.any():
        raise InputError(
            "MuJoCo has no periodic walls; shuffle the packing into a box first, or use a domain with walls. For shear "
            "without end take ring_shear, which sets the grains apart in a ring and needs no box"
        )


def refuse_overlap(scene: Scene, advice: str = "") -> None:
    """Raise `InputError` where grains, or grains and walls or parts, overlap so much that the start would explode."""
    depth, names = scene.engine.deepest_overlap()
    if depth > START_OVERLAP:
        advice = advice if set(names) & set(scene.engine.parts) else ""  # which is on parts
        raise InputError(
            f"the packing must not overlap by more than {START_OVERLAP:g} d at the start; "
            f"{' and '.join(names)} overlap by {depth:.3g} d, {depth * scene.units.length:.3g} m{advice}"
        )
