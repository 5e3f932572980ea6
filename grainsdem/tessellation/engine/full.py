"""The full pass: every cell as a polyhedron with ordered faces and neighbours, in flat arrays."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.errors import GrainsDEMError, name_offenders
from grainsdem.geometry.cells.cutting import CUT, EMPTY, FULL, HOME, LOST
from grainsdem.geometry.cells.emitting import BROKEN, emit
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.ragged import offsets_from_counts
from grainsdem.tessellation.engine.growing import gather, grow, leaf_of
from grainsdem.tessellation.engine.light import CHUNK, SIZE, list_arrays, work_arrays

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.tessellation.engine.frame import Frame
    from grainsdem.tessellation.engine.tree import Tree

WIDEST = 1e-6
"""Largest length, relative to the domain, that repairs may take for rounding."""

ROOM = (36, 22, 108)
"""Vertices, faces and corners a cell that the first buffers hold; the mean of a Poisson cell is 27, 16 and 81."""


class _Batch(NamedTuple):
    """Cells as one pass left them: buffers with gaps, and where each cell's part starts and how long it is."""

    vertices: NDArray[np.float64]
    counts: NDArray[np.int32]
    ids: NDArray[np.int32]
    codes: NDArray[np.int8]
    corners: NDArray[np.int32]
    spans: NDArray[np.int64]


class Cells(NamedTuple):
    """Cells in the order of their seeds; see `grainsdem.model.Polyhedra` and `Tessellation`."""

    vertices: NDArray[np.float64]
    vertex_offsets: NDArray[np.int64]
    face_offsets: NDArray[np.int64]
    corners: NDArray[np.int32]
    corner_offsets: NDArray[np.int64]
    neighbors: NDArray[np.int32]
    shifts: NDArray[np.int8]


@njit(cache=True, nogil=True)
def _grow_cells(first, last, tree, frame, places, bans, ban_offsets, size, chunk, room, batch, status, tolerances):  # type: ignore[no-untyped-def]
    vertices, counts, ids, codes, corners, spans = batch
    for b in range(first, last):
        work = work_arrays(size)
        around, named = list_arrays()
        leaf = -1
        count, known = 0, -1.0
        v, v_end = b * chunk * room[0], (b + 1) * chunk * room[0]
        f, f_end = b * chunk * room[1], (b + 1) * chunk * room[1]
        c, c_end = b * chunk * room[2], (b + 1) * chunk * room[2]
        for at in range(b * chunk, min((b + 1) * chunk, len(places))):
            banned = bans[ban_offsets[at] : ban_offsets[at + 1]]
            place = places[at]
            if leaf != leaf_of(place, tree[4], len(tree[0])):
                leaf = leaf_of(place, tree[4], len(tree[0]))
                count, known = gather(leaf, tree, frame, around, named, work[4])
            code, n_tri, n_planes = grow(place, tree, frame, banned, around, named, count, known, work)
            n_v = n_f = n_c = 0
            if code == CUT:
                code, n_v, n_f, n_c = emit(
                    work[0], work[1], work[3], n_tri, n_planes, tolerances[at],
                    vertices[v:v_end], counts[f:f_end], ids[f:f_end], codes[f:f_end], corners[c:c_end],
                )  # fmt: skip
            spans[at, 0], spans[at, 1] = v, n_v
            spans[at, 2], spans[at, 3] = f, n_f
            spans[at, 4], spans[at, 5] = c, n_c
            status[at] = code
            v += n_v
            f += n_f
            c += n_c


@njit(cache=True, nogil=True)
def _copy_cells(first, last, rows, seeds, scale, batch, cells):  # type: ignore[no-untyped-def]
    """Copy the cells in ``rows`` of a batch to their places in the final arrays."""
    vertices, counts, ids, codes, corners, spans = batch
    (
        out_vertices,
        vertex_offsets,
        face_offsets,
        out_corners,
        corner_offsets,
        neighbors,
        shifts,
        corner_starts,
    ) = cells
    for at in range(first, last):
        row = rows[at]
        i = seeds[at]
        start = spans[row, 0]
        v = vertex_offsets[i]
        for k in range(spans[row, 1]):
            out_vertices[v + k, 0] = vertices[start + k, 0] * scale
            out_vertices[v + k, 1] = vertices[start + k, 1] * scale
            out_vertices[v + k, 2] = vertices[start + k, 2] * scale
        start = spans[row, 4]
        c = corner_starts[i]
        for k in range(spans[row, 5]):
            out_corners[c + k] = corners[start + k]
        start = spans[row, 2]
        f = face_offsets[i]
        for k in range(spans[row, 3]):
            c += counts[start + k]
            corner_offsets[f + k + 1] = c
            neighbors[f + k] = ids[start + k]
            code = codes[start + k]
            if code == HOME:
                shifts[f + k, 0] = shifts[f + k, 1] = shifts[f + k, 2] = 0
            else:
                shifts[f + k, 0] = code // 9 - 1
                shifts[f + k, 1] = code // 3 % 3 - 1
                shifts[f + k, 2] = code % 3 - 1


