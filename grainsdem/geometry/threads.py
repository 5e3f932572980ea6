"""Kernels on all cores: plain threads that take blocks of the work.

numba's own parallel loops compile a kernel and all that it calls three times over; a kernel that lets go of Python's
lock runs as fast on plain threads, and is compiled once.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numba

if TYPE_CHECKING:
    from collections.abc import Callable

LEAST = 1024
"""Light items, a microsecond each, that are worth a thread: starting one takes a tenth of a millisecond."""

ROOM = 1 << 16
"""Values that the stack of `with_room` holds: half a megabyte, and twice as many calls as compiling nests."""

BLOCKS = 8
"""Blocks for each thread: where one takes long, the others take what is left."""


if TYPE_CHECKING:
    inner = numba.njit(cache=True)  # numba knows the other options, its types do not
else:
    inner = numba.njit(cache=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Compiles a function that only kernels call: what Python would call it through is left out."""


def with_room(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a frame so large that all it calls lie in one piece of the interpreter's stack.

    CPython keeps the stack of calls in pieces of 16 kB. A loop at the very end of a piece takes a new one from the
    system and gives it back at every call, and compiling, which nests some hundred calls deep, is such a loop at one
    depth or another: a quarter of its time, and at random.
    """
    return function(*arguments)


with_room.__code__ = with_room.__code__.replace(co_stacksize=ROOM)


def in_blocks(kernel: Callable[..., None], n: int, *arguments: Any, least: int = LEAST) -> None:
    """Call ``kernel(start, stop, *arguments)`` for blocks that make up 0 … n, on as many threads as numba would use.

    Parameters
    ----------
    kernel : callable
        Compiled with ``nogil=True``; what it writes for one item hangs on no other.
    n : int
        Number of items.
    *arguments
        Passed on.
    least : int
        Items that a block holds at least; with fewer than twice as many this thread does all.

    Notes
    -----
    The number of threads is `numba.get_num_threads`, which `numba.set_num_threads` and NUMBA_NUM_THREADS set.
    """
    threads = numba.get_num_threads() if n >= 2 * least else 1
    blocks = min(BLOCKS * threads, n // least) if threads > 1 else 1
    edges = [n * k // blocks for k in range(blocks + 1)]
    waiting = deque(pairwise(edges))

    def work() -> None:
        while waiting:
            try:
                start, stop = waiting.popleft()
            except IndexError:  # another thread took the last one
                return
            kernel(start, stop, *arguments)

    if threads == 1:
        work() if getattr(kernel, "overloads", True) else with_room(work)
        return
    with ThreadPoolExecutor(threads - 1) as pool:
        others = [pool.submit(work) for _ in range(threads - 1)]
        try:
            work()
        finally:
            waiting.clear()
    for other in others:
        other.result()
