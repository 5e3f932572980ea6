"""From the cells of a tessellation to grains."""

from __future__ import annotations

import logging
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import sphere_diameters, weighted_percentiles
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.geometry.rotations import identity_quaternions
from grainsdem.geometry.selection import select
from grainsdem.model import DROPPED, QUARTZ_DENSITY, CellLinks, Packing, Polyhedra, Tessellation

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray

LOG = logging.getLogger(__name__)


@gated
def carve(
    cells: Tessellation,
    *,
    keep: Literal["inside", "all"] = "inside",
    density: ArrayLike = QUARTZ_DENSITY,
    classes: ArrayLike | None = None,
) -> Packing:
    """Return the cells as grains that still touch, ready to be shrunk: of porosity zero where they fill space.

    Parameters
    ----------
    cells : Tessellation
        Cells of the domain.
    keep : {"inside", "all"}
        ``"inside"`` drops every cell that touches a wall, as the paper does; ``"all"`` keeps them. The two faces of a
        planar domain's slab are no walls: every cell touches both.
    density : array_like, shape () or (n_cells,)
        Density [kg/m³].
    classes : array_like of int, shape (n_cells,), optional
        What the grain of each cell is one of: its layer, say.

    Returns
    -------
    Packing
        Grains in the order of their cells, with links to their neighbours.

    Raises
    ------
    InputError
        If no cell is left, ``keep`` is unknown, or a density is not positive and finite.
    ShapeError
        If there is not one class for each cell.

    Notes
    -----
    Large cells touch walls more often than small ones. Where cells have weights, so that their sizes were asked for, a
    warning is logged of how many are dropped and what that does to the percentiles by mass.
    """
    if keep not in ("inside", "all"):
        raise InputError(f"keep must be 'inside' or 'all'; got {keep!r}")
    given = np.asarray(density, dtype=np.float64)
    if given.shape not in ((), (len(cells),)):
        raise ShapeError(f"density must be one number, or one for each of {len(cells)} cells; got shape {given.shape}")
    densities = np.broadcast_to(given, (len(cells),))
    if not (np.isfinite(densities).all() and (densities > 0).all()):
        raise InputError(f"density must be positive and finite; got {float(densities.min())}")
    # A Laguerre cell may be empty: it is no grain.
    has_faces = np.diff(cells.cells.face_offsets) > 0
    kept = np.flatnonzero(has_faces if keep == "all" else has_faces & ~cells.touch_walls())
    if kept.size == 0:
        raise InputError(
            f"all {len(cells)} cells touch a wall and would be dropped; use more seeds, a periodic domain or keep='all'"
        )
    if kept.size < np.count_nonzero(has_faces) and np.ptp(cells.weights) > 0:
        _tell_what_is_lost(cells, kept)
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
        CellLinks(
            neighbors,
            cells.shifts[faces],
            measured.volumes / cells.fill,
            cells.sites[kept],
            face_planes(grains).heights,
        ),
        classes=None if classes is None else _each(classes, len(cells))[kept],
    ).with_step("carve", keep=keep, n_cells=len(cells), n_grains=int(kept.size))


def _each(classes: ArrayLike, n: int) -> NDArray[np.int32]:
    """Return the classes of all cells, shape (n,)."""
    found = np.asarray(classes)
    if found.shape != (n,):
        raise ShapeError(f"there must be one class for each of the {n} cells; got shape {found.shape}")
    return found.astype(np.int32)


def _tell_what_is_lost(cells: Tessellation, kept: NDArray[np.int64]) -> None:
    """Log how many of the cells that were sized are dropped, and how far that moves the percentiles by mass."""
    volumes = integrate(cells.cells).volumes
    # Cells of a slab are of one height: only ratios count.
    sizes = np.sqrt(volumes) if cells.domain.is_planar else sphere_diameters(volumes)
    marks = np.array([10.0, 50.0, 90.0])
    asked = weighted_percentiles(sizes, marks, volumes)
    moved = 100 * (weighted_percentiles(sizes[kept], marks, volumes[kept]) / asked - 1)
    LOG.warning(
        "%d of %d cells of prescribed sizes touch a wall and are dropped, which moves d10, d50 and d90 by mass by "
        "%+.2f, %+.2f and %+.2f %%: keep = 'all', or a periodic domain, keeps every one; in a larger domain with more "
        "grains fewer of them touch a wall",
        len(cells) - kept.size, len(cells), *moved,
    )  # fmt: skip


@contextmanager
def unwarned() -> Iterator[None]:
    """Carve beds that are only tried, or told of together, without a warning of each."""

    def hold_back(_record: logging.LogRecord) -> bool:
        return False

    LOG.addFilter(hold_back)
    try:
        yield
    finally:
        LOG.removeFilter(hold_back)


@gated
def subset(packing: Packing, rows: ArrayLike) -> Packing:
    """Return the chosen grains of a packing, by number, in their order; `Packing.links` is gone.

    Parameters
    ----------
    packing : Packing
        The grains.
    rows : array_like of int, shape (m,)
        Numbers of those to keep.

    Raises
    ------
    InputError
        If there is no grain of a number.
    """
    ids = np.asarray(rows, dtype=np.int64)
    unknown = ids[(ids < 0) | (ids >= len(packing))]
    if unknown.size:
        raise InputError(f"there are grains 0 to {len(packing) - 1}; got {name_offenders(unknown)}")
    return replace(
        packing,
        grains=select(packing.grains, ids)[0],
        positions=packing.positions[ids],
        quaternions=packing.quaternions[ids],
        densities=packing.densities[ids],
        frictions=packing.frictions_of(ids),
        classes=packing.classes_of(ids),
        links=None,
    )
