"""How a packing hangs together: degrees, rattlers, components, and coordination against the gap that counts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import ContactGraph


@gated
def degree_distribution(graph: ContactGraph) -> NDArray[np.int64]:
    """Return how many grains have 0, 1, 2, … contacts, shape (most + 1,).

    Examples
    --------
    >>> from grainsdem.model import ContactGraph
    >>> import numpy as np
    >>> chain = ContactGraph(4, [[0, 1], [1, 2]], [0, 0], np.zeros((2, 3)), np.zeros((2, 3)), [0, 0])
    >>> degree_distribution(chain)
    array([1, 2, 1])
    """
    return np.bincount(graph.coordination(), minlength=1)


@gated
def rattlers(graph: ContactGraph, *, least: int = 2) -> NDArray[np.bool_]:
    """Return which grains carry no force: too few contacts, once other rattlers are taken away.

    Parameters
    ----------
    graph : ContactGraph
        Who touches whom; contacts with walls count.
    least : int
        Fewest contacts of a grain that carries force. Two for grains with friction; four for frictionless spheres.

    Returns
    -------
    ndarray of bool, shape (n_grains,)
        True for rattlers.

    Raises
    ------
    InputError
        If ``least`` is below 1.
    """
    if least < 1:
        raise InputError(f"least must be 1 or more; got {least}")
    i, j = graph.pairs.T
    loose = np.zeros(graph.n_grains, dtype=bool)
    kept = np.ones(len(graph), dtype=bool)
    while True:
        ids = np.concatenate([i[kept], j[kept]])
        now = np.bincount(ids[ids >= 0], minlength=graph.n_grains) < least
        if (now == loose).all():
            return loose
        loose = now
        kept = ~(loose[j] | (loose[i] & (i >= 0)))


@gated
def mean_coordination(graph: ContactGraph, *, without_rattlers: bool = False, least: int = 2) -> float:
    """Return the mean number of contacts a grain; NaN where no grain is left.

    Parameters
    ----------
    graph : ContactGraph
        Who touches whom; a contact with a wall counts once, for its grain.
    without_rattlers : bool
        Whether grains that carry no force, and their contacts, are left out (see `rattlers`).
    least : int
        Fewest contacts of a grain that carries force.
    """
    if not without_rattlers:
        return float(graph.coordination().mean()) if graph.n_grains else np.nan
    loose = rattlers(graph, least=least)
    i, j = graph.pairs.T
    carried = graph.select(~(loose[j] | (loose[i] & (i >= 0))))
    counts = carried.coordination()[~loose]
    return float(counts.mean()) if counts.size else np.nan


@gated
def components(graph: ContactGraph) -> NDArray[np.int32]:
    """Return the connected component of each grain, shape (n_grains,), numbered from 0 in the order of first grains.

    Walls connect nothing.
    """
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)

    labels = connected_components(graph.to_scipy(), directed=False)[1]
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(first.size, dtype=np.int32)
    rank[np.argsort(first)] = np.arange(first.size, dtype=np.int32)
    return rank[inverse.reshape(-1)]


@gated
def coordination_curve(
    graph: ContactGraph, thresholds: ArrayLike | None = None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean coordination number against the largest gap that counts as a contact, from one search.

    Parameters
    ----------
    graph : ContactGraph
        Contacts up to the largest threshold of interest: ``contacts(packing, within=largest)``.
    thresholds : array_like, shape (k,), optional
        Gaps [m]; by default the gap of every contact, where the curve steps.

    Returns
    -------
    thresholds : ndarray, shape (k,)
        Gaps [m].
    coordination : ndarray, shape (k,)
        Mean contacts a grain that are no wider.
    """
    order = np.argsort(graph.gaps, kind="stable")
    sorted_gaps = graph.gaps[order]
    ends = np.concatenate([[0], np.cumsum(np.where(graph.is_wall, 1, 2)[order])])
    at = sorted_gaps.copy() if thresholds is None else np.asarray(thresholds, dtype=np.float64)
    return at, ends[np.searchsorted(sorted_gaps, at, side="right")] / max(graph.n_grains, 1)
