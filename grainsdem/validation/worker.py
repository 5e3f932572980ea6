"""Pairs through manifold3d, block by block: imported for few pairs, run as a script of its own for many.

As a script it imports neither numba nor the rest of the library, and starts in a fraction of a second.
"""

from __future__ import annotations

import pickle
import sys
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Block = tuple[
        NDArray[np.int64], Floats, NDArray[np.int64], NDArray[np.uint64], NDArray[np.int64], NDArray[np.int64], Floats
    ]

MOST_BUILT = 20_000
"""Grains that a process keeps built, about 15 kB each: building one costs as much as testing two pairs."""


def run(block: Block, built: dict[int, Any]) -> Floats:
    """Return the shared volume of each pair of a block, in its own units; NaN where a grain is not accepted.

    Parameters
    ----------
    block : tuple
        Ids of grains, shape (k,); their vertices and offsets; their triangles and offsets; pairs of ids, shape (m, 2);
        the vector from the first grain of each pair to the second, shape (m, 3).
    built : dict
        Grains by id, kept for the blocks that follow.

    Returns
    -------
    ndarray, shape (m,)
        Volumes.
    """
    import manifold3d

    ids, vertices, vertex_offsets, corners, corner_offsets, pairs, offsets = block
    for k, i in enumerate(ids.tolist()):
        if i not in built:
            points = vertices[vertex_offsets[k] : vertex_offsets[k + 1]]
            solid = manifold3d.Manifold(manifold3d.Mesh64(points, corners[corner_offsets[k] : corner_offsets[k + 1]]))
            built[i] = solid if solid.status() == manifold3d.Error.NoError else None
    result = np.full(len(pairs), np.nan)
    for row, ((i, j), offset) in enumerate(zip(pairs.tolist(), offsets.tolist(), strict=True)):
        first, second = built[i], built[j]
        if first is not None and second is not None:
            # Moved to the first grain's frame: manifold3d's tolerance grows with the distance from the origin.
            result[row] = (first ^ second.translate(offset)).volume()
    for i in list(built)[: max(len(built) - MOST_BUILT, 0)]:
        del built[i]
    return result


def serve(stdin: BinaryIO | None = None, stdout: BinaryIO | None = None) -> None:
    """Work through blocks from standard input until it ends, answering each on standard output."""
    source, sink = stdin or sys.stdin.buffer, stdout or sys.stdout.buffer
    built: dict[int, Any] = {}
    while True:
        try:
            block = pickle.load(source)  # noqa: S301  (from the parent process, which started this one)
        except EOFError:
            return
        pickle.dump(run(block, built), sink, protocol=pickle.HIGHEST_PROTOCOL)
        sink.flush()


if __name__ == "__main__":
    serve()
