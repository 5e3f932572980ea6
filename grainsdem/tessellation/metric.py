"""Cells that are long or flat: a tessellation in space that was stretched, and mapped back.

With distances measured by (x - s)ᵀ G (x - s) in place of Euclid's, cells are those of Euclid's distance in the
coordinates y = A⁻¹ x with A Aᵀ = G⁻¹: an affine map, which keeps faces flat and cells convex, and fills space. One map
is for all cells: convex cells of metrics that differ from one to the next do not fill space.

References
----------
.. [1] F. Labelle, J. R. Shewchuk, "Anisotropic Voronoi diagrams and guaranteed-quality anisotropic mesh generation",
   Proc. 19th Symp. Computational Geometry (2003) 191-200.
"""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple, Self

import numpy as np

from grainsdem.errors import ConvergenceError, InputError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.forms.boxes import boxes_on_faces, rectangles
from grainsdem.model import Domain, Polyhedra, Tessellation
from grainsdem.model.arrays import Noun, check_within

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

TOLERANCE = 0.02
"""Largest relative difference of the mean ratios from those asked for."""

ROUNDS = 12
"""Most often that cells are grown anew; three are usual."""

FLATTEST = 0.02
"""Least ratio of two axes: flatter cells are slivers, whose volumes drown in rounding."""

