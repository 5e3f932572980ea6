"""What form grains have.

References
----------
.. [1] H. Wadell, "Volume, shape, and roundness of quartz particles", J. Geology 43 (1935) 250-280.
.. [2] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted
   granular material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, equation 4.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.integrals import integrate

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra


def sphericities(grains: Polyhedra) -> NDArray[np.float64]:
    """Return Wadell's sphericity of each grain, shape (n,): surface of the equal-volume sphere over its own.

    Notes
    -----
    S = π^(1/3) (6 V)^(2/3) / A: 1 for a sphere, 0.806 for a cube, 0.671 for a regular tetrahedron.
    """
    measured = integrate(grains)
    return wadell(measured.volumes, measured.areas)


def wadell(volumes: NDArray[np.float64], areas: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return Wadell's sphericity from volumes [m³] and surface areas [m²]."""
    result: NDArray[np.float64] = np.cbrt(np.pi) * np.cbrt(6 * volumes) ** 2 / areas
    return result