@inner
def _mixed(key):  # type: ignore[no-untyped-def]
    """Scatter a key over 64 bits (the finaliser of SplitMix64)."""
    key = (key ^ (key >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return key ^ (key >> np.uint64(31))


@njit(cache=True, nogil=True)
def _imbalance(first, last, face_offsets, neighbors, shifts, sums):  # type: ignore[no-untyped-def]
    """Sum a hash over the faces of each cell, added from one side and taken off from the other."""
    for i in range(first, last):
        total = np.uint64(0)
        for f in range(face_offsets[i], face_offsets[i + 1]):
            j = neighbors[f]
            if j < 0:
                continue
            code = 9 * shifts[f, 0] + 3 * shifts[f, 1] + shifts[f, 2]
            is_first = i < j or (i == j and code > 0)
            low, high, turned = (i, j, HOME + code) if is_first else (j, i, HOME - code)
            hashed = _mixed(_mixed(np.uint64(low) * np.uint64(32) + np.uint64(turned)) + np.uint64(high))
            total = total + hashed if is_first else total - hashed
        sums[i] = total


@njit(cache=True, nogil=True)
def _one_sided(first, last, face_offsets, neighbors, shifts, result):  # type: ignore[no-untyped-def]
    """Mark the faces that are not seen from their other side."""
    for i in range(first, last):
        for f in range(face_offsets[i], face_offsets[i + 1]):
            j = neighbors[f]
            if j < 0:
                continue
            found = False
            for g in range(face_offsets[j], face_offsets[j + 1]):
                if (
                    neighbors[g] == i
                    and shifts[g, 0] == -shifts[f, 0]
                    and shifts[g, 1] == -shifts[f, 1]
                    and shifts[g, 2] == -shifts[f, 2]
                ):
                    found = True
                    break
            result[f] = not found


def _pass(
    tree: Tree,
    frame: Frame,
    places: NDArray[np.int64],
    bans: tuple[NDArray[np.int64], NDArray[np.int64]],
    tolerances: NDArray[np.float64],
    size: int,
) -> tuple[_Batch, NDArray[np.int8]]:
    """Grow the cells at some places of the tree with work arrays of one size."""
    n = len(places)
    first = size == SIZE
    chunk = CHUNK if first else 1
    room = ROOM if first else (size, size, 3 * size)
    total = -(-n // chunk) * chunk
    batch = _Batch(
        np.empty((total * room[0], 3)),
        np.empty(total * room[1], dtype=np.int32),
        np.empty(total * room[1], dtype=np.int32),
        np.empty(total * room[1], dtype=np.int8),
        np.empty(total * room[2], dtype=np.int32),
        np.empty((n, 6), dtype=np.int64),
    )
    status = np.empty(n, dtype=np.int8)
    in_blocks(
        _grow_cells,
        total // chunk,
        tuple(tree),
        frame.kernel,
        places,
        *bans,
        size,
        chunk,
        room,
        tuple(batch),
        status,
        tolerances,
        least=1,
    )
    return batch, status


class _Collection:
    """Batches, and for every seed the batch and the row that its cell is in."""

    def __init__(self, tree: Tree, frame: Frame) -> None:
        n = len(tree.order)
        self.tree, self.frame = tree, frame
        self.batches: list[_Batch] = []
        self.batch = np.zeros(n, dtype=np.int32)
        self.row = np.zeros(n, dtype=np.int64)
        self.counts = np.zeros((n, 3), dtype=np.int64)
        self.tolerances = np.full(n, frame.merge_tolerance)

    def grow(self, places: NDArray[np.int64], bans: NDArray[np.int64], ban_counts: NDArray[np.int64]) -> None:
        """Grow the cells at ``places``; those that do not fit are grown again with more room."""
        size = SIZE
        owner = np.repeat(np.arange(len(places)), ban_counts)
        pending = np.arange(len(places))
        while pending.size:
            kept = np.isin(owner, pending)
            offsets = offsets_from_counts(np.bincount(owner[kept], minlength=len(places))[pending])
            tolerances = self.tolerances[self.tree.order[places[pending]]]
            batch, status = _pass(self.tree, self.frame, places[pending], (bans[kept], offsets), tolerances, size)
            lost = self.tree.order[places[pending[status == LOST]]]
            self.widen(lost, np.full(lost.size, np.inf))
            broken = self.tree.order[places[pending[status == BROKEN]]]
            self.widen(broken, 8 * self.tolerances[broken])
            done = np.flatnonzero((status == CUT) | (status == EMPTY))
            seeds = self.tree.order[places[pending[done]]]
            self.batch[seeds] = len(self.batches)
            self.row[seeds] = done
            self.counts[seeds] = batch.spans[done][:, 1::2]
            self.batches.append(batch)
            pending = pending[(status == FULL) | (status == BROKEN)]
            size *= 4 if np.any(status == FULL) else 1

    def widen(self, seeds: NDArray[np.int64], tolerances: NDArray[np.float64]) -> None:
        """Let more of the edges of some cells count as rounding, within reason."""
        hopeless = seeds[tolerances > WIDEST]
        if hopeless.size:
            raise GrainsDEMError(
                f"the cells around seeds {name_offenders(np.unique(hopeless))} cannot be told apart in double "
                f"precision: the planes between them meet at too small angles"
            )
        np.maximum.at(self.tolerances, seeds, tolerances)

    def cells(self) -> Cells:
        """Return all cells in the order of the seeds."""
        vertex_offsets, face_offsets, corner_starts = (offsets_from_counts(self.counts[:, k]) for k in range(3))
        cells = Cells(
            np.empty((vertex_offsets[-1], 3)),
            vertex_offsets,
            face_offsets,
            np.empty(corner_starts[-1], dtype=np.int32),
            np.zeros(face_offsets[-1] + 1, dtype=np.int64),
            np.empty(face_offsets[-1], dtype=np.int32),
            np.empty((face_offsets[-1], 3), dtype=np.int8),
        )
        for number, batch in enumerate(self.batches):
            seeds = np.flatnonzero(self.batch == number)
            places = (*cells, corner_starts)
            in_blocks(_copy_cells, seeds.size, self.row[seeds], seeds, self.frame.scale, tuple(batch), places)
        return cells


def copy_none() -> None:
    """Copy and compare no cells: for the kernels' sake, which are then compiled."""
    rows, counts, codes = np.empty(0, np.int64), np.empty(0, np.int32), np.empty(0, np.int8)
    points, sides = np.empty((0, 3)), (np.zeros(1, np.int64), counts, np.empty((0, 3), np.int8))
    batch = _Batch(points, counts, counts, codes, counts, np.empty((0, 6), np.int64))
    cells = Cells(points, rows, rows, counts, rows, *sides[1:])
    _copy_cells(0, 0, rows, rows, 1.0, tuple(batch), (*cells, rows))
    _imbalance(0, 0, *sides, np.empty(0, np.uint64))
    _one_sided(0, 0, *sides, np.empty(0, np.bool_))


def full_cells(tree: Tree, frame: Frame) -> Cells:
    """Return the cells of all seeds, every face of theirs seen from both its sides.

    Raises
    ------
    GrainsDEMError
        If seeds are so nearly degenerate that their cells cannot be told apart.
    """
    n = len(tree.order)
    collection = _Collection(tree, frame)
    collection.grow(np.arange(n), np.empty(0, dtype=np.int64), np.zeros(n, dtype=np.int64))
    place_of = np.empty(n, dtype=np.int64)
    place_of[tree.order] = np.arange(n)
    banned = np.empty((0, 2), dtype=np.int64)
    # A face near the size of rounding may exist for one of its cells only: that cell is grown again without it, and
    # with edges as short as the face is narrow taken for rounding.
    while True:
        cells = collection.cells()
        sides = cells.face_offsets, cells.neighbors, cells.shifts
        # The sum needs no look at the other cell, somewhere in memory; only where it is not zero are faces looked up.
        sums = np.empty(n, dtype=np.uint64)
        in_blocks(_imbalance, n, *sides, sums)
        if sums.sum(dtype=np.uint64) == 0:
            return cells
        is_one_sided = np.zeros(len(cells.neighbors), dtype=np.bool_)
        in_blocks(_one_sided, n, *sides, is_one_sided)
        faces = np.flatnonzero(is_one_sided)
        seeds = np.searchsorted(cells.face_offsets, faces, side="right") - 1
        keys = cells.neighbors[faces] * np.int64(27) + (cells.shifts[faces] + 1) @ np.array([9, 3, 1])
        banned = np.concatenate([banned, np.stack([seeds, keys], axis=1)])
        widths = np.array([_width(cells, f, i) for f, i in zip(faces, seeds, strict=True)]) / frame.scale
        collection.widen(seeds, np.maximum(4 * widths, 2 * collection.tolerances[seeds]))
        again = np.unique(seeds)
        mine = banned[np.isin(banned[:, 0], again)]
        mine = mine[np.lexsort(mine.T[::-1])]
        ban_counts = np.bincount(np.searchsorted(again, mine[:, 0]), minlength=again.size)
        collection.grow(place_of[again], np.ascontiguousarray(mine[:, 1]), ban_counts)


def _width(cells: Cells, face: np.int64, cell: np.int64) -> float:
    """Return twice the area of a face over its perimeter: the width of a sliver."""
    corners = cells.corners[cells.corner_offsets[face] : cells.corner_offsets[face + 1]]
    points = cells.vertices[cells.vertex_offsets[cell] + corners]
    arms = points - points[0]
    area = 0.5 * np.linalg.norm(np.cross(arms[1:-1], arms[2:]).sum(axis=0))
    return float(2 * area / np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum())
