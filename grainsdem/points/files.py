"""Seeds from a file of the user's own: text, CSV, .npy or .npz."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import FileFormatError, MissingFileError

if TYPE_CHECKING:
    import os

    from numpy.typing import NDArray

SUFFIXES = (".txt", ".dat", ".xyz", ".csv", ".npy", ".npz")


def read(path: str | os.PathLike[str]) -> NDArray[np.float64]:
    """Read seeds: numbers in two or three columns, one seed a row.

    Parameters
    ----------
    path : str or path-like
        ``.txt``, ``.dat``, ``.xyz`` (blanks between columns), ``.csv`` (commas; one header line is skipped),
        ``.npy``, or ``.npz`` (the array named ``points``, else the only one).

    Returns
    -------
    ndarray, shape (n, 2) or (n, 3)
        Positions in the units of the file.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown or the file does not hold columns of numbers.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: seeds are read from {', '.join(SUFFIXES)}; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    try:
        points = _load(path)
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise FileFormatError(f"{path}: not columns of numbers: {error}") from error
    if points.size and (points.ndim != 2 or points.shape[1] not in (2, 3)):
        raise FileFormatError(f"{path}: seeds need two or three columns; got an array of shape {points.shape}")
    return points


def _load(path: Path) -> NDArray[np.float64]:
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
    if suffix == ".npz":
        with np.load(path, allow_pickle=False) as arrays:
            names = arrays.files
            name = "points" if "points" in names else names[0] if len(names) == 1 else None
            if name is None:
                raise ValueError(f"expected one array, or one named 'points'; got {', '.join(names)}")
            return np.asarray(arrays[name], dtype=np.float64)
    lines = path.read_text(encoding="utf-8").splitlines()
    delimiter = "," if suffix == ".csv" else None
    if lines and suffix == ".csv" and not _is_number(lines[0].split(",")[0]):
        lines = lines[1:]
    if not any(line.split("#")[0].strip() for line in lines):
        return np.empty((0, 3))
    return np.loadtxt(lines, delimiter=delimiter, dtype=np.float64, ndmin=2)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
