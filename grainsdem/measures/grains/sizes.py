"""How large grains are: equal-volume diameters, masses, and percentiles of any of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.geometry.forms.boxes import rectangles
from grainsdem.geometry.forms.holes import square_holes
from grainsdem.geometry.forms.sizes import above_zero, grain_diameters, weighted_percentiles
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.model import Packing
from grainsdem.model.given import grains_of

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model.given import Grains


@gated
def diameters(grains: Grains) -> NDArray[np.float64]:
    """Return the diameter [m] of the sphere of each grain's volume, (6 V / π)^(1/3), shape (n,).

    Parameters
    ----------
    grains : Packing or Polyhedra
        Of a planar packing it is the diameter of the circle of equal area; grains alone do not know that they are flat.

    Raises
    ------
    InputError
        If a grain's volume is not above zero: it is empty, or wound inside out.
    """
    return grain_diameters(grains)


@gated
def sieve_diameters(grains: Grains) -> NDArray[np.float64]:
    """Return the side [m] of the smallest square hole that each grain passes, turned as it may be, shape (n,).

    Parameters
    ----------
    grains : Packing or Polyhedra
        Convex grains. Of a planar packing it is the narrowest slit that each outline passes, its least width.

    Notes
    -----
    A grain passes along the hole's axis where its shadow along it does: the side is the least of max(w(u), w(v)) over
    all directions u and v at right angles, w the width of the grain. It is looked for among all orientations, and what
    is found is one's; it is above the least of all by less than 0.5 % (0.1 % at most on 1800 grains of all kinds).
    A ball passes a square of its diameter, a regular tetrahedron of edge 1 one of 1/√2, a brick with edges a >= b >= c
    one of min(b, (b + c) / √2), and a disc of diameter D and thickness t one of min(D, (D + t) / √2): thin grains pass
    along the diagonal.

    Examples
    --------
    A cube passes a hole of its edge, and no smaller one.

    >>> from grainsdem import Domain, carve, tessellate
    >>> sieve_diameters(carve(tessellate([[0.5, 0.5, 0.5]], Domain.cube()), keep="all")).round(3)
    array([1.])
    """
    if isinstance(grains, Packing) and grains.domain.is_planar:
        return rectangles(world_vertices(grains)[:, :2], grains.grains.vertex_offsets)[:, 2]
    return square_holes(grains_of(grains))


@gated
def masses(packing: Packing) -> NDArray[np.float64]:
    """Return the mass [kg] of each grain, density times exact volume, shape (n,).

    Raises
    ------
    InputError
        If a grain's volume is not above zero, or grains are given without the packing that has their densities.
    """
    return packing.densities * above_zero(volumes(packing))


@gated
def percentiles(values: ArrayLike, q: ArrayLike, *, weights: ArrayLike | None = None) -> NDArray[np.float64]:
    """Return the values below which the given percentages lie, by number or by weight.

    Parameters
    ----------
    values : array_like, shape (n,)
        One value a grain, diameters as a rule.
    q : array_like, shape (...)
        Percentages in [0, 100]: 10, 50 and 90 give d10, d50 and d90.
    weights : array_like, shape (n,)
        What each grain counts for, zero or more: its mass gives percentiles by mass. Without it each counts for one.

    Returns
    -------
    ndarray, shape (...)
        Values in the units of ``values``.

    Raises
    ------
    ShapeError
        If ``values`` is not one-dimensional, or there is not one weight a value.
    InputError
        If there is no value, one is not finite, a percentage is out of range, or the weights are negative,
        not finite or sum to zero.

    Notes
    -----
    With the values sorted and W_k the running sum of their weights w_k, value k stands at the percentage
    100 (W_k - w_k / 2) / W_n, half of it lying below itself; between two values it is interpolated linearly,
    and beyond the first and last it is theirs. With equal weights this is Hazen's definition.

    Examples
    --------
    >>> percentiles([1.0, 2.0, 3.0], 50)
    array(2.)
    >>> percentiles([1.0, 2.0], [25, 50], weights=[1.0, 3.0])
    array([1.25, 1.75])
    """
    x = np.asarray(values, dtype=np.float64)
    w = np.ones(x.shape) if weights is None else np.asarray(weights, dtype=np.float64)
    percentages = np.asarray(q, dtype=np.float64)
    if x.ndim != 1 or w.shape != x.shape:
        raise ShapeError(f"values and weights must have the same shape (n,); got {x.shape} and {w.shape}")
    if x.size == 0:
        raise InputError("percentiles need at least one value; got none")
    if not np.isfinite(x).all():
        raise InputError(f"values must be finite; {int((~np.isfinite(x)).sum())} of {x.size} are not")
    if not (np.isfinite(w).all() and (w >= 0).all() and w.sum() > 0):
        raise InputError(f"weights must be finite, zero or more, and not all zero; the least is {float(w.min())}")
    if not ((percentages >= 0) & (percentages <= 100)).all():
        raise InputError(f"percentages must lie in [0, 100]; got {percentages.tolist()}")
    return weighted_percentiles(x, percentages, w)
