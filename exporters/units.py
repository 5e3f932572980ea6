"""Grain units: lengths in median grain diameters, densities in grain densities, and gravity one.

Programs with tolerances of their own (MuJoCo, for one) refuse or blur a millimetre in SI; in these units a
bed of 0.2 mm sand and one of 0.1 m cobbles are the same numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from exporters.check import check_positive
from grainsdem.geometry.integrals import volumes

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True)
class GrainUnits:
    """Factors from grain units to SI: a value in grain units times the factor is the value in SI.

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
    length = float(np.median(np.cbrt(grain_volumes * (6.0 / np.pi))))
    density = float(grain_volumes @ densities / grain_volumes.sum())
    return GrainUnits(length, density * length**3, float(np.sqrt(length / gravity)))
