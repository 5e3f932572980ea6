"""Some of many polyhedra, in any order and as often as asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts, take_indices

if TYPE_CHECKING:
    from collections.abc import Sequence

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


def replaced(polyhedra: Polyhedra, rows: NDArray[np.int64], others: Sequence[Polyhedra]) -> Polyhedra:
    """Return the polyhedra, those of some rows replaced by others, together one for each row."""
    if rows.size == 0:
        return polyhedra
    pool = (polyhedra, *others)
    order = np.arange(len(polyhedra))
    order[rows] = len(polyhedra) + np.arange(rows.size)

    def offsets(name: str) -> NDArray[np.int64]:
        return offsets_from_counts(np.concatenate([np.diff(getattr(part, name)) for part in pool]))

    both = Polyhedra(
        np.concatenate([part.vertices for part in pool]),
        offsets("vertex_offsets"),
        offsets("face_offsets"),
        np.concatenate([part.face_vertices for part in pool]),
        offsets("face_vertex_offsets"),
    )
    return select(both, order)[0]
