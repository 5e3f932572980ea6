from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grainsdem import ragged
from grainsdem.errors import ShapeError

pytestmark = pytest.mark.unit

counts = st.lists(st.integers(0, 5), max_size=12)


@pytest.mark.property
@given(counts, st.data())
def test_taken_rows_are_those_that_a_list_of_lists_gives(lengths, data):
    offsets = ragged.offsets_from_counts(lengths)
    flat = np.arange(offsets[-1])
    rows = data.draw(st.lists(st.integers(0, len(lengths) - 1), max_size=10)) if lengths else []
    lists = [flat[a:b].tolist() for a, b in pairwise(offsets)]
    indices, new_offsets = ragged.take_indices(offsets, np.array(rows, dtype=int))
    taken = [flat[indices][a:b].tolist() for a, b in pairwise(new_offsets)]
    assert taken == [lists[r] for r in rows]


@pytest.mark.property
@given(counts)
def test_row_sums_and_owners_agree_with_a_loop(lengths):
    offsets = ragged.offsets_from_counts(lengths)
    values = np.arange(2.0 * offsets[-1]).reshape(-1, 2)
    expected = [values[a:b].sum(axis=0) for a, b in pairwise(offsets)]
    np.testing.assert_array_equal(ragged.sum_rows(values, offsets), np.reshape(expected, (len(lengths), 2)))
    assert ragged.owners(offsets).tolist() == [i for i, n in enumerate(lengths) for _ in range(n)]
    assert ragged.counts_from_offsets(offsets).tolist() == lengths


@pytest.mark.parametrize("offsets", [[], [1, 3], [0, 2], [0, 4, 2, 3]])
def test_wrong_offsets_are_refused_by_name(offsets):
    with pytest.raises(ShapeError, match="face_offsets"):
        ragged.check_offsets("face_offsets", np.array(offsets, dtype=np.int64), 3)
