"""Jobs shared out among processes: plain interpreters that are fed through pipes.

`multiprocessing` would run the caller's script again in every process, and would need its main guard.
"""

from __future__ import annotations

import importlib
import os
import pickle
import subprocess
import sys
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any, BinaryIO, cast

from grainsdem.errors import GrainsDEMError, InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


def n_processors() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


MOST_WORKERS = 1024
"""Threads or processes that may be asked for."""


def check_workers(workers: int | None) -> None:
    """Raise `InputError` where so many threads or processes are none, or more than any machine is asked for."""
    if workers is not None and not 1 <= workers <= MOST_WORKERS:
        raise InputError(f"workers must be between 1 and {MOST_WORKERS}; got {workers:.4g}")


def can_start() -> bool:
    """Return whether this program is an interpreter that can be started again, and not one that was built in."""
    return Path(sys.executable or "").stem.startswith(("python", "pypy"))


def share(
    function: Callable[[Any], Any],
    jobs: Sequence[Any],
    *,
    workers: int | None = None,
    after: Sequence[Sequence[int]] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Yield each job's number and its result, in the order in which they are done.

    Parameters
    ----------
    function : callable
        A function of one argument that stands by its name in a module.
    jobs : sequence
        Arguments; they and the results are pickled.
    workers : int, optional
        Number of processes, one thread each; by default one for each processor. With 1, this process does the work.
    after : sequence of sequence of int, optional
        For each job, the earlier ones that must be done before it begins.

    Raises
    ------
    GrainsDEMError
        If a process ends before its work is done. What the function itself raises is raised here.
    """
    check_workers(workers)
    workers = min(n_processors() if workers is None else workers, len(jobs))
    if workers <= 1:
        for number, job in enumerate(jobs):
            yield number, function(job)
        return
    waiting: SimpleQueue[int] = SimpleQueue()
    for number in range(len(jobs)):
        waiting.put(number)
    done = [Event() for _ in jobs]
    needed = after or [()] * len(jobs)
    told = [(job, [done[other] for other in others]) for job, others in zip(jobs, needed, strict=True)]
    answers: SimpleQueue[tuple[int, Any, BaseException | None]] = SimpleQueue()
    processes = [_start() for _ in range(workers)]
    try:
        for process in processes:
            Thread(target=_feed, args=(process, function, told, waiting, answers), daemon=True).start()
        for _ in jobs:
            number, result, error = answers.get()
            if error is not None:
                raise error
            done[number].set()
            yield number, result
    finally:
        for event in done:
            event.set()  # no thread waits for what will not come
        for process in processes:
            process.kill()
            process.communicate()


def interpreter(module: str, *words: str) -> dict[str, Any]:
    """Return what `subprocess` needs to run a module as this process would, on one thread."""
    return {
        "args": [sys.executable, "-P", "-m", module, *words],
        "env": {
            **os.environ,
            "PYTHONPATH": os.pathsep.join(path or str(Path.cwd()) for path in sys.path),
            "NUMBA_NUM_THREADS": "1",
        },
        # Ctrl-C is for the parent, which ends its children.
        "start_new_session": True,
    }


def _start() -> subprocess.Popen[bytes]:
    # The processes are the threads.
    return subprocess.Popen(stdin=subprocess.PIPE, stdout=subprocess.PIPE, **interpreter("grainsdem.workers"))


def _feed(
    process: subprocess.Popen[bytes],
    function: Callable[[Any], Any],
    jobs: Sequence[tuple[Any, list[Event]]],
    waiting: SimpleQueue[int],
    answers: SimpleQueue[tuple[int, Any, BaseException | None]],
) -> None:
    """Send one process a job after another, each once what it needs is done, and pass its answers on."""
    source, sink = cast("tuple[BinaryIO, BinaryIO]", (process.stdout, process.stdin))
    number = -1
    try:
        while True:
            number = waiting.get_nowait()
            job, needs = jobs[number]
            for event in needs:
                event.wait()
            pickle.dump((function.__module__, function.__qualname__, job), sink)
            sink.flush()
            answers.put((number, *pickle.load(source)))  # noqa: S301  (from the child started above)
    except Empty:
        return
    except Exception as error:  # noqa: BLE001  (raised again by the thread that waits)
        ended = GrainsDEMError(f"a process ended before its job {number} was done")
        ended.__cause__ = error
        answers.put((number, None, ended))


def serve() -> None:
    """Do jobs from standard input until it ends, answering each on standard output."""
    # What a job prints must not mix with the answers.
    with os.fdopen(os.dup(1), "wb") as sink:
        os.dup2(2, 1)
        while True:
            try:
                module, name, job = pickle.load(sys.stdin.buffer)  # noqa: S301  (from the parent, which started this)
            except EOFError:
                return
            answer: tuple[Any, BaseException | None]
            try:
                answer = getattr(importlib.import_module(module), name)(job), None
            except Exception as error:  # noqa: BLE001  (raised again by the parent)
                answer = None, error
            pickle.dump(answer, sink, protocol=pickle.HIGHEST_PROTOCOL)
            sink.flush()


if __name__ == "__main__":
    serve()
