"""What is around the grains, in the file of a history: bodies once, and where they are in every frame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.gate import gated
from grainsdem.model import Surroundings
from grainsdem.storage.hdf5 import read_dataset, read_datasets, reading

if TYPE_CHECKING:
    import os

    import h5py
    from numpy.typing import NDArray

SCHEMA = "grainsdem.history"

GROUP = "surroundings"

SHAPES = "vertices", "triangles", "vertex_bodies"
"""What is written once."""

MOVES = {"positions": 3, "quaternions": 4, "gravity": 3}
"""What is written with every frame, and how many numbers each has."""


def create_surroundings(file: h5py.File, around: Surroundings) -> dict[str, h5py.Dataset]:
    """Write the bodies into the file of a history, and return the arrays that grow with its frames."""
    group = file.create_group(GROUP)
    group.attrs["names"] = list(around.names)
    for name in SHAPES:
        group.create_dataset(name, data=getattr(around, name), track_times=False)
    grown = {}
    for name in MOVES:
        width = getattr(around, name).shape[1:]
        if 0 in width:  # HDF5 has no chunks of nothing
            continue
        grown[name] = group.create_dataset(
            name,
            shape=(0, *width),
            maxshape=(None, *width),
            dtype=np.float64,
            chunks=(16, *width),
            track_times=False,
        )
    return grown


@gated
def load_surroundings(path: str | os.PathLike[str]) -> Surroundings | None:
    """Read what was around the grains in a run: what `grainsdem.figures.animate` draws besides them.

    Parameters
    ----------
    path : str or path-like
        A history that was written with frames.

    Returns
    -------
    Surroundings or None
        Of as many frames as `load_motion` gives; nothing where a history does not hold it.

    Raises
    ------
    MissingFileError, FileFormatError
        As in `load_history`.
    """
    with reading(path, SCHEMA) as file:
        if GROUP not in file or "frames" not in file:
            return None
        group = file[GROUP]
        held = [name for name in MOVES if name in group]
        times = read_dataset(file, "frames/times")
        arrays = read_datasets(file, [f"{GROUP}/{name}" for name in (*SHAPES, *held)])
        n = int(np.argmax(np.isnan(times))) if np.isnan(times).any() else len(times)
        shapes: dict[str, NDArray[Any]] = {name: arrays[f"{GROUP}/{name}"] for name in SHAPES}
        moves: dict[str, NDArray[Any]] = {
            name: arrays[f"{GROUP}/{name}"][:n] if name in held else np.empty((n, 0, width))
            for name, width in MOVES.items()
        }
        return Surroundings(tuple(map(str, group.attrs["names"])), **shapes, **moves)
