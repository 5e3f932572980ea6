"""Units of files: SI, millimetres, any other length, or grain units.

In grain units lengths are in median grain diameters, densities in grain densities, and gravity is one. Programs with
tolerances of their own (MuJoCo, for one) refuse or blur a millimetre in SI; in these units a bed of 0.2 mm sand and one
of 0.1 m cobbles are the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from exporters.check import check_positive
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

Units: TypeAlias = Literal["si", "mm", "grain"] | float
"""Units by name, or the length [m] that is one in the file; masses are then in kilograms and times in seconds."""

_LENGTHS = {"si": 1.0, "mm": 1e-3}


@dataclass(frozen=True, slots=True)
class GrainUnits:
    """Factors from a file's units to SI: a value in those units times the factor is the value in SI.

    They are described as they are in grain units.

    Parameters
    ----------
    length : float
        Median diameter [m] of the spheres of equal volume.
    mass : float
        Mass [kg] of a cube of that edge and of the mean grain density.
    time : float
        Square root of length over gravity [s].
    """

    length: float
    mass: float
    time: float

    @property
    def density(self) -> float:
        """Density [kg/m³]."""
        return self.mass / self.length**3

    @property
    def velocity(self) -> float:
        """Velocity [m/s]."""
        return self.length / self.time

    @property
    def acceleration(self) -> float:
        """Acceleration [m/s²]: gravity."""
        return self.length / self.time**2

    @property
    def force(self) -> float:
        """Force [N]."""
        return self.mass * self.acceleration

    @property
    def energy(self) -> float:
        """Energy [J]."""
        return self.force * self.length

    @property
    def stress(self) -> float:
        """Stress [Pa]."""
        return self.force / self.length**2

    @property
    def inertia(self) -> float:
        """Moment of inertia [kg m²]."""
        return self.mass * self.length**2


def units(packing: Packing, gravity: float = 9.81) -> GrainUnits:
    """Return the grain units of a packing.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    gravity : float
        What acceleration [m/s²] is one.

    Raises
    ------
    InputError
        If gravity is not positive and finite.
    """
    check_positive("gravity", gravity)
    return units_of(volumes(packing.grains), packing.densities, gravity)


def units_of(grain_volumes: NDArray[np.float64], densities: NDArray[np.float64], gravity: float) -> GrainUnits:
    """Return the grain units of grains with the given volumes [m³] and densities [kg/m³]."""
    length = float(np.median(cube_roots(grain_volumes * (6.0 / np.pi))))
    density = float(grain_volumes @ densities / grain_volumes.sum())
    return GrainUnits(length, density * length**3, float(np.sqrt(length / gravity)))


def check_units(units: Units) -> None:
    """Raise `InputError` unless units are a name of `Units` or a positive length."""
    if isinstance(units, str):
        if units not in (*_LENGTHS, "grain"):
            raise InputError(f"units must be si, mm, grain or a length in metres; got {units!r}")
        return
    check_positive("units", units)


def chosen_units(
    units: Units, grain_volumes: NDArray[np.float64], densities: NDArray[np.float64], gravity: float = 9.81
) -> GrainUnits:
    """Return the factors to SI of units by name or length, for grains with given volumes [m³] and densities [kg/m³]."""
    if units == "grain":
        return units_of(grain_volumes, densities, gravity)
    length = _LENGTHS[units] if isinstance(units, str) else float(units)
    return GrainUnits(length, 1.0, 1.0)


def factors_of(scales: GrainUnits) -> dict[str, float]:
    """Return factors to SI as the manifest has them: lengths in m, masses in kg, times in s."""
    return {"length": scales.length, "mass": scales.mass, "time": scales.time}