STEEPEST = 1e3
"""Largest ratio of two axes that a metric may have."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Metric(Noun):
    """A stretch of space that keeps volumes, along three axes at right angles.

    Parameters
    ----------
    matrix : array_like, shape (3, 3)
        A, symmetric and of determinant 1: a cell of the stretched space at y is at A y.
    """

    matrix: Floats

    def __post_init__(self) -> None:
        matrix = self.freeze("matrix", np.float64, 3, 3)
        is_finite = bool((np.abs(matrix) <= STEEPEST**2).all())
        determinant = float(np.linalg.det(matrix)) if is_finite else math.nan
        if not (np.allclose(matrix, matrix.T) and abs(determinant - 1) < 1e-6):
            raise InputError(f"a metric's matrix is symmetric and of determinant 1; got {matrix.tolist()}")

    @classmethod
    def along(cls, ratios: tuple[float, float], *, trend: float = 0.0, dip: float = 0.0) -> Self:
        """Return the stretch by ratios b/a and c/b of a ball's image.

        Parameters
        ----------
        ratios : tuple of float
            Middle over long axis and short over middle axis, each above zero.
        trend : float
            Direction [rad] of the long axis in the plane, counter-clockwise from +x.
        dip : float
            Angle [rad] by which the plane of the long and the middle axis is turned up about the middle axis: the end
            of the long axis that points along the trend is raised.
        """
        low, high = ratios
        if not all(1 / STEEPEST <= ratio <= STEEPEST for ratio in (low, high)):
            raise InputError(f"ratios of axes must lie from {1 / STEEPEST} to {STEEPEST:g}; got {low} and {high}")
        # a · b · c = 1
        a = (low * low * high) ** (-1 / 3)
        sizes = (a, a * low, a * low * high)
        axes = frame_along(trend, dip)
        matrix = np.array(
            [
                [sum(size * axis[i] * axis[j] for size, axis in zip(sizes, axes, strict=True)) for j in range(3)]
                for i in range(3)
            ]
        )
        return cls(matrix)

    @property
    def is_along_axes(self) -> bool:
        """Whether x, y and z are stretched, each by itself: boxes stay boxes."""
        return bool((self.matrix[~np.eye(3, dtype=bool)] == 0).all())

    def forward(self, points: Floats) -> Floats:
        """Return where points, shape (n, 3), of the stretched space lie."""
        check_within("points", points)
        return _turned(self.matrix, points)

    def back(self, points: Floats) -> Floats:
        """Return where points, shape (n, 3), lie in the stretched space."""
        check_within("points", points)
        return _turned(self._inverse(), points)

    def unstretched(self, domain: Domain) -> Domain:
        """Return a domain in the stretched space.

        Raises
        ------
        InputError
            If it wraps around and is not stretched along its own axes, or is a slab that would not stay one.
        """
        if domain.is_planar and not (self.matrix[2, :2] == 0).all():
            raise InputError("grains of a slab are stretched in its plane: leave out flatness and dip")
        if self.is_along_axes:
            inverse = self._inverse().diagonal()
            planes = domain.planes.copy()
            planes[:, :3] *= self.matrix.diagonal()
            return Domain(domain.lower * inverse, domain.upper * inverse, domain.periodic, domain.is_planar, planes)
        if domain.periodic.any():
            raise InputError(
                "a periodic domain is stretched along its own axes only: leave out trend and dip, or periodic"
            )
        faces = np.concatenate([-np.eye(3), np.eye(3)])[[0, 3, 1, 4, 2, 5]]
        reach = np.column_stack([-domain.lower, domain.upper]).ravel()
        planes = np.concatenate([np.column_stack([faces, reach]), domain.planes])
        planes[:, :3] = _turned(self.matrix, planes[:, :3])  # A is symmetric
        corners = np.stack(np.meshgrid(*np.column_stack([domain.lower, domain.upper]), indexing="ij"), axis=-1)
        mapped = self.back(corners.reshape(-1, 3))
        # A box around the parallelepiped that no cell comes to touch.
        margin = 0.01 * (mapped.max(axis=0) - mapped.min(axis=0))
        return Domain(mapped.min(axis=0) - margin, mapped.max(axis=0) + margin, planes=planes)

    def stretched(self, cells: Tessellation, domain: Domain) -> Tessellation:
        """Return cells of the stretched space where they lie in the domain; errors as in `unstretched`."""
        shapes, neighbors = cells.cells, cells.neighbors
        if not self.is_along_axes:
            # The six sides of the box were planes there.
            neighbors = np.where(neighbors <= _FIRST_PLANE, neighbors - _FIRST_PLANE - 1, neighbors)
        sites = np.clip(self.forward(cells.sites), domain.lower, domain.upper)
        return Tessellation(domain, sites, cells.weights, self.stretched_shapes(shapes), neighbors, cells.shifts)

    def stretched_shapes(self, shapes: Polyhedra) -> Polyhedra:
        """Return polyhedra of the stretched space as they are outside of it."""
        return Polyhedra(
            self.forward(shapes.vertices),
            shapes.vertex_offsets,
            shapes.face_offsets,
            shapes.face_vertices,
            shapes.face_vertex_offsets,
        )

    def _inverse(self) -> Floats:
        if self.is_along_axes:
            return np.diag(1 / self.matrix.diagonal())
        m = self.matrix
        # The adjugate: the determinant is 1. Not LAPACK, whose last bit is the processor's.
        rows = [np.cross(m[1], m[2]), np.cross(m[2], m[0]), np.cross(m[0], m[1])]
        return np.array(rows).T


def frame_along(trend: float, dip: float) -> tuple[tuple[float, float, float], ...]:
    """Return the long, the middle and the short axis of what lies along a trend and dip [rad]; see `Metric.along`."""
    if not (math.isfinite(trend) and math.isfinite(dip)):
        raise InputError(f"trend and dip [rad] must be finite; got {trend} and {dip}")
    t, d = _exact(trend), _exact(dip)
    return (t[0] * d[0], t[1] * d[0], d[1]), (-t[1], t[0], 0.0), (-t[0] * d[1], -t[1] * d[1], d[0])


_FIRST_PLANE = -7  # as `Domain` numbers walls


class Shape(NamedTuple):
    """Mean proportions of grains, and how they lie.

    Parameters
    ----------
    elongation : float, optional
        Mean of b/a, middle over long edge of each grain's box; None leaves it as it grows.
    flatness : float, optional
        Mean of c/b, short over middle edge.
    trend, dip : float
        Direction of the long axes, and by how much the flat sides are turned up [rad], see `Metric.along`.
    """

    elongation: float | None = None
    flatness: float | None = None
    trend: float = 0.0
    dip: float = 0.0


@gated
def shaped_cells(
    domain: Domain,
    shape: Shape,
    grow: Callable[[Domain, Metric], Tessellation],
    *,
    keep: Literal["inside", "all"] = "inside",
    progress: Callable[[int, float], None] | None = None,
) -> tuple[Tessellation, Metric]:
    """Return cells whose mean proportions are those asked for, and the metric that they grew by.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    shape : Shape
        Mean proportions, and how the grains lie.
    grow : callable
        Grows cells in a domain of the stretched space, by any of `tessellate`, `sized_cells` and `graded_cells`.
    keep : {"inside", "all"}
        Which cells become grains, whose proportions count.
    progress : callable, optional
        Called after each round with its number, from 1, and the largest relative difference.

    Raises
    ------
    InputError
        If a ratio is out of range, or cells of these seeds are less equant than is asked for.
    ConvergenceError
        If the ratios do not come within `TOLERANCE`.

    Notes
    -----
    Cells of a metric are not as long as its ellipsoids: cells of seeds at random have b/a of some 0.8 where space is
    not stretched at all. So they are grown, measured, and grown anew with ratios as much smaller as were missing.
    """
    goals = _goals(shape, domain)
    ratios = dict.fromkeys(goals, 1.0)
    worst = math.inf
    for done in range(1, ROUNDS + 1):
        if domain.is_planar:
            # In the plane only: what a and b lose or gain, z does not.
            metric = _in_plane(ratios["elongation"], shape.trend)
        else:
            pair = ratios.get("elongation", 1.0), ratios.get("flatness", 1.0)
            metric = Metric.along(pair, trend=shape.trend, dip=shape.dip)
        cells = metric.stretched(grow(metric.unstretched(domain), metric), domain)
        found = _proportions(cells, keep)
        offs = {name: found[name] / goal for name, goal in goals.items()}
        worst = max(abs(off - 1) for off in offs.values())
        LOG.debug("round %d: %s, off by %.3g", done, found, worst)
        if progress is not None:
            progress(done, worst)
        if worst <= TOLERANCE:
            return cells, metric
        for name, off in offs.items():
            if ratios[name] == 1.0 and off < 1:
                raise InputError(
                    f"cells of these seeds have {_NAMES[name]} of {found[name]:.3g} in the mean as they are, less than "
                    f"the {goals[name]:g} asked for: more relaxations make them more equant"
                )
            ratios[name] = max(min(ratios[name] / off, 1.0), FLATTEST / 2)
    raise ConvergenceError(
        f"the grains' mean proportions came within {100 * worst:.2g} % of those asked for in {ROUNDS} rounds, not "
        f"{100 * TOLERANCE:g} %"
    )


_NAMES = {"elongation": "b/a", "flatness": "c/b"}


def _goals(shape: Shape, domain: Domain) -> dict[str, float]:
    """Return the mean ratios asked for, checked."""
    asked = {"elongation": shape.elongation, "flatness": shape.flatness}
    goals = {name: value for name, value in asked.items() if value is not None}
    for name, value in goals.items():
        if not FLATTEST <= value <= 1:
            raise InputError(f"{name}, the mean of {_NAMES[name]}, lies from {FLATTEST} to 1; got {value}")
    if not goals:
        raise InputError("a shape has an elongation, a flatness or both; got neither")
    if domain.is_planar and (shape.flatness is not None or shape.dip):
        raise InputError("grains of a slab are stretched in its plane: leave out flatness and dip")
    return goals


def _in_plane(ratio: float, trend: float) -> Metric:
    """Return a stretch of x and y that keeps z."""
    along, across = ratio**-0.5, ratio**0.5
    c, s = _exact(trend)
    off = (along - across) * c * s
    return Metric(
        np.array(
            [
                [along * c * c + across * s * s, off, 0.0],
                [off, along * s * s + across * c * c, 0.0],
                [0.0, 0.0, 1.0],
            ]
        )
    )


def _proportions(cells: Tessellation, keep: str) -> dict[str, float]:
    """Return the mean b/a and c/b of the cells that are kept."""
    has_faces = np.diff(cells.cells.face_offsets) > 0
    kept = has_faces if keep == "all" else has_faces & ~cells.touch_walls()
    if not kept.any():
        raise InputError(f"all {len(cells)} cells touch a wall; use more seeds, a periodic domain or keep='all'")
    shapes = cells.cells
    if cells.domain.is_planar:
        a, b, _ = rectangles(shapes.vertices[:, :2], shapes.vertex_offsets)[kept].T
        return {"elongation": float((b / a).mean())}
    a, b, c = boxes_on_faces(shapes)[kept].T
    return {"elongation": float((b / a).mean()), "flatness": float((c / b).mean())}


def _exact(angle: float) -> tuple[float, float]:
    """Return cosine and sine, with zeros where they are zero but for rounding."""
    c, s = math.cos(angle), math.sin(angle)
    return (0.0 if abs(c) < 1e-15 else c), (0.0 if abs(s) < 1e-15 else s)


def _turned(matrix: Floats, points: Floats) -> Floats:
    """Return a matrix applied to each row; not by BLAS, whose last bit is the processor's."""
    x, y, z = points[:, 0], points[:, 1], points[:, 2]
    return np.column_stack([row[0] * x + row[1] * y + row[2] * z for row in matrix])
