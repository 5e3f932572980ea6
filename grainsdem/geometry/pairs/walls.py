"""Gaps between grains and the walls of their domain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numba import njit

from grainsdem.geometry.pairs.gaps import Gaps
from grainsdem.geometry.pairs.patches import find_feature, make_patch, share_patch

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.pairs.bodies import Bodies
    from grainsdem.model import Domain

    Floats = NDArray[np.float64]


def measure_wall_gaps(
    solids: Bodies, positions: Floats, domain: Domain, within: float
) -> tuple[NDArray[np.int32], Gaps]:
    """Return the grains no farther than ``within`` from a wall, and how far they are.

    Parameters
    ----------
    solids : Bodies
        Convex grains.
    positions : ndarray, shape (n, 3)
        Where they are [m].
    domain : Domain
        Walls stand at its faces, but for periodic axes, and at its planes.
    within : float
        Largest gap [m].

    Returns
    -------
    pairs : ndarray of int32, shape (m, 2)
        Wall, numbered as in `Domain`, and grain, sorted.
    gaps : Gaps
        As for two grains, with normals from the wall into the domain; points are relative to the grain's position.
    """
    ids: list[NDArray[np.int64]] = []
    found: list[Gaps] = []
    nothing = _empty(0)
    room = int(np.diff(solids.corner_offsets).max(initial=2)) + 8
    for wall, normal, distance in _walls(domain):
        # Where the wall stands, seen from each grain, along the normal into the domain.
        heights = distance - positions @ normal
        near = np.flatnonzero(heights >= -(solids.radii + within))
        result = _empty(near.size)
        _touch(solids, near, np.ascontiguousarray(heights[near]), normal, room, result)
        kept = result.gaps <= within
        ids.append(np.column_stack([np.full(int(kept.sum()), wall), near[kept]]))
        found.append(result.take(kept))
    columns = {
        name: np.concatenate([getattr(rows, name) for rows in found]) if found else getattr(nothing, name)
        for name in Gaps._fields
    }
    return np.concatenate([np.zeros((0, 2), np.int64), *ids]).astype(np.int32), nothing._replace(**columns)


def _walls(domain: Domain) -> list[tuple[int, Floats, float]]:
    """Return id, unit normal into the domain, and distance along it from the origin [m] of each wall, by id."""
    found = [(-7 - k, -plane[:3], -float(plane[3])) for k, plane in enumerate(domain.planes)]
    for axis in np.flatnonzero(~domain.periodic).tolist():
        along = np.eye(3)[axis]
        found.append((-1 - 2 * axis, along, float(domain.lower[axis])))
        found.append((-2 - 2 * axis, -along, -float(domain.upper[axis])))
    return sorted(found, key=lambda wall: wall[0])


def _empty(m: int) -> Gaps:
    """Return ``m`` rows to be filled."""
    a, b, c, d = (np.zeros((m, 3)) for _ in range(4))
    return Gaps(np.zeros(m), a, b, c, d, np.zeros(m), np.zeros((m, 2), dtype=np.int8))


@njit(cache=True)
def _touch(solids: Bodies, grains: NDArray[np.int64], heights: Floats, n: Floats, room: int, out: Gaps) -> None:
    patch = make_patch(room)
    x, nowhere = solids.vertices, np.zeros(3)
    for row in range(grains.size):
        a: Any = np.int32(grains[row])  # as ids of pairs are: for another type the callees would be compiled again
        low, lowest = np.inf, -1
        for k in range(solids.vertex_ranges[a, 0], solids.vertex_ranges[a, 1]):
            s = n[0] * x[k, 0] + n[1] * x[k, 1] + n[2] * x[k, 2]
            if s < low:
                low, lowest = s, k
        if lowest < 0:
            out.gaps[row] = np.inf
            continue
        gap = low - heights[row]
        count = find_feature(solids, a, -n[0], -n[1], -n[2], patch.polygon_b)
        out.gaps[row] = gap
        out.features[row, 0] = 2
        out.features[row, 1] = min(count, 3) - 1
        # The whole of what the grain touches with lies on the wall: cut by itself it is its own patch.
        for k in range(count):
            patch.polygon_a[k] = patch.polygon_b[count - 1 - k]
        shared, area = (0, 0.0) if count < 3 else share_patch(solids, count, count, nowhere, n, patch)
        out.areas[row] = area
        for c in range(3):
            out.normals[row, c] = n[c]
            out.seconds[row, c] = x[lowest, c]
            out.firsts[row, c] = x[lowest, c] - gap * n[c]
            out.centres[row, c] = x[lowest, c] - 0.5 * gap * n[c]
            if count == 2:
                middle = 0.5 * (x[patch.polygon_b[0], c] + x[patch.polygon_b[1], c])
                out.centres[row, c] = middle - 0.5 * gap * n[c]
            if shared > 0:
                flat = patch.centre[0] * patch.across[c] + patch.centre[1] * patch.up[c]
                out.centres[row, c] = flat + (low - 0.5 * gap) * n[c]
