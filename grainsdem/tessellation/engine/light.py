"""The light pass: volume, centroid and second moment of every cell, and no shapes."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.cells.cutting import CUT, FULL
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.tessellation.engine.growing import gather, grow, leaf_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.tessellation.engine.frame import Frame
    from grainsdem.tessellation.engine.tree import Tree

SIZE = 128
"""Triangles and planes that fit the first work arrays; a Poisson cell needs some 40."""

NEAR = 1024
"""Seeds that the list around a leaf holds; a Poisson leaf needs some 300."""

CHUNK = 256
"""Cells that one task of the thread pool makes."""


class Moments(NamedTuple):
    """What the light pass knows of every cell.

    Parameters
    ----------
    volumes : ndarray, shape (n,)
        Volumes [m³].
    centroids : ndarray, shape (n, 3)
        Centroids [m], relative to the seeds; zeros for an empty cell.
    energies : ndarray, shape (n,)
        ∫ |x − s|² dV [m⁵] over each cell, s its seed.
    """

    volumes: NDArray[np.float64]
    centroids: NDArray[np.float64]
    energies: NDArray[np.float64]


@inner
def work_arrays(size):  # type: ignore[no-untyped-def]
    """Return work arrays for a cell of up to ``size`` triangles and planes."""
    return (
        np.empty((8, size)),
        np.zeros((11, size), dtype=np.int32),
        np.empty((4, size)),
        np.zeros((4, size), dtype=np.int32),
        np.empty(128, dtype=np.int64),
    )


@inner
def list_arrays():  # type: ignore[no-untyped-def]
    """Return the arrays for the list of seeds around a leaf; the last entry is never counted."""
    return np.empty((5, NEAR + 1)), np.empty((3, NEAR + 1), dtype=np.int64)


@inner
def _measure(geo, tri, tags, n_tri, result):  # type: ignore[no-untyped-def]
    """Write volume, first moment and second moment about the site: signed tetrahedra over the faces' fans.

    Every directed edge of the dual is one edge of one face; any vertex of the face may be the fan's apex, so no face
    needs to be walked.
    """
    for t in range(n_tri):
        for k in range(3):
            tags[2, tri[k, t]] = t
    volume = mx = my = mz = second = 0.0
    for t in range(n_tri):
        bx, by, bz = geo[0, t], geo[1, t], geo[2, t]
        for k in range(3):
            a = tags[2, tri[k, t]]
            # Across the edge that ends at plane k lies the next corner of that plane's face.
            c = tri[3 + (k + 2) % 3, t]
            if a == t or a == c:  # noqa: PLR1714, SIM109  (numba has no "in" for integers of mixed widths)
                continue
            ax, ay, az = geo[0, a], geo[1, a], geo[2, a]
            cx, cy, cz = geo[0, c], geo[1, c], geo[2, c]
            det = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
            sx, sy, sz = ax + bx + cx, ay + by + cy, az + bz + cz
            volume += det
            mx += det * sx
            my += det * sy
            mz += det * sz
            second += det * (geo[3, a] + geo[3, t] + geo[3, c] + sx * sx + sy * sy + sz * sz)
    result[0] = volume / 6.0
    result[1] = mx / 24.0
    result[2] = my / 24.0
    result[3] = mz / 24.0
    result[4] = second / 120.0


@njit(cache=True, nogil=True)
def measure_cells(first, last, tree, frame, places, size, chunk, result, status):  # type: ignore[no-untyped-def]
    """Write volume, first and second moments of the cells at ``places`` of the tree, in rows by seed."""
    nothing = np.empty(0, dtype=np.int64)
    for b in range(first, last):
        work = work_arrays(size)
        around, named = list_arrays()
        leaf = -1
        count, known = 0, -1.0
        for at in range(b * chunk, min((b + 1) * chunk, len(places))):
            place = places[at]
            if leaf != leaf_of(place, tree[4], len(tree[0])):
                leaf = leaf_of(place, tree[4], len(tree[0]))
                count, known = gather(leaf, tree, frame, around, named, work[4])
            code, n_tri, _ = grow(place, tree, frame, nothing, around, named, count, known, work)
            row = result[tree[0][place]]
            if code == CUT:
                _measure(work[0], work[1], work[3], n_tri, row)
            else:
                for k in range(5):
                    row[k] = 0.0
            status[at] = code == FULL


def moments(tree: Tree, frame: Frame) -> Moments:
    """Return volume, centroid and energy of every cell, in the order of the seeds."""
    rows = np.empty((len(tree.order), 5))
    pending = np.arange(len(tree.order))
    size, chunk = SIZE, CHUNK
    while pending.size:
        is_full = np.zeros(pending.size, dtype=bool)
        n_chunks = -(-pending.size // chunk)
        in_blocks(measure_cells, n_chunks, tuple(tree), frame.kernel, pending, size, chunk, rows, is_full, least=1)
        pending = pending[is_full]
        size, chunk = 4 * size, 1
    volumes = rows[:, 0]
    centroids = np.divide(rows[:, 1:4], volumes[:, None], out=np.zeros((len(rows), 3)), where=volumes[:, None] > 0)
    return Moments(volumes * frame.scale**3, centroids * frame.scale, rows[:, 4] * frame.scale**5)
