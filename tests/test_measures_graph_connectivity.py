from __future__ import annotations

import numpy as np
import pytest

from grainsdem.errors import InputError
from grainsdem.measures.graph.connectivity import (
    components,
    coordination_curve,
    degree_distribution,
    mean_coordination,
    rattlers,
)
from grainsdem.model import ContactGraph
from grainsdem.packing import contacts
from grainsdem.packing.contacts import mean_diameter

pytestmark = pytest.mark.unit


def graph_of(n, pairs, gaps=None):
    m = len(pairs)
    pairs = np.array(pairs, dtype=int).reshape(-1, 2)
    return ContactGraph(
        n, pairs, np.zeros(m) if gaps is None else gaps, np.tile([1.0, 0, 0], (m, 1)), np.zeros((m, 3)), np.zeros(m)
    )


def tailed():
    """A triangle 0-1-2 with a tail 2-3-4, and grain 5 alone; grain 0 stands on the floor."""
    return graph_of(6, [[-5, 0], [0, 1], [0, 2], [1, 2], [2, 3], [3, 4]])


def test_degrees_count_contacts_with_walls():
    assert tailed().coordination().tolist() == [3, 2, 3, 2, 1, 0]
    assert degree_distribution(tailed()).tolist() == [1, 1, 2, 2]


def test_rattlers_are_taken_away_until_none_is_left():
    assert np.flatnonzero(rattlers(tailed())).tolist() == [3, 4, 5]
    assert np.flatnonzero(rattlers(tailed(), least=1)).tolist() == [5]
    assert rattlers(tailed(), least=4).all()
    with pytest.raises(InputError, match="got 0"):
        rattlers(tailed(), least=0)


def test_the_mean_coordination_is_higher_without_rattlers():
    assert mean_coordination(tailed()) == pytest.approx(11 / 6)
    assert mean_coordination(tailed(), without_rattlers=True) == pytest.approx((3 + 2 + 2) / 3)
    assert np.isnan(mean_coordination(tailed(), without_rattlers=True, least=5))
    assert np.isnan(mean_coordination(graph_of(0, [])))


def test_components_are_numbered_by_their_first_grain_and_walls_connect_nothing():
    assert components(tailed()).tolist() == [0, 0, 0, 0, 0, 1]
    assert components(graph_of(4, [[-5, 0], [-5, 1], [2, 3]])).tolist() == [0, 1, 2, 2]


def test_components_are_those_of_networkx(fresh):
    import networkx as nx

    graph = contacts(fresh, within=0.12 * mean_diameter(fresh))
    wanted = {frozenset(c) for c in nx.connected_components(graph.to_networkx())}
    labels = components(graph)
    assert {frozenset(np.flatnonzero(labels == k).tolist()) for k in range(labels.max() + 1)} == wanted


def test_one_search_gives_the_coordination_of_every_threshold(fresh):
    d = mean_diameter(fresh)
    thresholds = np.array([0.0, 0.05, 0.1, 0.15, 0.2]) * d
    at, curve = coordination_curve(contacts(fresh, within=0.2 * d, walls=True), thresholds)
    np.testing.assert_array_equal(at, thresholds)
    searched = [contacts(fresh, within=t, walls=True).coordination().mean() for t in thresholds]
    np.testing.assert_allclose(curve, searched, rtol=1e-12)


def test_the_curve_steps_at_every_gap():
    at, curve = coordination_curve(graph_of(4, [[-1, 0], [0, 1], [2, 3]], gaps=[0.3, 0.1, 0.2]))
    assert at.tolist() == [0.1, 0.2, 0.3]
    assert curve.tolist() == [0.5, 1.0, 1.25]
