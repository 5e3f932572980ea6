"""Round shapes: ellipsoids, and superellipsoids from boxes over cylinders to spindles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.hulls import convex_hull, outline
from grainsdem.geometry.integrals import volumes
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.shapes.directions import spread
from grainsdem.shapes.simplifying import FEWEST, simplified
from grainsdem.shapes.sizing import centred, check_positive, scaled

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

N_VERTICES = 32
"""Corners of a round shape by default: 60 faces, and PhysX holds 64 of either."""

_SAMPLE = 4000
"""Points of a superellipsoid's surface that corners are chosen among."""


@gated
def ellipsoid(a: float, b: float, c: float, *, n_vertices: int = N_VERTICES) -> Polyhedra:
    """Return an ellipsoid as a polyhedron of triangles, about its centroid.

    Parameters
    ----------
    a, b, c : float
        Axes [m], full lengths along x, y and z.
    n_vertices : int
        Number of corners, four or more.

    Returns
    -------
    Polyhedra
        One shape of the ellipsoid's own volume, π a b c / 6, so that it is as heavy: its corners lie a little outside
        of it, its faces inside. The corners of 32 lie 6 % farther out than the ellipsoid, those of 64 lie 3 %.

    Raises
    ------
    InputError
        If an axis is not positive, or there are too few corners.
    """
    check_positive(a=a, b=b, c=c)
    _check_number(n_vertices)
    shape = centred(convex_hull(0.5 * spread(n_vertices) * [a, b, c]))
    return _of_volume(shape, np.pi / 6 * a * b * c)


@gated
def superellipsoid(
    a: float, b: float, c: float, *, exponents: tuple[float, float] = (1.0, 1.0), n_vertices: int = N_VERTICES
) -> Polyhedra:
    """Return a superellipsoid as a polyhedron, about its centroid.

    Parameters
    ----------
    a, b, c : float
        Axes [m], full lengths along x, y and z.
    exponents : tuple of two floats
        ε₁ of sections along z and ε₂ of the section across it, each in (0, 2]: 1 is an ellipse, near 0 a rectangle, 2 a
        rhomb. (1, 1) is the ellipsoid, (0.2, 1) nearly a cylinder, (0.2, 0.2) nearly a box, (2, 2) an octahedron.
    n_vertices : int
        Number of corners at most, four or more.

    Returns
    -------
    Polyhedra
        One shape of the superellipsoid's own volume, as `ellipsoid`.

    Raises
    ------
    InputError
        If a number is out of range.

    Notes
    -----
    (|2x/a|^(2/ε₂) + |2y/b|^(2/ε₂))^(ε₂/ε₁) + |2z/c|^(2/ε₁) = 1 [1]_; it is convex for exponents up to 2. Its volume is
    a b c ε₁ ε₂ B(ε₁/2 + 1, ε₁) B(ε₂/2, ε₂/2) / 4, B being the beta function.

    References
    ----------
    .. [1] A. H. Barr, "Superquadrics and angle-preserving transformations", IEEE Computer Graphics and Applications 1
       (1981) 11-23.
    """
    check_positive(a=a, b=b, c=c)
    _check_number(n_vertices)
    if len(exponents) != 2 or not all(0 < e <= 2 for e in exponents):
        raise InputError(f"exponents are two numbers in (0, 2], for a shape that is convex; got {exponents}")
    from scipy.special import beta  # noqa: PLC0415  (a tenth of a second)

    first, second = exponents
    hull = outline(0.5 * _surface(first, second) * [a, b, c])
    shape = centred(simplified(hull, n_vertices).shape)
    content = beta(first / 2 + 1, first) * beta(second / 2, second / 2)
    return _of_volume(shape, float(a * b * c * first * second * content / 4))


def _surface(first: float, second: float) -> NDArray[np.float64]:
    """Return points on the superellipsoid of half-axes one, where directions through its middle leave it."""
    x, y, z = np.abs(directions := spread(_SAMPLE)).T
    # Relative to the largest: high powers of small numbers vanish, and those of large ones are infinite.
    across = np.maximum(x, y)
    flat = across * ((x / across) ** (2 / second) + (y / across) ** (2 / second)) ** (second / 2)
    most = np.maximum(flat, z)
    size = most * ((flat / most) ** (2 / first) + (z / most) ** (2 / first)) ** (first / 2)
    points: NDArray[np.float64] = directions / size[:, None]
    return np.concatenate([points, np.eye(3), -np.eye(3)])


def _of_volume(shape: Polyhedra, volume: float) -> Polyhedra:
    return scaled(shape, np.cbrt(volume / volumes(shape)))


def _check_number(n_vertices: int) -> None:
    if n_vertices < FEWEST:
        raise InputError(f"a shape has {FEWEST} corners or more; got n_vertices = {n_vertices}")
    allow_memory(n_vertices, A_SEED, "corners")
