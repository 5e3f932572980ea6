"""Named solids with flat faces: Plato's five, boxes, prisms."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.hulls import convex_hull
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.shapes.sizing import centred, check_positive, sized

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra

_GOLDEN = (1 + 5**0.5) / 2

PLATONIC = ("tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron")
"""Names that `platonic` knows."""


@gated
def platonic(name: str, *, diameter: float = 1.0) -> Polyhedra:
    """Return one of Plato's solids, about its centre.

    Parameters
    ----------
    name : {"tetrahedron", "cube", "octahedron", "dodecahedron", "icosahedron"}
        Which one.
    diameter : float
        Of the sphere of equal volume [m].

    Raises
    ------
    InputError
        If there is no solid of that name, or the diameter is not positive.

    Examples
    --------
    >>> platonic("dodecahedron").n_faces
    12
    """
    if name not in PLATONIC:
        raise InputError(f"a Platonic solid is one of {', '.join(PLATONIC)}; got {name!r}")
    check_positive(diameter=diameter)
    return sized(convex_hull(_corners(name)), diameter)


@gated
def box(a: float, b: float, c: float) -> Polyhedra:
    """Return a brick about its centre, with edges [m] along x, y and z.

    Examples
    --------
    >>> from grainsdem import volumes
    >>> volumes(box(3.0, 2.0, 1.0)).round(12)
    array([6.])
    """
    check_positive(a=a, b=b, c=c)
    return convex_hull(0.5 * np.array(list(product((-a, a), (-b, b), (-c, c)))))


@gated
def prism(n: int, *, aspect: float = 1.0, diameter: float = 1.0) -> Polyhedra:
    """Return an upright prism over a regular polygon, about its centroid.

    Parameters
    ----------
    n : int
        Sides of the polygon, three or more.
    aspect : float
        Height over the diameter of the circle of the polygon's area: large for rods, small for flakes.
    diameter : float
        Of the sphere of equal volume [m].

    Raises
    ------
    InputError
        If a number is out of range.
    """
    if n < 3:
        raise InputError(f"the polygon of a prism has three sides or more; got {n}")
    check_positive(aspect=aspect, diameter=diameter)
    allow_memory(n, A_SEED, "corners")
    angles = 2 * np.pi / n * np.arange(n)
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    height = aspect * 2 * np.sqrt(0.5 * n * np.sin(2 * np.pi / n) / np.pi)
    corners = np.concatenate([np.insert(ring, 2, z, axis=1) for z in (-0.5 * height, 0.5 * height)])
    return sized(centred(convex_hull(corners)), diameter)


def _corners(name: str) -> NDArray[np.float64]:
    if name == "tetrahedron":
        return np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    if name == "dodecahedron":
        return np.vstack([_around(1, 1, 1), _around(0, 1 / _GOLDEN, _GOLDEN)])
    return {"cube": _around(1, 1, 1), "octahedron": _around(1, 0, 0), "icosahedron": _around(0, 1, _GOLDEN)}[name]


def _around(*point: float) -> NDArray[np.float64]:
    """Return a point with all signs and with its coordinates in all three cyclic orders, shape (k, 3)."""
    signed = [np.multiply(point, signs) for signs in product((1, -1), repeat=3)]
    return np.unique(np.round([np.roll(p, k) for p in signed for k in range(3)], 15) + 0.0, axis=0)
