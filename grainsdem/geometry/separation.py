"""Exact signed gaps of pairs of convex grains, and planes that certify that two grains do not overlap.

Each pair is solved in the frame of its first grain, so answers do not depend on where in the world a packing lies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

from grainsdem.geometry.pairs.bodies import Bodies, bodies
from grainsdem.geometry.pairs.gaps import Gaps
from grainsdem.geometry.pairs.gjk import FAR, OVERLAPPING, closest_points, descend, make_simplex
from grainsdem.geometry.pairs.patches import (
    find_facing,
    find_feature,
    make_patch,
    share_patch,
    take_face,
)
from grainsdem.geometry.pairs.penetration import along, search_faces, solve_near
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.ragged import offsets_from_counts, take_indices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.pairs.patches import Patch
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

__all__ = ["Bodies", "Gaps", "bodies", "certify", "measure_gaps", "measure_near", "offsets_between"]

TURN = 1 << 21
"""Pairs measured at a time: a third of a gigabyte of results."""

PAIRS = 256
"""Pairs that are worth a thread."""

UNIT = 2.0**-53
"""Largest relative error of one rounding."""


def offsets_between(packing: Packing, pairs: NDArray[np.int32], shifts: NDArray[np.integer] | None = None) -> Floats:
    """Return the vector [m] from the first grain's position to the second's image, shape (m, 3)."""
    between = packing.positions[pairs[:, 1]] - packing.positions[pairs[:, 0]]
    if shifts is None or not shifts.any():
        return between
    return between + shifts * packing.domain.lengths


def measure_gaps(solids: Bodies, pairs: NDArray[np.int32], offsets: Floats, limit: float = np.inf) -> Gaps:
    """Return the exact signed gap of each pair.

    Parameters
    ----------
    solids : Bodies
        Convex grains (see `bodies`).
    pairs : ndarray of int32, shape (m, 2)
        Grain ids.
    offsets : ndarray, shape (m, 3)
        Vector [m] from the first grain's position to the second's (see `offsets_between`).
    limit : float
        Pairs farther apart than this [m] get an infinite gap and nothing else; saves most of the work.

    Returns
    -------
    Gaps
        One row a pair.

    Notes
    -----
    GJK finds the distance and proves it by a plane. Where it finds none, or cannot prove it, every face normal and
    pair of edges that could be the shortest way out is tried instead.
    """
    m = len(pairs)
    a, b, c, d = (np.zeros((m, 3)) for _ in range(4))
    result = Gaps(np.full(m, np.inf), a, b, c, d, np.zeros(m), np.zeros((m, 2), dtype=np.int8))
    room = 2 * int(np.diff(solids.corner_offsets).max(initial=2)) + 8  # a clipped polygon has corners of both
    turns = _in_space(solids, pairs[:, 0])
    pairs, offsets = _plain(pairs, np.int32), _plain(offsets, np.float64)
    in_blocks(_measure, m, solids, pairs, offsets, turns, float(limit), room, result, least=PAIRS)
    return result


def measure_near(
    packing: Packing, solids: Bodies, pairs: NDArray[np.int32], shifts: NDArray[np.int32], within: float
) -> tuple[NDArray[np.int64], Gaps]:
    """Return which pairs are no farther apart than ``within`` [m], and their gaps.

    Takes the pairs in turns, so that what is far apart, most of them, never fills the memory.
    """
    rows: list[NDArray[np.int64]] = []
    found: list[Gaps] = []
    for start in range(0, max(len(pairs), 1), TURN):
        some = slice(start, start + TURN)
        measured = measure_gaps(solids, pairs[some], offsets_between(packing, pairs[some], shifts[some]), within)
        kept = np.flatnonzero(measured.gaps <= within)
        rows.append(kept + start)
        found.append(measured.take(kept))
    if len(found) == 1:
        return rows[0], found[0]
    columns = {name: np.concatenate([getattr(part, name) for part in found]) for name in Gaps._fields}
    return np.concatenate(rows), found[0]._replace(**columns)


def certify(solids: Bodies, pairs: NDArray[np.int32], offsets: Floats) -> tuple[Floats, Floats]:
    """Return a plane's normal for each pair, and how far apart the two grains surely are along it.

    Parameters
    ----------
    solids : Bodies
        Convex grains (see `bodies`).
    pairs : ndarray of int32, shape (m, 2)
        Grain ids.
    offsets : ndarray, shape (m, 3)
        Vector [m] from the first grain's position to the second's.

    Returns
    -------
    normals : ndarray, shape (m, 3)
        Unit normals from the first grain to the second.
    margins : ndarray, shape (m,)
        Lower bound [m] of min n · x over the second minus max n · x over the first. Where it is not negative, the
        plane proves that the two do not overlap; else the overlap is no thicker than its opposite.

    Notes
    -----
    However the normal was found, the margin is taken afresh over all vertices, and lowered by more than all its
    roundings together: 32 u (r_i + r_j + |offset|), with u = 2⁻⁵³ and r the farthest vertex from a grain's position.
    The dot products and their sum err by less than 6 u of it, the turning of the vertices by less than 12 u.
    """
    normals = np.zeros((len(pairs), 3))
    margins = np.full(len(pairs), -np.inf)
    pairs, offsets = _plain(pairs, np.int32), _plain(offsets, np.float64)
    in_blocks(_certify, len(pairs), solids, pairs, offsets, normals, margins, least=PAIRS)
    return normals, margins


def _in_space(solids: Bodies, firsts: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return the pairs in the order in which their first grains lie in memory, and so in space."""
    starts = solids.vertex_ranges[:, 0]
    if (firsts[1:] < firsts[:-1]).any():
        return np.argsort(starts[firsts], kind="stable")
    # Pairs sorted by id, as most are: whole grains are put in order instead of their pairs.
    groups = offsets_from_counts(np.bincount(firsts, minlength=starts.size))
    return take_indices(groups, np.argsort(starts, kind="stable"))[0]


