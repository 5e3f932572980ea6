"""Voronoi cells cut by the domain."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.model import Polyhedra, Tessellation
from grainsdem.points.check import check_seeds
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain


def tessellate(seeds: ArrayLike, domain: Domain) -> Tessellation:
    """Return the Voronoi cells of ``seeds``, cut by the walls of ``domain``."""
    from scipy.spatial import Voronoi  # noqa: PLC0415  (half a second)

    sites = check_seeds(seeds, domain)
    n = len(sites)
    images = [sites]
    for axis in range(3):
        for wall in (domain.lower[axis], domain.upper[axis]):
            mirrored = sites.copy()
            mirrored[:, axis] = 2 * wall - mirrored[:, axis]
            images.append(mirrored)
    diagram = Voronoi(np.concatenate(images))
    faces: list[list[tuple[int, NDArray[np.int64]]]] = [[] for _ in range(n)]
    for (p, q), ridge in zip(diagram.ridge_points, diagram.ridge_vertices, strict=True):
        for a, b in ((p, q), (q, p)):
            if a < n:
                faces[a].append((int(b) if b < n else -int(b // n), np.asarray(ridge)))
    vertices, corners, corner_counts, face_counts, vertex_counts, neighbors = [], [], [], [], [], []
    for i, rows in enumerate(faces):
        ids, inverse = np.unique(np.concatenate([ridge for _, ridge in rows]), return_inverse=True)
        local = diagram.vertices[ids] - sites[i]
        vertices.append(local)
        vertex_counts.append(len(ids))
        face_counts.append(len(rows))
        start = 0
        for neighbor, ridge in rows:
            loop = inverse[start : start + len(ridge)]
            start += len(ridge)
            polygon = local[loop]
            normal = np.cross(polygon[1:-1] - polygon[0], polygon[2:] - polygon[0]).sum(axis=0)
            corners.append(loop if normal @ polygon.mean(axis=0) > 0 else loop[::-1])
            corner_counts.append(len(loop))
            neighbors.append(neighbor)
    cells = Polyhedra(
        np.concatenate(vertices), offsets_from_counts(vertex_counts), offsets_from_counts(face_counts),
        np.concatenate(corners), offsets_from_counts(corner_counts),
    )
    return Tessellation(domain, sites, np.zeros(n), cells, np.array(neighbors), np.zeros((len(neighbors), 3)))
