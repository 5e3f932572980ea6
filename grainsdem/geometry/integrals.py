"""Exact volume, area, centroid and inertia of polyhedra, by the divergence theorem.

References
----------
.. [1] B. Mirtich, "Fast and accurate computation of polyhedral mass properties", J. Graphics Tools 1 (1996) 31-50.
.. [2] F. Tonon, "Explicit exact formulas for the 3-D tetrahedron inertia tensor in terms of its vertex
   coordinates", J. Math. Stat. 1 (2005) 8-11.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.gate import gated
from grainsdem.geometry.threads import in_blocks
from grainsdem.model.given import grains_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model.given import Grains


class Integrals(NamedTuple):
    """Volume and its first moments, one row a polyhedron.

    Parameters
    ----------
    volumes : ndarray, shape (n,)
        Volumes [m³], negative where faces are wound inward.
    areas : ndarray, shape (n,)
        Surface areas [m²].
    centroids : ndarray, shape (n, 3)
        Centroids [m] in each polyhedron's frame.
    inertias : ndarray, shape (n, 3, 3)
        Inertia tensors [m⁵] about the centroid for unit density.
    """

    volumes: NDArray[np.float64]
    areas: NDArray[np.float64]
    centroids: NDArray[np.float64]
    inertias: NDArray[np.float64]


@njit(cache=True, nogil=True)
def _integrate(start, stop, mesh, volumes, areas, centroids, inertias):  # type: ignore[no-untyped-def]
    vertices, vertex_offsets, face_offsets, corners, corner_offsets = mesh
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        count = vertex_offsets[i + 1] - v0
        # The vertex mean as origin keeps the signed tetrahedra small: no cancellation far from the frame's origin.
        ox = oy = oz = 0.0
        for k in range(count):
            ox += vertices[v0 + k, 0]
            oy += vertices[v0 + k, 1]
            oz += vertices[v0 + k, 2]
        if count > 0:
            ox /= count
            oy /= count
            oz /= count
        volume6 = 0.0
        area = 0.0
        m = np.zeros(3)
        s = np.zeros((3, 3))
        for f in range(face_offsets[i], face_offsets[i + 1]):
            c0 = corner_offsets[f]
            a = v0 + corners[c0]
            ax, ay, az = vertices[a, 0] - ox, vertices[a, 1] - oy, vertices[a, 2] - oz
            nx = ny = nz = 0.0
            for c in range(c0 + 1, corner_offsets[f + 1] - 1):
                b = v0 + corners[c]
                d = v0 + corners[c + 1]
                bx, by, bz = vertices[b, 0] - ox, vertices[b, 1] - oy, vertices[b, 2] - oz
                dx, dy, dz = vertices[d, 0] - ox, vertices[d, 1] - oy, vertices[d, 2] - oz
                ux, uy, uz = bx - ax, by - ay, bz - az
                wx, wy, wz = dx - ax, dy - ay, dz - az
                cx, cy, cz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
                nx += cx
                ny += cy
                nz += cz
                det = ax * cx + ay * cy + az * cz
                volume6 += det
                sx, sy, sz = ax + bx + dx, ay + by + dy, az + bz + dz
                m[0] += det * sx
                m[1] += det * sy
                m[2] += det * sz
                # ∫ x_p x_q over the tetrahedron (0, a, b, d) = det / 120 · (Σ v_p v_q + s_p s_q)
                s[0, 0] += det * (ax * ax + bx * bx + dx * dx + sx * sx)
                s[1, 1] += det * (ay * ay + by * by + dy * dy + sy * sy)
                s[2, 2] += det * (az * az + bz * bz + dz * dz + sz * sz)
                s[0, 1] += det * (ax * ay + bx * by + dx * dy + sx * sy)
                s[0, 2] += det * (ax * az + bx * bz + dx * dz + sx * sz)
                s[1, 2] += det * (ay * az + by * bz + dy * dz + sy * sz)
            area += 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
        volume = volume6 / 6.0
        volumes[i] = volume
        areas[i] = area
        g = np.zeros(3)
        if volume6 != 0.0:
            # Number by number: numba would compile what the assignment of a whole array says of unlike shapes.
            for k in range(3):
                g[k] = m[k] / (4.0 * volume6)
        centroids[i, 0] = ox + g[0]
        centroids[i, 1] = oy + g[1]
        centroids[i, 2] = oz + g[2]
        xx = s[0, 0] / 120.0 - volume * g[0] * g[0]
        yy = s[1, 1] / 120.0 - volume * g[1] * g[1]
        zz = s[2, 2] / 120.0 - volume * g[2] * g[2]
        xy = s[0, 1] / 120.0 - volume * g[0] * g[1]
        xz = s[0, 2] / 120.0 - volume * g[0] * g[2]
        yz = s[1, 2] / 120.0 - volume * g[1] * g[2]
        inertias[i, 0, 0] = yy + zz
        inertias[i, 1, 1] = xx + zz
        inertias[i, 2, 2] = xx + yy
        inertias[i, 0, 1] = inertias[i, 1, 0] = -xy
        inertias[i, 0, 2] = inertias[i, 2, 0] = -xz
        inertias[i, 1, 2] = inertias[i, 2, 1] = -yz


@gated
def integrate(polyhedra: Grains) -> Integrals:
    """Return volume, area, centroid and inertia of each polyhedron.

    Parameters
    ----------
    polyhedra : Polyhedra or Packing
        Closed polyhedra with planar faces, wound outward; of a packing its grains, each in its own frame.

    Returns
    -------
    Integrals
        Named tuple of arrays in the units of the vertices.
    """
    p = grains_of(polyhedra)
    n = len(p)
    result = Integrals(np.empty(n), np.empty(n), np.empty((n, 3)), np.empty((n, 3, 3)))
    mesh = p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets
    in_blocks(_integrate, n, mesh, *result)
    return result


@njit(cache=True, nogil=True)
def _face_planes(start, stop, vertices, vertex_offsets, face_offsets, corners, corner_offsets, normals, heights, areas):  # type: ignore[no-untyped-def]
    for i in range(start, stop):
        v0 = vertex_offsets[i]
        for f in range(face_offsets[i], face_offsets[i + 1]):
            c0, c1 = corner_offsets[f], corner_offsets[f + 1]
            a = v0 + corners[c0]
            nx = ny = nz = 0.0
            for c in range(c0 + 1, c1 - 1):
                b = v0 + corners[c]
                d = v0 + corners[c + 1]
                ux, uy = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1]
                uz = vertices[b, 2] - vertices[a, 2]
                wx, wy = vertices[d, 0] - vertices[a, 0], vertices[d, 1] - vertices[a, 1]
                wz = vertices[d, 2] - vertices[a, 2]
                nx += uy * wz - uz * wy
                ny += uz * wx - ux * wz
                nz += ux * wy - uy * wx
            norm = np.sqrt(nx * nx + ny * ny + nz * nz)
            areas[f] = 0.5 * norm
            if norm > 0.0:
                nx, ny, nz = nx / norm, ny / norm, nz / norm
            normals[f, 0], normals[f, 1], normals[f, 2] = nx, ny, nz
            h = 0.0
            for c in range(c0, c1):
                b = v0 + corners[c]
                h += nx * vertices[b, 0] + ny * vertices[b, 1] + nz * vertices[b, 2]
            heights[f] = h / max(c1 - c0, 1)


class FacePlanes(NamedTuple):
    """Plane n · x = h and area of each face.

    Parameters
    ----------
    normals : ndarray, shape (n_faces, 3)
        Outward unit normals.
    heights : ndarray, shape (n_faces,)
        Signed distance [m] of the plane from the polyhedron's origin, averaged over the corners.
    areas : ndarray, shape (n_faces,)
        Areas [m²].
    """

    normals: NDArray[np.float64]
    heights: NDArray[np.float64]
    areas: NDArray[np.float64]


@gated
def face_planes(polyhedra: Grains) -> FacePlanes:
    """Return the plane and the area of every face of polyhedra, or of a packing's grains, each in its own frame."""
    p = grains_of(polyhedra)
    n = p.n_faces
    result = FacePlanes(np.empty((n, 3)), np.empty(n), np.empty(n))
    mesh = p.vertices, p.vertex_offsets, p.face_offsets, p.face_vertices, p.face_vertex_offsets
    in_blocks(_face_planes, len(p), *mesh, *result)
    return result


@gated
def volumes(polyhedra: Grains) -> NDArray[np.float64]:
    """Return the volume [m³] of each polyhedron, or of each grain of a packing, shape (n,).

    It has a sign: below zero where faces are wound inward. Sizes and shapes, which have none, refuse such grains.
    """
    return integrate(polyhedra).volumes


@gated
def surface_areas(polyhedra: Grains) -> NDArray[np.float64]:
    """Return the surface area [m²] of each polyhedron, or of each grain of a packing, shape (n,)."""
    return integrate(polyhedra).areas


@gated
def centroids(polyhedra: Grains) -> NDArray[np.float64]:
    """Return the centroid [m] of each polyhedron, or of each grain of a packing, in its own frame, shape (n, 3)."""
    return integrate(polyhedra).centroids


@gated
def inertia_tensors(polyhedra: Grains) -> NDArray[np.float64]:
    """Return the inertia tensor [m⁵] about the centroid for unit density, shape (n, 3, 3).

    Of polyhedra or of the grains of a packing, each in its own frame.
    """
    return integrate(polyhedra).inertias
