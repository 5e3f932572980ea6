"""Who touches whom, in any packing of convex grains: fresh, settled, sheared or read from a file."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.geometry.pairs.walls import measure_wall_gaps
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.separation import bodies, measure_near, offsets_between
from grainsdem.model import ContactGraph
from grainsdem.ragged import owners
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Gaps
    from grainsdem.model import Packing

NEAR = 1e-3
"""Default of ``within``, relative to the mean grain diameter: the overlap that soft contacts are allowed."""


@gated
def contacts(packing: Packing, *, within: float | None = None, walls: bool = False) -> ContactGraph:
    """Return every pair of grains no farther apart than ``within``, with the exact signed gap.

    Parameters
    ----------
    packing : Packing
        Convex grains, wherever they are; periodic axes of the domain are honoured.
    within : float, optional
        Largest gap [m] of a contact; by default 1e-3 of the mean equal-volume diameter. Grains in place that were
        shrunk do not touch: see `neighbor_contacts`.
    walls : bool
        Whether the walls of the domain count as grains, with negative ids (see `Domain`).

    Returns
    -------
    ContactGraph
        Gap, normal, midpoint of the closest points (or the centre of the shared patch where faces or edges lie flat
        on one another), the area that facing polygons share, what touches with what, and the closest points. Points
        lie beside the first grain of each pair, whose second may be a periodic image.

    Raises
    ------
    InputError
        If ``within`` is negative or not finite.
    """
    compiled("walls" if walls else "contacts")
    if within is None:
        within = NEAR * mean_diameter(packing)
    if not (np.isfinite(within) and within >= 0):
        raise InputError(f"within must be zero or more and finite; got {within}")
    pairs, shifts = near_images(packing, within)
    solids = bodies(packing)
    kept, measured = measure_near(packing, solids, pairs, shifts, within)
    found = _graph(packing, pairs[kept], shifts[kept], pairs[kept, 0], measured)
    if not walls:
        return found
    pairs, measured = measure_wall_gaps(solids, packing.positions, packing.domain, within)
    nowhere = np.zeros((len(pairs), 3), dtype=np.int32)
    touched = _graph(packing, pairs, nowhere, pairs[:, 1], measured)
    arrays = {
        name: np.concatenate([getattr(touched, name), getattr(found, name)])
        for name in ("pairs", "gaps", "normals", "points", "areas", "features", "ends", "shifts")
    }
    return ContactGraph(len(packing), **arrays)


def _graph(
    packing: Packing, pairs: NDArray[np.int32], shifts: NDArray[np.int32], beside: NDArray[np.int32], measured: Gaps
) -> ContactGraph:
    """Return a graph of what was measured relative to the grains ``beside``."""
    origins = packing.positions[beside]
    return ContactGraph(
        len(packing),
        pairs,
        measured.gaps,
        measured.normals,
        origins + measured.centres,
        measured.areas,
        measured.features,
        np.stack([origins + measured.firsts, origins + measured.seconds], axis=1),
        shifts,
    )


@gated
def neighbor_contacts(packing: Packing) -> ContactGraph:
    """Return the neighbours of the tessellation that grains in place were carved from, in closed form.

    Parameters
    ----------
    packing : Packing
        Grains still in the cells they grew in, shrunk or not.

    Returns
    -------
    ContactGraph
        One pair for each face between two kept cells; a periodic domain may hold a pair more than once. The gap is
        the distance of the two facing planes, the area the mean of the two faces.

    Raises
    ------
    InputError
        If the packing no longer knows its neighbours.

    Notes
    -----
    Both faces lie in planes parallel to the cells' common one, so the gap is (c_j - c_i) · n minus the heights of
    the two planes above their centres c. It is the distance of the grains themselves wherever the two faces overlap
    seen along n, which small faces need not do once shrunk about different centres.
    """
    if packing.links is None:
        raise InputError("the packing has no links to a tessellation; use contacts(packing, within=...)")
    links, grains = packing.links, packing.grains
    planes = face_planes(grains)
    turned = np.repeat(to_matrices(packing.quaternions), np.diff(grains.face_offsets), axis=0)
    normals = np.einsum("fij,fj->fi", turned, planes.normals)
    i = owners(grains.face_offsets)
    j = links.neighbors.astype(np.int64)
    faces = np.flatnonzero(j >= 0)
    back = _facing(i[faces], j[faces], links.shifts[faces].astype(np.int64), len(packing))
    faces, back = faces[back >= 0], faces[back[back >= 0]]
    once = (i[faces] < j[faces]) | ((i[faces] == j[faces]) & (faces < back))
    faces, back = faces[once], back[once]
    pairs = np.stack([i[faces], j[faces]], axis=1).astype(np.int32)
    between = offsets_between(packing, pairs, links.shifts[faces])
    n = normals[faces]
    heights, others = planes.heights[faces], planes.heights[back]
    gaps = np.einsum("ij,ij->i", n, between) - heights - others
    centres = packing.positions[i[faces]] + n * (heights + 0.5 * gaps)[:, None]
    order = np.lexsort((faces, j[faces], i[faces]))
    areas = 0.5 * (planes.areas[faces] + planes.areas[back])
    features = np.full((len(pairs), 2), 2, dtype=np.int8)
    graph = ContactGraph(len(packing), pairs, gaps, n, centres, areas, features, shifts=links.shifts[faces])
    return graph.select(order)


def _facing(i: NDArray[np.int64], j: NDArray[np.int64], shifts: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Return, for every face from i to an image of j, the face that looks back; -1 where there is none."""
    most = int(np.abs(shifts).max(initial=0))
    base = 2 * most + 1
    place = np.array([base * base, base, 1])
    forward = (i * n + j) * base**3 + (shifts + most) @ place
    backward = (j * n + i) * base**3 + (most - shifts) @ place
    back = np.full(i.size, -1)
    if i.size:
        # Both in order: a search for scattered keys would miss the cache each time.
        order, wanted = np.argsort(forward, kind="stable"), np.argsort(backward, kind="stable")
        found = order[np.minimum(np.searchsorted(forward[order], backward[wanted]), i.size - 1)]
        back[wanted] = np.where(forward[found] == backward[wanted], found, -1)
    return back


def mean_diameter(packing: Packing) -> float:
    """Return the mean diameter [m] of the spheres of equal volume: the length that tolerances are relative to."""
    sizes = cube_roots(6 / np.pi * np.abs(volumes(packing.grains)))
    return float(sizes.mean()) if sizes.size else 1.0
