"""A point that is proven to lie in the void: snappyHexMesh keeps the cells that can be reached from it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.void.region import Region
    from exporters.void.solids import Solids
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

CANDIDATES = 20_000
"""About how many points are tried."""


def void_point(grains: Packing, treated: Solids, region: Region, cells: NDArray[np.int64]) -> tuple[Floats, float]:
    """Return the centre of a background cell that is as far from every solid as any that was tried.

    Parameters
    ----------
    grains : Packing
        The grains before their contacts were treated.
    treated : Solids
        What became of them.
    region : Region
        The flow domain.
    cells : ndarray of int, shape (3,)
        Background cells along each axis.

    Returns
    -------
    point : ndarray, shape (3,)
        The point [m]. A cell's centre lies on no face of the mesh.
    clearance : float
        A distance [m] from the point within which there is certainly no solid: for each grain the largest distance of
        the point from one of its face planes, for each bridge that from its axis less its radius.

    Raises
    ------
    InputError
        If no point that was tried is clear of the solids by half a cell.
    """
    size = (region.upper - region.lower) / cells
    stride = np.maximum(1, np.ceil((np.prod(cells) / CANDIDATES) ** (1 / 3))).astype(int)
    axes = [region.lower[k] + size[k] * (np.arange(stride // 2, cells[k], stride) + 0.5) for k in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    clear = _clearance(points, grains, treated)
    if len(region.planes):
        clear = np.minimum(clear, (region.planes[:, 3] - points @ region.planes[:, :3].T).min(axis=1))
    # Of points that are equally good, the one nearest to the middle: at the border it may lie in a corner.
    best = int(np.argmax(clear - 1e-3 * np.linalg.norm(points - 0.5 * (region.lower + region.upper), axis=1)))
    if clear[best] < 0.5 * size.max():
        raise InputError(
            f"no point of the void is half a cell, {0.5 * size.max():.3g} m, from all grains: the widest clearance "
            f"found is {clear[best]:.3g} m; use more cells a diameter or a higher porosity"
        )
    return points[best], float(clear[best])


def _clearance(points: Floats, grains: Packing, treated: Solids) -> Floats:
    """Return a lower bound of each point's distance from the solids; negative inside one."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (half a second)

    planes = face_planes(grains.grains)
    turns = to_matrices(grains.quaternions)
    offsets, rows = grains.grains.vertex_offsets, grains.grains.face_offsets
    radii = np.sqrt(np.maximum.reduceat((grains.grains.vertices**2).sum(axis=1), offsets[:-1])) * treated.growth
    clear = np.full(len(points), float(radii.max()))
    # A point farther than two radii from a grain is one radius from it: nearer grains decide.
    near = cKDTree(points).query_ball_point(grains.positions, 2 * radii.max())
    for i, found in enumerate(near):
        if found:
            local = (points[found] - grains.positions[i]) @ turns[i]
            faces = slice(rows[i], rows[i + 1])
            outside = (local @ planes.normals[faces].T - treated.growth * planes.heights[faces]).max(axis=1)
            clear[found] = np.minimum(clear[found], outside)
    for first, last in treated.bridges:
        along = last - first
        share = np.clip((points - first) @ along / (along @ along), 0, 1)
        away = np.linalg.norm(points - first - share[:, None] * along, axis=1)
        clear = np.minimum(clear, away - treated.radius)
    return clear
