"""Cells of a domain."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import ShapeError
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import Noun
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model.domain import Domain
    from grainsdem.model.shapes import Polyhedra

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

_FACES = (-5, -6)
"""The walls at the two faces of a slab, as `Domain` numbers them."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Tessellation(Noun):
    """Cells of a domain, and for every face the cell on its other side.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    sites : array_like, shape (n, 3)
        Seeds [m] that the cells grew from.
    weights : array_like, shape (n,)
        Laguerre weights [m²]; zeros for a Voronoi tessellation.
    cells : Polyhedra
        One polyhedron a site, its vertices relative to the site.
    neighbors : array_like of int32, shape (n_faces,)
        The cell behind each face; a negative number is a wall (see `Domain`).
    shifts : array_like of int8, shape (n_faces, 3)
        Periodic image of that neighbour, in whole domain lengths; zeros without periodic axes.
    fill : float
        Share of the domain that the cells fill, in (0, 1]: one, but for cells of unlike forms, which leave void between
        them. Each cell is taken to have its part of that void.
    """

    domain: Domain
    sites: Floats
    weights: Floats
    cells: Polyhedra
    neighbors: Ints
    shifts: NDArray[np.int8]
    fill: float = 1.0

    def __post_init__(self) -> None:
        n = len(self.cells)
        self.freeze("sites", np.float64, n, 3)
        self.freeze("weights", np.float64, n)
        neighbors = self.freeze("neighbors", np.int32, self.cells.n_faces)
        self.freeze("shifts", np.int8, self.cells.n_faces, 3)
        if not 0 < self.fill <= 1:
            raise ShapeError(f"fill must lie in (0, 1]; got {self.fill}")
        if neighbors.size and neighbors.max() >= n:
            raise ShapeError(f"neighbors must be below the number of cells {n}; got {neighbors.max()}")

    def __len__(self) -> int:
        return len(self.cells)

    def touch_walls(self) -> NDArray[np.bool_]:
        """Return which cells touch a wall, shape (n,); the two faces of a planar domain's slab are none."""
        is_wall = self.neighbors < 0
        if self.domain.is_planar:
            is_wall = is_wall & ~np.isin(self.neighbors, _FACES)
        found = np.zeros(len(self), dtype=bool)
        found[owners(self.cells.face_offsets)[is_wall]] = True
        return found
