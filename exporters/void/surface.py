"""Solids as triangles in single precision, the precision in which OpenFOAM keeps a surface."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.text import filled
from grainsdem.errors import InputError
from grainsdem.geometry.triangles import vector_areas

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.void.region import Region
    from exporters.void.solids import Frame

    Floats = NDArray[np.float64]
    Singles = NDArray[np.float32]

SLIVERS = (0.0, 1e-6, 4e-6, 1.6e-5, 6.4e-5)
"""Sizes, in diameters, below which features are taken off, one after another until rounding leaves a sound surface."""

ON_FACE = 1e-5
"""Distance from a wall of the region, in diameters, within which a triangle lies on it: single precision's."""

_FACET = "facet normal %.9g %.9g %.9g\nouter loop\n" + "vertex %.9g %.9g %.9g\n" * 3 + "endloop\nendfacet\n"


def corners(bodies: list[Any], frame: Frame) -> Floats:
    """Return the triangles [m] of all bodies, shape (m, 3, 3), wound outward."""
    parts = []
    for body in bodies:
        mesh = body.to_mesh64()
        points = np.asarray(mesh.vert_properties)[:, :3] * frame.length + frame.origin
        parts.append(points[np.asarray(mesh.tri_verts).astype(np.int64)])
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))


def rounded(bodies: list[Any], frame: Frame, shift: Floats) -> Singles:
    """Return the triangles of all bodies, moved by ``shift`` [m] and rounded, each body closed, none without area.

    Raises
    ------
    InputError
        If rounding does not leave that: the bodies lie too far from the origin, or too near one another.
    """
    for tolerance in SLIVERS:
        smooth = [body.simplify(tolerance) for body in bodies] if tolerance else bodies
        singles = (corners(smooth, frame) + shift).astype(np.float32)
        # Where an edge has shrunk to a point, both its triangles have gone: what is left is closed.
        distinct = [(singles[:, a] != singles[:, b]).any(axis=1) for a, b in ((0, 1), (1, 2), (2, 0))]
        singles = singles[np.logical_and.reduce(distinct)]
        if _is_sound(singles):
            return singles
    raise InputError(
        "the grains' surface does not stay closed, or loses the area of a triangle, in single precision; use "
        "origin='region' or a larger gap"
    )


def _is_sound(triangles: Singles) -> bool:
    """Return whether every triangle has an area and every edge two faces: points are known by their place alone."""
    if not np.linalg.norm(vector_areas(triangles), axis=1).all():
        return False
    _, ids = np.unique(triangles.reshape(-1, 3), axis=0, return_inverse=True)
    ids = ids.reshape(-1, 3)
    edges = np.sort(np.concatenate([ids[:, [0, 1]], ids[:, [1, 2]], ids[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges @ np.array([len(ids) * 3, 1]), return_counts=True)
    return bool((counts == 2).all())


def on_faces(triangles: Floats, region: Region, length: float) -> NDArray[np.int64]:
    """Return which wall of the region each triangle lies on.

    2 axis + (0 lower, 1 upper) for those of the box, 6 and above for the planes in their order, and -1 for none.
    """
    face = np.full(len(triangles), -1, dtype=np.int64)
    walls = [(np.eye(3)[k], height) for k in range(3) for height in (region.lower[k], region.upper[k])]
    walls += [(plane[:3], plane[3]) for plane in region.planes]
    for number, (normal, height) in enumerate(walls):
        face[(np.abs(triangles @ normal - height) < ON_FACE * length).all(axis=1)] = number
    return face


def ascii_stl(patches: dict[str, Floats]) -> bytes:
    """Return triangles as ASCII STL, one named solid a patch."""
    text = []
    for name, triangles in patches.items():
        areas = vector_areas(triangles)
        norms = np.linalg.norm(areas, axis=1, keepdims=True)
        normals = np.divide(areas, norms, out=np.zeros_like(areas), where=norms > 0)
        numbers = np.concatenate([normals[:, None], triangles], axis=1)
        rows = filled(_FACET, numbers, np.ones(len(triangles), dtype=np.int64))
        text.append(f"solid {name}\n{''.join(rows)}endsolid {name}\n")
    return "".join(text).encode()
