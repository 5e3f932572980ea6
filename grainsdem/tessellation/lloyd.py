"""Lloyd's relaxation: every seed moves to the centroid of its cell, again and again.

References
----------
.. [1] Q. Du, V. Faber, M. Gunzburger, "Centroidal Voronoi tessellations: applications and algorithms",
   SIAM Review 41 (1999) 637-676.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.points.check import check_seeds
from grainsdem.tessellation.frame import Frame
from grainsdem.tessellation.light import moments
from grainsdem.tessellation.tree import build

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain


def relax(
    seeds: ArrayLike,
    domain: Domain,
    *,
    iterations: int = 10,
    progress: Callable[[int], None] | None = None,
) -> NDArray[np.float64]:
    """Return the seeds after Lloyd iterations towards a centroidal Voronoi tessellation (CVT).

    Parameters
    ----------
    seeds : array_like, shape (n, 3)
        Positions [m].
    domain : Domain
        What the cells fill; seeds wrap around its periodic axes.
    iterations : int
        How many times every seed moves to the centroid of its cell.
    progress : callable, optional
        Called with the number of each finished iteration, from 1.

    Returns
    -------
    ndarray, shape (n, 3)
        Relaxed positions [m].

    Raises
    ------
    InputError
        If ``iterations`` is negative, or the seeds cannot be tessellated.
    """
    if iterations < 0:
        raise InputError(f"iterations must be zero or more; got {iterations}")
    sites = check_seeds(seeds, domain)
    frame = Frame.of(domain)
    weights = np.zeros(len(sites))
    for iteration in range(iterations):
        cells = moments(build(frame.inward(sites), weights), frame)
        sites = inside(sites + cells.centroids, domain)
        if progress is not None:
            progress(iteration + 1)
    return sites


def inside(sites: NDArray[np.float64], domain: Domain) -> NDArray[np.float64]:
    """Return the sites wrapped around the periodic axes; a centroid is inside but for rounding."""
    wrapped = domain.lower + np.mod(sites - domain.lower, domain.lengths)
    return np.clip(np.where(domain.periodic, wrapped, sites), domain.lower, domain.upper)
