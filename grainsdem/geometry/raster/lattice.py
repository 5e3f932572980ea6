"""Which grain each point of a lattice lies in: rows of voxels cut by the planes of convex grains."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.clipping import box_planes
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.raster.copies import copies, spread, turned_normals
from grainsdem.geometry.threads import in_blocks
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Labels = NDArray[np.int32]

BLOCK = 1 << 24
"""Voxels that are held at a time: 64 MiB."""

VOID, OUTSIDE = 0, -1
"""Labels of voxels in no grain, and outside the domain."""


class Lattice(NamedTuple):
    """Voxels that fill a box.

    Parameters
    ----------
    lower : ndarray, shape (3,)
        Lower corner [m] of the box.
    spacing : ndarray, shape (3,)
        Edges [m] of a voxel.
    counts : tuple of int
        Numbers of voxels along x, y and z.
    """

    lower: Floats
    spacing: Floats
    counts: tuple[int, int, int]

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of an array of voxels: z, y, x."""
        return self.counts[2], self.counts[1], self.counts[0]

    @property
    def upper(self) -> Floats:
        """Upper corner [m] of the box, shape (3,)."""
        return np.asarray(self.lower + self.spacing * np.array(self.counts))


def label_blocks(packing: Packing, lattice: Lattice, *, most: int = BLOCK) -> Iterator[Labels]:
    """Yield the labels of a lattice in blocks of whole layers, from below.

    Parameters
    ----------
    packing : Packing
        Convex grains; where two overlap, the one of the lower id is there.
    lattice : Lattice
        Any voxels.
    most : int
        Voxels of a block; one layer at least.

    Yields
    ------
    ndarray of int32, shape (k, ny, nx)
        Grain id + 1 where the middle of the voxel lies in a grain or on its surface, `VOID` or `OUTSIDE`.
    """
    nx, ny, nz = lattice.counts
    grains = packing.grains
    planes = face_planes(grains)
    normals = turned_normals(packing, planes.normals)
    found = copies(packing, lattice.lower, lattice.upper)
    low = np.ceil((found.lower[:, 2] - found.slack - lattice.lower[2]) / lattice.spacing[2] - 0.5).astype(np.int64)
    high = np.floor((found.upper[:, 2] + found.slack - lattice.lower[2]) / lattice.spacing[2] - 0.5).astype(np.int64)
    domain = packing.domain
    walls = box_planes(domain.lower, domain.upper)[~np.tile(domain.periodic, 2)]
    walls = np.ascontiguousarray(np.vstack([walls, domain.planes]))
    bounds = np.stack([found.lower[:, 1], found.upper[:, 1]], axis=1)
    layers = max(1, most // (nx * ny))
    for first in range(0, nz, layers):
        labels = np.zeros((min(layers, nz - first), ny, nx), dtype=np.int32)
        starts, entries = _by_layer(low - first, high - first, len(labels))
        place = lattice.lower.copy()
        place[2] += first * lattice.spacing[2]
        in_blocks(
            _fill,
            len(labels),
            (labels, place, lattice.spacing),
            (starts, entries, found.ids, found.centres, bounds),
            (grains.face_offsets, normals, planes.heights),
            found.slack,
            least=1,
        )
        if len(walls):
            in_blocks(_mark_outside, len(labels), labels, place, lattice.spacing, walls, found.slack, least=1)
        yield labels


def _by_layer(low: NDArray[np.int64], high: NDArray[np.int64], n: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return offsets and copies of each layer, in the order of the copies."""
    rows, layers = spread(np.maximum(low, 0), np.minimum(high, n - 1))
    return offsets_from_counts(np.bincount(layers, minlength=n)), rows[np.argsort(layers, kind="stable")]


@njit(cache=True, nogil=True)
def _fill(start, stop, image, found, mesh, slack):  # type: ignore[no-untyped-def]
    labels, lower, spacing = image
    starts, entries, ids, centres, bounds = found
    face_offsets, normals, heights = mesh
    n_rows, n_columns = labels.shape[1], labels.shape[2]
    for layer in range(start, stop):
        lines = np.empty((64, 2))
        for e in range(starts[layer], starts[layer + 1]):
            copy = entries[e]
            i = ids[copy]
            f0, f1 = face_offsets[i], face_offsets[i + 1]
            if f1 - f0 > lines.shape[0]:
                lines = np.empty((f1 - f0, 2))
            # In this layer each face is a line x = p - q y; those that bound x from above stand first.
            z = lower[2] + (layer + 0.5) * spacing[2] - centres[copy, 2]
            n_right, n_left = 0, f1 - f0
            south, north = -np.inf, np.inf
            for f in range(f0, f1):
                room = heights[f] - normals[f, 2] * z + slack
                nx, ny = normals[f, 0], normals[f, 1]
                if nx > 0.0:
                    lines[n_right, 0], lines[n_right, 1] = room / nx, ny / nx
                    n_right += 1
                elif nx < 0.0:
                    n_left -= 1
                    lines[n_left, 0], lines[n_left, 1] = room / nx, ny / nx
                elif ny > 0.0:
                    north = min(north, room / ny)
                elif ny < 0.0:
                    south = max(south, room / ny)
                elif room < 0.0:
                    north = -np.inf
            south = max(south, bounds[copy, 0] - centres[copy, 1] - slack)
            north = min(north, bounds[copy, 1] - centres[copy, 1] + slack)
            if south > north:
                continue
            shift = centres[copy, 1] - lower[1]
            first = int(max(np.ceil((south + shift) / spacing[1] - 0.5), 0.0))
            last = int(min(np.floor((north + shift) / spacing[1] - 0.5), n_rows - 1.0))
            for row in range(first, last + 1):
                y = lower[1] + (row + 0.5) * spacing[1] - centres[copy, 1]
                left, right = -np.inf, np.inf
                for k in range(n_right):
                    right = min(right, lines[k, 0] - lines[k, 1] * y)
                for k in range(n_left, f1 - f0):
                    left = max(left, lines[k, 0] - lines[k, 1] * y)
                if left > right:
                    continue
                shift = centres[copy, 0] - lower[0]
                a = int(max(np.ceil((left + shift) / spacing[0] - 0.5), 0.0))
                b = int(min(np.floor((right + shift) / spacing[0] - 0.5), n_columns - 1.0))
                for column in range(a, b + 1):
                    if labels[layer, row, column] == 0:
                        labels[layer, row, column] = i + 1


@njit(cache=True, nogil=True)
def _mark_outside(start, stop, labels, lower, spacing, walls, slack):  # type: ignore[no-untyped-def]
    n_columns = labels.shape[2]
    for layer in range(start, stop):
        z = lower[2] + (layer + 0.5) * spacing[2]
        for row in range(labels.shape[1]):
            y = lower[1] + (row + 0.5) * spacing[1]
            left, right = -np.inf, np.inf
            for w in range(walls.shape[0]):
                room = walls[w, 3] - walls[w, 1] * y - walls[w, 2] * z + slack
                nx = walls[w, 0]
                if nx > 0.0:
                    right = min(right, room / nx)
                elif nx < 0.0:
                    left = max(left, room / nx)
                elif room < 0.0:
                    right = -np.inf
            a, b = 0, n_columns - 1
            if left > right:
                b = -1
            else:
                if left > lower[0]:
                    a = int(min(np.ceil((left - lower[0]) / spacing[0] - 0.5), float(n_columns)))
                if right < lower[0] + n_columns * spacing[0]:
                    b = int(max(np.floor((right - lower[0]) / spacing[0] - 0.5), -1.0))
            for column in range(n_columns):
                if column < a or column > b:
                    labels[layer, row, column] = -1
