"""What a render shows: grains, the value that colours each, the container's outline, eye and lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, get_args

import numpy as np

from grainsdem.errors import InputError
from grainsdem.figures.frame import length_unit
from grainsdem.geometry.rotations import world_vertices
from grainsdem.looks import QUANTITIES, View
from grainsdem.measures import diameters, sphericities

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

N_LAYERS = 5
"""How many layers, or columns, are told apart by colour."""

MOST_STEPS = 12
"""Most classes that have a colour each on their scale."""

HALVES = "coolwarm"
"""Colours of two halves: blue on the left, red on the right."""

EYES: dict[str, tuple[float, float, float]] = {
    "corner": (3.0, -4.2, 2.2), "front": (0.0, -1.0, 0.0), "side": (1.0, 0.0, 0.0), "top": (0.0, 0.0, 1.0),
}  # fmt: skip
"""Direction from the middle of the container to the eye: to the right, to the back, and up."""

EYE = EYES["corner"]
"""That of a picture which is not told otherwise."""

LIGHTS = (((-2.0, -3.0, 4.0), 0.85), ((4.0, -2.0, 2.0), 0.45), ((0.0, 4.0, 1.0), 0.2))
"""Direction to each light: to the right, to the back, and up; and its strength."""

AMBIENT, DIFFUSE = 0.25, 0.8
"""Share of the light that comes from everywhere, and that falls on faces from the lights."""


class Scene(NamedTuple):
    """What is drawn.

    Parameters
    ----------
    packing : Packing
        The grains.
    lower, upper : ndarray, shape (3,)
        Corners [m] of what the picture has room for.
    values : ndarray, shape (n,)
        One a grain, for its colour.
    limits : tuple of float
        Values at the ends of the colour map.
    colors : str
        Name of the colour map.
    label : str or None
        Title of the scale; None for no scale.
    view : str
        From where one looks.
    up : ndarray, shape (3,)
        What is up in the picture.
    is_turning : bool
        Whether the container turns in the pictures that follow one another, which it is then small enough for.
    bodies : tuple of (ndarray, ndarray)
        Corners [m] and triangles of what is around the grains.
    outline : (ndarray, ndarray), optional
        Corners [m] of the container, where its outline is drawn.
    steps : tuple of str
        Words beside the scale, where it has one colour for each of the values 0, 1, … and none between them.
    """

    packing: Packing
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    values: NDArray[np.float64]
    limits: tuple[float, float]
    colors: str
    label: str | None
    view: View
    up: NDArray[np.float64]
    is_turning: bool = False
    bodies: tuple[tuple[NDArray[np.float64], NDArray[np.int32]], ...] = ()
    outline: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    steps: tuple[str, ...] = ()

    @property
    def is_flat(self) -> bool:
        """Whether one looks straight on, without perspective."""
        return self.view != "corner"

    def directions(self, rows: ArrayLike) -> NDArray[np.float64]:
        """Return directions that are given to the right, to the back and up in those of the world, shape (n, 3)."""
        return np.asarray(rows, dtype=np.float64) @ _frame(self.packing.domain.is_planar)

    @property
    def upright(self) -> NDArray[np.float64]:
        """What is up in the picture, or to the back where one looks from the top."""
        return self.directions([0.0, 1.0, 0.0]) if self.view == "top" else self.up


def _frame(is_planar: bool) -> NDArray[np.float64]:
    """Return the directions to the right, to the back and up as rows: up is against gravity, y in planar work."""
    return np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if is_planar else np.eye(3)


def set_scene(packing: Packing, color_by: str | ArrayLike, view: View | None = None) -> Scene:
    """Return what is drawn of a packing; see `grainsdem.figures.render`."""
    is_planar = packing.domain.is_planar
    if view is None:
        view = "front" if is_planar else "corner"
    if view not in get_args(View):
        raise InputError(f"view must be one of {', '.join(get_args(View))}; got {view!r}")
    values, label, colors = _quantity(packing, color_by)
    steps = _steps(values) if isinstance(color_by, str) and color_by == "class" else ()
    if steps:
        values = np.unique(values, return_inverse=True)[1].ravel().astype(np.float64)
    low, high = (-0.5, len(steps) - 0.5) if steps else (float(values.min()), float(values.max()))
    if high - low <= 1e-9 * max(abs(low), abs(high)):  # one value: the middle of a narrow scale
        low, high = low - (0.01 * abs(low) or 1.0), high + (0.01 * abs(high) or 1.0)
    if colors == HALVES:  # the ends of its scale are dark
        low, high = low - 0.15, high + 0.15
    domain, up = packing.domain, 1 if is_planar else 2
    # A container much higher than its bed would leave the bed small: it is drawn to a little above the grains.
    upper = domain.upper.copy()
    top = world_vertices(packing)[:, up].max() + 0.5 * diameters(packing.grains).mean()
    upper[up] = max(min(upper[up], top), domain.lower[up] + 1e-3 * domain.lengths[up])
    return Scene(
        packing, domain.lower, upper, values, (low, high), colors, label, view, _frame(is_planar)[2],
        outline=(domain.lower, upper), steps=steps,
    )  # fmt: skip


def _steps(classes: NDArray[np.float64]) -> tuple[str, ...]:
    """Return the numbers of classes as words, or nothing where they are too many to be told apart by colour."""
    numbers = np.unique(classes)
    return tuple(f"{number:.0f}" for number in numbers.tolist()) if numbers.size <= MOST_STEPS else ()


_KINDS = ("id", "class", "halves", "layers", "columns")
"""Colours that tell grains, or groups of them, apart."""


def _kind(
    packing: Packing, color_by: str, right: NDArray[np.float64], heights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], str | None, str]:
    """Return what `_quantity` does of colours that tell grains apart."""
    if color_by == "id":
        # Multiples of the golden ratio: ids that follow one another get colours far apart.
        return np.mod(np.arange(len(packing)) * 0.6180339887498949, 1.0), None, "Spectral"
    if color_by == "class":
        if packing.classes is None:
            raise InputError("the grains have no classes to be coloured by")
        return packing.classes.astype(np.float64), "class", "viridis"
    if color_by == "halves":
        return (right > np.median(right)).astype(np.float64), None, HALVES
    # Of as many grains each, from the lowest to the highest, or from the left.
    ranks = np.empty(len(packing))
    ranks[np.argsort(heights if color_by == "layers" else right, kind="stable")] = np.arange(len(packing))
    return np.floor(N_LAYERS * ranks / len(packing)), None, "Spectral"


def _quantity(packing: Packing, color_by: str | ArrayLike) -> tuple[NDArray[np.float64], str | None, str]:
    """Return one value a grain, the title of its scale and the colours; no title for a scale that says nothing."""
    if not isinstance(color_by, str):
        values = np.asarray(color_by, dtype=np.float64)
        if values.shape != (len(packing),) or not np.isfinite(values).all():
            raise InputError(f"color_by must hold one finite value a grain, {len(packing)}; got shape {values.shape}")
        return values, "", "viridis"
    if color_by not in QUANTITIES:
        raise InputError(f"color_by must be {', '.join(QUANTITIES)} or one value a grain; got {color_by!r}")
    right, _, heights = _frame(packing.domain.is_planar) @ packing.positions.T
    if color_by in _KINDS:
        return _kind(packing, color_by, right, heights)
    if color_by == "sphericity":
        return sphericities(packing.grains), "sphericity", "viridis"
    values = diameters(packing.grains) if color_by == "diameter" else heights
    factor, unit = length_unit(float(np.median(np.abs(values))))
    return values * factor, f"{color_by}  [{unit}]", "viridis"
