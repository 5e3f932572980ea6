"""Seeds whose density is that of an array: any field in two or three dimensions.

References
----------
.. [1] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, section 2.2.2.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import FileFormatError, InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.points.files import load_array
from grainsdem.points.poisson import check_count, place

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

Axis = Literal["x", "y", "z"]

MOST_TRIES = 1_000_000
"""Seeds in a row that fall where planes have cut the domain away, after which none is expected to fall inside."""


@gated
def from_density(
    domain: Domain,
    n: int,
    density: ArrayLike,
    *,
    along: Axis = "z",
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    """Return independent seeds that are as dense, everywhere, as an array says.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie; the array fills its box.
    n : int
        Number of seeds, at least 1.
    density : array_like, shape (p, q, r) or (p, q)
        Relative density in each of p × q × r equal voxels along x, y and z, finite and nowhere negative. An array of
        two axes stands for all of the third.
    along : {"x", "y", "z"}
        Axis along which an array of two axes is extruded: its own are the other two, in this order. In a planar domain
        always z.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m], uniform inside each voxel; in the mid-plane where the domain is planar.

    Raises
    ------
    ShapeError
        If the array has another number of axes, or is empty.
    InputError
        If ``n`` is below 1, a value is negative or not finite, all are zero, or the domain's planes leave none.

    Notes
    -----
    The running sum of the voxels in their order, divided by the sum of all, is a distribution function; the voxel of a
    seed is the first at which it exceeds a uniform number [1]_. A voxel of density zero gets none.
    """
    check_count(n)
    weights = _weights(density, domain, along)
    generator = np.random.default_rng(rng)
    running = np.cumsum(weights.ravel())
    running /= running[-1]
    kept: list[NDArray[np.float64]] = []
    missing, tries = n, 0
    while missing > 0:
        voxels = np.searchsorted(running, generator.random(missing), side="right")
        corners = np.column_stack(np.unravel_index(voxels, weights.shape))
        points = place((corners + generator.random(corners.shape)) / weights.shape, domain)
        kept.append(points[domain.contains(points)] if len(domain.planes) else points)
        tries = 0 if len(kept[-1]) else tries + missing
        missing -= len(kept[-1])
        if tries >= MOST_TRIES:
            raise InputError(
                f"the density is zero, or nearly so, in all that the {len(domain.planes)} planes leave of the domain: "
                f"none of {tries} seeds fell inside"
            )
    return np.concatenate(kept)


@gated
def read_density(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read an array of two or three axes for `from_density`.

    Parameters
    ----------
    path : str or path-like
        ``.npy``, or ``.npz`` (the array named ``density``, else the only one).

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is another, or the file does not hold such an array.
    """
    path = Path(path)
    if path.suffix.lower() not in (".npy", ".npz"):
        raise FileFormatError(f"{path}: a density is read from .npy or .npz; got {path.suffix or 'no suffix'!r}")
    density = load_array(path, "density")
    if density.ndim not in (2, 3):
        raise FileFormatError(f"{path}: a density has two or three axes; got an array of shape {density.shape}")
    return density


def _weights(density: ArrayLike, domain: Domain, along: str) -> NDArray[np.float64]:
    """Return the density as an array of three axes, its largest value 1; an extruded axis has one voxel."""
    if along not in ("x", "y", "z"):
        raise InputError(f"along must be 'x', 'y' or 'z'; got {along!r}")
    try:
        values = np.asarray(density, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"a density is an array of numbers with two or three axes; {error}") from error
    if values.ndim == 2:
        values = np.expand_dims(values, 2 if domain.is_planar else "xyz".index(along))
    if values.ndim != 3 or not values.size:
        raise ShapeError(f"a density has two or three axes, and a voxel or more; got shape {values.shape}")
    if domain.is_planar and values.shape[2] != 1:
        raise ShapeError(f"in a planar domain a density has two axes; got shape {values.shape}")
    bad = np.flatnonzero(~(np.isfinite(values) & (values >= 0)).ravel())
    if bad.size:
        named = name_offenders(str(index) for index in _tuples(bad, values.shape))
        raise InputError(f"a density must be finite and nowhere negative; {bad.size} voxels are not: {named}")
    largest = values.max()
    if largest == 0:
        raise InputError("a density must be above zero somewhere; all of it is zero")
    return np.asarray(values / largest)


def _tuples(flat: NDArray[np.int64], shape: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [tuple(int(k) for k in np.unravel_index(index, shape)) for index in flat.tolist()]
