"""Kernels on plain threads: every item once, whatever the number of threads."""

import threading

import numba
import numpy as np
import pytest

from grainsdem.geometry.threads import BLOCKS, in_blocks

pytestmark = pytest.mark.unit


@pytest.fixture(params=[1, 3])
def threads(request, monkeypatch):
    monkeypatch.setattr(numba, "get_num_threads", lambda: request.param)
    return request.param


@pytest.mark.usefixtures("threads")
@pytest.mark.parametrize("n", [0, 1, 7, 100])
def test_every_item_is_taken_once(n):
    counts = np.zeros(n, dtype=int)

    def kernel(start, stop, out):
        out[start:stop] += 1

    in_blocks(kernel, n, counts, least=1)
    assert (counts == 1).all()


def test_several_threads_take_blocks_and_none_more_than_there_are(threads):
    barrier = threading.Barrier(threads, timeout=30)
    met, blocks = set(), []

    def kernel(start, stop):
        if threading.get_ident() not in met:
            met.add(threading.get_ident())
            barrier.wait()  # each thread holds a block until all have one
        blocks.append((start, stop))

    in_blocks(kernel, 1000, least=1)
    assert len(met) == threads
    assert len(blocks) <= BLOCKS * threads


@pytest.mark.usefixtures("threads")
def test_few_items_stay_on_this_thread():
    seen = []
    in_blocks(lambda start, stop: seen.append((start, stop, threading.get_ident())), 9, least=5)
    assert seen == [(0, 9, threading.get_ident())]


@pytest.mark.usefixtures("threads")
def test_what_a_block_raises_reaches_the_caller():
    def kernel(start, stop):
        if start <= 50 < stop:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        in_blocks(kernel, 100, least=1)
