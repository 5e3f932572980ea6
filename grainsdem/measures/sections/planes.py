"""The polygons in which a plane cuts a bed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.clipping import box_planes
from grainsdem.geometry.raster.copies import copies
from grainsdem.geometry.raster.slicing import cut_polygons
from grainsdem.model.arrays import Noun, check_row
from grainsdem.ragged import check_offsets

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.geometry.raster.copies import Copies
    from grainsdem.model import Domain, Packing

    Floats = NDArray[np.float64]

_NORMALS = {"x": (1.0, 0.0, 0.0), "y": (0.0, -1.0, 0.0), "z": (0.0, 0.0, 1.0)}
"""Normals of level planes, towards the eye: x, y and z grow to the right or upward in the picture."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Section(Noun):
    """Convex polygons in which a plane cuts grains.

    Parameters
    ----------
    ids : array_like of int32, shape (k,)
        The grain that each polygon is cut from; rising.
    shifts : array_like of int32, shape (k, 3)
        Its periodic image, in whole domain lengths.
    points : array_like, shape (n_points, 2)
        Corners [m] of all polygons in the plane's coordinates u and v, counter-clockwise seen from the normal's tip.
    offsets : array_like of int64, shape (k + 1,)
        Corners of polygon j are ``points[offsets[j]:offsets[j + 1]]``.
    frame : array_like, shape (3, 3)
        Unit vectors u, v and the normal n in the world; v points as far up as it can.
    distance : float
        The plane is n · x = distance [m].
    outline : array_like, shape (m, 2)
        Corners [m] of the domain's own section. Polygons are whole: where grains reach over a periodic face, they
        reach over the outline, and stand at its other side once more.
    """

    ids: NDArray[np.int32]
    shifts: NDArray[np.int32]
    points: Floats
    offsets: NDArray[np.int64]
    frame: Floats
    distance: float
    outline: Floats

    def __post_init__(self) -> None:
        k = self.freeze("ids", np.int32, None).size
        self.freeze("shifts", np.int32, k, 3)
        points = self.freeze("points", np.float64, None, 2)
        offsets = self.freeze("offsets", np.int64, None)
        check_offsets("offsets", offsets, len(points))
        if offsets.size != k + 1:
            raise ShapeError(f"offsets must be one more than the {k} ids; got {offsets.size}")
        self.freeze("frame", np.float64, 3, 3)
        self.freeze("outline", np.float64, None, 2)

    def __len__(self) -> int:
        return len(self.ids)

    def polygon(self, j: int) -> Floats:
        """Return the corners [m] of polygon ``j`` in the plane, shape (m, 2)."""
        check_row("j", j, len(self))
        return self.points[self.offsets[j] : self.offsets[j + 1]]

    def world_points(self) -> Floats:
        """Return all corners [m] in the world, shape (n_points, 3)."""
        flat: Floats = self.points @ self.frame[:2] + self.distance * self.frame[2]
        return flat


@gated
def section(
    packing: Packing,
    *,
    x: float | None = None,
    y: float | None = None,
    z: float | None = None,
    plane: ArrayLike | None = None,
) -> Section:
    """Return the polygons in which a plane cuts the grains of a bed, exactly.

    Parameters
    ----------
    packing : Packing
        Convex grains.
    x, y, z : float, optional
        Place [m] of a level plane. A plane of constant y is looked at along y, so that x runs to the right.
    plane : array_like, shape (4,), optional
        Any plane, (n_x, n_y, n_z, d): n · x = d [m], n of any length; it is looked at against n. Give one of the four.

    Returns
    -------
    Section
        Grains that reach into the domain from across a periodic face are cut, too.

    Raises
    ------
    InputError
        If not one plane is given, it is not finite or has no normal, or it misses the domain.

    Notes
    -----
    A corner that lies in the plane counts as below it: of two grains whose shared face is in the plane, one is cut.
    """
    domain = packing.domain
    return cut(packing, copies(packing, domain.lower, domain.upper), *find_plane({"x": x, "y": y, "z": z}, plane))


def cut(packing: Packing, found: Copies, frame: Floats, distance: float) -> Section:
    """Return the section of a plane, of those grains and images that reach into the domain; see `section`."""
    outline = cut_domain(packing.domain, frame, distance)
    if len(outline) < 3:
        low, high = packing.domain.lower.tolist(), packing.domain.upper.tolist()
        normal = ", ".join(f"{c:.4g}" for c in frame[2])
        raise InputError(f"the plane ({normal}) · x = {distance:.6g} m misses the domain, {low} to {high}")
    polygons = cut_polygons(packing, found, frame, distance)
    return Section(
        polygons.ids.astype(np.int32),
        polygons.shifts.astype(np.int32),
        polygons.points,
        polygons.offsets,
        frame,
        distance,
        outline,
    )


def find_plane(levels: dict[str, float | None], plane: ArrayLike | None) -> tuple[Floats, float]:
    """Return the frame and the distance [m] of a plane that is given in one of the ways of `section`."""
    given = {axis: place for axis, place in levels.items() if place is not None}
    if len(given) + (plane is not None) != 1:
        names = [*given, *(["plane"] if plane is not None else [])]
        raise InputError(f"give one plane, by x, y, z or plane; got {', '.join(names) or 'none'}")
    if plane is None:
        ((axis, place),) = given.items()
        row = np.append(_NORMALS[axis], float(place) * (-1.0 if axis == "y" else 1.0))
    else:
        row = np.asarray(plane, dtype=np.float64)
    if row.shape != (4,) or not np.isfinite(row).all() or not row[:3].any():
        raise InputError(f"a plane is four finite numbers, n_x, n_y, n_z and d, with a normal; got {row.tolist()}")
    normal = row[:3] / np.linalg.norm(row[:3])
    up = np.array([0.0, 0.0, 1.0]) if abs(normal[2]) < 1 - 1e-12 else np.array([0.0, 1.0, 0.0])
    v = up - (up @ normal) * normal
    v /= np.linalg.norm(v)
    # Without signed zeros, so that the same plane is the same bytes.
    return np.array([np.cross(v, normal), v, normal]) + 0.0, float(row[3] / np.linalg.norm(row[:3])) + 0.0


def cut_domain(domain: Domain, frame: Floats, distance: float) -> Floats:
    """Return the corners [m] of a domain's section, counter-clockwise in the plane, shape (m, 2); none if it misses."""
    planes = np.vstack([box_planes(domain.lower, domain.upper), domain.planes])
    middle, reach = 0.5 * (domain.lower + domain.upper), float(np.linalg.norm(domain.lengths))
    corners = (frame[:2] @ middle) + reach * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    slack = 1e-12 * (reach + float(np.abs(middle).max()))
    for nx, ny, nz, d in planes:
        normal = np.array([nx, ny, nz])
        side = corners @ (frame[:2] @ normal) + distance * (frame[2] @ normal) - d
        # A plane along a wall touches the domain, and its section is that wall.
        side[np.abs(side) <= slack] = 0.0
        kept: list[Floats] = []
        for a, b, sa, sb in zip(np.roll(corners, 1, axis=0), corners, np.roll(side, 1), side, strict=True):
            if (sa <= 0) != (sb <= 0):
                kept.append(a + sa / (sa - sb) * (b - a))
            if sb <= 0:
                kept.append(b)
        corners = np.array(kept).reshape(-1, 2)
        if len(corners) == 0:
            break
    # Walls that meet in the plane give their corner once each.
    apart = np.abs(corners - np.roll(corners, 1, axis=0)).max(axis=1, initial=0.0) > slack
    return np.asarray(corners[apart])
