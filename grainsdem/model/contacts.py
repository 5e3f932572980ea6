"""Pairs of grains that are near each other."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import MissingPackageError, ShapeError
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import Noun, check_rows

if TYPE_CHECKING:
    import networkx as nx
    from numpy.typing import NDArray
    from scipy.sparse import csr_array

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]


FEATURES = ("vertex", "edge", "face")
"""Names of what a grain touches with, by dimension."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class ContactGraph(Noun):
    """Pairs of grains that are near each other.

    Parameters
    ----------
    n_grains : int
        Number of grains of the packing, those without contact included.
    pairs : array_like of int32, shape (m, 2)
        Grain ids, i < j, sorted; a pair may stand more than once where images of a periodic domain meet. A negative
        id is a wall of the domain (see `Domain`).
    gaps : array_like, shape (m,)
        Signed gap [m]; negative is the depth of an overlap.
    normals : array_like, shape (m, 3)
        Unit normal from i to j.
    points : array_like, shape (m, 3)
        A point [m] of the contact, midway between the grains.
    areas : array_like, shape (m,)
        Area [m²] of the facing polygons; zero where the contact is a point or an edge.
    features : array_like of int8, shape (m, 2), optional
        What i and j touch with: 0 a vertex, 1 an edge, 2 a face, -1 unknown.
    ends : array_like, shape (m, 2, 3), optional
        Closest points [m] of i and j; both ``points`` where they are not known.
    shifts : array_like of int32, shape (m, 3), optional
        Periodic image of j, in whole domain lengths.
    """

    n_grains: int
    pairs: Ints
    gaps: Floats
    normals: Floats
    points: Floats
    areas: Floats
    features: NDArray[np.int8] = None  # type: ignore[assignment]  # filled below, where the number of pairs is known
    ends: Floats = None  # type: ignore[assignment]
    shifts: Ints = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        pairs = self.freeze("pairs", np.int32, None, 2)
        m = len(pairs)
        self.freeze("gaps", np.float64, m)
        self.freeze("normals", np.float64, m, 3)
        points = self.freeze("points", np.float64, m, 3)
        self.freeze("areas", np.float64, m)
        defaults = {
            "features": np.full((m, 2), -1, dtype=np.int8),
            "ends": np.repeat(points[:, None], 2, axis=1),
            "shifts": np.zeros((m, 3), dtype=np.int32),
        }
        for name, default in defaults.items():
            if getattr(self, name) is None:
                object.__setattr__(self, name, default)
        self.freeze("features", np.int8, m, 2)
        self.freeze("ends", np.float64, m, 2, 3)
        self.freeze("shifts", np.int32, m, 3)
        i, j = pairs.T
        if m and not (np.all(i <= j) and j.min() >= 0 and j.max() < self.n_grains):
            raise ShapeError(f"pairs must be i <= j within 0 … {self.n_grains - 1}, or i a wall, which is negative")

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def is_wall(self) -> NDArray[np.bool_]:
        """Which contacts are with a wall, shape (m,)."""
        return self.pairs[:, 0] < 0

    def coordination(self) -> NDArray[np.int64]:
        """Return the number of contacts of each grain, shape (n_grains,); those with walls count."""
        ids = self.pairs.ravel()
        return np.bincount(ids[ids >= 0], minlength=self.n_grains)

    def kinds(self) -> list[str]:
        """Return the kind of each contact, the lower feature first: ``vertex-face``, ``edge-edge`` and so on."""
        return ["-".join(FEATURES[k] for k in sorted(row)) if min(row) >= 0 else "" for row in self.features.tolist()]

    def among_grains(self) -> ContactGraph:
        """Return the graph without the contacts with walls."""
        return self if not self.is_wall.any() else self.select(~self.is_wall)

    def select(self, rows: NDArray[Any]) -> ContactGraph:
        """Return the graph of the chosen contacts, given by index or mask."""
        chosen = check_rows("rows", rows, len(self))
        arrays = {f.name: getattr(self, f.name)[chosen] for f in fields(self) if f.name != "n_grains"}
        return ContactGraph(self.n_grains, **arrays)

    def to_scipy(self) -> csr_array[Any, Any]:
        """Return the symmetric adjacency matrix, shape (n_grains, n_grains): how often each pair is in contact.

        Contacts with walls are left out.
        """
        from scipy.sparse import coo_array  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)

        i, j = self.pairs[~self.is_wall].T.astype(np.int64)
        ones = np.ones(2 * i.size, dtype=np.int64)
        shape = (self.n_grains, self.n_grains)
        return coo_array((ones, (np.append(i, j), np.append(j, i))), shape=shape).tocsr()

    def to_networkx(self) -> nx.MultiGraph:
        """Return an undirected `networkx.MultiGraph` of all grains.

        Edges carry gap, normal, point and area in SI, and the kind of contact. Walls that are touched are nodes of
        their negative ids.

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
            self.kinds(),
            strict=True,
        )
        graph.add_edges_from(
            (i, j, {"gap": g, "normal": n, "point": p, "area": a, "kind": k}) for (i, j), g, n, p, a, k in rows
        )
        return graph
