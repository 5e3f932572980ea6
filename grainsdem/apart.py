"""Files that can crash or stall the library that opens them: read in a process of their own, which has limits."""

from __future__ import annotations

import importlib
import io
import math
import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import FileFormatError, GrainsDEMError
from grainsdem.memory import VARIABLE, allowed_memory
from grainsdem.workers import can_start, interpreter

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    Arrays = Mapping[str, NDArray[Any]]

PATIENCE = 8.0
"""Time [s] of a processor that reading any file may take."""

PACE = 5e5
"""Bytes for each of which it may take a second more: a tenth of the slowest that files of ours were seen to be read."""

_ROOM = 2 << 30
"""Bytes of address space besides those allowed: programs and stacks of threads, most of which are never touched."""

_REFUSED, _READ = b"-", b"+"


def read_apart(function: Callable[[Path], Arrays], path: Path) -> Arrays:
    """Return the arrays that a function makes of a file in another process.

    Parameters
    ----------
    function : callable
        Takes the path, and stands by its name in a module.
    path : Path
        The file.

    Raises
    ------
    FileFormatError
        If the function refuses the file, the process ends before it is done, or it would take too long or too much
        memory. A program that Python is built into cannot start another: there the function is called as it is.
    """
    if not can_start():
        return function(path)
    seconds = PATIENCE + path.stat().st_size / PACE
    limits = str(math.ceil(seconds)), str(allowed_memory())
    command = interpreter("grainsdem.apart", function.__module__, function.__qualname__, str(path), *limits)
    try:
        # A clock besides, for what waits without end; it allows for a machine that has much else to do.
        done = subprocess.run(
            check=False,
            timeout=2 * seconds,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            **command,
        )
    except OSError as error:
        raise FileFormatError(f"{path}: no process to read it in can be started: {error.strerror or error}") from error
    except subprocess.TimeoutExpired as error:
        raise FileFormatError(f"{path}: damaged: reading it does not end within {2 * seconds:.0f} s") from error
    answer: bytes = done.stdout
    if answer.startswith(_READ):
        with np.load(io.BytesIO(answer[1:]), allow_pickle=False) as arrays:
            return dict(arrays)
    if answer.startswith(_REFUSED):
        raise FileFormatError(answer[1:].decode("utf-8", "replace"))
    raise FileFormatError(f"{path}: damaged: {_end(done.returncode, seconds)}")


def _end(code: int, seconds: float) -> str:
    """Return in words how a process ended that gave no answer."""
    with suppress(ImportError):
        import signal  # noqa: PLC0415  (its numbers are this system's)

        if code == -getattr(signal, "SIGXCPU", code + 1):
            return f"reading it takes more than {seconds:.0f} s of a processor"
    return f"reading it ends the process that does, with exit status {code}"


def _limit(seconds: int, memory: float) -> None:
    """Take from this process what reading a file does not need; Windows has no such limits."""
    try:
        import resource  # noqa: PLC0415  (there is none on Windows)
    except ImportError:
        return
    for kind, wanted in (
        (resource.RLIMIT_AS, memory + _ROOM),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_CORE, 0),
    ):
        hard = resource.getrlimit(kind)[1]
        if wanted != float("inf") and (hard == resource.RLIM_INFINITY or wanted < hard):
            with suppress(OSError, ValueError):
                resource.setrlimit(kind, (int(wanted), hard))


def _answer(module: str, name: str, path: Path) -> bytes:
    """Return what the other process is told."""
    try:
        arrays = getattr(importlib.import_module(module), name)(path)
    except GrainsDEMError as error:
        return _REFUSED + str(error).encode()
    except MemoryError:
        return _REFUSED + f"{path}: reading it takes more memory than may be taken; {VARIABLE} raises that".encode()
    except Exception as error:  # noqa: BLE001  (what a library says of damage is its own)
        text = str(error).strip() or type(error).__name__
        return _REFUSED + f"{path}: damaged or incomplete: {' '.join(text.splitlines()[0].split())}".encode()
    sink = io.BytesIO()
    np.savez(sink, **arrays)
    return _READ + sink.getvalue()


def _main(module: str, name: str, path: str, seconds: str, memory: str) -> None:
    """Read one file and answer on standard output, on which nothing else is written."""
    _limit(int(seconds), float(memory))
    with os.fdopen(os.dup(1), "wb") as sink:
        os.dup2(2, 1)
        sink.write(_answer(module, name, Path(path)))
        sink.flush()
        os._exit(0)  # a library that met damage may not know how to end


if __name__ == "__main__":
    _main(*sys.argv[1:])
