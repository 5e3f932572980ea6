"""Graded beds: grains whose size goes linearly with place, by the density of the paper's equation 3.

Sizes h that go linearly along an axis have h⁻³ seeds a volume (h⁻² an area), which is solved for in closed form, and
centroidal cells of them have the density ν = h⁻⁵ (h⁻⁴): in the limit there are ν^(3/5) seeds a volume, ν^(1/2) an area.

References
----------
.. [1] D. D. Buscombe, D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, equation 3.
.. [2] Q. Du, V. Faber, M. Gunzburger, "Centroidal Voronoi tessellations: applications and algorithms",
   SIAM Review 41 (1999) 637-676: the exponent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import check_within
from grainsdem.roots import raised

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

Axis = Literal["x", "y", "z"]

STEEPEST = 20.0
"""Largest ratio of sizes at the two ends: of more there are thousands of small grains for a large one."""


@gated_noun
@dataclass(frozen=True, slots=True)
class Grade:
    """Sizes of grains that go linearly along an axis.

    Parameters
    ----------
    ratio : float
        Size at the upper end of the domain over that at the lower end: below one the bed fines upward.
    along : {"x", "y", "z"}
        The axis.

    Raises
    ------
    InputError
        If the ratio is out of range or the axis unknown.
    """

    ratio: float
    along: Axis = "z"

    def __post_init__(self) -> None:
        if self.along not in get_args(Axis):
            raise InputError(f"along must be 'x', 'y' or 'z'; got {self.along!r}")
        if not 1 / STEEPEST <= self.ratio <= STEEPEST:
            raise InputError(f"ratio must lie from {1 / STEEPEST} to {STEEPEST:g}; got {self.ratio}")

    def moved(self, seeds: Floats, domain: Domain) -> Floats:
        """Return uniform seeds [m], shape (n, 3), moved along the axis to where there are so many of each size.

        Raises
        ------
        InputError
            If the domain wraps around along the axis, is a slab that is graded across, or has planes.
        """
        axis = self._axis(domain)
        if len(domain.planes):
            raise InputError("seeds are graded in boxes and slabs; the domain is cut by planes")
        check_within("seeds", seeds)
        low, length = domain.lower[axis], domain.lengths[axis]
        u = np.clip((seeds[:, axis] - low) / length, 0.0, 1.0)
        if self.ratio == 1:
            return seeds
        # Of u the share below, h = 1 + (r - 1) t the size at t.
        if domain.is_planar:
            size = 1 / (1 - u * (1 - 1 / self.ratio))
        else:
            size = 1 / np.sqrt(1 - u * (1 - 1 / self.ratio**2))
        moved = seeds.copy()
        moved[:, axis] = np.clip(low + length * (size - 1) / (self.ratio - 1), low, domain.upper[axis])
        return moved

    def density(self, domain: Domain) -> Callable[[Floats], Floats]:
        """Return the density ν that centroidal cells of such sizes have, a function of points [m], shape (m, 3)."""
        axis = self._axis(domain)
        low, length = float(domain.lower[axis]), float(domain.lengths[axis])
        power = 4 if domain.is_planar else 5

        def density(points: Floats) -> Floats:
            size = 1 + (self.ratio - 1) * np.clip((points[:, axis] - low) / length, 0.0, 1.0)
            return 1 / raised(size, power)

        return density

    def _axis(self, domain: Domain) -> int:
        axis = "xyz".index(self.along)
        if domain.periodic[axis]:
            raise InputError(f"the domain wraps around along {self.along}: sizes cannot be graded there")
        if domain.is_planar and axis == 2:
            raise InputError("a slab is one grain thick along z: grade it along x or y")
        return axis
