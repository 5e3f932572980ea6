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
from grainsdem.geometry.integrals import centroids
from grainsdem.points.check import check_seeds
from grainsdem.tessellation.voronoi import tessellate

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
    """Return the seeds after Lloyd iterations towards a centroidal Voronoi tessellation (CVT)."""
    if iterations < 0:
        raise InputError(f"iterations must be zero or more; got {iterations}")
    sites = check_seeds(seeds, domain)
    for iteration in range(iterations):
        sites = sites + centroids(tessellate(sites, domain).cells)
        if progress is not None:
            progress(iteration + 1)
    return sites
