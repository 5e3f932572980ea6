"""What threads share hangs on neither their number nor their order, and kernels do what their source says."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit
from racing import RaceError, alone, everything, interpreted, isolated, measured, places, split, told

SMALL, GROWN, LARGE = 12, 60, 2200


@njit(nogil=True)
def _sums(start, stop, values, total):
    for i in range(start, stop):
        total[0] += values[i]


@njit(nogil=True)
def _runs(start, stop, values, out):
    for i in range(start, stop):
        out[i] = values[i] + (out[i - 1] if i > 0 else 0.0)


@njit(nogil=True)
def _sorts(start, stop, values, scratch, out):
    for i in range(start, stop):
        for k in range(3):
            scratch[k] = values[i] * k
        out[i] = scratch.sum()


@njit(nogil=True)
def _carries(start, stop, values, out):
    last = 0.0
    for i in range(start, stop):
        out[i], last = values[i] + last, values[i]


@njit(nogil=True)
def _doubles(start, stop, values, out):
    for i in range(start, stop):
        out[i] = 2.0 * values[i]


@pytest.fixture(scope="module")
def whole():
    """What is measured on one thread, which so few grains are left to."""
    return measured(SMALL)


@pytest.mark.unit
@pytest.mark.parametrize(
    ("kernel", "outputs"),
    [(_sums, [1]), (_runs, [40]), (_sorts, [3, 40]), (_carries, [40])],
    ids=["sums", "runs", "scratch", "carries"],
)
def test_a_planted_race_is_seen_whatever_the_clock(kernel, outputs):
    with pytest.raises(RaceError, match=kernel.py_func.__name__):
        alone(kernel, 40, np.arange(1.0, 41.0), *(np.zeros(n) for n in outputs))


@pytest.mark.unit
def test_what_has_no_race_passes_and_leaves_what_all_in_one_block_leaves():
    out = np.full(40, np.nan)
    alone(_doubles, 40, np.arange(40.0), out)
    assert out.tolist() == (2.0 * np.arange(40.0)).tolist()


@pytest.mark.unit
def test_no_block_of_any_kernel_reads_or_writes_what_another_writes(whole):
    seen = set()
    with isolated(seen):
        assert measured(SMALL) == whole
    assert seen == places()


@pytest.mark.unit
@pytest.mark.parametrize("threads", [2, 3])
def test_what_is_measured_has_the_same_bytes_on_any_number_of_threads(whole, threads):
    seen = set()
    with split(threads, seen):
        assert measured(SMALL) == whole
    assert seen == places()


@pytest.mark.slow
@pytest.mark.unit
def test_what_is_grown_by_every_process_has_the_same_bytes_on_any_number_of_threads():
    grown = everything(GROWN)
    for threads in (1, 2, 3):
        seen = set()
        with split(threads, seen):
            assert everything(GROWN) == grown, threads
        assert seen == places()


@pytest.mark.slow
@pytest.mark.unit
def test_what_is_measured_of_a_bed_that_threads_do_share_has_the_same_bytes_on_one_two_and_three():
    found = []
    for threads in (1, 2, 3):
        seen = set()
        with split(threads, seen, small=False):
            found.append(measured(LARGE))
        # Few lattices leave a face that is seen from one side only, and those of this one are small.
        assert places() - seen <= {("grainsdem.tessellation.engine.full", "_one_sided")}
    assert found[0] == found[1] == found[2]


@pytest.mark.slow
@pytest.mark.unit
def test_no_block_of_any_kernel_races_while_every_process_grows():
    grown = everything(GROWN)
    with isolated(set()):
        assert everything(GROWN) == grown


@pytest.mark.slow
@pytest.mark.unit
def test_kernels_make_the_bytes_that_their_source_makes_when_python_takes_their_items_in_disorder():
    compiled, plain = told(SMALL), interpreted(SMALL)
    assert plain["measured"] == compiled["measured"]
    # Sums of arctangents, of which NumPy's and libm's differ in the last bit.
    for name in ("roundness", "width"):
        assert plain[name] == pytest.approx(compiled[name], rel=1e-14, nan_ok=True)
