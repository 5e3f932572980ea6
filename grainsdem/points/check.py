"""What every seed must be: finite, inside the domain, and unlike every other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

DUPLICATE_TOLERANCE = 1e-12
"""Seeds nearer than this times the domain's longest edge are one seed: their bisector plane is lost in rounding."""


@gated
def check_seeds(seeds: ArrayLike, domain: Domain) -> NDArray[np.float64]:
    """Return the seeds as a fresh float64 array, shape (n, 3), or raise one clear error.

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        Positions [m]; shape (n, 2) is taken as lying in the mid-plane of a planar domain.
    domain : Domain
        What they must lie in; its faces are allowed.

    Raises
    ------
    ShapeError
        If the array is not of shape (n, 3), or (n, 2) for a planar domain.
    InputError
        If there is no seed, or one is not finite, outside the domain or equal to another; the first are named.
    """
    try:
        points = np.array(seeds, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"seeds must be numbers in an array of shape (n, 3); {error}") from error
    if points.size == 0:
        raise InputError("there must be at least one seed; got none")
    if domain.is_planar and points.ndim == 2 and points.shape[1] == 2:
        middle = 0.5 * (domain.lower[2] + domain.upper[2])
        points = np.column_stack([points, np.full(len(points), middle)])
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"seeds must have shape (n, 3); got {points.shape}")
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if bad.size:
        raise InputError(f"seeds must be finite; {bad.size} of {len(points)} are not: {name_offenders(bad)}")
    outside = np.flatnonzero(~domain.contains(points))
    if outside.size:
        cut = f" and at n · x <= d of its {len(domain.planes)} planes" if len(domain.planes) else ""
        raise InputError(
            f"seeds must lie in the domain {domain.lower.tolist()} to {domain.upper.tolist()}{cut}; "
            f"{outside.size} of {len(points)} lie outside: {name_offenders(outside)}"
        )
    _refuse_duplicates(points, domain)
    return points


def _refuse_duplicates(points: NDArray[np.float64], domain: Domain) -> None:
    from scipy.spatial import cKDTree  # noqa: PLC0415  (a third of a second)

    size = domain.lengths
    box = np.where(domain.periodic, size, 0.0)
    wrapped = np.where(domain.periodic, np.mod(points - domain.lower, size), points - domain.lower)
    # Seeds that differ along one axis differ; sorting tells most sets at a tenth of a tree's price.
    along = np.sort(wrapped[:, 0])
    gaps = np.diff(along, append=along[0] + size[0] if domain.periodic[0] else np.inf)
    if gaps.min() > DUPLICATE_TOLERANCE * float(size.max()):
        return
    tree = cKDTree(wrapped, boxsize=box if domain.periodic.any() else None)
    pairs = tree.query_pairs(DUPLICATE_TOLERANCE * float(size.max()), output_type="ndarray")
    if len(pairs):
        pairs = pairs[np.lexsort(pairs.T[::-1])]
        raise InputError(
            f"seeds must differ from one another; {len(pairs)} pairs coincide: "
            f"{name_offenders(f'{i}–{j}' for i, j in pairs)}"
        )
