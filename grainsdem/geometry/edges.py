"""Edges of polyhedra, each once."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.ragged import owners

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Polyhedra


class Edges(NamedTuple):
    """Edges of closed polyhedra, each once.

    Parameters
    ----------
    ends : ndarray of int32, shape (m, 2)
        Vertices, local to the polyhedron, the lower first.
    offsets : ndarray of int64, shape (n + 1,)
        Edges of polyhedron i are ``ends[offsets[i]:offsets[i + 1]]``.
    faces : ndarray of int64, shape (m, 2)
        The two faces that meet in each edge.
    """

    ends: NDArray[np.int32]
    offsets: NDArray[np.int64]
    faces: NDArray[np.int64]


def edges(shapes: Polyhedra) -> Edges:
    """Return the edges of closed polyhedra."""
    corners, offsets = shapes.face_vertices, shapes.face_vertex_offsets
    following = np.arange(1, corners.size + 1)
    following[offsets[1:] - 1] = offsets[:-1]
    face = owners(offsets)
    grain = owners(shapes.face_offsets)[face]
    low, high = np.minimum(corners, corners[following]), np.maximum(corners, corners[following])
    # One number an edge, in the order of the grains; its two sides become neighbours.
    widest = int(np.diff(shapes.vertex_offsets).max())
    order = np.argsort((shapes.vertex_offsets[grain] + low) * widest + high, kind="stable")
    first, second = order[::2], order[1::2]
    ends = np.column_stack([low[first], high[first]])
    counts = np.bincount(grain[first], minlength=len(shapes))
    return Edges(ends, np.append(0, np.cumsum(counts)), np.column_stack([face[first], face[second]]))


def edge_lengths(shapes: Polyhedra, found: Edges) -> NDArray[np.float64]:
    """Return the length [m] of each edge, shape (m,)."""
    starts = shapes.vertex_offsets[owners(found.offsets)]
    ends = shapes.vertices[starts[:, None] + found.ends]
    lengths: NDArray[np.float64] = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    return lengths
