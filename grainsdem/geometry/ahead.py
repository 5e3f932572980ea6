"""Kernels compiled before they are needed, on all processors.

numba compiles a kernel when it is first called and keeps it on disk. One kernel after another, that is what a newcomer
waits for; so processes of their own first compile parts of the work each, which leaves the kernels in the cache.
"""

from __future__ import annotations

import gc
import hashlib
import importlib
import logging
import os
import platform
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import llvmlite.binding as llvm  # type: ignore[import-untyped]
import numba

from grainsdem.geometry import integrals
from grainsdem.geometry.threads import with_room
from grainsdem.workers import can_start, n_processors, share

if TYPE_CHECKING:
    from collections.abc import Callable

LOG = logging.getLogger(__name__)


class Step(NamedTuple):
    """A part of the compiling.

    Parameters
    ----------
    seconds : float
        Processor time [s] that it takes, about, on two cores of today: an estimate that only the announcement uses.
    after : tuple of str
        Steps whose kernels it calls: without them it would compile them once more.
    """

    seconds: float
    after: tuple[str, ...] = ()


STEPS: dict[str, Step] = {
    "cutting": Step(4),
    "starting": Step(2),
    "emitting": Step(4),
    "growing": Step(4, ("cutting", "starting")),
    "volumes": Step(2),
    "copying": Step(1),
    "cells": Step(2, ("emitting", "growing", "volumes", "copying")),
    "approaching": Step(4),
    "near": Step(3, ("volumes",)),
    "touching": Step(4),
    "searching": Step(3, ("approaching",)),
    "contacts": Step(2, ("near", "touching", "searching")),
    "shapes": Step(4, ("near",)),
    "lloyd": Step(2, ("emitting", "growing")),
    "proof": Step(1, ("contacts", "shapes")),
    "walls": Step(2, ("contacts",)),
    "facets": Step(1),
    "loose": Step(5, ("approaching",)),
    "between": Step(7, ("cutting", "starting", "emitting")),
    "outlines": Step(12, ("volumes",)),
    "holes": Step(4, ("volumes", "outlines")),
}
"""All steps, each behind those that it comes after; `grainsdem.compiling` says how each is taken."""

_done: set[str] = set()
"""Steps that this process need not look for again."""


def compiled(*steps: str) -> None:
    """See to it that the kernels of some steps are compiled.

    Nothing hangs on it: numba compiles each kernel where it is called, and with one processor that is as quick.
    """
    if _done.issuperset(steps):
        return
    lacking = missing(*steps)
    if lacking:
        LOG.info("compiling kernels, the first time on this machine: about %d s", seconds(lacking))
        if n_processors() > 1 and can_start():
            try:
                compile_kernels(lacking)
            except Exception as error:  # noqa: BLE001
                LOG.debug("kernels were not compiled in advance: %s", error)
    _done.update(steps)


def missing(*steps: str) -> list[str]:
    """Return the steps, and those that they come after, whose kernels are not compiled for this machine and version."""
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]  # set by who looks for a fault: there are no kernels then
        return []
    wanted = set(steps)
    for step in reversed(STEPS):
        if step in wanted:
            wanted.update(STEPS[step].after)
    return [step for step in STEPS if step in wanted and not _mark(step).exists()]


def seconds(steps: list[str]) -> int:
    """Return about how long [s] these steps take."""
    ends: dict[str, float] = {}
    for step in steps:
        ends[step] = STEPS[step].seconds + max((ends.get(other, 0.0) for other in STEPS[step].after), default=0.0)
    whole = sum(STEPS[step].seconds for step in steps) / n_processors()
    # And a second for the processes to start.
    return ceil(1 + max(whole, *ends.values())) if steps else 0


def compile_kernels(steps: list[str], progress: Callable[[int, int], None] | None = None) -> None:
    """Compile the kernels of some steps.

    Parameters
    ----------
    steps : list of str
        What `missing` returns.
    progress : callable, optional
        Called with the number of steps done and of all.
    """
    after = [[steps.index(other) for other in STEPS[step].after if other in steps] for step in steps]
    for done, (number, _) in enumerate(share(take, steps, after=after), start=1):
        _leave(steps[number])
        if progress is not None:
            progress(done, len(steps))


def take(step: str) -> None:
    """Take one step in a process that does nothing else; what numba compiles on the way stays in its cache."""
    _done.update(STEPS)
    gc.disable()  # a tenth of the time, for a tenth of a gigabyte
    # By its name: the steps call upon rooms above this one.
    with_room(importlib.import_module("grainsdem.compiling").TAKEN[step])


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
    package = Path(__file__).parents[1]
    sources = sorted(path for room in ("geometry", "tessellation") for path in (package / room).rglob("*.py"))
    parts = [
        platform.python_version(), numba.__version__, llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten(),
        os.environ.get("NUMBA_CPU_NAME"), os.environ.get("NUMBA_CPU_FEATURES"),
        *((path.name, path.stat().st_mtime_ns, path.stat().st_size) for path in sources),
    ]  # fmt: skip
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:16]
