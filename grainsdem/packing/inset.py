"""Grains with their faces moved inward: the same distance everywhere, where scaling takes more from long grains."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.cells.insets import inset_shapes
from grainsdem.geometry.integrals import centroids, face_planes, volumes
from grainsdem.geometry.rotations import to_matrices
from grainsdem.ragged import owners
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.cells.insets import Insets
    from grainsdem.model import CellLinks, Packing

    Floats = NDArray[np.float64]

LEVEL = 1e-9
"""A face this near to level, as the sine of its slope, is an upper or lower face of a planar bed."""

OUT = 1e-9
"""How far outside its cell a point may lie, relative to the grain's size: rounding of what came from a file."""


@gated
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
    smallest, largest = (float(distances.min()), float(distances.max())) if n else (0.0, 0.0)
    moved = _moved(packing, np.repeat(distances, np.diff(packing.grains.face_offsets)), distances, "distance")
    return moved.with_step("inset", smallest=smallest, largest=largest)


def set_apart(packing: Packing, gap: float) -> Packing:
    """Return the grains with every face half a gap [m] inside the plane of its cell; see `shrink`."""
    if not (np.isfinite(gap) and gap >= 0):
        raise InputError(f"gap must be zero or more and finite; got {gap}")
    if packing.links is None or packing.links.heights is None:
        raise InputError("a gap can be set only while grains are in the cells they grew in; use inset, or scale")
    owner = owners(packing.grains.face_offsets)
    moves = np.where(_is_moving(packing), 0.5 * gap - slacks(packing).distances, 0.0)
    # A face that fills its cell is off its plane by rounding, either way.
    wide = np.unique(owner[moves < -OUT * cube_roots(volumes(packing.grains))[owner]])
    if wide.size:
        raise InputError(
            f"a gap can only grow: {wide.size} of {len(packing)} grains are farther from their cells' planes than "
            f"half of {gap} already: {name_offenders(wide)}"
        )
    moves = np.maximum(moves, 0.0)
    least = np.full(len(packing), np.inf)
    np.minimum.at(least, owner[_is_moving(packing)], moves[_is_moving(packing)])
    return _moved(packing, moves, np.where(np.isfinite(least), least, 0.0), "half the gap")


class Slacks(NamedTuple):
    """Room between grains and the planes of their cells.

    Parameters
    ----------
    normals : ndarray, shape (n_faces, 3)
        Outward unit normals in the world.
    distances : ndarray, shape (n_faces,)
        Distance [m] to the cell's plane along each.
    """

    normals: Floats
    distances: Floats


def slacks(packing: Packing, *, cells: bool = False) -> Slacks:
    """Return how far each face is from the plane of its own cell, or with ``cells`` how far the centroid is.

    Without known cells the planes are those of the faces themselves.
    """
    links = packing.links
    normals, heights = _normals(packing), face_planes(packing.grains).heights
    distances = heights
    if links is not None and links.sites is not None and links.heights is not None:
        offsets = (packing.positions - links.sites)[owners(packing.grains.face_offsets)]
        distances = links.heights - np.einsum("fi,fi->f", normals, offsets)
    return Slacks(normals, distances if cells else distances - heights)


def _moved(packing: Packing, moves: Floats, least: Floats, what: str) -> Packing:
    """Return the grains with each face moved inward by its own distance, those of a grain by ``least`` or more."""
    moves = np.where(_is_moving(packing), moves, 0.0)
    moved = inset_shapes(packing.grains, moves)
    _refuse(moved, moves, packing.grains.face_offsets, what)
    is_still = _largest(moves, packing.grains.face_offsets) == 0
    steps = np.where(is_still[:, None], 0.0, centroids(moved.shapes))
    vertices = moved.shapes.vertices - np.repeat(steps, np.diff(moved.shapes.vertex_offsets), axis=0)
    return replace(
        packing,
        grains=replace(moved.shapes, vertices=vertices),
        positions=packing.positions + np.einsum("nij,nj->ni", to_matrices(packing.quaternions), steps),
        links=None if packing.links is None else _kept_links(packing, packing.links, moved.faces, moves, least),
    )


def _largest(moves: Floats, offsets: NDArray[np.int64]) -> Floats:
    """Return the largest move of each grain's faces."""
    most = np.zeros(offsets.size - 1)
    np.maximum.at(most, owners(offsets), moves)
    return most


def _is_moving(packing: Packing) -> NDArray[np.bool_]:
    """Return which faces an inset moves: all, but the upper and lower ones of a planar bed."""
    if not packing.domain.is_planar:
        return np.ones(packing.grains.n_faces, dtype=bool)
    is_moving: NDArray[np.bool_] = np.hypot(*_normals(packing)[:, :2].T) > LEVEL
    return is_moving


def _normals(packing: Packing) -> Floats:
    """Return the outward unit normals of the faces in the world, shape (n_faces, 3)."""
    owner = owners(packing.grains.face_offsets)
    turned: Floats = np.einsum(
        "fij,fj->fi", to_matrices(packing.quaternions)[owner], face_planes(packing.grains).normals
    )
    return turned


def _refuse(moved: Insets, moves: Floats, offsets: NDArray[np.int64], what: str) -> None:
    """Raise `InputError` where a grain vanishes or never was one."""
    unsound = np.flatnonzero(moved.is_unsound)
    if unsound.size:
        raise InputError(
            f"grains must be closed, convex and finite to be inset; {unsound.size} are not: {name_offenders(unsound)}"
        )
    gone = np.flatnonzero(moved.is_gone)
    if gone.size:
        raise InputError(
            f"{what} must be below the radius of the largest ball inside each grain; {gone.size} of "
            f"{offsets.size - 1} would vanish by {_largest(moves, offsets)[gone[0]]:.6g}: {name_offenders(gone)}"
        )


def _kept_links(
    packing: Packing, links: CellLinks, faces: NDArray[np.int64], moves: Floats, least: Floats
) -> CellLinks:
    """Return the links of the faces that are left; what is known of the cells' other planes is how far they are."""
    neighbors, shifts = links.neighbors[faces], links.shifts[faces]
    if links.sites is None or links.heights is None or links.rooms is None:
        return replace(links, neighbors=neighbors, shifts=shifts)
    rooms = links.rooms + least
    is_lost = np.ones(moves.size, dtype=bool)
    is_lost[faces] = False
    # A face that the others cut off was passed by its own plane too.
    np.minimum.at(rooms, owners(packing.grains.face_offsets)[is_lost], (slacks(packing).distances + moves)[is_lost])
    return replace(links, neighbors=neighbors, shifts=shifts, heights=links.heights[faces], rooms=rooms)
