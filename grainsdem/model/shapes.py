"""Convex polyhedra in flat arrays."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import LONGEST, Noun, check_row
from grainsdem.ragged import check_offsets

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]
    Offsets = NDArray[np.int64]


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Polyhedra(Noun):
    """Convex polyhedra in flat arrays, each in a frame of its own.

    Parameters
    ----------
    vertices : array_like, shape (n_vertices, 3)
        Vertices [m] of all polyhedra, one after another; each vertex once per polyhedron.
    vertex_offsets : array_like of int64, shape (n + 1,)
        Vertices of polyhedron i are ``vertices[vertex_offsets[i]:vertex_offsets[i + 1]]``.
    face_offsets : array_like of int64, shape (n + 1,)
        Faces of polyhedron i are numbers ``face_offsets[i]`` to ``face_offsets[i + 1]``.
    face_vertices : array_like of int32, shape (n_corners,)
        Corners of all faces, one face after another, counter-clockwise seen from outside; indices are local to
        the polyhedron.
    face_vertex_offsets : array_like of int64, shape (n_faces + 1,)
        Corners of face f are ``face_vertices[face_vertex_offsets[f]:face_vertex_offsets[f + 1]]``.
    """

    vertices: Floats
    vertex_offsets: Offsets
    face_offsets: Offsets
    face_vertices: Ints
    face_vertex_offsets: Offsets

    def __post_init__(self) -> None:
        vertices = self.freeze("vertices", np.float64, None, 3)
        # Not a number is left to validation, which tells whose it is.
        if vertices.size and (vertices.max() > LONGEST or vertices.min() < -LONGEST):
            raise InputError(
                f"vertices must lie within {LONGEST:g} m of the origin; got {vertices.min():g} to {vertices.max():g}"
            )
        vertex_offsets = self.freeze("vertex_offsets", np.int64, None)
        face_offsets = self.freeze("face_offsets", np.int64, None)
        corners = self.freeze("face_vertices", np.int32, None)
        corner_offsets = self.freeze("face_vertex_offsets", np.int64, None)
        check_offsets("vertex_offsets", vertex_offsets, len(vertices))
        check_offsets("face_vertex_offsets", corner_offsets, len(corners))
        check_offsets("face_offsets", face_offsets, corner_offsets.size - 1)
        if vertex_offsets.size != face_offsets.size:
            raise ShapeError(
                f"vertex_offsets and face_offsets must be of equal length; "
                f"got {vertex_offsets.size} and {face_offsets.size}"
            )
        counts = np.diff(corner_offsets[face_offsets])
        filled = np.flatnonzero(counts)
        # The highest corner of each polyhedron: a bound for every corner would take as much memory as the vertices.
        highest = np.maximum.reduceat(corners, corner_offsets[face_offsets[:-1]][filled]) if filled.size else counts[:0]
        if corners.size and (corners.min() < 0 or np.any(highest >= np.diff(vertex_offsets)[filled])):
            bounds = np.repeat(np.diff(vertex_offsets), counts)
            bad = np.flatnonzero((corners < 0) | (corners >= bounds))
            raise ShapeError(
                f"face_vertices must index the vertices of their own polyhedron; entries {name_offenders(bad)} do not"
            )

    def __len__(self) -> int:
        return int(self.vertex_offsets.size - 1)

    @property
    def n_faces(self) -> int:
        """Number of faces of all polyhedra together."""
        return int(self.face_vertex_offsets.size - 1)

    def vertices_of(self, i: int) -> Floats:
        """Return the vertices [m] of polyhedron ``i``, shape (k, 3)."""
        check_row("i", i, len(self))
        return self.vertices[self.vertex_offsets[i] : self.vertex_offsets[i + 1]]

    def faces_of(self, i: int) -> list[Ints]:
        """Return the faces of polyhedron ``i`` as arrays of local vertex indices."""
        check_row("i", i, len(self))
        first, last = self.face_offsets[i], self.face_offsets[i + 1]
        cuts = self.face_vertex_offsets[first : last + 1]
        return [self.face_vertices[a:b] for a, b in pairwise(cuts)]
