"""The surface of a heap, how steep it is, and how far the heap reaches."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.dynamics.mechanics.networks import contact_graph
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics.snapshots import Snapshot
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Origin = Mapping[int, tuple[float, float]]
    """For each level axis along which a bed runs out: where from [m], and which way, 0 for both."""

FLANK = 0.2, 0.8
"""Heights, over the greatest, between which the slope is fitted: neither crest nor toe."""

PIECE = 2.0
"""Length of the pieces [width of a bin] that a bin is cut into across the slope."""

REACH = 0.95
"""Share of the mass that the run-out encloses; single grains roll farther."""


class Slope(NamedTuple):
    """The surface of a heap.

    Parameters
    ----------
    distances, heights : ndarray, shape (k,)
        Middles of the bins [m] from where the heap runs out, and heights of the surface above the floor [m].
    angle : float
        Slope of the flank [rad], NaN where fewer than three bins are on it.
    error : float
        Standard error of the fit [rad]: how well a line describes this one surface, not how far the next heap differs.
    n_bins : int
        Bins that are on the flank.
    """

    distances: Floats
    heights: Floats
    angle: float
    error: float
    n_bins: int


def directions(packing: Packing) -> tuple[int, tuple[int, ...]]:
    """Return the axis against gravity and the level ones."""
    return (1, (0,)) if packing.domain.is_planar else (2, (0, 1))


def distance_from(points: Floats, origin: Origin) -> Floats:
    """Return how far [m] points, shape (n, 3), are from where a bed runs out, shape (n,)."""
    parts = []
    for axis, (place, way) in origin.items():
        along = points[:, axis] - place
        parts.append(along * way if way else np.abs(along))
    return parts[0] if len(parts) == 1 else np.asarray(np.hypot(*parts))


def run_out(packing: Packing, origin: Origin) -> tuple[float, float]:
    """Return the height [m] of a bed's highest point, and the distance [m] within which 95 % of its mass are."""
    up, _ = directions(packing)
    distances = distance_from(packing.positions, origin)
    masses = volumes(packing.grains) * packing.densities
    order = np.argsort(distances, kind="stable")
    shares = np.cumsum(masses[order]) / masses.sum()
    reach = distances[order][min(int(np.searchsorted(shares, REACH)), len(order) - 1)]
    return float(world_vertices(packing)[:, up].max() - packing.domain.lower[up]), float(reach)


def surface(snapshot: Snapshot, origin: Origin, *, width: float) -> Slope:
    """Return the surface of a heap, in bins of a width [m]; grains that touch no other one do not count."""
    packing = snapshot.packing
    up, _ = directions(packing)
    points = world_vertices(packing)
    is_heaped = contact_graph(snapshot).coordination() > 0
    points = points[is_heaped[owners(packing.grains.vertex_offsets)]]
    if not len(points):
        return Slope(np.empty(0), np.empty(0), np.nan, np.nan, 0)
    distances = distance_from(points, origin)
    heights = points[:, up] - packing.domain.lower[up]
    inside = distances >= 0
    n_bins = int(distances.max() / width) + 1
    middles = np.asarray((np.arange(n_bins) + 0.5) * width, dtype=np.float64)
    tops = np.zeros(n_bins)
    bins = np.clip(distances / width, 0, n_bins - 1).astype(np.int64)
    for k in range(n_bins):
        mine = inside & (bins == k)
        n_pieces, pieces = _pieces(points[mine], origin, packing, radius=middles[k], length=PIECE * width)
        highest = np.zeros(n_pieces)
        np.maximum.at(highest, pieces, heights[mine])
        tops[k] = highest.mean()
    return Slope(middles, tops, *_fit(middles, tops))


def _pieces(
    points: Floats, origin: Origin, packing: Packing, *, radius: float, length: float
) -> tuple[int, NDArray[np.int64]]:
    """Return into how many pieces a bin is cut across the slope, and the piece of each point, shape (n,)."""
    if len(origin) == 2:  # around the middle
        (x, _), (y, _) = origin[0], origin[1]
        share = np.arctan2(points[:, 1] - y, points[:, 0] - x) / (2 * np.pi) + 0.5
        count = max(3, int(2 * np.pi * radius / length))
        return count, np.minimum((share * count).astype(np.int64), count - 1)
    (axis, (place, way)) = next(iter(origin.items()))
    across = [other for other in directions(packing)[1] if other != axis]
    n_ways = 1 if way else 2
    side = np.zeros(len(points), np.int64) if way else (points[:, axis] > place).astype(np.int64)
    if not across:
        return n_ways, side
    low, high = packing.domain.lower[across[0]], packing.domain.upper[across[0]]
    count = max(1, int((high - low) / length))
    piece = np.clip((points[:, across[0]] - low) / (high - low) * count, 0, count - 1).astype(np.int64)
    return n_ways * count, side * count + piece


def _fit(distances: Floats, heights: Floats) -> tuple[float, float, int]:
    """Return the angle of the flank's least-squares line and its standard error [rad], and how many bins it has."""
    top = heights.max()
    if not top > 0:
        return np.nan, np.nan, 0
    above = np.flatnonzero(heights >= FLANK[1] * top)
    first = int(above[-1])
    below = np.flatnonzero(heights[first:] < FLANK[0] * top)
    last = first + int(below[0]) if below.size else len(heights) - 1
    x, y = distances[first : last + 1], heights[first : last + 1]
    if x.size < 3:
        return np.nan, np.nan, int(x.size)
    spread = x - x.mean()
    slope = float(spread @ y / (spread @ spread))
    residual = y - y.mean() - slope * spread
    error = float(np.sqrt(residual @ residual / (x.size - 2) / (spread @ spread)))
    return float(np.arctan(-slope)), error / (1 + slope**2), int(x.size)
