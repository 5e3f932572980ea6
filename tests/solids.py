"""Named solids with the closed forms of their volume, area and inertia, and packings made of any convex points."""

from __future__ import annotations

from itertools import permutations, product

import numpy as np
from scipy.spatial import ConvexHull

from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.ragged import offsets_from_counts

PHI = (1 + np.sqrt(5)) / 2


def _signs(*point):
    return np.unique([np.multiply(point, s) for s in product((-1, 1), repeat=3)], axis=0)


def _cyclic(*point):
    return np.vstack([_signs(*np.roll(point, k)) for k in range(3)])


# Vertices, edge length of those, then per edge length one: volume, area, moment of inertia over mass.
SOLIDS = {
    "tetrahedron": (
        np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], float),
        2 * np.sqrt(2),
        (1 / (6 * np.sqrt(2)), np.sqrt(3), 1 / 20),
    ),
    "cube": (_signs(1.0, 1.0, 1.0), 2.0, (1.0, 6.0, 1 / 6)),
    "octahedron": (_cyclic(1.0, 0.0, 0.0), np.sqrt(2), (np.sqrt(2) / 3, 2 * np.sqrt(3), 1 / 10)),
    "dodecahedron": (
        np.vstack([_signs(1.0, 1.0, 1.0), _cyclic(0.0, 1 / PHI, PHI)]),
        2 / PHI,
        ((15 + 7 * np.sqrt(5)) / 4, 3 * np.sqrt(25 + 10 * np.sqrt(5)), (39 * PHI + 28) / 150),
    ),
    "icosahedron": (
        _cyclic(0.0, 1.0, PHI),
        2.0,
        (5 * (3 + np.sqrt(5)) / 12, 5 * np.sqrt(3), PHI**2 / 10),
    ),
    # Inertia from the second moment of the BCC lattice's cell, G = 19 / (192 · 2^(1/3)): I / V = 2 G V^(2/3).
    "truncated octahedron": (
        np.unique(np.vstack([_signs(*p) for p in permutations((0.0, 1.0, 2.0))]), axis=0),
        np.sqrt(2),
        (8 * np.sqrt(2), 6 + 12 * np.sqrt(3), 2 * 19 / (192 * np.cbrt(2)) * (8 * np.sqrt(2)) ** (2 / 3)),
    ),
}


def polygons(points):
    """Return the faces of the convex hull as lists of vertices, coplanar triangles merged, wound outward."""
    points = np.unique(np.round(np.asarray(points, float), 12), axis=0)
    hull = ConvexHull(points)
    points, old = points[hull.vertices], hull.vertices
    new = {int(v): k for k, v in enumerate(old)}
    faces = {}
    for triangle, equation in zip(hull.simplices, hull.equations, strict=True):
        key = tuple(np.round(equation, 7) + 0.0)
        faces.setdefault(key, set()).update(new[int(v)] for v in triangle)
    ordered = []
    for key, face in faces.items():
        ids, n = np.array(sorted(face)), np.array(key[:3])
        middle = points[ids].mean(axis=0)
        u = points[ids[0]] - middle
        angles = np.arctan2((points[ids] - middle) @ np.cross(n, u), (points[ids] - middle) @ u * np.linalg.norm(n))
        ordered.append(ids[np.argsort(angles)])
    return points, ordered


def polyhedra(*clouds):
    """Return the convex hulls of several clouds of points as one `Polyhedra`."""
    vertices, faces, n_vertices, n_faces = [], [], [], []
    for cloud in clouds:
        points, rings = polygons(cloud)
        vertices.append(points)
        faces.extend(rings)
        n_vertices.append(len(points))
        n_faces.append(len(rings))
    return Polyhedra(
        np.vstack(vertices),
        offsets_from_counts(n_vertices),
        offsets_from_counts(n_faces),
        np.concatenate(faces),
        offsets_from_counts([len(f) for f in faces]),
    )


def solid(name, edge=1.0):
    """Return one named solid of a given edge, about its centre."""
    points, length, _ = SOLIDS[name]
    return polyhedra(points * edge / length)


def blob(rng, n=24):
    """Return points whose hull is a random convex grain of size about one."""
    points = rng.standard_normal((n, 3))
    return points / np.linalg.norm(points, axis=1, keepdims=True) * rng.uniform(0.3, 0.6, 3)


def place(shapes, positions, *, quaternions=None, domain=None, density=1.0):
    """Return a packing of shapes that are already about their centroids."""
    n = len(shapes)
    q = np.tile([1.0, 0, 0, 0], (n, 1)) if quaternions is None else quaternions
    return Packing(shapes, positions, q, np.full(n, density), domain or Domain.cube(10.0))


def centred(shapes):
    """Return the shapes about their centroids, found by splitting each hull into tetrahedra."""
    moved = np.array(shapes.vertices)
    for i in range(len(shapes)):
        rows = slice(shapes.vertex_offsets[i], shapes.vertex_offsets[i + 1])
        points = moved[rows]
        origin = points.mean(axis=0)
        hull = ConvexHull(points)
        a, b, c = (points[hull.simplices[:, k]] - origin for k in range(3))
        volume = np.abs(np.einsum("ij,ij->i", a, np.cross(b, c))) / 6
        moved[rows] = points - origin - (volume[:, None] * (a + b + c) / 4).sum(axis=0) / volume.sum()
    return Polyhedra(
        moved, shapes.vertex_offsets, shapes.face_offsets, shapes.face_vertices, shapes.face_vertex_offsets
    )
