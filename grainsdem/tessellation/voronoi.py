"""Voronoi and Laguerre cells cut by the domain.

References
----------
.. [1] F. Aurenhammer, "Power diagrams: properties, algorithms and applications", SIAM J. Comput. 16 (1987) 78-96.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import GrainsDEMError, InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.integrals import volumes
from grainsdem.memory import A_CELL, allow_memory
from grainsdem.model import Polyhedra, Tessellation
from grainsdem.model.arrays import LONGEST
from grainsdem.points.check import check_seeds
from grainsdem.ragged import owners
from grainsdem.tessellation.engine.frame import Frame
from grainsdem.tessellation.engine.full import full_cells
from grainsdem.tessellation.engine.tree import build

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain


VOLUME_TOLERANCE = 1e-11
"""What the sum of the volumes may be off, relative to the domain: some 1e-15 for all but nearly coincident seeds."""


@gated
def tessellate(seeds: ArrayLike, domain: Domain, *, weights: ArrayLike | None = None) -> Tessellation:
    """Return the Voronoi cells of ``seeds``, or their Laguerre cells, cut by the walls of ``domain``.

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        Positions [m]; shape (n, 2) is taken as lying in the mid-plane of a planar domain.
    domain : Domain
        What the cells fill.
    weights : array_like, shape () or (n,), optional
        Laguerre weights w [m²]: a point x belongs to the seed of least |x − s|² − w. Only their differences matter.

    Returns
    -------
    Tessellation
        One cell a seed, in the order of the seeds. A Laguerre cell may be empty: it has no vertices and no faces.

    Raises
    ------
    ShapeError
        If the seeds or the weights have the wrong shape.
    InputError
        If seeds are outside the domain, not finite or equal to one another, or a weight is not finite.
    GrainsDEMError
        If the cells cannot be told apart in double precision, as may be where several seeds are nearer to one another
        than some 1e-8 of the domain.

    Notes
    -----
    Every face is seen from both its cells. Vertices nearer than some 1e-13 of the domain's size are one vertex, and
    faces without area are none, so the cells of lattices have exactly their faces. The result is the same to the last
    byte whatever the number of threads.

    Examples
    --------
    >>> from grainsdem.model import Domain
    >>> tessellate([[0.25, 0.5, 0.5], [0.75, 0.5, 0.5]], Domain.cube()).neighbors.tolist()
    [-1, -3, -4, -5, -6, 1, -2, -3, -4, -5, -6, 0]
    """
    sites = check_seeds(seeds, domain)
    allow_memory(len(sites), A_CELL, "cells")
    given = check_weights(weights, len(sites))
    frame = Frame.of(domain)
    # Only differences matter, and the largest difference from the mean is rounded least.
    relative = (given - given.mean()) / frame.scale**2
    compiled("cells")
    cells = full_cells(build(frame.inward(sites), relative), frame)
    polyhedra = Polyhedra(cells.vertices, cells.vertex_offsets, cells.face_offsets, cells.corners, cells.corner_offsets)
    result = Tessellation(domain, sites, given, polyhedra, cells.neighbors, cells.shifts)
    _check_volume(result)
    return result


def _check_volume(cells: Tessellation) -> None:
    """Refuse cells that do not fill their domain, and name the seeds that are nearest to each other."""
    total = float(volumes(cells.cells).sum())
    if abs(total / cells.domain.volume - 1) <= VOLUME_TOLERANCE:
        return
    i, j = owners(cells.cells.face_offsets), cells.neighbors.astype(np.int64)
    inner = np.flatnonzero((j >= 0) & (i < j))
    apart = cells.sites[j[inner]] + cells.shifts[inner] * cells.domain.lengths - cells.sites[i[inner]]
    distances = np.linalg.norm(apart, axis=1)
    nearest = inner[np.argsort(distances, kind="stable")]
    pairs = name_offenders([f"{a}–{b}" for a, b in zip(i[nearest], j[nearest], strict=True)][:5])
    raise GrainsDEMError(
        f"the cells' volumes sum to {total / cells.domain.volume!r} of the domain's: double precision cannot tell the "
        f"cells of seeds apart that are as near as {distances.min(initial=np.inf):.3g} m; the nearest are {pairs}"
    )


def check_weights(weights: ArrayLike | None, n: int) -> NDArray[np.float64]:
    """Return the weights as a fresh array, shape (n,); zeros where none are given."""
    if weights is None:
        return np.zeros(n)
    try:
        given = np.array(weights, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"weights must be numbers in an array of shape ({n},); {error}") from error
    if given.shape not in ((), (n,)):
        raise ShapeError(f"weights must have shape ({n},), one a seed; got {given.shape}")
    # Squares of lengths; where larger ones are no numbers any more, cells would never be found.
    bad = np.flatnonzero(~(np.abs(np.atleast_1d(given)) <= LONGEST**2))
    if bad.size:
        raise InputError(f"weights must be within ±{LONGEST**2:g} m²; {bad.size} are not: {name_offenders(bad)}")
    return np.broadcast_to(given, (n,)).copy()
