"""What is around the grains of a run: bodies of the apparatus, and where gravity points, in each frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import ShapeError
from grainsdem.model.arrays import Noun

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings(Noun):
    """Bodies of an apparatus that were recorded with the grains, such as walls, a lid, a wheel; and gravity.

    Parameters
    ----------
    names : tuple of str
        Of the b bodies.
    vertices : ndarray, shape (v, 3)
        Corners [m] of all bodies, each body's in its own frame.
    triangles : ndarray of int32, shape (f, 3)
        Corners of each triangle, counter-clockwise seen from outside.
    vertex_bodies : ndarray of int32, shape (v,)
        Which body each corner is of.
    positions : ndarray, shape (t, b, 3)
        Where the bodies' frames are [m] in each of t frames; NaN for a body that has been taken away.
    quaternions : ndarray, shape (t, b, 4)
        Their rotations (w, x, y, z).
    gravity : ndarray, shape (t, 3)
        Unit vector along gravity in each frame; zero where there is none.
    """

    names: tuple[str, ...]
    vertices: Floats
    triangles: NDArray[np.int32]
    vertex_bodies: NDArray[np.int32]
    positions: Floats
    quaternions: Floats
    gravity: Floats

    def __post_init__(self) -> None:
        n = len(self.names)
        self.freeze("vertices", np.float64, None, 3)
        self.freeze("triangles", np.int32, None, 3)
        bodies = self.freeze("vertex_bodies", np.int32, len(self.vertices))
        t = len(self.freeze("gravity", np.float64, None, 3))
        self.freeze("positions", np.float64, t, n, 3)
        self.freeze("quaternions", np.float64, t, n, 4)
        for name, values, limit in (("triangles", self.triangles, len(self.vertices)), ("vertex_bodies", bodies, n)):
            if values.size and not (values.min() >= 0 and values.max() < limit):
                raise ShapeError(f"{name} must be 0 to {limit - 1}; got {values.min()} to {values.max()}")

    def __len__(self) -> int:
        return len(self.names)
