"""The surface of a solid as plane faces with holes, what bounds a volume in a mesher that makes its own triangles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.void.short import merged
from grainsdem.geometry.triangles import vector_areas

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


class Faces(NamedTuple):
    """A closed surface of plane faces.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        Corners.
    triangles : ndarray of int, shape (m, 3)
        The surface as triangles, wound outward.
    face_of : ndarray of int, shape (m,)
        The face that each triangle is part of.
    loops : list of list of list of int
        For each face its loops of corners, that around it first, then its holes.
    parts : list of list of list of int
        For each part that is not connected to others its shells as lists of faces, the outer one first.
    """

    points: Floats
    triangles: Ints
    face_of: Ints
    loops: list[list[list[int]]]
    parts: list[list[list[int]]]

    def volume(self) -> float:
        """Return the volume inside."""
        return float(_volumes(self.points[self.triangles]).sum())


ON_WALL = 1e-9
"""How far corners on a wall of the box may lie from it, in units of a grain."""

FLAT = 1e-10
"""How far corners of a plane face may lie from its plane, in units of a grain: what a mesh's volume does not show."""


def faces(body: Any, lower: Floats, upper: Floats, *, shortest: float = 0.0) -> Faces:
    """Return the plane faces of a manifold in a box: triangles that came from one face and hang together.

    Edges shorter than ``shortest`` are merged away where they can be; what is no longer plane falls into triangles.
    """
    mesh = body.to_mesh64()
    points = np.asarray(mesh.vert_properties)[:, :3].copy()
    triangles = np.asarray(mesh.tri_verts).astype(np.int64)
    starts = np.array(mesh.run_index, dtype=np.int64) // 3
    origins = np.repeat(np.array(mesh.run_original_id, dtype=np.int64), starts[1:] - starts[:-1])
    keys = np.column_stack([origins, np.asarray(mesh.face_id).astype(np.int64)])
    _, keys = np.unique(keys, axis=0, return_inverse=True)
    walls = np.hstack([np.abs(points - wall) < ON_WALL for wall in (lower, upper)])
    triangles, keys = merged(points, triangles, keys.ravel(), walls, shortest)
    kept, triangles = np.unique(triangles, return_inverse=True)
    points, triangles = points[kept], triangles.reshape(-1, 3)
    first, second = _neighbours(triangles)
    same = keys[first] == keys[second]
    face_of = _connected(len(triangles), first[same], second[same])
    face_of = _parted(points, triangles, face_of)
    shell_of = _connected(len(triangles), first, second)
    loops = [_loops(points, triangles[rows]) for rows in _rows(face_of)]
    return Faces(points, triangles, face_of, loops, _parts(points, triangles, face_of, shell_of))


def _parted(points: Floats, triangles: Ints, face_of: Ints) -> Ints:
    """Return the faces, those that are not plane parted into their triangles."""
    areas = vector_areas(points[triangles])
    sums = np.column_stack([np.bincount(face_of, areas[:, k]) for k in range(3)])
    normals = sums / np.linalg.norm(sums, axis=1, keepdims=True)
    heights = (points[triangles] * normals[face_of][:, None]).sum(axis=2)
    n = int(face_of.max()) + 1
    spread = np.full(n, -np.inf), np.full(n, np.inf)
    np.maximum.at(spread[0], face_of, heights.max(axis=1))
    np.minimum.at(spread[1], face_of, heights.min(axis=1))
    bent = (spread[0] - spread[1] > FLAT)[face_of]
    return np.unique(np.where(bent, n + np.arange(len(face_of)), face_of), return_inverse=True)[1].ravel()


def _neighbours(triangles: Ints) -> tuple[Ints, Ints]:
    """Return the two triangles at every edge."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    order = np.lexsort(edges.T)
    owners = np.tile(np.arange(len(triangles)), 3)[order]
    return owners[::2], owners[1::2]


def _connected(n: int, first: Ints, second: Ints) -> Ints:
    from scipy.sparse import coo_array  # noqa: PLC0415  (a quarter of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    links = coo_array((np.ones(len(first), dtype=np.int8), (first, second)), shape=(n, n))
    return np.asarray(connected_components(links, directed=False)[1], dtype=np.int64)


def _rows(group_of: Ints) -> list[Ints]:
    """Return the members of each group."""
    return np.split(np.argsort(group_of, kind="stable"), np.cumsum(np.bincount(group_of))[:-1])


def _loops(points: Floats, triangles: Ints) -> list[list[int]]:
    """Return the loops around a face, that which encloses the others first."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    there = set(map(tuple, edges.tolist()))
    following: dict[int, list[int]] = {}
    for a, b in edges.tolist():
        if (b, a) not in there:
            following.setdefault(a, []).append(b)
    loops = []
    while following:
        start = at = next(iter(following))
        loop: list[int] = []
        while True:
            loop.append(at)
            at_next = following[at].pop()
            if not following[at]:
                del following[at]
            at = at_next
            if at == start:
                break
        loops.append(loop)
    return sorted(loops, key=lambda loop: -_area(points[loop]))


def _area(corners: Floats) -> float:
    """Return the area that a plane loop encloses."""
    moved = corners - corners[0]
    return float(0.5 * np.linalg.norm(np.cross(moved, np.roll(moved, -1, axis=0)).sum(axis=0)))


def _parts(points: Floats, triangles: Ints, face_of: Ints, shell_of: Ints) -> list[list[list[int]]]:
    """Return for each part its shells: hollows, whose volume is negative, belong to the shell that is around them."""
    shells = _rows(shell_of)
    corners = points[triangles]
    volumes = _volumes(corners)
    content = [float(volumes[rows].sum()) for rows in shells]
    owned = [np.unique(face_of[rows]).tolist() for rows in shells]
    outer = [k for k, volume in enumerate(content) if volume > 0]
    parts = {k: [owned[k]] for k in outer}
    for k, volume in enumerate(content):
        if volume <= 0:
            around = [j for j in outer if len(outer) == 1 or _holds(corners[shells[j]], corners[shells[k][0], 0])]
            # The smallest of those around it: a pocket in a hollow has a shell of its own.
            parts[min(around, key=content.__getitem__)].append(owned[k])
    return [parts[k] for k in sorted(outer, key=lambda k: -content[k])]


def _volumes(corners: Floats) -> Floats:
    """Return the signed volume between each triangle and the origin."""
    return np.asarray(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)


def _holds(corners: Floats, point: Floats) -> bool:
    """Return whether a closed surface is around a point: the solid angles of its triangles add to a whole sphere."""
    a, b, c = (corners - point).transpose(1, 0, 2)
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    above = np.einsum("ij,ij->i", a, np.cross(b, c))
    below = la * lb * lc + (a * b).sum(axis=1) * lc + (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
    return bool(np.arctan2(above, below).sum() > np.pi)