def _plain(array: NDArray[Any], dtype: type) -> NDArray[Any]:
    """Return the array in the one layout that the kernels are compiled for: another would compile them again."""
    return np.require(array, dtype, ["C", "W"])


@njit(cache=True, nogil=True)
def _measure(
    start: int,
    stop: int,
    solids: Bodies,
    pairs: NDArray[np.int32],
    offsets: Floats,
    turns: NDArray[np.int64],
    limit: float,
    room: int,
    out: Gaps,
) -> None:
    """Measure the pairs of one block of turns, with scratch of its own."""
    simplex, patch = make_simplex(), make_patch(room)
    pa, pb = np.empty(3), np.empty(3)
    picked, segments = np.empty(2, dtype=np.int64), np.empty((4, 3))
    n = simplex.nearest
    for row in turns[start:stop]:
        a, b = pairs[row, 0], pairs[row, 1]
        t = offsets[row]
        # Most grains of a fresh packing face each other with parallel faces: their planes prove their distance.
        face, other = find_facing(solids, a, b, t, n)
        if other >= 0:
            gap = along(solids, a, b, t, n[0], n[1], n[2])
            if gap > limit:
                continue
            if gap >= 0.0:
                corners_a = take_face(solids, a, face, patch.polygon_a)
                corners_b = take_face(solids, b, other, patch.polygon_b)
                shared, area = share_patch(solids, corners_a, corners_b, t, n, patch)
                if shared > 0:
                    _keep(row, gap, n, corners_a, corners_b, out)
                    _keep_patch(row, solids.heights[face] + 0.5 * gap, area, n, patch, out)
                    for c in range(3):
                        out.firsts[row, c] = out.centres[row, c] - 0.5 * gap * n[c]
                        out.seconds[row, c] = out.centres[row, c] + 0.5 * gap * n[c]
                    continue
        state, count, lower = descend(solids, a, b, t, limit, simplex)
        if state == FAR:
            continue
        size = solids.radii[a] + solids.radii[b]
        apart = closest_points(solids, count, t, simplex, pa, pb)
        gap = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        # Below 1e-9 of a grain the direction is rounding; above, the bound must meet the distance.
        if state != OVERLAPPING and gap > 1e-9 * size and gap - lower <= 1e-12 * size:
            n[0], n[1], n[2] = n[0] / gap, n[1] / gap, n[2] / gap
        else:
            gap = solve_near(solids, a, b, t, pa, pb, apart, n, picked, segments)
        if gap > limit:
            continue
        corners_a = find_feature(solids, a, n[0], n[1], n[2], patch.polygon_a)
        corners_b = find_feature(solids, b, -n[0], -n[1], -n[2], patch.polygon_b)
        _keep(row, gap, n, corners_a, corners_b, out)
        for c in range(3):
            out.firsts[row, c] = pa[c]
            out.seconds[row, c] = pb[c]
            out.centres[row, c] = 0.5 * (pa[c] + pb[c])
        if max(corners_a, corners_b) >= 3 and min(corners_a, corners_b) >= 2:
            shared, area = share_patch(solids, corners_a, corners_b, t, n, patch)
            if shared > 0:
                height = 0.5 * (n[0] * (pa[0] + pb[0]) + n[1] * (pa[1] + pb[1]) + n[2] * (pa[2] + pb[2]))
                _keep_patch(row, height, area if min(corners_a, corners_b) >= 3 else 0.0, n, patch, out)


@inner
def _keep(row: int, gap: float, n: Floats, corners_a: int, corners_b: int, out: Gaps) -> None:
    """Write down a gap, its normal and what touches what."""
    out.gaps[row] = gap
    out.features[row, 0] = min(corners_a, 3) - 1
    out.features[row, 1] = min(corners_b, 3) - 1
    for c in range(3):
        out.normals[row, c] = n[c]


@inner
def _keep_patch(row: int, height: float, area: float, n: Floats, patch: Patch, out: Gaps) -> None:
    """Write down a shared patch's area, and its centre at a height along the normal."""
    out.areas[row] = area
    for c in range(3):
        out.centres[row, c] = patch.centre[0] * patch.across[c] + patch.centre[1] * patch.up[c] + height * n[c]


@njit(cache=True, nogil=True)
def _certify(
    start: int, stop: int, solids: Bodies, pairs: NDArray[np.int32], offsets: Floats, normals: Floats, margins: Floats
) -> None:
    """Certify the pairs of one block, with scratch of its own."""
    simplex = make_simplex()
    pa, pb = np.empty(3), np.empty(3)
    for row in range(start, stop):
        a, b = pairs[row, 0], pairs[row, 1]
        t = offsets[row]
        n = simplex.nearest
        reach = solids.radii[a] + solids.radii[b] + np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
        error = 32.0 * UNIT * reach
        _, count, _ = descend(solids, a, b, t, 2.0 * error, simplex)
        norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
        margin = -np.inf
        if norm > 0.0:
            n[0], n[1], n[2] = n[0] / norm, n[1] / norm, n[2] / norm
            margin = along(solids, a, b, t, n[0], n[1], n[2])
        if margin < error:
            closest_points(solids, count, t, simplex, pa, pb)
            margin = search_faces(solids, a, b, t, pa, pb, margin, n)
        for c in range(3):
            normals[row, c] = n[c]
        margins[row] = margin - error
