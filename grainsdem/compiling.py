"""Kernels compiled before they are needed, on all processors.

numba compiles a kernel when it is first called and keeps it on disk. One kernel after another, that is what a newcomer
waits for; so a command first has processes of their own make a tiny bed each, which leaves the kernels in the cache.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numba
import numpy as np

from grainsdem.geometry import integrals
from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.clipping import solid_volume
from grainsdem.geometry.defects import find_defects
from grainsdem.geometry.triangles import best_apexes, facets
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import contacts
from grainsdem.tessellation import relax, tessellate
from grainsdem.validation import validate
from grainsdem.workers import n_processors, share

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray


LOG = logging.getLogger(__name__)

CHAINS: tuple[tuple[str, ...], ...] = (("contacts", "proof", "walls"), ("cells", "lloyd"), ("shapes", "facets"))
"""What one process compiles, in this order: the steps of a chain share kernels, those of two chains hardly any."""

SECONDS: dict[str, int] = {
    "cells": 6, "lloyd": 2, "shapes": 3, "contacts": 8, "walls": 1, "proof": 2, "facets": 1,
}  # fmt: skip
"""Processor time [s] that each takes, about, on two cores of today: an estimate that only the announcement uses."""


def missing(steps: Sequence[str]) -> list[str]:
    """Return the steps whose kernels were not compiled yet for this machine and these sources."""
    return [step for step in steps if not _mark(step).exists()]


def seconds(steps: Sequence[str]) -> int:
    """Return about how long [s] these steps take."""
    chains = [sum(SECONDS[step] for step in chain) for chain in _chains(steps)]
    # And a second for the processes to start.
    return 1 + max(*chains, ceil(sum(chains) / n_processors()), 0) if chains else 0


def compile_kernels(steps: Sequence[str], progress: Callable[[int, int], None] | None = None) -> None:
    """Compile the kernels of some steps, unless they are in numba's cache.

    Parameters
    ----------
    steps : sequence of str
        ``"cells"``, ``"lloyd"``, ``"shapes"``, ``"contacts"``, ``"walls"``, ``"proof"`` and ``"facets"``.
    progress : callable, optional
        Called with the number of steps done and of all.
    """
    chains = _chains(missing(steps))
    done, n = 0, sum(map(len, chains))
    for number, _ in share(run_chain, chains):
        for step in chains[number]:
            _leave(step)
        done += len(chains[number])
        if progress is not None:
            progress(done, n)


def run_chain(steps: Sequence[str]) -> None:
    """Take some steps on a tiny bed; what numba compiles on the way stays in its cache."""
    for step in steps:
        STEPS[step]()


def _chains(steps: Sequence[str]) -> list[tuple[str, ...]]:
    chains = [tuple(step for step in chain if step in steps) for chain in CHAINS]
    return [chain for chain in chains if chain]


def _two_cubes() -> Packing:
    """Return two unit cubes, one turned, a little apart."""
    corners = np.array([(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    offsets = (np.array(ends, dtype=np.int64) for ends in ([0, 8, 16], [0, 6, 12], range(0, 49, 4)))
    of_vertices, of_faces, of_corners = offsets
    cubes = Polyhedra(np.tile(corners, (2, 1)), of_vertices, of_faces, np.ravel(faces * 2).astype(np.int32), of_corners)
    half = np.sqrt(0.5)
    places, turns = np.array([[1.0, 1.0, 1.0], [2.01, 1.0, 1.0]]), np.array([[1.0, 0, 0, 0], [half, half, 0, 0]])
    return Packing(cubes, places, turns, np.full(2, 2650.0), Domain(np.zeros(3), np.full(3, 3.0)))


def _sites() -> NDArray[np.float64]:
    return np.random.default_rng(0).random((8, 3))


def _cells() -> None:
    tessellate(_sites(), Domain.cube())


def _lloyd() -> None:
    relax(_sites(), Domain.cube(), iterations=1)


def _shapes() -> None:
    packing = _two_cubes()
    near_images(packing, 0.1)
    solid_volume(packing, np.array([[1.0, 0.0, 0.0, 1.0]]))
    find_defects(packing.grains)


def _contacts() -> None:
    contacts(_two_cubes())


def _walls() -> None:
    contacts(_two_cubes(), walls=True)


def _proof() -> None:
    validate(_two_cubes())


def _facets() -> None:
    grains = _two_cubes().grains
    facets(grains, best_apexes(grains))


STEPS: dict[str, Callable[[], None]] = {
    "cells": _cells, "lloyd": _lloyd, "shapes": _shapes, "contacts": _contacts, "walls": _walls, "proof": _proof,
    "facets": _facets,
}  # fmt: skip


def _mark(step: str) -> Path:
    """Return the file beside numba's cache whose presence says that a step was compiled."""
    # numba chooses the folder, for all kernels of a folder alike, by what is writable and by NUMBA_CACHE_DIR.
    folder = integrals._integrate.stats.cache_path  # noqa: SLF001  (any kernel would do)
    return Path(folder or "") / f"compiled-{step}-{_stamp()}"


def _leave(step: str) -> None:
    try:
        _mark(step).touch()
    except OSError as error:
        LOG.debug("not noted that %s was compiled: %s", step, error)


def _stamp() -> str:
    """Return a digest of all that numba compiles a kernel anew for: versions, processor, sources."""
    package = Path(__file__).parent
    sources = sorted(path for room in ("geometry", "tessellation") for path in (package / room).rglob("*.py"))
    parts = [
        platform.python_version(), numba.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(),
        os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES"),
        *((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sources),
    ]  # fmt: skip
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
