"""What is known of pairs of bodies, or of bodies and walls, once they are measured."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Gaps(NamedTuple):
    """Where two grains of a pair are nearest, one row a pair.

    Parameters
    ----------
    gaps : ndarray, shape (m,)
        Signed gap [m]: distance, or minus the depth of the overlap; infinite beyond the limit.
    normals : ndarray, shape (m, 3)
        Unit normal from the first grain to the second.
    firsts, seconds : ndarray, shape (m, 3)
        Closest points, or the deepest ones, of the two, relative to the first grain's position [m].
    centres : ndarray, shape (m, 3)
        Centre of the shared patch where faces or edges lie flat on one another, else midway between the closest
        points; relative to the first grain's position [m].
    areas : ndarray, shape (m,)
        Area [m²] that facing polygons share.
    features : ndarray of int8, shape (m, 2)
        What each grain touches with: 0 a corner, 1 an edge, 2 a face.
    """

    gaps: Floats
    normals: Floats
    firsts: Floats
    seconds: Floats
    centres: Floats
    areas: Floats
    features: NDArray[np.int8]

    def take(self, rows: NDArray[Any]) -> Gaps:
        """Return the chosen rows, given by index or mask."""
        return self._replace(**{name: getattr(self, name)[rows] for name in self._fields})
