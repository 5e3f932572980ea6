"""What is seen of a bed from straight above, pixel by pixel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.raster.above import look_down
from grainsdem.model.arrays import Noun, check_length

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PER_DIAMETER = 20.0
"""Pixels along a mean diameter where nothing else is asked for."""

MOST_PIXELS = 1 << 30
"""Pixels of a planform: 16 bytes each."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Planform(Noun):
    """A bed seen from straight above through pixels, without perspective; row 0 is at the largest y.

    Parameters
    ----------
    labels : array_like of int32, shape (ny, nx)
        Grain id + 1 of the highest grain in the middle of the pixel; 0 where there is none.
    heights : array_like, shape (ny, nx)
        Height z [m] of its surface there; NaN where there is none.
    faces : array_like of int32, shape (ny, nx)
        The face that is seen, counted over all grains; -1 where there is none.
    corner : array_like, shape (2,)
        Smallest x and y [m] of the picture.
    pixel : array_like, shape (2,)
        Edges [m] of a pixel along x and y.
    floor : float
        Height z [m] of the domain's floor.
    periodic : array_like of bool, shape (2,)
        Along which of x and y the picture goes on at its other side.
    ends : array_like of bool, shape (2, 2)
        Whether grains may go on beyond the picture: at its smallest and largest x, and y.
    """

    labels: NDArray[np.int32]
    heights: Floats
    faces: NDArray[np.int32]
    corner: Floats
    pixel: Floats
    floor: float
    periodic: NDArray[np.bool_]
    ends: NDArray[np.bool_]

    def __post_init__(self) -> None:
        shape = self.freeze("labels", np.int32, None, None).shape
        self.freeze("heights", np.float64, *shape)
        self.freeze("faces", np.int32, *shape)
        self.freeze("corner", np.float64, 2)
        self.freeze("pixel", np.float64, 2)
        self.freeze("periodic", np.bool_, 2)
        self.freeze("ends", np.bool_, 2, 2)

    def depths(self) -> Floats:
        """Return how far below the highest thing seen each pixel is [m], shape (ny, nx); NaN where no grain is."""
        if not (self.labels > 0).any():
            return self.heights
        return np.asarray(np.nanmax(self.heights) - self.heights)

    def places(self) -> tuple[Floats, Floats]:
        """Return x of the middles of the columns, shape (nx,), and y of the rows, shape (ny,) [m]."""
        ny, nx = self.labels.shape
        x = self.corner[0] + (np.arange(nx) + 0.5) * self.pixel[0]
        y = self.corner[1] + (ny - np.arange(ny) - 0.5) * self.pixel[1]
        return x, y


@gated
def planform(
    packing: Packing,
    *,
    pixel: float | None = None,
    per_diameter: float | None = None,
    region: tuple[ArrayLike, ArrayLike] | None = None,
) -> Planform:
    """Return what is seen of a bed from straight above, hidden grains hidden.

    Parameters
    ----------
    packing : Packing
        Convex grains; a planar bed is seen along z, as a section of it.
    pixel : float, optional
        Edge [m] of a pixel.
    per_diameter : float, optional
        Pixels along a mean diameter, 20 by default; instead of ``pixel``.
    region : tuple of two array_like, shape (2,), optional
        Smallest and largest x and y [m] of the picture; those of the domain by default.

    Returns
    -------
    Planform
        Pixels fill the region: their number along each axis is the nearest whole one. Images across periodic faces are
        seen, except across a periodic z: there the highest grain of the bed is its top.

    Raises
    ------
    InputError
        If both sizes are given, one is not positive and finite, the region is none, or there would be too many pixels.
    """
    domain = packing.domain
    lower, upper = (domain.lower[:2], domain.upper[:2]) if region is None else _corners(region)
    counts = _count(packing, upper - lower, pixel, per_diameter)
    size = (upper - lower) / counts
    nx, ny = counts.astype(int).tolist()
    seen = look_down(packing, lower, size, (nx, ny))
    # A millionth: a corner that came from a file may be rounded.
    slack = 1e-6 * domain.lengths[:2]
    spans = domain.periodic[:2] & (np.abs(upper - lower - domain.lengths[:2]) <= slack)
    reaches = np.stack([lower <= domain.lower[:2] + slack, upper >= domain.upper[:2] - slack], axis=1)
    ends = ~spans[:, None] & (domain.periodic[:2, None] | ~reaches)
    return Planform(*seen, lower, size, float(domain.lower[2]), spans, ends)


def _count(packing: Packing, lengths: Floats, pixel: float | None, per_diameter: float | None) -> Floats:
    """Return how many pixels fill the picture along x and y."""
    if pixel is not None and per_diameter is not None:
        raise InputError(f"give pixel or per_diameter, not both; got {pixel} and {per_diameter}")
    if pixel is None:
        if len(packing) == 0:
            raise InputError("a packing without grains has no diameter; give the size of a pixel")
        ratio = PER_DIAMETER if per_diameter is None else per_diameter
        if not (np.isfinite(ratio) and ratio > 0):
            raise InputError(f"per_diameter must be positive and finite; got {ratio}")
        pixel = float(grain_diameters(packing).mean()) / ratio
    check_length("pixel", pixel)
    counts: Floats = np.maximum(np.rint(lengths / pixel), 1)
    if counts.max() > MOST_PIXELS or counts.prod() > MOST_PIXELS:
        raise InputError(f"a planform has at most {MOST_PIXELS} pixels; got {counts[0]:.0f} × {counts[1]:.0f}")
    return counts


def _corners(region: tuple[ArrayLike, ArrayLike]) -> tuple[Floats, Floats]:
    try:
        lower, upper = (np.asarray(corner, dtype=np.float64) for corner in region)
        fits = lower.shape == upper.shape == (2,) and bool(np.isfinite([lower, upper]).all() and (upper > lower).all())
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise InputError(
            f"region must be the corners of a rectangle, (x, y) and a larger (x, y), in metres; got {region!r}"
        )
    return lower, upper
