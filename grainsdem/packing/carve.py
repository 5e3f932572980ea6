"""From the cells of a tessellation to grains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.rotations import identity_quaternions
from grainsdem.model import DROPPED, QUARTZ_DENSITY, CellLinks, Packing, Polyhedra, Tessellation
from grainsdem.ragged import owners, take_indices

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

_LOWER_Z, _UPPER_Z = -5, -6  # walls as `Domain` numbers them


def carve(
    cells: Tessellation,
    *,
    keep: Literal["inside", "all"] = "inside",
    density: ArrayLike = QUARTZ_DENSITY,
) -> Packing:
    """Return the cells as grains that still touch: porosity zero, ready to be shrunk.

    Parameters
    ----------
    cells : Tessellation
        Cells of the domain.
    keep : {"inside", "all"}
        ``"inside"`` drops every cell that touches a wall, as the paper does; ``"all"`` keeps them. The two faces of a
        planar domain's slab are no walls: every cell touches both.
    density : array_like, shape () or (n_cells,)
        Density [kg/m³].

    Returns
    -------
    Packing
        Grains in the order of their cells, with links to their neighbours.

    Raises
    ------
    InputError
        If no cell is left, ``keep`` is unknown, or a density is not positive and finite.
    """
    if keep not in ("inside", "all"):
        raise InputError(f"keep must be 'inside' or 'all'; got {keep!r}")
    densities = np.broadcast_to(np.asarray(density, dtype=np.float64), (len(cells),))
    if not (np.isfinite(densities).all() and (densities > 0).all()):
        raise InputError(f"density must be positive and finite; got {float(densities.min())}")
    owner = owners(cells.cells.face_offsets)
    at_wall = np.zeros(len(cells), dtype=bool)
    is_wall = cells.neighbors < 0
    if cells.domain.is_planar:
        is_wall &= (cells.neighbors != _LOWER_Z) & (cells.neighbors != _UPPER_Z)
    at_wall[owner[is_wall]] = True
    # A Laguerre cell may be empty: it is no grain.
    has_faces = np.diff(cells.cells.face_offsets) > 0
    kept = np.flatnonzero(has_faces if keep == "all" else has_faces & ~at_wall)
    if kept.size == 0:
        raise InputError(
            f"all {len(cells)} cells touch a wall and would be dropped; use more seeds, a periodic domain or keep='all'"
        )
    grains, faces = select(cells.cells, kept)
    new_ids = np.full(len(cells), DROPPED, dtype=np.int32)
    new_ids[kept] = np.arange(kept.size)
    neighbors = cells.neighbors[faces]
    neighbors = np.where(neighbors < 0, neighbors, new_ids[np.maximum(neighbors, 0)])
    measured = integrate(grains)
    centred = grains.vertices - np.repeat(measured.centroids, np.diff(grains.vertex_offsets), axis=0)
    return Packing(
        Polyhedra(
            centred,
            grains.vertex_offsets,
            grains.face_offsets,
            grains.face_vertices,
            grains.face_vertex_offsets,
        ),
        cells.sites[kept] + measured.centroids,
        identity_quaternions(kept.size),
        densities[kept],
        cells.domain,
        CellLinks(neighbors, cells.shifts[faces], measured.volumes, cells.sites[kept], face_planes(grains).heights),
    ).with_step("carve", keep=keep, n_cells=len(cells), n_grains=int(kept.size))


def select(polyhedra: Polyhedra, rows: NDArray[np.int64]) -> tuple[Polyhedra, NDArray[np.int64]]:
    """Return the chosen polyhedra in their order, and the old number of each face of theirs."""
    vertices, vertex_offsets = take_indices(polyhedra.vertex_offsets, rows)
    faces, face_offsets = take_indices(polyhedra.face_offsets, rows)
    corners, corner_offsets = take_indices(polyhedra.face_vertex_offsets, faces)
    chosen = Polyhedra(
        polyhedra.vertices[vertices],
        vertex_offsets,
        face_offsets,
        polyhedra.face_vertices[corners],
        corner_offsets,
    )
    return chosen, faces
