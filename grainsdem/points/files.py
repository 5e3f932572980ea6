"""Seeds of the user's own: read from text, CSV, .npy or .npz, and scaled into a domain."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, InputError, MissingFileError, ShapeError, name_offenders
from grainsdem.foreign import array_of, refusing
from grainsdem.gate import gated
from grainsdem.model.arrays import LONGEST
from grainsdem.points import text
from grainsdem.points.check import check_seeds

if TYPE_CHECKING:
    import os

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

SUFFIXES = (".txt", ".dat", ".xyz", ".csv", ".npy", ".npz")


@gated
def read(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read seeds: numbers in two or three columns, one seed a row.

    Parameters
    ----------
    path : str or path-like
        ``.txt``, ``.dat``, ``.xyz``, ``.csv``: text, see Notes; ``.npy``, or ``.npz`` (the array named ``points``, else
        the only one).

    Returns
    -------
    ndarray, shape (n, 2) or (n, 3)
        Positions in the units of the file.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown, the file does not hold columns of numbers, or it is not clear which are meant.

    Notes
    -----
    Text is UTF-8, or UTF-16 or -32 with a byte-order mark, its lines ended in any way. Columns are parted by blanks,
    tabs, ``,`` or ``;``, whatever the suffix; decimals follow a point, or a comma where that parts no columns. A header
    is a first line, or a comment, that names columns: x, y and z are found by their names (``pos_x``, ``X [mm]``,
    ``Points:0``) and others, such as ids, left out. Without names two or three columns are coordinates, words before
    them labels; four or more, or three the first of which may be ids, are refused. XYZ (the number, a comment, and
    ``C x y z`` in each line; extended XYZ, too), Qhull's format and files that begin with the number of their points
    are read.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: seeds are read from {', '.join(SUFFIXES)}; got {path.suffix or 'no suffix'!r}")
    points = load_array(path, "points")
    if points.size and (points.ndim != 2 or points.shape[1] not in (2, 3)):
        raise FileFormatError(f"{path}: seeds need two or three columns; got an array of shape {points.shape}")
    return points


@gated
def write(seeds: ArrayLike, path: str | os.PathLike[str]) -> Path:
    """Write seeds so that `read` gives the same to the bit, and return the path.

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        Positions [m].
    path : str or path-like
        ``.txt``, ``.dat``, ``.xyz``, ``.csv`` (with a header) or ``.npy``.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    ShapeError
        If the array has another shape.
    WriteError
        If the file cannot be written; nothing is left behind.
    """
    target = check_written(path)
    suffix = target.suffix.lower()
    points = np.asarray(seeds, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] not in (2, 3):
        raise ShapeError(f"seeds must have shape (n, 3) or (n, 2); got {points.shape}")
    with replacing(target) as temporary:
        if suffix == ".npy":
            np.save(temporary, points)
        elif suffix == ".csv":
            header = ",".join("xyz"[: points.shape[1]])
            np.savetxt(temporary, points, fmt="%.17g", delimiter=",", header=header, comments="")
        else:
            # Only where x could be taken for an id: the header is one more line for other programs to stumble over.
            is_clear = not text.may_have_ids(points)
            np.savetxt(temporary, points, fmt="%.17g", header="" if is_clear else " ".join("xyz"[: points.shape[1]]))
    return target


def check_written(path: str | os.PathLike[str]) -> Path:
    """Return the path of seeds, or raise `FileFormatError` where its suffix is none that they are written as."""
    target = Path(path)
    suffix = target.suffix.lower()
    if suffix not in SUFFIXES or suffix == ".npz":
        raise FileFormatError(
            f"{target}: seeds are written as {', '.join(SUFFIXES[:-1])}; got {suffix or 'no suffix'!r}"
        )
    return target


def load_array(path: Path, name: str) -> NDArray[np.float64]:
    """Return the numbers of a file whose suffix is known; of several arrays that of the given name."""
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    with refusing(path, "not an array of numbers"):
        if path.suffix.lower() in (".npy", ".npz"):
            return np.asarray(array_of(path, name), dtype=np.float64)
        return text.positions(path.read_bytes())


@gated
def scaled(
    points: ArrayLike, domain: Domain, *, bounds: ArrayLike | None = None, stretch: bool = True
) -> NDArray[np.float64]:
    """Return points of any unit, moved and scaled into a domain.

    Parameters
    ----------
    points : array_like, shape (n, 3) or (n, 2)
        In any unit; in a planar domain shape (n, 2), too, and what is beyond two columns is left out.
    domain : Domain
        Where they are to lie.
    bounds : array_like, shape (2, 3) or (2, 2), optional
        Corners, in the unit of the points, of the box that becomes the domain's: that in which they were made. Without
        it, it is estimated: wider than the points on either side by 1/(n - 1) of their extent, as n uniform points
        leave so much of their box empty, on the average.
    stretch : bool
        Whether each axis has a factor of its own; else the smallest is that of all, and the points stay in the middle.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    ShapeError
        If the points or their bounds have another shape.
    InputError
        If there is none, one is not finite, beyond the bounds or where planes have cut the domain away, or two
        coincide.

    Examples
    --------
    >>> from grainsdem.model import Domain
    >>> scaled([[0, 0, 0], [10, 10, 40]], Domain.cube(), bounds=[[-10, -10, -10], [30, 30, 70]])
    array([[0.25 , 0.25 , 0.125],
           [0.5  , 0.5  , 0.625]])
    """
    try:
        values = np.array(points, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise ShapeError(f"points must be numbers in an array of shape (n, 3); {error}") from error
    if values.ndim != 2 or values.shape[1] not in ((2, 3) if domain.is_planar else (3,)):
        allowed = "(n, 2) or (n, 3)" if domain.is_planar else "(n, 3)"
        raise ShapeError(f"points must have shape {allowed}; got {values.shape}")
    axes = 2 if domain.is_planar else 3
    values = values[:, :axes]
    bad = np.flatnonzero(~(np.abs(values) <= LONGEST).all(axis=1))
    if not len(values) or bad.size:
        raise InputError(f"points must be finite, and one or more; {bad.size} of {len(values)} are not")
    low, high = _box_of(values) if bounds is None else _given_box(bounds, values)
    size = np.where(high > low, high - low, 1.0)
    factors = domain.lengths[:axes] / size
    if not stretch:
        factors = np.full(axes, factors[high > low].min(initial=np.inf if (high > low).any() else 1.0))
    middle = 0.5 * (domain.lower + domain.upper)[:axes]
    placed = middle + (values - 0.5 * (low + high)) * factors
    # A point on a bound may be rounded past its wall.
    return check_seeds(np.clip(placed, domain.lower[:axes], domain.upper[:axes]), domain)


def _box_of(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners of the box that points were probably made in."""
    low, high = values.min(axis=0), values.max(axis=0)
    beyond = (high - low) / max(len(values) - 1, 1)
    return low - beyond, high + beyond


def _given_box(bounds: ArrayLike, values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners that were given, or raise one clear error."""
    corners = np.asarray(bounds, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[0] != 2 or corners.shape[1] < values.shape[1]:
        raise ShapeError(f"bounds are two corners of {values.shape[1]} coordinates; got shape {corners.shape}")
    low, high = corners[:, : values.shape[1]]
    if not (np.isfinite(corners).all() and (high > low).all()):
        raise InputError(f"bounds must be a lower and a higher corner, both finite; got {corners.tolist()}")
    outside = np.flatnonzero(((values < low) | (values > high)).any(axis=1))
    if outside.size:
        raise InputError(
            f"points must lie within their bounds; {outside.size} of {len(values)} do not: {name_offenders(outside)}"
        )
    return low, high
