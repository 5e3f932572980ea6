"""What a render shows: grains, the value that colours each, the container's outline, eye and lights."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.figures.frame import length_unit
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters, sphericities

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

QUANTITIES = ("diameter", "sphericity", "height", "id")
"""What `render` colours grains by, besides an array."""

EYE = (3.0, -4.2, 2.2)
"""Direction from the middle of the container to the eye."""

LIGHTS = (((-2.0, -3.0, 4.0), 0.85), ((4.0, -2.0, 2.0), 0.45), ((0.0, 4.0, 1.0), 0.2))
"""Direction to each light, and its strength."""

AMBIENT, DIFFUSE = 0.25, 0.8
"""Share of the light that comes from everywhere, and that falls on faces from the lights."""


class Scene(NamedTuple):
    """What is drawn.

    Parameters
    ----------
    packing : Packing
        The grains.
    lower, upper : ndarray, shape (3,)
        Corners [m] of the outline.
    values : ndarray, shape (n,)
        One a grain, for its colour.
    limits : tuple of float
        Values at the ends of the colour map.
    colors : str
        Name of the colour map.
    label : str or None
        Title of the scale; None for no scale.
    """

    packing: Packing
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    values: NDArray[np.float64]
    limits: tuple[float, float]
    colors: str
    label: str | None


def set_scene(packing: Packing, color_by: str | ArrayLike) -> Scene:
    """Return what is drawn of a packing; see `grainsdem.figures.render`."""
    values, label = _quantity(packing, color_by)
    low, high = float(values.min()), float(values.max())
    if high - low <= 1e-9 * max(abs(low), abs(high)):  # one value: the middle of a narrow scale
        low, high = low - (0.01 * abs(low) or 1.0), high + (0.01 * abs(high) or 1.0)
    domain = packing.domain
    # A container much higher than its bed would leave the bed small: it is drawn to a little above the grains.
    upper = domain.upper.copy()
    top = world_vertices(packing)[:, 2].max() + 0.5 * diameters(packing.grains).mean()
    upper[2] = max(min(upper[2], top), domain.lower[2] + 1e-3 * domain.lengths[2])
    colors = "Spectral" if label is None else "viridis"
    return Scene(packing, domain.lower, upper, values, (low, high), colors, label)


def _quantity(packing: Packing, color_by: str | ArrayLike) -> tuple[NDArray[np.float64], str | None]:
    """Return one value a grain and the title of its scale; None for a scale that says nothing."""
    if not isinstance(color_by, str):
        values = np.asarray(color_by, dtype=np.float64)
        if values.shape != (len(packing),) or not np.isfinite(values).all():
            raise InputError(f"color_by must hold one finite value a grain, {len(packing)}; got shape {values.shape}")
        return values, ""
    if color_by not in QUANTITIES:
        raise InputError(f"color_by must be {', '.join(QUANTITIES)} or one value a grain; got {color_by!r}")
    if color_by == "id":
        # Multiples of the golden ratio: ids that follow one another get colours far apart.
        return np.mod(np.arange(len(packing)) * 0.6180339887498949, 1.0), None
    if color_by == "sphericity":
        return sphericities(packing.grains), "sphericity"
    values = diameters(packing.grains) if color_by == "diameter" else packing.positions[:, 2]
    factor, unit = length_unit(float(np.median(np.abs(values))))
    return values * factor, f"{color_by}  [{unit}]"
