"""Pairs of grains that are near each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import MissingPackageError, ShapeError
from grainsdem.model.arrays import Noun

if TYPE_CHECKING:
    import networkx as nx
    from numpy.typing import NDArray
    from scipy.sparse import csr_array

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class ContactGraph(Noun):
    """Pairs of grains that are near each other.

    Parameters
    ----------
    n_grains : int
        Number of grains of the packing, those without contact included.
    pairs : array_like of int32, shape (m, 2)
        Grain ids, i < j, sorted; a pair may stand more than once where images of a periodic domain meet.
    gaps : array_like, shape (m,)
        Signed gap [m]; negative is the depth of an overlap.
    normals : array_like, shape (m, 3)
        Unit normal from i to j.
    points : array_like, shape (m, 3)
        A point [m] of the contact, midway between the grains.
    areas : array_like, shape (m,)
        Area [m²] of the facing polygons; zero where the contact is a point or an edge.
    """

    n_grains: int
    pairs: Ints
    gaps: Floats
    normals: Floats
    points: Floats
    areas: Floats

    def __post_init__(self) -> None:
        pairs = self.freeze("pairs", np.int32, None, 2)
        m = len(pairs)
        self.freeze("gaps", np.float64, m)
        self.freeze("normals", np.float64, m, 3)
        self.freeze("points", np.float64, m, 3)
        self.freeze("areas", np.float64, m)
        if m and not (np.all(pairs[:, 0] <= pairs[:, 1]) and pairs.min() >= 0 and pairs.max() < self.n_grains):
            raise ShapeError(f"pairs must be i <= j within 0 … {self.n_grains - 1}")

    def __len__(self) -> int:
        return len(self.pairs)

    def coordination(self) -> NDArray[np.int64]:
        """Return the number of contacts of each grain, shape (n_grains,)."""
        return np.bincount(self.pairs.ravel(), minlength=self.n_grains)

    def to_scipy(self) -> csr_array[Any, Any]:
        """Return the symmetric adjacency matrix, shape (n_grains, n_grains): how often each pair is in contact."""
        from scipy.sparse import coo_array  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)

        i, j = self.pairs.T.astype(np.int64)
        ones = np.ones(2 * len(self), dtype=np.int64)
        shape = (self.n_grains, self.n_grains)
        return coo_array((ones, (np.append(i, j), np.append(j, i))), shape=shape).tocsr()

    def to_networkx(self) -> nx.MultiGraph:
        """Return an undirected `networkx.MultiGraph` of all grains; edges carry gap, normal, point and area in SI.

        Raises
        ------
        MissingPackageError
            Where networkx is not installed.
        """
        try:
            import networkx as nx
        except ImportError as error:
            raise MissingPackageError('to_networkx needs networkx: pip install "grainsdem[all]"') from error
        graph = nx.MultiGraph()
        graph.add_nodes_from(range(self.n_grains))
        rows = zip(
            self.pairs.tolist(),
            self.gaps.tolist(),
            self.normals.tolist(),
            self.points.tolist(),
            self.areas.tolist(),
            strict=True,
        )
        graph.add_edges_from((i, j, {"gap": g, "normal": n, "point": p, "area": a}) for (i, j), g, n, p, a in rows)
        return graph
