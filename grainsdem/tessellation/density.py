"""Centroids weighted by a density: equation 3 of Buscombe and Rubin (2012)."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.triangles import triangles
from grainsdem.ragged import owners, sum_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain, Tessellation

    Floats = NDArray[np.float64]

Density: TypeAlias = "Callable[[Floats], ArrayLike] | ArrayLike"
"""Density at points, shape (m, 3) to (m,), or an array of voxels that fill the domain's box."""

NODES = 0.1381966011250105
"""(5 - √5) / 20: the rule of four points that is exact for quadratics (Hammer and Stroud 1956)."""

BATCH = 200_000
"""Tetrahedra that are measured at once: some 100 MB."""


def sampler(density: Density, domain: Domain) -> Callable[[Floats], Floats]:
    """Return a function that gives the density at points, shape (m, 3) to (m,), and checks what it gives.

    Raises
    ------
    ShapeError
        If voxels are not three-dimensional, or a callable does not return one value a point.
    InputError
        If a density is negative or not finite, or voxels are zero everywhere.
    """
    if callable(density):

        def called(points: Floats) -> Floats:
            values = np.asarray(density(points), dtype=np.float64)
            if values.shape != (len(points),):
                raise ShapeError(f"the density must return shape ({len(points)},); got {values.shape}")
            return _checked(values)

        return called
    voxels = np.asarray(density, dtype=np.float64)
    if voxels.ndim != 3 or voxels.size == 0:
        raise ShapeError(f"a density of voxels must have three axes; got shape {voxels.shape}")
    if not _checked(voxels).any():
        raise InputError("the density must not be zero everywhere")

    def looked_up(points: Floats) -> Floats:
        index = ((points - domain.lower) / domain.lengths * voxels.shape).astype(np.int64)
        i, j, k = np.clip(index, 0, np.array(voxels.shape) - 1).T
        return np.asarray(voxels[i, j, k])

    return looked_up


def _checked(values: Floats) -> Floats:
    if not (np.isfinite(values).all() and (values >= 0).all()):
        raise InputError(f"the density must be finite and not negative; got {values.min()}")
    return values


def weighted_centroids(cells: Tessellation, density: Callable[[Floats], Floats]) -> tuple[Floats, Floats]:
    """Return the centroid of each cell under a density, relative to its site, shape (n, 3), and its energy, shape (n,).

    Notes
    -----
    Each cell is cut into tetrahedra from its site, and ∫ ρ and ∫ ρ x taken by four points in each. Where the density
    is zero in a whole cell, its centroid is that of its volume.
    """
    shapes, sites = cells.cells, cells.sites
    cut = triangles(shapes)
    owner = owners(cut.offsets)
    sums = np.zeros((len(cells), 5))
    step = max(1, round(BATCH * len(cells) / max(len(owner), 1)))
    for first in range(0, len(cells), step):
        last = min(first + step, len(cells))
        span = slice(cut.offsets[first], cut.offsets[last])
        mine = owner[span]
        corners = shapes.vertices[cut.indices[span] + shapes.vertex_offsets[mine][:, None]]
        volumes = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
        total = corners.sum(axis=1)
        rows = np.zeros((len(mine), 5))
        # The site is the fourth corner, at the origin of its cell.
        nodes = [NODES * total, *(NODES * total + (1 - 4 * NODES) * corners[:, k] for k in range(3))]
        for node in nodes:
            weight = 0.25 * volumes * density(_wrapped(node + sites[mine], cells.domain))
            rows += weight[:, None] * np.column_stack([np.ones(len(node)), node, np.sum(node**2, axis=1)])
        sums[first:last] = sum_rows(rows, cut.offsets[first : last + 1] - cut.offsets[first])
    mass = sums[:, :1]
    plain = integrate(shapes).centroids
    return np.where(mass > 0, sums[:, 1:4] / np.where(mass > 0, mass, 1.0), plain), sums[:, 4]


def _wrapped(points: Floats, domain: Domain) -> Floats:
    """Return points of cells that reach across periodic axes at their places in the domain."""
    inside = domain.lower + np.mod(points - domain.lower, domain.lengths)
    return np.where(domain.periodic, inside, points)
