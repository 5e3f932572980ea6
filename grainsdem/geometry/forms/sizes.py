"""How large and how round grains are, in space and, for the prisms of a planar bed, in their plane."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, name_offenders
from grainsdem.geometry.integrals import integrate
from grainsdem.model import Packing
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model.given import Grains

    Floats = NDArray[np.float64]


def above_zero(volumes: Floats) -> Floats:
    """Return volumes [m³] that are grains', or raise `InputError` where one is not above zero, and name it."""
    bad = np.flatnonzero(~(volumes > 0))
    if bad.size:
        raise InputError(
            f"grains must have volumes above zero, faces counter-clockwise seen from outside; {bad.size} of "
            f"{volumes.size} have not: {name_offenders(bad)} (of the first it is {volumes[bad[0]]:.4g} m3)"
        )
    return volumes


def sphere_diameters(volumes: Floats) -> Floats:
    """Return the diameters [m] of the spheres of the given volumes [m³]."""
    return cube_roots(6 * above_zero(volumes) / np.pi)


def wadell(volumes: Floats, areas: Floats) -> Floats:
    """Return Wadell's sphericity from volumes [m³] and surface areas [m²]."""
    result: Floats = cube_roots(np.pi) * cube_roots(6 * above_zero(volumes)) ** 2 / areas
    return result


def grain_diameters(grains: Grains, measured: Integrals | None = None) -> Floats:
    """Return the diameter [m] of each grain's equal-volume sphere, or in a planar bed of its equal-area circle."""
    measured = measured or integrate(grains)
    if not (isinstance(grains, Packing) and grains.domain.is_planar):
        return sphere_diameters(measured.volumes)
    return np.sqrt(4 / np.pi * above_zero(measured.volumes) / thickness(grains))


def grain_sphericities(grains: Grains, measured: Integrals | None = None) -> Floats:
    """Return each grain's sphericity; in a planar bed the circle of equal area's perimeter over the grain's own.

    Notes
    -----
    A prism of thickness t has a base of area V / t, and a perimeter of (A - 2 V / t) / t.
    """
    measured = measured or integrate(grains)
    if not (isinstance(grains, Packing) and grains.domain.is_planar):
        return wadell(measured.volumes, measured.areas)
    t = thickness(grains)
    base = above_zero(measured.volumes) / t
    result: Floats = 2 * np.sqrt(np.pi * base) * t / (measured.areas - 2 * base)
    return result


def thickness(packing: Packing) -> float:
    """Return the thickness [m] of a planar bed."""
    return float(packing.domain.lengths[2])


def weighted_percentiles(x: Floats, q: Floats, w: Floats) -> Floats:
    """Return the values below which the percentages ``q`` of the weight lie; Hazen's definition for equal weights."""
    order = np.lexsort((w, x))  # equal values by their weight: the order they are given in must not matter
    order = order[w[order] > 0]  # a grain that counts for nothing must not bend the curve
    x, w = x[order], w[order]
    running = np.cumsum(w)
    return np.asarray(np.interp(q, 100 * (running - 0.5 * w) / running[-1], x))
