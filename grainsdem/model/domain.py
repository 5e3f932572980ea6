"""What seeds are placed in and cells are cut by."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Self

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import LONGEST, SHORTEST, Noun, check_factor, check_length, read_only

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


FLATTEST = 1e9
"""Longest edge of a domain over its shortest: beyond that no search for neighbours ends."""

ROUNDEST = 1024
"""Most facets of a cylinder: their middles lie within two millionths of the circle."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Domain(Noun):
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
        lower = self.freeze("lower", np.float64, 3)
        upper = self.freeze("upper", np.float64, 3)
        self.freeze("periodic", np.bool_, 3)
        if not (np.all(np.isfinite(lower)) and np.all(np.isfinite(upper)) and np.all(upper > lower)):
            raise InputError(
                f"the domain's upper corner must lie above its lower corner along every axis, both finite; "
                f"got {lower.tolist()} and {upper.tolist()}"
            )
        lengths = upper - lower
        if not (lengths.min() >= SHORTEST and lengths.max() <= LONGEST and lengths.max() <= FLATTEST * lengths.min()):
            raise InputError(
                f"the domain's edges must be between {SHORTEST:g} and {LONGEST:g} m, the longest at most {FLATTEST:g} "
                f"times the shortest; got {lengths.tolist()}"
            )
        planes = self.freeze("planes", np.float64, None, 4)
        volume = float(np.prod(upper - lower))
        if len(planes):
            norms = np.linalg.norm(planes[:, :3], axis=1)
            bad = np.flatnonzero(~(np.isfinite(planes).all(axis=1) & (norms > 0)))
            if bad.size:
                raise InputError(f"planes must be finite and have a normal; rows {name_offenders(bad)} are not")
            object.__setattr__(self, "planes", read_only("planes", planes / norms[:, None], np.float64, (None, 4)))
            crossed = np.flatnonzero((self.planes[:, :3][:, self.periodic] != 0).any(axis=1))
            if crossed.size:
                raise InputError(
                    f"planes must be parallel to every periodic axis; rows {name_offenders(crossed)} are not"
                )
            from scipy.spatial import ConvexHull  # noqa: PLC0415  (half a second, and only for domains with planes)

            # In units of the box: Qhull's own tolerances are absolute.
            size = float((upper - lower).max())
            volume = float(ConvexHull(self.corners() / size).volume * size**3)
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
        """Return a cylinder of ``radius`` [m] about the z axis, from z = 0 to ``height`` [m], as an upright prism.

        ``sides``, a multiple of 4 from 8 to 1024, is the number of its facets; four are the walls of the box. The
        prism has the area of the circle, and so the volume of the cylinder: a porosity is that of the round pipe. Of 32
        facets the middles lie 0.16 % inside the circle and the edges 0.32 % outside. ``periodic`` makes the z axis
        wrap around.
        """
        if not 8 <= sides <= ROUNDEST or sides % 4:
            raise InputError(f"sides must be a multiple of 4, from 8 to {ROUNDEST}; got {sides}")
        check_length("radius", radius)
        angles = [2 * math.pi * k / sides for k in range(sides) if 4 * k % sides]
        # The apothem of the regular polygon whose area, sides · tan(π / sides) · apothem², is the circle's.
        reach = radius * math.sqrt(math.pi / (sides * math.tan(math.pi / sides)))
        # Not NumPy's sines: their last bit is the processor's.
        planes = np.array([(math.cos(angle), math.sin(angle), 0.0, reach) for angle in angles])
        return cls([-reach, -reach, 0.0], [reach, reach, height], [False, False, periodic], planes=planes)  # type: ignore[arg-type]

    @classmethod
    def hopper(cls, top: ArrayLike, bottom: ArrayLike, height: float) -> Self:
        """Return a funnel about the z axis: ``top`` and ``bottom`` are its lengths [m] in x and y, shape (2,)."""
        upper, lower = _pair("top", top), _pair("bottom", bottom)
        if not np.all((lower > 0) & (upper > lower)):
            raise InputError(
                f"a hopper must be wider at the top than at the bottom; got {upper.tolist()} and {lower.tolist()}"
            )
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

    def corners(self) -> Floats:
        """Return the corners [m] of the container, shape (k, 3).

        Raises
        ------
        InputError
            If the planes leave nothing of the box.
        """
        from scipy.optimize import linprog  # noqa: PLC0415  (half a second, and only for domains with planes)
        from scipy.spatial import HalfspaceIntersection  # noqa: PLC0415  (the same)

        # In units of the box, about its middle: Qhull's own tolerances are absolute.
        middle, size = 0.5 * (self.lower + self.upper), float(self.lengths.max())
        half = 0.5 * self.lengths / size
        distances = (self.planes[:, 3] - (self.planes[:, :3] * middle).sum(axis=1)) / size
        normals = np.concatenate([self.planes[:, :3], np.eye(3), -np.eye(3)])
        offsets = np.concatenate([distances, half, half])
        rows = np.column_stack([normals, np.ones(len(normals))])
        # The largest ball inside: its centre is the point that Qhull needs.
        ball = linprog([0, 0, 0, -1], A_ub=rows, b_ub=offsets, bounds=[(None, None)] * 3 + [(0, None)])
        best = np.zeros(4) if ball.x is None else ball.x
        if ball.status != 0 or best[3] < 1e-9:
            raise InputError(
                f"the planes leave nothing of the box {self.lower.tolist()} to {self.upper.tolist()}; they keep "
                "n · x <= d"
            )
        found = HalfspaceIntersection(np.column_stack([normals, -offsets]), best[:3]).intersections
        return np.asarray(middle + size * found)

    def contains(self, points: Floats) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), lie in the domain or on its walls, shape (n,)."""
        inside = ((points >= self.lower) & (points <= self.upper)).all(axis=1)
        # 4 roundings: a point on an inclined plane is on it only within those.
        slack = 4 * np.finfo(np.float64).eps * max(np.abs(self.lower).max(), np.abs(self.upper).max())
        for plane in self.planes:
            # Not a matrix product: BLAS rounds as the processor's vectors are wide.
            inside &= (points * plane[:3]).sum(axis=1) <= plane[3] + slack
        return np.asarray(inside, dtype=bool)

    def scaled(self, factor: float) -> Self:
        """Return the domain scaled about the origin."""
        check_factor(factor)
        planes = self.planes * np.array([1.0, 1.0, 1.0, factor])
        return type(self)(self.lower * factor, self.upper * factor, self.periodic, self.is_planar, planes)


def _pair(name: str, lengths: ArrayLike) -> Floats:
    """Return two lengths, or one for both, as two."""
    given = np.asarray(lengths, float)
    if given.shape not in ((), (1,), (2,)):
        raise ShapeError(f"{name} must be one length or two, shape (2,); got shape {given.shape}")
    return np.broadcast_to(given, (2,))
