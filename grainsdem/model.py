"""The nouns: frozen, slotted dataclasses of flat read-only arrays, checked when they are made.

Axis 0 counts items. Geometry is float64 in metres, indices are int32, offsets int64. Indices inside a grain are
local to it, indices between grains are global. Grain counts run from 0.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from grainsdem.errors import InputError, MissingPackageError, ShapeError, ValidationError, name_offenders
from grainsdem.ragged import check_offsets

if TYPE_CHECKING:
    from collections.abc import Iterable

    import networkx as nx
    from numpy.typing import ArrayLike, NDArray
    from scipy.sparse import csr_array

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]
    Offsets = NDArray[np.int64]

DROPPED = np.iinfo(np.int32).min
"""Neighbour of a face whose other cell was dropped when the packing was carved."""

QUARTZ_DENSITY = 2650.0
"""Density of quartz [kg/m³], the default of every packing."""


def _read_only(name: str, value: ArrayLike, dtype: type, shape: tuple[int | None, ...]) -> NDArray[Any]:
    """Return ``value`` as a read-only C-contiguous array of the given shape (None: any length)."""
    array = np.ascontiguousarray(value, dtype=dtype)
    if array.ndim != len(shape) or any(w is not None and g != w for g, w in zip(array.shape, shape, strict=True)):
        wanted = ", ".join("n" if w is None else str(w) for w in shape)
        raise ShapeError(f"{name} must have shape ({wanted}); got {np.shape(value)}")
    array = array.view()
    array.flags.writeable = False
    return array


class _Noun:
    """Rebuilds itself through its constructor, so that copies and pickles are checked and read-only again."""

    __slots__ = ()

    def __reduce__(self) -> tuple[Any, ...]:
        values = {f.name: getattr(self, f.name) for f in fields(self) if f.init}  # type: ignore[arg-type]
        return _rebuild, (type(self), values)

    def _freeze(self, name: str, dtype: type, *shape: int | None) -> NDArray[Any]:
        array = _read_only(name, getattr(self, name), dtype, shape)
        object.__setattr__(self, name, array)
        return array


def _rebuild(kind: type, values: dict[str, Any]) -> Any:
    return kind(**values)


@dataclass(frozen=True, slots=True, eq=False)
class Domain(_Noun):
    """A box, periodic along any of its axes and cut by any planes, that seeds are placed in and cells are cut by.

    Parameters
    ----------
    lower, upper : array_like, shape (3,)
        Opposite corners [m].
    periodic : array_like of bool, shape (3,)
        Which axes wrap around.
    is_planar : bool
        Whether the box is a slab one grain thick along z: two-dimensional work.
    planes : array_like, shape (k, 4)
        Rows (n_x, n_y, n_z, d): the domain is the part of the box at n · x <= d [m]. Normals are made unit vectors; a
        plane must be parallel to every periodic axis.

    Notes
    -----
    The walls carry the ids -1 (lower x), -2 (upper x), -3 (lower y), -4 (upper y), -5 (lower z), -6 (upper z), and
    -7, -8, … for the planes in their order.
    """

    lower: Floats = field(default_factory=lambda: np.zeros(3))
    upper: Floats = field(default_factory=lambda: np.ones(3))
    periodic: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(3, dtype=bool))
    is_planar: bool = False
    planes: Floats = field(default_factory=lambda: np.empty((0, 4)))
    volume: float = field(init=False)
    """Volume [m³]."""

    def __post_init__(self) -> None:
        lower = self._freeze("lower", np.float64, 3)
        upper = self._freeze("upper", np.float64, 3)
        self._freeze("periodic", np.bool_, 3)
        if not (np.all(np.isfinite(lower)) and np.all(np.isfinite(upper)) and np.all(upper > lower)):
            raise InputError(
                f"the domain's upper corner must lie above its lower corner along every axis, both finite; "
                f"got {lower.tolist()} and {upper.tolist()}"
            )
        planes = self._freeze("planes", np.float64, None, 4)
        volume = float(np.prod(upper - lower))
        if len(planes):
            norms = np.linalg.norm(planes[:, :3], axis=1)
            bad = np.flatnonzero(~(np.isfinite(planes).all(axis=1) & (norms > 0)))
            if bad.size:
                raise InputError(f"planes must be finite and have a normal; rows {name_offenders(bad)} are not")
            object.__setattr__(self, "planes", _read_only("planes", planes / norms[:, None], np.float64, (None, 4)))
            crossed = np.flatnonzero((self.planes[:, :3][:, self.periodic] != 0).any(axis=1))
            if crossed.size:
                raise InputError(
                    f"planes must be parallel to every periodic axis; rows {name_offenders(crossed)} are not"
                )
            volume = _volume_inside(lower, upper, self.planes)
        object.__setattr__(self, "volume", volume)

    @classmethod
    def cube(cls, side: float = 1.0, *, periodic: bool = False) -> Self:
        """Return the cube from the origin to ``side`` [m] along each axis."""
        return cls.box((side, side, side), periodic=periodic)

    @classmethod
    def box(cls, lengths: ArrayLike, *, periodic: bool | tuple[bool, bool, bool] = False) -> Self:
        """Return the box from the origin to ``lengths`` [m], shape (3,)."""
        return cls(np.zeros(3), np.asarray(lengths, float), np.broadcast_to(np.asarray(periodic, bool), (3,)))

    @classmethod
    def slab(cls, lengths: ArrayLike, thickness: float, *, periodic: bool | tuple[bool, bool] = False) -> Self:
        """Return a planar domain: ``lengths`` [m], shape (2,), in x and y, and one grain's ``thickness`` [m] in z."""
        wraps = (*np.broadcast_to(np.asarray(periodic, bool), (2,)), False)
        return cls(np.zeros(3), np.append(np.asarray(lengths, float), thickness), np.asarray(wraps), is_planar=True)

    @classmethod
    def cylinder(cls, radius: float, height: float, *, sides: int = 32, periodic: bool = False) -> Self:
        """Return an upright prism around a cylinder of ``radius`` [m] about the z axis, from z = 0 to ``height`` [m].

        ``sides``, a multiple of 4 above 4, is the number of planes that touch the cylinder; four of them are the
        walls of the box. ``periodic`` makes the z axis wrap around.
        """
        if sides < 8 or sides % 4:
            raise InputError(f"sides must be a multiple of 4, 8 or more; got {sides}")
        angles = np.delete(np.arange(sides), np.arange(4) * sides // 4) * (2 * np.pi / sides)
        planes = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles, np.full(angles.size, radius)])
        return cls([-radius, -radius, 0.0], [radius, radius, height], [False, False, periodic], planes=planes)  # type: ignore[arg-type]

    @classmethod
    def hopper(cls, top: ArrayLike, bottom: ArrayLike, height: float) -> Self:
        """Return a funnel about the z axis: ``top`` and ``bottom`` are its lengths [m] in x and y, shape (2,)."""
        upper, lower = np.broadcast_to(np.asarray(top, float), (2,)), np.broadcast_to(np.asarray(bottom, float), (2,))
        if not np.all((lower > 0) & (upper > lower)):
            raise InputError(f"a hopper must be wider at the top than at the bottom; got {top} and {bottom}")
        planes = np.zeros((4, 4))
        for axis in range(2):
            for side in range(2):
                row = planes[2 * axis + side]
                row[axis] = height if side else -height
                row[2] = -0.5 * (upper[axis] - lower[axis])
                row[3] = 0.5 * height * lower[axis]
        return cls(np.append(-0.5 * upper, 0.0), np.append(0.5 * upper, height), planes=planes)

    @property
    def lengths(self) -> Floats:
        """Edge lengths [m] of the box, shape (3,)."""
        return self.upper - self.lower

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), lie in the domain or on its walls, shape (n,)."""
        inside = ((points >= self.lower) & (points <= self.upper)).all(axis=1)
        # 4 roundings: a point on an inclined plane is on it only within those.
        slack = 4 * np.finfo(np.float64).eps * max(np.abs(self.lower).max(), np.abs(self.upper).max())
        for plane in self.planes:
            inside &= points @ plane[:3] <= plane[3] + slack
        return np.asarray(inside, dtype=bool)

    def scaled(self, factor: float) -> Self:
        """Return the domain scaled about the origin."""
        planes = self.planes * np.array([1.0, 1.0, 1.0, factor])
        return type(self)(self.lower * factor, self.upper * factor, self.periodic, self.is_planar, planes)


def _volume_inside(lower: Floats, upper: Floats, planes: Floats) -> float:
    """Return the volume of the box from ``lower`` to ``upper`` at n · x <= d, or raise `InputError` where there is none."""
    from scipy.optimize import linprog  # noqa: PLC0415  (half a second, and only for domains with planes)
    from scipy.spatial import ConvexHull, HalfspaceIntersection  # noqa: PLC0415  (the same)

    # In units of the box, about its middle: Qhull's own tolerances are absolute.
    middle, size = 0.5 * (lower + upper), float((upper - lower).max())
    half = 0.5 * (upper - lower) / size
    distances = (planes[:, 3] - planes[:, :3] @ middle) / size
    normals = np.concatenate([planes[:, :3], np.eye(3), -np.eye(3)])
    offsets = np.concatenate([distances, half, half])
    rows = np.column_stack([normals, np.ones(len(normals))])
    # The largest ball inside: its centre is the point that Qhull needs.
    ball = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets, bounds=[(None, None)] * 3 + [(0, None)])
    if ball.status != 0 or ball.x[3] < 1e-9:
        raise InputError(
            f"the planes leave nothing of the box {lower.tolist()} to {upper.tolist()}; they keep n · x <= d"
        )
    corners = HalfspaceIntersection(np.column_stack([normals, -offsets]), ball.x[:3]).intersections
    return float(ConvexHull(corners).volume * size**3)


@dataclass(frozen=True, slots=True, eq=False)
class Polyhedra(_Noun):
    """Convex polyhedra in flat arrays, each in a frame of its own.

    Parameters
    ----------
    vertices : array_like, shape (n_vertices, 3)
        Vertices [m] of all polyhedra, one after another; each vertex once per polyhedron.
    vertex_offsets : array_like of int64, shape (n + 1,)
        Vertices of polyhedron i are ``vertices[vertex_offsets[i]:vertex_offsets[i + 1]]``.
    face_offsets : array_like of int64, shape (n + 1,)
        Faces of polyhedron i are numbers ``face_offsets[i]`` to ``face_offsets[i + 1]``.
    face_vertices : array_like of int32, shape (n_corners,)
        Corners of all faces, one face after another, counter-clockwise seen from outside; indices are local to
        the polyhedron.
    face_vertex_offsets : array_like of int64, shape (n_faces + 1,)
        Corners of face f are ``face_vertices[face_vertex_offsets[f]:face_vertex_offsets[f + 1]]``.
    """

    vertices: Floats
    vertex_offsets: Offsets
    face_offsets: Offsets
    face_vertices: Ints
    face_vertex_offsets: Offsets

    def __post_init__(self) -> None:
        vertices = self._freeze("vertices", np.float64, None, 3)
        vertex_offsets = self._freeze("vertex_offsets", np.int64, None)
        face_offsets = self._freeze("face_offsets", np.int64, None)
        corners = self._freeze("face_vertices", np.int32, None)
        corner_offsets = self._freeze("face_vertex_offsets", np.int64, None)
        check_offsets("vertex_offsets", vertex_offsets, len(vertices))
        check_offsets("face_vertex_offsets", corner_offsets, len(corners))
        check_offsets("face_offsets", face_offsets, corner_offsets.size - 1)
        if vertex_offsets.size != face_offsets.size:
            raise ShapeError(
                f"vertex_offsets and face_offsets must be of equal length; "
                f"got {vertex_offsets.size} and {face_offsets.size}"
            )
        bounds = np.repeat(np.diff(vertex_offsets), np.diff(corner_offsets[face_offsets]))
        bad = np.flatnonzero((corners < 0) | (corners >= bounds))
        if bad.size:
            raise ShapeError(
                f"face_vertices must index the vertices of their own polyhedron; entries {name_offenders(bad)} do not"
            )

    def __len__(self) -> int:
        return int(self.vertex_offsets.size - 1)

    @property
    def n_faces(self) -> int:
        """Number of faces of all polyhedra together."""
        return int(self.face_vertex_offsets.size - 1)

    def vertices_of(self, i: int) -> Floats:
        """Return the vertices [m] of polyhedron ``i``, shape (k, 3)."""
        return self.vertices[self.vertex_offsets[i] : self.vertex_offsets[i + 1]]

    def faces_of(self, i: int) -> list[Ints]:
        """Return the faces of polyhedron ``i`` as arrays of local vertex indices."""
        first, last = self.face_offsets[i], self.face_offsets[i + 1]
        cuts = self.face_vertex_offsets[first : last + 1]
        return [self.face_vertices[a:b] for a, b in pairwise(cuts)]


@dataclass(frozen=True, slots=True, eq=False)
class Tessellation(_Noun):
    """Cells that fill a domain, and for every face the cell on its other side.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    sites : array_like, shape (n, 3)
        Seeds [m] that the cells grew from.
    weights : array_like, shape (n,)
        Laguerre weights [m²]; zeros for a Voronoi tessellation.
    cells : Polyhedra
        One polyhedron a site, its vertices relative to the site.
    neighbors : array_like of int32, shape (n_faces,)
        The cell behind each face; a negative number is a wall (see `Domain`).
    shifts : array_like of int8, shape (n_faces, 3)
        Periodic image of that neighbour, in whole domain lengths; zeros without periodic axes.
    """

    domain: Domain
    sites: Floats
    weights: Floats
    cells: Polyhedra
    neighbors: Ints
    shifts: NDArray[np.int8]

    def __post_init__(self) -> None:
        n = len(self.cells)
        self._freeze("sites", np.float64, n, 3)
        self._freeze("weights", np.float64, n)
        neighbors = self._freeze("neighbors", np.int32, self.cells.n_faces)
        self._freeze("shifts", np.int8, self.cells.n_faces, 3)
        if neighbors.size and neighbors.max() >= n:
            raise ShapeError(f"neighbors must be below the number of cells {n}; got {neighbors.max()}")

    def __len__(self) -> int:
        return len(self.cells)


@dataclass(frozen=True, slots=True, eq=False)
class CellLinks(_Noun):
    """What grains in place still know of the tessellation that they were carved from.

    Parameters
    ----------
    neighbors : array_like of int32, shape (n_faces,)
        The grain across each face; negative for a wall (see `Domain`), `DROPPED` where that cell was dropped.
    shifts : array_like of int8, shape (n_faces, 3)
        Periodic image of that neighbour, in whole domain lengths.
    cell_volumes : array_like, shape (n,)
        Volume [m³] of the cell that each grain was shrunk from.
    """

    neighbors: Ints
    shifts: NDArray[np.int8]
    cell_volumes: Floats

    def __post_init__(self) -> None:
        neighbors = self._freeze("neighbors", np.int32, None)
        self._freeze("shifts", np.int8, neighbors.size, 3)
        self._freeze("cell_volumes", np.float64, None)


@dataclass(frozen=True, slots=True, eq=False)
class Packing(_Noun):
    """Grains in a domain, each with a pose and a density.

    Parameters
    ----------
    grains : Polyhedra
        Shapes, each about its own centroid.
    positions : array_like, shape (n, 3)
        Centroid [m] of each grain.
    quaternions : array_like, shape (n, 4)
        Rotation (w, x, y, z) from each grain's frame to the world, of unit length.
    densities : array_like, shape (n,)
        Density [kg/m³] of each grain.
    domain : Domain
        The container.
    links : CellLinks, optional
        Neighbours in the tessellation, while they are still meaningful.
    provenance : tuple of str
        What made it: one JSON object a step, oldest first.
    """

    grains: Polyhedra
    positions: Floats
    quaternions: Floats
    densities: Floats
    domain: Domain
    links: CellLinks | None = None
    provenance: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        n = len(self.grains)
        self._freeze("positions", np.float64, n, 3)
        self._freeze("quaternions", np.float64, n, 4)
        self._freeze("densities", np.float64, n)
        object.__setattr__(self, "provenance", tuple(self.provenance))
        if self.links is not None:
            if self.links.neighbors.size != self.grains.n_faces:
                raise ShapeError(
                    f"links must have one neighbour a face: {self.grains.n_faces}; got {self.links.neighbors.size}"
                )
            if self.links.cell_volumes.size != n:
                raise ShapeError(f"links must have one cell volume a grain: {n}; got {self.links.cell_volumes.size}")

    def __len__(self) -> int:
        return len(self.grains)

    def with_step(self, step: str, **options: Any) -> Packing:
        """Return the same packing with one more step in its provenance; options must be JSON values."""
        line = json.dumps({"step": step, **options}, sort_keys=True)
        return replace(self, provenance=(*self.provenance, line))


@dataclass(frozen=True, slots=True, eq=False)
class ContactGraph(_Noun):
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
        pairs = self._freeze("pairs", np.int32, None, 2)
        m = len(pairs)
        self._freeze("gaps", np.float64, m)
        self._freeze("normals", np.float64, m, 3)
        self._freeze("points", np.float64, m, 3)
        self._freeze("areas", np.float64, m)
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


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that validation looked at.

    Parameters
    ----------
    name : str
        What was looked at.
    ok : bool
        Whether it is as it should be.
    worst : float
        The worst value found, in ``unit``.
    threshold : float
        What is allowed, in ``unit``.
    unit : str
        Unit of both; empty for counts and ratios.
    offenders : tuple
        Grain ids, or pairs of them, that failed.
    note : str
        What a reader should know beside it.
    """

    name: str
    ok: bool
    worst: float
    threshold: float
    unit: str = ""
    offenders: tuple[Any, ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class Report:
    """What validation found.

    Parameters
    ----------
    checks : tuple of Check
        Everything that was looked at, failed or not.
    """

    checks: tuple[Check, ...]

    @property
    def ok(self) -> bool:
        """Whether every check passed."""
        return all(check.ok for check in self.checks)

    @property
    def failed(self) -> tuple[Check, ...]:
        """The checks that failed."""
        return tuple(check for check in self.checks if not check.ok)

    def raise_if_failed(self) -> Report:
        """Return the report itself, or raise `ValidationError` naming every failed check and its first offenders."""
        if not self.ok:
            raise ValidationError("; ".join(_describe(check) for check in self.failed))
        return self

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        names = [f.name for f in fields(Check)]
        return {
            "ok": self.ok,
            "checks": [{name: getattr(check, name) for name in names} for check in self.checks],
        }


def _describe(check: Check) -> str:
    unit = f" {check.unit}" if check.unit else ""
    text = f"{check.name}: worst {check.worst:.3g}{unit}, allowed {check.threshold:.3g}{unit}"
    return f"{text} (grains {name_offenders(_plain(check.offenders))})" if check.offenders else text


def _plain(ids: Iterable[Any]) -> list[str]:
    """Return ids and pairs of ids as text: 7, 3–9."""
    return ["–".join(map(str, i)) if isinstance(i, tuple) else str(i) for i in ids]
