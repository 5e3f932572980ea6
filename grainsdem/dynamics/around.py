"""What is around the grains of a scene: bodies of its apparatus as meshes, where they are, and where gravity points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.model import Surroundings

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.scene import Scene

    Floats = NDArray[np.float64]


def bodies_of(scene: Scene) -> Surroundings:
    """Return the bodies around the grains of a scene, in SI, without any frame.

    Flat walls without end are none: the container is known by its domain.
    """
    hulls = scene.engine.hulls()
    vertices: list[Floats] = []
    triangles: list[NDArray[np.int64]] = []
    owners: list[int] = []
    for number, shapes in enumerate(hulls.values()):
        for corners in shapes:
            triangles.append(_faces(corners) + len(owners))
            vertices.append(corners * scene.units.length)
            owners += [number] * len(corners)
    n = len(hulls)
    return Surroundings(
        tuple(hulls),
        np.concatenate(vertices) if vertices else np.empty((0, 3)),
        np.concatenate(triangles).astype(np.int32) if triangles else np.empty((0, 3), np.int32),
        np.array(owners, np.int32),
        np.empty((0, n, 3)),
        np.empty((0, n, 4)),
        np.empty((0, 3)),
    )


def places_of(scene: Scene, names: tuple[str, ...]) -> tuple[Floats, Floats, Floats]:
    """Return where bodies are now [m], shape (b, 3), their rotations, shape (b, 4), and the direction of gravity."""
    positions, quaternions = scene.engine.places(names)
    gravity = scene.engine.gravity
    strength = float(np.linalg.norm(gravity))
    return positions * scene.units.length, quaternions, gravity / strength if strength > 0 else np.zeros(3)


def _faces(corners: Floats) -> NDArray[np.int64]:
    """Return the triangles of the convex hull of corners, counter-clockwise seen from outside, shape (f, 3)."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415  (half a second, and only for runs that are recorded)

    hull = ConvexHull(corners)
    faces = hull.simplices.astype(np.int64)
    a, b, c = (corners[faces[:, k]] for k in range(3))
    is_inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0
    faces[is_inward] = faces[is_inward][:, ::-1]
    return faces
