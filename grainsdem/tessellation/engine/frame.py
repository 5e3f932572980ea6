"""The engine's own units: the domain from the origin, its longest edge between a half and one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain


@dataclass(frozen=True)
class Frame:
    """How the engine sees a domain.

    Parameters
    ----------
    scale : float
        One engine length [m]: a power of two, so that scaling rounds nothing.
    lower : ndarray, shape (3,)
        Lower corner [m].
    lengths : ndarray, shape (3,)
        Edges in engine lengths.
    periodic : ndarray of bool, shape (3,)
        Which axes wrap around.
    walls : ndarray, shape (k, 4)
        Planes n · x <= d that cut the box, in engine lengths.
    ulp : float
        What a coordinate is known to, in engine lengths.
    """

    scale: float
    lower: NDArray[np.float64]
    lengths: NDArray[np.float64]
    periodic: NDArray[np.bool_]
    walls: NDArray[np.float64]
    ulp: float

    @classmethod
    def of(cls, domain: Domain) -> Frame:
        """Return the frame of a domain."""
        scale = float(2.0 ** np.ceil(np.log2(domain.lengths.max())))
        largest = max(np.abs(domain.lower).max(), np.abs(domain.upper).max(), domain.lengths.max())
        ulp = float(np.finfo(np.float64).eps * largest / scale)
        # Not a matrix product: BLAS rounds as the processor's vectors are wide.
        distances = (domain.planes[:, 3] - (domain.planes[:, :3] * domain.lower).sum(axis=1)) / scale
        walls = np.column_stack([domain.planes[:, :3], distances])
        return cls(scale, domain.lower.copy(), domain.lengths / scale, domain.periodic.copy(), walls, ulp)

    @property
    def kernel(self) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64], float]:
        """What kernels take: lengths, periodic axes, walls, and the distance within which a vertex is on a plane."""
        # 8 roundings: a vertex cut from a box of length 1 is off by a few.
        return self.lengths, self.periodic, self.walls, 8.0 * self.ulp

    @property
    def merge_tolerance(self) -> float:
        """Length below which an edge is rounding: many roundings, as its planes may meet at a small angle."""
        return 512.0 * self.ulp

    def inward(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return points [m] in engine lengths."""
        return (points - self.lower) / self.scale
