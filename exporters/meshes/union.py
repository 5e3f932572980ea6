"""A bed as one mesh: the union of its grains, for printing and rendering."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from exporters.check import measured, refuse
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import identity_quaternions, world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.model import Packing, Polyhedra
from grainsdem.packing import contacts
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

NEAR = 1e-9
"""Grains nearer than this, in mean diameters, are given to manifold3d; others stand as they are."""


class _Mesh(NamedTuple):
    """Points, and triangles as their numbers."""

    points: Floats
    corners: NDArray[np.int64]


def united(packing: Packing, *, mass: float | None = None) -> Packing:
    """Return the grains as one body of triangles, in general not convex.

    Parameters
    ----------
    packing : Packing
        Convex grains; those that touch or overlap become one piece of surface.
    mass : float, optional
        Mass [kg] of the body; that of the grains by default.

    Raises
    ------
    InputError
        If the packing cannot be written, or a grain is none to manifold3d.

    Notes
    -----
    The volume is that of the grains together less what they share. Grains that touch to rounding may stay pieces.
    """
    integrals = measured(packing)
    d = float(cube_roots(6.0 / np.pi * integrals.volumes.mean()))
    found = contacts(packing, within=NEAR * d)
    # What meets the image of a grain does not meet it in the file.
    is_touching = np.zeros(len(packing), dtype=bool)
    is_touching[found.pairs[(found.shifts == 0).all(axis=1)]] = True
    # manifold3d's tolerance grows with the distance from the origin, in lengths of its own.
    centre = 0.5 * (packing.domain.lower + packing.domain.upper)
    points = (world_vertices(packing) - centre) / d
    corners, owner = _corners(packing)
    alone = _Mesh(points, corners[~is_touching[owner]])
    mesh = _packed(alone)
    if is_touching.any():
        joined = _joined(packing, points, np.flatnonzero(is_touching))
        mesh = _Mesh(
            np.concatenate([mesh.points, joined.points]),
            np.concatenate([mesh.corners, joined.corners + len(mesh.points)]),
        )
    return _body(
        packing,
        mesh,
        centre=centre,
        length=d,
        mass=float(packing.densities @ integrals.volumes) if mass is None else mass,
    )


def what_united(packing: Packing) -> dict[str, Any]:
    """Return what a union is: its pieces of surface, and the change of volume by what grains share."""
    from scipy.sparse import coo_array  # noqa: PLC0415  (a quarter of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415

    whole = united(packing).grains
    corners, n = whole.face_vertices.reshape(-1, 3), len(whole.vertices)
    a, b = np.concatenate([corners[:, :2], corners[:, 1:]]).T
    links = coo_array((np.ones(a.size, dtype=bool), (a, b)), shape=(n, n))
    sizes = integrate(packing.grains).volumes
    return {
        "n_pieces": int(connected_components(links, directed=False)[0]),
        "volume_change": float(integrate(whole).volumes[0] / sizes.sum() - 1.0),
    }


def _corners(packing: Packing) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles of all grains by numbers of vertices, and the grain of each."""
    cut = triangles(packing.grains, apexes=best_apexes(packing.grains))
    owner = np.repeat(np.arange(len(packing)), np.diff(cut.offsets))
    return cut.indices.astype(np.int64) + packing.grains.vertex_offsets[owner][:, None], owner


def _packed(mesh: _Mesh) -> _Mesh:
    """Return a mesh without the points that none of its triangles has."""
    used, corners = np.unique(mesh.corners, return_inverse=True)
    return _Mesh(mesh.points[used], corners.reshape(-1, 3))


def _joined(packing: Packing, points: Floats, rows: NDArray[np.int64]) -> _Mesh:
    """Return the union of some grains."""
    import manifold3d

    cut = triangles(packing.grains, apexes=best_apexes(packing.grains))
    solids, bad = [], np.zeros(len(packing), dtype=bool)
    for i in rows.tolist():
        own = slice(*packing.grains.vertex_offsets[i : i + 2].tolist())
        corners = cut.indices[slice(*cut.offsets[i : i + 2].tolist())].astype(np.uint64)
        solids.append(manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(points[own]), corners)))
        bad[i] = solids[-1].status() != manifold3d.Error.NoError
    refuse("grains must be closed bodies to manifold3d to be merged", bad)
    made = manifold3d.Manifold.batch_boolean(solids, manifold3d.OpType.Add).to_mesh64()
    return _Mesh(np.asarray(made.vert_properties)[:, :3], np.asarray(made.tri_verts).astype(np.int64))


def _body(packing: Packing, mesh: _Mesh, *, centre: Floats, length: float, mass: float) -> Packing:
    """Return a mesh as the one body of a packing."""
    n = len(mesh.corners)
    vertices = mesh.points * length
    shape = Polyhedra(
        vertices, np.array([0, len(vertices)]), np.array([0, n]), mesh.corners.ravel().astype(np.int32),
        3 * np.arange(n + 1),
    )  # fmt: skip
    one = integrate(shape)
    return Packing(
        replace(shape, vertices=vertices - one.centroids[0]),
        centre + one.centroids,
        identity_quaternions(1),
        np.array([mass / float(one.volumes[0])]),
        packing.domain,
    )
