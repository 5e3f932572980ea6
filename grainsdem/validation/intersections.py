"""Volumes that pairs of grains share, by manifold3d: in this process for few pairs, in processes of its own for many.

manifold3d's binding holds the interpreter's lock, so threads would not help. The processes are plain interpreters
fed through pipes, not `multiprocessing`: that would run the caller's script again, and would need its main guard.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from contextlib import nullcontext
from pathlib import Path
from queue import Queue
from threading import Thread
from typing import TYPE_CHECKING, Any, BinaryIO, Self, cast

import numpy as np

from grainsdem.errors import GrainsDEMError
from grainsdem.geometry.pairs.bodies import standing
from grainsdem.geometry.triangles import triangles
from grainsdem.ragged import take_indices
from grainsdem.validation import worker
from grainsdem.validation.worker import run

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Bodies
    from grainsdem.geometry.triangles import Triangles
    from grainsdem.model import Polyhedra
    from grainsdem.validation.worker import Block

    Floats = NDArray[np.float64]

BLOCK = 2000
"""Pairs tested at a time: a fraction of a second of work."""

FEW = 10 * BLOCK
"""Up to this many pairs, starting processes costs more than they save."""


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
    if processes is None:
        processes = 1 if m <= FEW else len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    processes = min(processes, -(-m // BLOCK))
    volumes = np.empty(m)
    # The processes start while their work is being prepared.
    with _Pool(processes) if processes > 1 else nullcontext() as pool:
        order = _by_place(solids, pairs)
        parts = _parts(order, processes)
        mesh = triangles(grains)

        def cut(part: NDArray[np.int64]) -> Block:
            return _block(solids, mesh, pairs[part], offsets[part], length)

        done = 0
        for k, result in _alone(cut, parts) if pool is None else pool.work(cut, parts):
            volumes[parts[k]] = result
            done += len(parts[k])
            if progress is not None:
                progress(done, m)
    return volumes * length**3


def _parts(order: NDArray[np.int64], processes: int) -> list[NDArray[np.int64]]:
    """Cut the order into parts of up to `BLOCK` pairs, equal ones and as many for each process."""
    if not len(order):
        return []
    shares = max(processes, 1)
    return np.array_split(order, shares * -(-len(order) // (shares * BLOCK)))


def _alone(cut: Callable[[NDArray[np.int64]], Block], parts: list[NDArray[np.int64]]) -> Iterator[tuple[int, Floats]]:
    """Yield the number of each part and its volumes, measured in this process."""
    built: dict[int, Any] = {}
    for k, part in enumerate(parts):
        yield k, run(cut(part), built)


class _Pool:
    """Interpreters that run `serve`, each fed by a thread of its own."""

    def __init__(self, n: int) -> None:
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path)}
        self._workers = [
            subprocess.Popen(  # noqa: S603  (this very interpreter and a file of ours)
                [sys.executable, "-P", worker.__file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment
            )
            for _ in range(n)
        ]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._workers:
            process.kill()
            process.communicate()

    def work(
        self, cut: Callable[[NDArray[np.int64]], Block], parts: list[NDArray[np.int64]]
    ) -> Iterator[tuple[int, Floats]]:
        """Yield the number of each part and its volumes, as they come."""
        answers: Queue[tuple[int, Floats | Exception]] = Queue()
        # Each worker has a run of neighbouring parts, so that it builds few grains that another builds too.
        runs = np.array_split(np.arange(len(parts)), len(self._workers))
        for process, numbers in zip(self._workers, runs, strict=True):
            Thread(target=_feed, args=(process, cut, parts, numbers.tolist(), answers), daemon=True).start()
        for _ in parts:
            number, answer = answers.get()
            if isinstance(answer, Exception):
                raise GrainsDEMError("a process that measured overlaps ended before its work was done") from answer
            yield number, answer


def _feed(
    process: subprocess.Popen[bytes],
    cut: Callable[[NDArray[np.int64]], Block],
    parts: list[NDArray[np.int64]],
    numbers: list[int],
    answers: Queue[tuple[int, Floats | Exception]],
) -> None:
    """Send one worker its parts, one after another, and pass its answers on."""
    source, sink = cast("tuple[BinaryIO, BinaryIO]", (process.stdout, process.stdin))
    number = -1
    try:
        ahead = cut(parts[numbers[0]]) if numbers else None
        for place, number in enumerate(numbers):
            pickle.dump(ahead, sink, protocol=pickle.HIGHEST_PROTOCOL)
            sink.flush()
            # The next part is made while the worker is busy with this one.
            ahead = cut(parts[numbers[place + 1]]) if place + 1 < len(numbers) else None
            answers.put((number, np.asarray(pickle.load(source))))  # noqa: S301  (from the child started above)
    except Exception as error:  # noqa: BLE001  (raised again by the thread that waits)
        answers.put((number, error))


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
    ids = np.unique(pairs).astype(np.int64)
    vertices, vertex_offsets = standing(solids, ids)
    corners, corner_offsets = take_indices(mesh.offsets, ids)
    return (
        ids,
        vertices / length,
        vertex_offsets,
        mesh.indices[corners].astype(np.uint64),
        corner_offsets,
        pairs.astype(np.int64),
        offsets / length,
    )
