"""Chords of both phases: how long straight lines stay in grains, and in the void."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.raster.lattice import OUTSIDE, VOID
from grainsdem.geometry.raster.lines import run_lengths

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.voxels.labels import Voxels

    Floats = NDArray[np.float64]


class Chords(NamedTuple):
    """How often a straight line has chords of each length.

    Parameters
    ----------
    lengths : ndarray, shape (m,)
        Lengths [m]: whole numbers of voxels.
    solid, void : ndarray of int64, shape (m,)
        Number of chords in grains and in the void between grains.
    """

    lengths: Floats
    solid: NDArray[np.int64]
    void: NDArray[np.int64]

    def mean(self, phase: Literal["solid", "void"]) -> float:
        """Return the mean length [m] of the chords of a phase; NaN where there is none."""
        counts = self.solid if phase == "solid" else self.void
        total = int(counts.sum())
        return float(counts @ self.lengths / total) if total else float("nan")


@gated
def chord_lengths(voxels: Voxels, axis: Literal["x", "y", "z"] = "x") -> Chords:
    """Return how often lines along an axis have chords of each length, in grains and in the void.

    Parameters
    ----------
    voxels : Voxels
        Any voxels.
    axis : {"x", "y", "z"}
        Direction of the lines: one through each row of voxels.

    Returns
    -------
    Chords
        Chords that the end of a row cuts are left out, as are those that end outside the domain; across a periodic
        axis they go on. A chord in grains may run through several that touch.

    Raises
    ------
    InputError
        If the axis is another.

    Notes
    -----
    Of a convex body and lines from all sides the mean chord is 4 V / A (Cauchy); of the solid and the void of a bed
    4 (1 - φ) / s and 4 φ / s, φ the porosity, s its specific surface. Lines of one direction are not from all sides:
    they cross a face of normal n by |n_x| where those from all sides do by 1/2 in the mean, so that cubes that lie
    along the lattice have chords of 1.5 times 4 V / A along each axis, however fine the voxels.
    """
    if axis not in ("x", "y", "z"):
        raise InputError(f"axis must be 'x', 'y' or 'z'; got {axis!r}")
    number = "xyz".index(axis)
    phase = np.where(voxels.labels == OUTSIDE, -1, voxels.labels > VOID).astype(np.int8)
    rows = np.ascontiguousarray(np.moveaxis(phase, 2 - number, -1)).reshape(-1, phase.shape[2 - number])
    solid, void = run_lengths(rows, wraps=bool(voxels.periodic[number]))
    used = np.flatnonzero(solid + void)
    n = int(used[-1]) + 1 if used.size else 1
    return Chords(voxels.spacing[number] * np.arange(n), solid[:n], void[:n])
