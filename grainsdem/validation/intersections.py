"""Volumes that pairs of grains share, by manifold3d: in this process for few pairs, in processes of its own for many.

manifold3d's binding holds the interpreter's lock, so threads would not help. The processes are plain interpreters
fed through pipes, not `multiprocessing`: that would run the caller's script again, and would need its main guard.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path
from queue import Queue
from typing import TYPE_CHECKING, BinaryIO, NamedTuple, Self, cast

import numpy as np

from grainsdem.geometry.triangles import triangles
from grainsdem.ragged import take_indices

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Bodies
    from grainsdem.geometry.triangles import Triangles
    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

BLOCK = 2000
"""Pairs tested at a time: about half a second of work."""

FEW = 4 * BLOCK
"""Up to this many pairs, starting processes costs more than they save."""


class Block(NamedTuple):
    """Some pairs, with what is needed to build their grains: pickled, sent, worked through."""

    vertices: Floats
    vertex_offsets: NDArray[np.int64]
    corners: NDArray[np.uint64]
    corner_offsets: NDArray[np.int64]
    pairs: NDArray[np.int64]
    offsets: Floats


def intersection_volumes(
    grains: Polyhedra,
    solids: Bodies,
    pairs: NDArray[np.int32],
    offsets: Floats,
    *,
    length: float = 1.0,
    processes: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Floats:
    """Return the volume that the two grains of each pair share.

    Parameters
    ----------
    grains : Polyhedra
        Closed grains, wound outward: who the corners of their faces are.
    solids : Bodies
        The same grains as they stand.
    pairs : ndarray of int32, shape (m, 2)
        Grain ids.
    offsets : ndarray, shape (m, 3)
        Vector [m] from the first grain's position to the second's.
    length : float
        Length [m] that becomes 1 inside manifold3d: a grain's size, so that nothing depends on the unit.
    processes : int, optional
        Number of processes; by default as many as there are processors for this one, and none for few pairs.
    progress : callable, optional
        Called with the number of pairs done and of all.

    Returns
    -------
    ndarray, shape (m,)
        Volumes [m³]; NaN where manifold3d does not accept a grain.
    """
    m = len(pairs)
    volumes = np.empty(m)
    order = _by_place(solids, pairs)
    parts = [order[start : start + BLOCK] for start in range(0, m, BLOCK)]
    if processes is None:
        processes = 1 if m <= FEW else len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    mesh = triangles(grains)
    done = 0

    def cut(part: NDArray[np.int64]) -> Block:
        return _block(solids, mesh, pairs[part], offsets[part], length)

    with ExitStack() as stack:
        results = (
            map(run, map(cut, parts))
            if processes <= 1
            else stack.enter_context(_Pool(min(processes, len(parts)))).map(cut, parts)
        )
        for part, result in zip(parts, results, strict=True):
            volumes[part] = result
            done += len(part)
            if progress is not None:
                progress(done, m)
    return volumes * length**3


def run(block: Block) -> Floats:
    """Return the shared volume of each pair of a block, in its own units."""
    import manifold3d

    grains = []
    for i in range(len(block.vertex_offsets) - 1):
        vertices = block.vertices[block.vertex_offsets[i] : block.vertex_offsets[i + 1]]
        corners = block.corners[block.corner_offsets[i] : block.corner_offsets[i + 1]]
        solid = manifold3d.Manifold(manifold3d.Mesh64(vertices, corners))
        grains.append(solid if solid.status() == manifold3d.Error.NoError else None)
    result = np.full(len(block.pairs), np.nan)
    for row, ((i, j), offset) in enumerate(zip(block.pairs.tolist(), block.offsets.tolist(), strict=True)):
        first, second = grains[i], grains[j]
        if first is not None and second is not None:
            # Moved to the first grain's frame: manifold3d's tolerance grows with the distance from the origin.
            result[row] = (first ^ second.translate(offset)).volume()
    return result


def serve(stdin: BinaryIO | None = None, stdout: BinaryIO | None = None) -> None:
    """Work through blocks from standard input until it ends, answering each on standard output."""
    source, sink = stdin or sys.stdin.buffer, stdout or sys.stdout.buffer
    while True:
        try:
            block = pickle.load(source)  # noqa: S301  (from the parent process, which started this one)
        except EOFError:
            return
        pickle.dump(run(block), sink, protocol=pickle.HIGHEST_PROTOCOL)
        sink.flush()


class _Pool:
    """Interpreters that run `serve`, each fed by a thread of its own."""

    def __init__(self, n: int) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
        code = "from grainsdem.validation.intersections import serve; serve()"
        self._idle: Queue[subprocess.Popen[bytes]] = Queue()
        self._workers = [
            subprocess.Popen(  # noqa: S603  (this very interpreter and a constant)
                [sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
            )
            for _ in range(n)
        ]
        for worker in self._workers:
            self._idle.put(worker)
        self._threads = ThreadPoolExecutor(n)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._threads.shutdown(wait=False, cancel_futures=True)
        for worker in self._workers:
            worker.kill()
            worker.communicate()

    def map(self, cut: Callable[[NDArray[np.int64]], Block], parts: list[NDArray[np.int64]]) -> Iterator[Floats]:
        """Yield the results in the order of the parts."""
        return self._threads.map(lambda part: self._ask(cut(part)), parts)

    def _ask(self, block: Block) -> Floats:
        worker = self._idle.get()
        try:
            source, sink = cast("tuple[BinaryIO, BinaryIO]", (worker.stdout, worker.stdin))
            pickle.dump(block, sink, protocol=pickle.HIGHEST_PROTOCOL)
            sink.flush()
            return np.asarray(pickle.load(source))  # noqa: S301  (from the child process started here)
        finally:
            self._idle.put(worker)


def _by_place(solids: Bodies, pairs: NDArray[np.int32]) -> NDArray[np.int64]:
    """Return an order of the pairs in which those that share grains lie together."""
    from scipy.sparse import coo_array  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)
    from scipy.sparse.csgraph import reverse_cuthill_mckee  # noqa: PLC0415  (the same)

    n = solids.radii.size
    i, j = pairs.T.astype(np.int64)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (i, j)), shape=(n, n)).tocsr()
    rank = np.empty(n, dtype=np.int64)
    rank[reverse_cuthill_mckee(graph + graph.T, symmetric_mode=True)] = np.arange(n)
    return np.lexsort((np.maximum(rank[i], rank[j]), np.minimum(rank[i], rank[j])))


def _block(solids: Bodies, mesh: Triangles, pairs: NDArray[np.int32], offsets: Floats, length: float) -> Block:
    """Gather the grains of some pairs and number them afresh."""
    ids, local = np.unique(pairs, return_inverse=True)
    vertices, vertex_offsets = take_indices(solids.vertex_offsets, ids)
    corners, corner_offsets = take_indices(mesh.offsets, ids)
    return Block(
        solids.vertices[vertices] / length,
        vertex_offsets,
        mesh.indices[corners].astype(np.uint64),
        corner_offsets,
        local.reshape(-1, 2),
        offsets / length,
    )
