"""The tables of experiments: ``[compact]``, ``[tap]``, ``[triaxial]``, ``[shear]``, ``[collapse]`` and ``[tilt]``."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from grainsdem.recipe.base import Coefficient, Positive, Table

Strain = Annotated[float, Field(gt=0, lt=0.9)]
Angle = Annotated[float, Field(gt=0, le=np.pi / 2)]


class ExperimentTable(Table):
    """What the tables of all experiments have.

    Parameters
    ----------
    start : {"random", "place"}
        Whether grains are turned at random, reordered and set apart first, or start where they are.
    friction : float
        Coefficient of friction among grains.
    spheres : bool
        Whether each grain is replaced by the sphere of equal volume.
    time_step : float
        Time step in grain units.
    seeds : int
        How many runs, each with a seed of its own: with two or more, means and 95 % intervals are the result.
    """

    function: ClassVar[str]

    start: Literal["random", "place"] = "random"
    friction: Coefficient = 0.5
    spheres: bool = False
    time_step: Positive = 0.01
    seeds: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _seeds_need_chance(self) -> Self:
        if self.seeds > 1 and self.start == "place":
            raise ValueError("several seeds need start = 'random': grains in place are the same for each")
        return self

    @property
    def call(self) -> str:
        """Name of the function in `grainsdem.dynamics`."""
        return self.function

    def options(self) -> dict[str, Any]:
        """Return the options of that function."""
        return self.model_dump(exclude={"start", "seeds"})


class CompactTable(ExperimentTable):
    """``[compact]``: compression from all sides; see `grainsdem.dynamics.compact`.

    Parameters
    ----------
    pressure : float
        Pressure [Pa] that six walls press with.
    porosity : float, optional
        Share of void at which they stop; at the pressure by default.
    compaction_friction : float, optional
        Coefficient of friction while walls close in; as after it by default.
    max_time : float
        Time limit in units of d √(ρ/P).
    """

    function = "compact"

    pressure: Positive = 1e4
    porosity: Annotated[float, Field(gt=0, lt=1)] | None = None
    compaction_friction: Coefficient | None = None
    max_time: Positive = 200.0


class TapTable(ExperimentTable):
    """``[tap]``: the container is shaken up and down; see `grainsdem.dynamics.tap`.

    Parameters
    ----------
    taps : int
        How many.
    amplitude : float, optional
        Height of a tap [m]; half a median diameter by default.
    acceleration : float
        Its greatest acceleration over gravity.
    wall_friction : float, optional
        Coefficient of friction with floor and walls; as among grains by default.
    gravity : float
        Acceleration [m/s²].
    """

    function = "tap"

    taps: Annotated[int, Field(ge=1)] = 50
    amplitude: Positive | None = None
    acceleration: Positive = 3.0
    wall_friction: Coefficient | None = None
    gravity: Positive = 9.81


class TriaxialTable(ExperimentTable):
    """``[triaxial]``: compression between six smooth walls; see `grainsdem.dynamics.triaxial`.

    Parameters
    ----------
    confining_pressure : float
        σ3 [Pa].
    strain : float
        Axial strain to go to.
    inertial_number : float
        ε̇ d √(ρ/σ3).
    compaction_friction : float, optional
        Coefficient of friction while the bed is compressed; as in shear by default.
    """

    function = "triaxial"

    confining_pressure: Positive = 1e5
    strain: Strain = 0.4
    inertial_number: Positive = 1e-2
    compaction_friction: Coefficient | None = None


class ShearTable(ExperimentTable):
    """``[shear]``: a ring under a lid that turns, or a box of two halves.

    Parameters
    ----------
    kind : {"ring", "box"}
        See `grainsdem.dynamics.ring_shear` and `direct_shear`.
    normal_stress : float
        On the lid [Pa].
    strain : float, optional
        Shear strain of the ring to go to, 2 by default, or way of the upper half over the length of the box, 0.2.
    inertial_number : float
        γ̇ d √(ρ/σ).
    compaction_friction : float, optional
        Coefficient of friction while the bed is compressed; as in shear by default.
    inner_radius, outer_radius : float, optional
        Radii of the ring [m].
    """

    kind: Literal["ring", "box"] = "ring"
    normal_stress: Positive = 1e4
    strain: Positive | None = None
    inertial_number: Positive = 1e-2
    compaction_friction: Coefficient | None = None
    inner_radius: Positive | None = None
    outer_radius: Positive | None = None

    @model_validator(mode="after")
    def _fits_the_kind(self) -> Self:
        if self.kind == "box" and (self.inner_radius or self.outer_radius):
            raise ValueError("inner_radius and outer_radius are of a ring; this is a box")
        if self.kind == "ring" and self.start == "place":
            raise ValueError("grains are always set apart in a ring; start must be 'random'")
        return self

    @property
    def call(self) -> str:
        """Name of the function in `grainsdem.dynamics`."""
        return "ring_shear" if self.kind == "ring" else "direct_shear"

    def options(self) -> dict[str, Any]:
        """Return the options of that function."""
        found = super().options()
        for name in ("kind", "strain", *(("inner_radius", "outer_radius") if self.kind == "box" else ())):
            found.pop(name)
        if self.strain is not None:
            found["strain" if self.kind == "ring" else "displacement"] = self.strain
        return found


class CollapseTable(ExperimentTable):
    """``[collapse]``: walls are taken away; see `grainsdem.dynamics.collapse`.

    Parameters
    ----------
    release : list of str, optional
        Walls to take away, such as ``wall_x1``; all by default.
    wall_friction : float, optional
        Coefficient of friction with floor and walls; as among grains by default.
    gravity : float
        Acceleration [m/s²].
    max_time : float
        Time limit after the release in units of √(d/g).
    """

    function = "collapse"

    release: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    wall_friction: Coefficient | None = None
    gravity: Positive = 9.81
    max_time: Positive = 100.0


class TiltTable(ExperimentTable):
    """``[tilt]``: gravity is turned until the bed fails; see `grainsdem.dynamics.tilt`.

    Parameters
    ----------
    wall_friction : float, optional
        Coefficient of friction with floor and walls; as among grains by default.
    gravity : float
        Acceleration [m/s²].
    rate : float
        Angle [rad] by which gravity is turned in √(d/g).
    max_angle : float
        Angle [rad] at which a bed that stands is given up.
    """

    function = "tilt"

    wall_friction: Coefficient | None = None
    gravity: Positive = 9.81
    rate: Positive = 0.01
    max_angle: Angle = float(np.pi / 3)
