"""The two-point correlation of the solid phase."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.raster.lattice import OUTSIDE, VOID
from grainsdem.workers import n_processors

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.voxels.labels import Voxels

    Floats = NDArray[np.float64]


class Correlation(NamedTuple):
    """The two-point correlation S₂, the chance that two points a vector apart both lie in grains.

    Parameters
    ----------
    distances : ndarray, shape (m,)
        Mean distance [m] of the pairs of each shell, the first zero.
    values : ndarray, shape (m,)
        S₂ over all directions.
    along : ndarray, shape (3, m)
        S₂ at k voxels along x, y and z; NaN where there are fewer voxels.
    solid_fraction : float
        S₂ at distance zero, 1 - φ; far away S₂ tends to (1 - φ)² where there is no order.
    """

    distances: Floats
    values: Floats
    along: Floats
    solid_fraction: float

    def table(self) -> NDArray[np.void]:
        """Return one row a shell: ``distance`` [m], ``s2``, and ``s2_x``, ``s2_y``, ``s2_z`` along the axes."""
        columns = {"distance": self.distances, "s2": self.values}
        columns |= {f"s2_{axis}": row for axis, row in zip("xyz", self.along, strict=True)}
        rows = np.empty(self.distances.size, dtype=[(name, np.float64) for name in columns])
        for name, values in columns.items():
            rows[name] = values
        return rows


@gated
def two_point_correlation(voxels: Voxels, *, farthest: float | None = None) -> Correlation:
    """Return the two-point correlation of the solid phase, by Fourier transforms.

    Parameters
    ----------
    voxels : Voxels
        Any voxels. It takes about 50 bytes of memory for each, twice as many where no axis wraps.
    farthest : float, optional
        Largest distance [m]; a quarter of the longest edge of the box by default.

    Returns
    -------
    Correlation
        By shells one voxel wide. Pairs are counted exactly: across periodic axes, and elsewhere only within the domain.

    Raises
    ------
    InputError
        If ``farthest`` is not between a voxel and half of the longest edge of the box, or no voxel lies in the domain.
    """
    shape, spacing = np.array(voxels.labels.shape), voxels.spacing[::-1]
    step, longest = float(spacing[shape > 1].max(initial=0.0) or spacing[0]), float((shape * spacing).max())
    farthest = 0.25 * longest if farthest is None else float(farthest)
    if not step <= farthest <= 0.5 * longest:
        raise InputError(
            f"farthest must be between a voxel, {step:.4g} m, and half of the longest edge, {0.5 * longest:.4g} m; "
            f"got {farthest:.4g}"
        )
    periodic = voxels.periodic[::-1]
    reach = np.minimum(np.floor(farthest / spacing + 1e-9).astype(int), np.where(periodic, shape // 2, shape - 1))
    solid = _pairs(voxels.labels > VOID, reach, periodic)
    pairs = _pairs(voxels.labels != OUTSIDE, reach, periodic)
    # A little more, so that a whole number of voxels is one after rounding.
    return _shells(solid, pairs, spacing, step, int(np.floor(farthest / step + 1e-9)) + 1)


def _pairs(mask: NDArray[np.bool_], reach: NDArray[np.int64], periodic: NDArray[np.bool_]) -> Floats:
    """Return how many pairs of voxels are in a mask, by offset: -reach to reach along each axis."""
    from scipy import fft  # noqa: PLC0415  (a tenth of a second)

    # Beyond an axis that does not wrap, so many zeros that no offset within reach finds the other side.
    sizes = [
        n if wraps else fft.next_fast_len(int(n + r), real=True)
        for n, r, wraps in zip(mask.shape, reach, periodic, strict=True)
    ]
    workers = n_processors()
    transform = fft.rfftn(mask.astype(np.float64), s=sizes, workers=workers)
    power = transform.real**2 + transform.imag**2
    counts = np.rint(fft.irfftn(power, s=sizes, workers=workers, overwrite_x=True))
    for axis, r in enumerate(reach):
        counts = np.take(counts, np.arange(-r, r + 1) % counts.shape[axis], axis=axis)
    return np.asarray(counts)


def _shells(solid: Floats, pairs: Floats, spacing: Floats, step: float, n: int) -> Correlation:
    """Sum the pairs of all offsets in n shells one voxel wide, and those along the axes one by one."""
    reach = [size // 2 for size in pairs.shape]
    if pairs[tuple(reach)] == 0:
        raise InputError("no voxel lies in the domain: there is nothing to correlate")
    offsets = np.meshgrid(*(np.arange(-r, r + 1) * s for r, s in zip(reach, spacing, strict=True)), indexing="ij")
    distance = np.sqrt(sum(offset**2 for offset in offsets))
    shell = np.rint(distance / step).astype(np.int64)
    kept = (shell < n) & (pairs > 0)
    weights = [np.bincount(shell[kept], weights=w[kept], minlength=n) for w in (pairs, solid, pairs * distance)]
    along = np.full((3, n), np.nan)
    for row, axis in enumerate((2, 1, 0)):
        line = [slice(r, r + 1) for r in reach]
        line[axis] = slice(int(reach[axis]), None)
        places = tuple(line)
        share = (solid[places] / np.maximum(pairs[places], 1)).ravel()[:n]
        along[row, : share.size] = share
    total = np.where(weights[0] > 0, weights[0], np.nan)
    return Correlation(weights[2] / total, weights[1] / total, along, float(along[0, 0]))
