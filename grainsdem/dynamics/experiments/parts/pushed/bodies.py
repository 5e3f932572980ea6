"""Bodies that are pushed into a bed: plates, cones, wheels, spheres, and meshes of the user's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.dynamics.experiments.parts.meshes import check_length, read_hulls
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from typing import Any

    from numpy.typing import NDArray

    from grainsdem.dynamics.engine import Apparatus
    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

Kind = Literal["plate", "cone", "sphere", "wheel"]

CORNERS = 32
"""Corners of the circle on which a cone stands: it is 0.5 % inside the round one."""

NAME = "penetrator"
"""Name of the body, and of the part of the apparatus that it is."""


class Shape(NamedTuple):
    """A convex shape of a body.

    Parameters
    ----------
    kind : {"box", "sphere", "cylinder", "hull"}
        What it is.
    numbers : ndarray
        Half sizes [m] as MuJoCo takes them, or corners [m] of a hull, shape (n, 3).
    quaternion : tuple of float
        How it is turned.
    """

    kind: str
    numbers: Floats
    quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Body:
    """A body in its own frame, whose origin is in its middle.

    Parameters
    ----------
    name : str
        What it is called in messages.
    shapes : tuple of Shape
        Its convex shapes.
    half : ndarray, shape (3,)
        Half the sides [m] of the box around it.
    volume : float
        Volume [m³].
    """

    name: str
    shapes: tuple[Shape, ...]
    half: Floats
    volume: float

    def furnish(self, apparatus: Apparatus, element: Any, length: float, *, friction: float | None) -> None:
        """Add the shapes to a part of an apparatus, in units of ``length`` [m]."""
        for number, shape in enumerate(self.shapes):
            name, numbers = f"{NAME}_{number}", shape.numbers / length
            if shape.kind == "hull":
                apparatus.add_hull(element, name, numbers, friction=friction, is_solid=True)
            else:
                apparatus.add_shape(
                    element, name, shape.kind, numbers, quaternion=shape.quaternion, friction=friction, is_solid=True
                )


def make_body(
    kind: Kind,
    domain: Domain,
    *,
    width: float | None = None,
    thickness: float | None = None,
    apex_angle: float = np.pi / 3,
) -> Body:
    """Return a body of a simple shape that fits into a box.

    Parameters
    ----------
    kind : {"plate", "cone", "sphere", "wheel"}
        Which. In planar work they are a strip, a wedge, a disc and a disc, as deep as the slab.
    domain : Domain
        The box.
    width : float, optional
        Side of the square plate, diameter of the others [m]; by default a third of the shorter level side of the box, a
        quarter of its length for a wheel.
    thickness : float, optional
        Height of the plate, breadth of the wheel [m]; by default the plate's width, a third of the box's breadth.
    apex_angle : float
        Angle [rad] between opposite sides of the cone.

    Raises
    ------
    InputError
        If it does not fit into the box.
    """
    sides, planar = domain.lengths, domain.is_planar
    level = float(sides[0] if planar else sides[:2].min())
    if width is None:
        width = float(sides[0]) / 4 if kind == "wheel" else level / 3
    check_length(f"width of the {kind}", width, float(sides[0]) if kind == "wheel" else level, "the box's")
    if thickness is None:
        thickness = float(sides[1]) / 3 if kind == "wheel" else width
    if kind == "wheel" and not planar:
        check_length("thickness of the wheel", thickness, float(sides[1]), "the box's breadth")
    radius, depth = width / 2, float(sides[2]) / 2
    if kind == "plate":
        half = np.array([radius, thickness / 2, depth] if planar else [radius, radius, thickness / 2])
        return Body(kind, (Shape("box", half),), half, float(np.prod(2 * half)))
    if kind == "cone":
        return _cone(radius, radius / np.tan(apex_angle / 2), depth if planar else None)
    if planar:
        return Body(
            kind, (Shape("cylinder", np.array([radius, depth])),), np.array([radius, radius, depth]),
            float(np.pi * radius**2 * 2 * depth),
        )  # fmt: skip
    if kind == "sphere":
        return Body(kind, (Shape("sphere", np.array([radius])),), np.full(3, radius), float(4 / 3 * np.pi * radius**3))
    s = float(np.sqrt(0.5))
    wheel = Shape("cylinder", np.array([radius, thickness / 2]), (s, s, 0.0, 0.0))  # its axis from z to y
    half = np.array([radius, thickness / 2, radius])
    return Body(kind, (wheel,), half, float(np.pi * radius**2 * thickness))


def _cone(radius: float, height: float, depth: float | None) -> Body:
    """Return a cone with its tip down, or a wedge of half a depth in planar work."""
    if depth is not None:
        ends = np.array([[0.0, -height / 2], [-radius, height / 2], [radius, height / 2]])
        corners = np.array([[x, y, z] for x, y in ends for z in (-depth, depth)])
        half = np.array([radius, height / 2, depth])
        return Body("cone", (Shape("hull", corners),), half, 2 * depth * radius * height)
    angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = np.column_stack([radius * np.cos(angles), radius * np.sin(angles), np.full(CORNERS, height / 2)])
    corners = np.vstack([[[0.0, 0.0, -height / 2]], circle])
    half = np.array([radius, radius, height / 2])
    return Body("cone", (Shape("hull", corners),), half, float(np.pi * radius**2 * height / 3))


def read_body(path: str, domain: Domain, *, scale: float = 1.0) -> Body:
    """Return the body of a mesh, z up as in its file.

    Parameters
    ----------
    path : str
        ``.stl`` or ``.obj``; see `meshes.read_hulls`.
    domain : Domain
        The box that it has to fit into.
    scale : float
        Length [m] of the file's unit.

    Raises
    ------
    InputError
        If it does not fit into the box, or the bed is planar.
    """
    from scipy.spatial import ConvexHull  # noqa: PLC0415  (a third of a second)

    if domain.is_planar:
        raise InputError("a planar bed takes a plate, cone, sphere or wheel; a mesh needs a bed in space")
    hulls = [scale * corners for corners in read_hulls(path)]
    every = np.vstack(hulls)
    lower, upper = every.min(axis=0), every.max(axis=0)
    for axis in range(2):
        check_length(f"{path}: side along {'xy'[axis]}", upper[axis] - lower[axis], domain.lengths[axis], "the box's")
    shapes = tuple(Shape("hull", corners - 0.5 * (lower + upper)) for corners in hulls)
    volume = sum(float(ConvexHull(corners).volume) for corners in hulls)
    return Body(Path(path).name, shapes, 0.5 * (upper - lower), volume)
