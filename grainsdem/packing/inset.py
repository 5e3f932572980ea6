"""Grains with their faces moved inward: the same distance everywhere, where scaling takes more from long grains."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.geometry.cells.insets import inset_shapes
from grainsdem.geometry.integrals import centroids, face_planes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.cells.insets import Insets
    from grainsdem.model import CellLinks, Packing

    Floats = NDArray[np.float64]

LEVEL = 1e-9
"""A face this near to level, as the sine of its slope, is an upper or lower face of a planar bed."""


def inset(packing: Packing, distance: ArrayLike) -> Packing:
    """Return the grains with all their faces moved inward by a distance; faces and edges that vanish are gone.

    Parameters
    ----------
    packing : Packing
        Convex grains, wherever they are.
    distance : array_like, shape () or (n,)
        Distance [m], zero or more: one for all, or one for each grain. Two grains that both move by t are apart by at
        least 2 t more than before.

    Returns
    -------
    Packing
        The same grains, each about its new centroid; links to neighbours stay for the faces that are left. A grain
        that does not move is the same to the bit. In a planar bed the upper and lower faces stay, as the grains are
        prisms.

    Raises
    ------
    InputError
        If a distance is negative or not finite, a grain vanishes, or a grain is not a closed body.
    ShapeError
        If there is neither one distance nor one a grain.

    Notes
    -----
    Each grain becomes its erosion by a ball: every point that is at least ``distance`` inside. Its volume is between
    V - A t and V - A t + O(t²); its faces keep their normals.
    """
    distances = np.asarray(distance, dtype=np.float64)
    n = len(packing)
    if distances.shape not in ((), (n,)):
        raise ShapeError(f"distance must be one number or {n}, one a grain; got shape {distances.shape}")
    distances = np.broadcast_to(distances, (n,))
    bad = np.flatnonzero(~(np.isfinite(distances) & (distances >= 0)))
    if bad.size:
        raise InputError(f"distance must be zero or more and finite; got {distances[bad[0]]}")
    moved = inset_shapes(packing.grains, _moves(packing, distances))
    _refuse(moved, distances)
    is_still = distances == 0
    steps = np.where(is_still[:, None], 0.0, centroids(moved.shapes))
    vertices = moved.shapes.vertices - np.repeat(steps, np.diff(moved.shapes.vertex_offsets), axis=0)
    return replace(
        packing,
        grains=replace(moved.shapes, vertices=vertices),
        positions=packing.positions + np.einsum("nij,nj->ni", to_matrices(packing.quaternions), steps),
        links=None if packing.links is None else _kept_links(packing, packing.links, moved.faces, distances),
    ).with_step("inset", smallest=float(distances.min()) if n else 0.0, largest=float(distances.max(initial=0.0)))


def _moves(packing: Packing, distances: Floats) -> Floats:
    """Return the distance of each face: that of its grain, but none for the upper and lower faces of a planar bed."""
    moves = np.repeat(distances, np.diff(packing.grains.face_offsets))
    if packing.domain.is_planar:
        moves[np.hypot(*_normals(packing)[:, :2].T) <= LEVEL] = 0.0
    return moves


def _normals(packing: Packing) -> Floats:
    """Return the outward unit normals of the faces in the world, shape (n_faces, 3)."""
    owner = owners(packing.grains.face_offsets)
    turned: Floats = np.einsum(
        "fij,fj->fi", to_matrices(packing.quaternions)[owner], face_planes(packing.grains).normals
    )
    return turned


def _refuse(moved: Insets, distances: Floats) -> None:
    """Raise `InputError` where a grain vanishes or never was one."""
    unsound = np.flatnonzero(moved.is_unsound)
    if unsound.size:
        raise InputError(
            f"grains must be closed, convex and finite to be inset; {unsound.size} are not: {name_offenders(unsound)}"
        )
    gone = np.flatnonzero(moved.is_gone)
    if gone.size:
        raise InputError(
            f"distance must be below the radius of the largest ball inside each grain; {gone.size} of "
            f"{len(distances)} would vanish by {distances[gone[0]]:.6g}: {name_offenders(gone)}"
        )


def _kept_links(packing: Packing, links: CellLinks, faces: NDArray[np.int64], distances: Floats) -> CellLinks:
    """Return the links of the faces that are left; what is known of the cells' other planes is how far they are."""
    neighbors, shifts = links.neighbors[faces], links.shifts[faces]
    if links.sites is None or links.heights is None or links.rooms is None:
        return replace(links, neighbors=neighbors, shifts=shifts)
    owner = owners(packing.grains.face_offsets)
    offsets = (packing.positions - links.sites)[owner]
    slacks = links.heights - np.einsum("fi,fi->f", _normals(packing), offsets) - face_planes(packing.grains).heights
    is_lost = np.ones(slacks.size, dtype=bool)
    is_lost[faces] = False
    rooms = np.array(links.rooms)
    np.minimum.at(rooms, owner[is_lost], slacks[is_lost])
    return replace(links, neighbors=neighbors, shifts=shifts, heights=links.heights[faces], rooms=rooms + distances)
