"""What the files that show or move a bed share: its container, and the colours of its grains."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from exporters.check import stretches
from grainsdem.errors import InputError
from grainsdem.geometry.rotations import from_matrices, world_vertices
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain, Packing

    Colour: TypeAlias = Literal["mineral", "id", "diameter", "class"] | ArrayLike

COLOURS = ("mineral", "id", "diameter", "class")
"""What a colour can be by name."""

GRAIN_COLOURS = {
    "quartz": (0.87, 0.80, 0.66),
    "amber": (0.83, 0.65, 0.40),
    "feldspar": (0.85, 0.62, 0.50),
    "flint": (0.55, 0.50, 0.45),
    "chalk": (0.93, 0.90, 0.83),
    "slate": (0.62, 0.63, 0.62),
}
"""Colours of minerals, linear red, green and blue from 0 to 1."""

# Matplotlib's viridis at nine places: even to the eye, and told apart by colour-blind readers.
_SCALE = np.array([
    (0.267, 0.005, 0.329), (0.279, 0.175, 0.483), (0.230, 0.322, 0.546), (0.173, 0.449, 0.558), (0.128, 0.567, 0.551),
    (0.158, 0.684, 0.502), (0.369, 0.789, 0.383), (0.678, 0.864, 0.190), (0.993, 0.906, 0.144),
])  # fmt: skip


def shades(n_grains: int) -> NDArray[np.int64]:
    """Return which of the minerals each grain is, shape (n,): all as often, near numbers apart."""
    # Multiples of the golden ratio spread evenly over any number of colours.
    turns = np.arange(n_grains) * 0.6180339887498949 % 1.0
    return (turns * len(GRAIN_COLOURS)).astype(np.int64)


def check_colour(colour: Colour) -> None:
    """Raise `InputError` unless a colour is one of `COLOURS` or finite numbers, one or three a grain."""
    if isinstance(colour, str):
        if colour not in COLOURS:
            raise InputError(f"colour must be one of {', '.join(COLOURS)}, or numbers; got {colour!r}")
        return
    numbers = np.asarray(colour)
    if numbers.dtype.kind not in "fiub" or not (numbers.ndim == 1 or numbers.shape[1:] == (3,)):
        raise InputError(
            f"colour must be a number or red, green and blue of each grain; got {numbers.dtype} of shape "
            f"{numbers.shape}"
        )
    if not np.isfinite(numbers).all() or (numbers.ndim == 2 and (numbers.min() < 0 or numbers.max() > 1)):
        raise InputError("colour must be finite numbers, red, green and blue from 0 to 1")


def colours_of(packing: Packing, volumes: NDArray[np.float64], colour: Colour) -> NDArray[np.float64]:
    """Return red, green and blue of each grain, shape (n, 3).

    Parameters
    ----------
    packing : Packing
        The grains.
    volumes : ndarray, shape (n,)
        Their volumes [m³].
    colour : {"mineral", "id", "diameter", "class"} or array_like
        Minerals mixed; along a scale from dark blue to yellow by number, diameter or class of the grain, or by numbers
        of one's own, shape (n,); or red, green and blue, shape (n, 3).

    Raises
    ------
    InputError
        If there are not as many numbers as grains, or grains have no classes to be coloured by.
    """
    n = len(packing)
    if isinstance(colour, str):
        if colour == "mineral":
            return np.array(list(GRAIN_COLOURS.values()))[shades(n)]
        if colour == "class":
            if packing.classes is None:
                raise InputError("the grains have no classes to be coloured by")
            # One step a class, whatever their numbers.
            return scale(np.unique(packing.classes, return_inverse=True)[1].ravel().astype(np.float64))
        return scale(np.arange(n, dtype=np.float64) if colour == "id" else cube_roots(volumes))
    numbers = np.asarray(colour, dtype=np.float64)
    if len(numbers) != n:
        raise InputError(f"colour must have one row for each of {n} grains; got {len(numbers)}")
    return numbers if numbers.ndim == 2 else scale(numbers)


def scale(numbers: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the colours of numbers, the smallest dark blue and the largest yellow, shape (n, 3)."""
    span = np.ptp(numbers)
    places = (numbers - numbers.min()) / (span if span > 0 else 1.0)
    stops = np.linspace(0.0, 1.0, len(_SCALE))
    return np.stack([np.interp(places, stops, _SCALE[:, k]) for k in range(3)], axis=1)


def world_bounds(packing: Packing) -> NDArray[np.float64]:
    """Return the lower and the upper corner [m] of the box around all grains, shape (2, 3)."""
    corners = [
        (vertices.min(axis=0), vertices.max(axis=0))
        for _, part in stretches(packing)
        for vertices in [world_vertices(part)]
    ]
    lower, upper = np.array(corners).swapaxes(0, 1)
    return np.stack([lower.min(axis=0), upper.max(axis=0)])


def container_box(packing: Packing, vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners [m] of the container around vertices in the world, or around the corners of their box.

    Along a periodic axis, where cells reach over the boundary, it is as wide as the grains; else it is the
    domain.
    """
    domain = packing.domain
    lower = np.where(domain.periodic, np.minimum(domain.lower, vertices.min(axis=0)), domain.lower)
    upper = np.where(domain.periodic, np.maximum(domain.upper, vertices.max(axis=0)), domain.upper)
    return lower, upper


def wall_names(domain: Domain, walls: str = "box") -> list[str]:
    """Return the names of a container's walls, the floor first: of all, of the floor alone, or of none."""
    flat, solid = ("wall_y0", "wall_x0", "wall_x1"), ("floor", "wall_x0", "wall_x1", "wall_y0", "wall_y1")
    names = flat if domain.is_planar else solid
    planes = [f"wall_p{k}" for k in range(len(domain.planes))]
    return {"box": [*names, *planes], "floor": [names[0]], "none": []}[walls]


def plane_frames(domain: Domain) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a point [m] on each of the domain's planes, shape (k, 3), and rotations that turn z inward, shape (k, 4).

    The point is that nearest to the middle of the box; the x axis of each frame is level.
    """
    normals, distances = domain.planes[:, :3], domain.planes[:, 3]
    middle = (domain.lower + domain.upper) / 2
    points = middle + (distances - normals @ middle)[:, None] * normals
    level = np.cross([0.0, 0.0, 1.0], -normals)
    # A plane that is level itself has no level direction of its own.
    level = np.where(np.linalg.norm(level, axis=1, keepdims=True) > 1e-9, level, [1.0, 0.0, 0.0])
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    axes = np.stack([level, np.cross(-normals, level), -normals], axis=2)
    return points, from_matrices(axes)
