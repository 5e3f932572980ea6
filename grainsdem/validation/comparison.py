"""Whether a packing that went through a file is still the packing that it was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model import Check

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

SAME = 1e-4
"""Default tolerance of volumes, relative to a grain's, and of centroids, relative to the mean diameter."""


@gated
def compare(packing: Packing, original: Packing, *, tolerance: float = SAME) -> tuple[Check, ...]:
    """Return whether every grain of ``original`` is there, as large and where it was.

    Parameters
    ----------
    packing : Packing
        What was read, its grains in the order of the original.
    original : Packing
        What was written.
    tolerance : float
        Largest change of a grain's volume, relative to it, and of its centroid, relative to the mean diameter.

    Returns
    -------
    tuple of Check
        ``grains`` and, where their number is right, ``volumes as written`` and ``centroids as written``.

    Raises
    ------
    InputError
        If the tolerance is not positive.
    """
    if not tolerance > 0:
        raise InputError(f"tolerance must be positive; got {tolerance}")
    missing = len(original) - len(packing)
    grains = Check("grains", missing == 0, float(abs(missing)), 0.0, "too few" if missing >= 0 else "too many")
    if missing:
        return (grains,)
    sizes, positions = _measures(original)
    found, places = _measures(packing)
    d = float(np.cbrt(6 * sizes / np.pi).mean())
    changes = np.abs(found / sizes - 1)
    moves = np.linalg.norm(places - positions, axis=1) / d
    return (
        grains,
        _check("volumes as written", changes, tolerance, ""),
        _check("centroids as written", moves, tolerance, "d"),
    )


def _measures(packing: Packing) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return volume [m³] and centroid in the world [m] of each grain."""
    measured = integrate(packing.grains)
    turned = np.einsum("nij,nj->ni", to_matrices(packing.quaternions), measured.centroids)
    return measured.volumes, packing.positions + turned


def _check(name: str, values: NDArray[np.float64], allowed: float, unit: str) -> Check:
    is_bad = ~(values <= allowed)  # NaN is bad
    worst = float(np.nanmax(values, initial=0.0))
    return Check(name, not is_bad.any(), worst, allowed, unit, tuple(np.flatnonzero(is_bad).tolist()))
