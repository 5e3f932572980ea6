"""What form grains have: sphericity, axes, and the class that their proportions put them in.

References
----------
.. [1] H. Wadell, "Volume, shape, and roundness of quartz particles", J. Geology 43 (1935) 250-280.
.. [2] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted
   granular material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, equation 4.
.. [3] W. C. Krumbein, "Measurement and geological significance of shape and roundness of sedimentary particles",
   J. Sedimentary Petrology 11 (1941) 64-72.
.. [4] Th. Zingg, "Beitrag zur Schotteranalyse", Schweizerische Mineralogische und Petrographische Mitteilungen 15
   (1935) 39-140.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.forms.boxes import boxes_on_faces
from grainsdem.geometry.forms.outlines import outline_roundnesses
from grainsdem.geometry.forms.sizes import above_zero, grain_sphericities
from grainsdem.geometry.integrals import integrate
from grainsdem.model import Packing
from grainsdem.model.arrays import LONGEST, SHORTEST
from grainsdem.model.given import grains_of
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model.given import Grains

    Floats = NDArray[np.float64]

ZINGG_BOUND = 2 / 3
"""Ratio of axes that parts Zingg's classes."""

ZINGG_CLASSES = ("blade", "rod", "disc", "spheroid")
"""Zingg's classes: neither ratio above the bound, c/b alone, b/a alone, both."""


@gated
def sphericities(grains: Grains) -> Floats:
    """Return Wadell's sphericity of each grain, shape (n,): surface of the equal-volume sphere over its own.

    Parameters
    ----------
    grains : Packing or Polyhedra
        Of a planar packing it is the perimeter of the circle of equal area over the outline's; grains alone do not know
        that they are flat.

    Raises
    ------
    InputError
        If a grain's volume is not above zero: it is empty, or wound inside out.

    Notes
    -----
    S = π^(1/3) (6 V)^(2/3) / A: 1 for a sphere, 0.806 for a cube, 0.671 for a regular tetrahedron.
    """
    return grain_sphericities(grains)


@gated
def ellipsoid_axes(grains: Grains, *, measured: Integrals | None = None) -> Floats:
    """Return the axes [m] a >= b >= c, shape (n, 3), of the ellipsoid that turns like each grain.

    Parameters
    ----------
    grains : Packing or Polyhedra
        Closed polyhedra.
    measured : Integrals, optional
        What `integrate` returned for them, where it is known already.

    Raises
    ------
    InputError
        If a grain's volume is not above zero: it is empty, or wound inside out.

    Notes
    -----
    Full lengths along the principal axes of inertia, of the ellipsoid with the grain's moments of inertia a mass:
    a_k = 2 √(5 ∫x_k² dV / V). A ball has its diameter three times; a cube of edge s has s √(5/3).
    """
    found = measured or integrate(grains)
    above_zero(found.volumes)
    moments = np.linalg.eigvalsh(found.inertias)  # rising: the longest axis has the least moment
    squares = 0.5 * moments.sum(axis=1, keepdims=True) - moments
    return np.asarray(2 * np.sqrt(5 * np.maximum(squares, 0.0) / found.volumes[:, None]))


@gated
def box_axes(grains: Grains) -> Floats:
    """Return the edges [m] a >= b >= c, shape (n, 3), of each grain's smallest box with a side on one of its faces.

    Parameters
    ----------
    grains : Packing or Polyhedra
        Convex grains; which way their faces are wound does not matter.

    Notes
    -----
    The caliper axes of sedimentology. A grain passes a square opening of width b, and most pass a smaller one, see
    `sieve_diameters`. Another box, that only edges of the grain lie on, may be smaller still, as the cube around a
    regular tetrahedron is.
    """
    return boxes_on_faces(grains_of(grains))


@gated
def roundness(grains: Grains) -> Floats:
    """Return Wadell's roundness of each grain, shape (n,): the radius of its corners over that of the circle inside.

    Parameters
    ----------
    grains : Packing or Polyhedra
        Convex grains. Of a planar packing it is that of the outline in its plane.

    Notes
    -----
    The mean of the outlines seen along the three edges of the smallest box on a face (`box_axes`). Of an outline it is
    the mean radius of the arcs that fit into its corners, each counted by the angle that it turns by, over the radius
    of the largest circle inside. Arcs grow alike until two have used up the side between them.

    A polyhedron of few faces may stand for a smooth grain. A corner of an outline that turns by 45° or less is taken
    for part of an arc, one of 90° or more is sharp, and between the two it counts in part. A side that cuts less than
    1 % of the circle's radius off a corner is taken for none. So a cube has 0, a ball 1, and a cube whose edges are
    bevelled to arcs of radius r has 2 r over its edge exactly. Balls of 32 corners have 0.87, of 1000 0.98. A regular
    hexagon counts as 2/3 and an octagon as 1: whether eight sides were meant as a circle is not known.
    """
    if isinstance(grains, Packing) and grains.domain.is_planar:
        return np.asarray(outline_roundnesses(grains.grains, upright=True)[:, 2])
    return np.asarray(outline_roundnesses(grains_of(grains)).mean(axis=1))


@gated
def krumbein(axes: ArrayLike) -> Floats:
    """Return Krumbein's intercept sphericity (b c / a²)^(1/3), shape (n,), of axes a >= b >= c.

    Parameters
    ----------
    axes : array_like, shape (n, 3)
        Finite, or not a number where a grain has none.

    Raises
    ------
    ShapeError, InputError
        If the shape is another, or axes do not fall.
    """
    a, b, c = _checked(axes).T
    return cube_roots(b * c / a**2)


@gated
def zingg(axes: ArrayLike) -> NDArray[np.str_]:
    """Return the Zingg class of axes a >= b >= c: one of `ZINGG_CLASSES` a grain, empty for NaN.

    Parameters
    ----------
    axes : array_like, shape (n, 3)
        Finite, or not a number where a grain has none.

    Raises
    ------
    ShapeError, InputError
        If the shape is another, or axes do not fall.

    Examples
    --------
    >>> zingg([[3.0, 1.0, 0.9], [3.0, 2.9, 1.0]]).tolist()
    ['rod', 'disc']
    """
    a, b, c = _checked(axes).T
    classes = np.array(ZINGG_CLASSES)[2 * (b / a > ZINGG_BOUND) + 1 * (c / b > ZINGG_BOUND)]
    return np.where(np.isnan(a), "", classes)


def _checked(axes: ArrayLike) -> Floats:
    found = np.asarray(axes, dtype=np.float64)
    if found.ndim != 2 or found.shape[1] != 3:
        raise ShapeError(f"axes must have shape (n, 3); got {found.shape}")
    a, b, c = found.T
    falling = (a <= LONGEST) & (a >= b) & (b >= c) & (c >= SHORTEST)
    bad = np.flatnonzero(~falling & ~np.isnan(found).any(axis=1))
    if bad.size:
        raise InputError(f"axes must be a >= b >= c > 0; {bad.size} rows are not: {name_offenders(bad)}")
    return found
