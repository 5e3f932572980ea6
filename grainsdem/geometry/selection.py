"""Some of many polyhedra, in any order and as often as asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

from grainsdem.model import Polyhedra
from grainsdem.ragged import take_indices

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


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
