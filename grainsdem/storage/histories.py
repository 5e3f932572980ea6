"""Histories in HDF5: they grow while a run goes and can be read at any time, also after it was killed."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from contextlib import nullcontext, suppress
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.storage.hdf5 import LIBVER, check_room, check_suffix, describe, read_datasets, reading, writing
from grainsdem.storage.packings import packed_arrays, read_packing, write_packing
from grainsdem.storage.seals import seal
from grainsdem.storage.surroundings import MOVES, SCHEMA, create_surroundings

if TYPE_CHECKING:
    from collections.abc import Iterable
    from contextlib import AbstractContextManager
    from pathlib import Path
    from types import TracebackType

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing, Surroundings


class HistoryWriter:
    """Appends rows, and now and then whole frames, to an HDF5 file while a run goes.

    Parameters
    ----------
    path : str or path-like
        Ends in ``.h5`` or ``.hdf5``; replaced if it exists.
    columns : iterable of str, or mapping of str to str
        Names of the scalar series, ``time`` [s] among them as a rule; a mapping gives each its unit.
    n_grains : int
        Where given, frames of all grains' positions [m] and quaternions (w, x, y, z) can be appended too.
    grains : Packing, optional
        The grains that are moved, where the run's last packing need not have them all: `load_moved` gives them back.
    around : Surroundings, optional
        The bodies around the grains, whose places and gravity are then appended with every frame; its own are not
        looked at.
    attributes : mapping of str to JSON value
        What a reader should know: provenance, units of mass, parameters.
    rows_per_chunk : int
        Rows are written and flushed together in chunks of this many, and when the writer is closed. An
        interrupted run loses at most the rows since the last chunk; a frame flushes everything.

    Raises
    ------
    FileFormatError
        If the suffix is unknown.
    InputError
        If there is no column, two are of one name, or one is named like a frame's arrays.
    WriteError
        If the file cannot be written.

    Notes
    -----
    The file is in HDF5's single-writer/multiple-reader mode from its first row on. In that mode what is on
    disk is consistent at any time, so that it can be read by `load_history` while the run goes and after it
    was killed.

    Examples
    --------
    >>> with HistoryWriter("run.h5", {"time": "s", "kinetic_energy": "J"}) as history:  # doctest: +SKIP
    ...     history.append(time=0.0, kinetic_energy=1e-9)
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        columns: Iterable[str] | Mapping[str, str],
        *,
        n_grains: int | None = None,
        grains: Packing | None = None,
        around: Surroundings | None = None,
        attributes: Mapping[str, Any] | None = None,
        rows_per_chunk: int = 16,
    ) -> None:
        names = list(columns)
        reserved = {"frame_times", "positions", "quaternions"}
        if not names or len(set(names)) < len(names) or reserved & set(names) or rows_per_chunk < 1:
            raise InputError(
                f"a history needs columns of different names, none of {', '.join(sorted(reserved))}, and "
                f"rows_per_chunk of 1 or more; got {', '.join(names) or 'none'} and {rows_per_chunk}"
            )
        self.path = check_suffix(path)
        self.columns = tuple(names)
        self.n_grains = n_grains
        self._rows: list[tuple[float, ...]] = []
        self._rows_per_chunk = rows_per_chunk
        units = dict(columns) if isinstance(columns, Mapping) else {}
        with writing(self.path), _beginning(self.path) as temporary:
            check_room(self.path, _first_size(grains, around))
            self._file = h5py.File(temporary, "w", libver=LIBVER, locking="best-effort")
            describe(self._file, SCHEMA)
            self._file.attrs["units"] = json.dumps(units, ensure_ascii=False)
            self._file.attrs["attributes"] = json.dumps(dict(attributes or {}), ensure_ascii=False, sort_keys=True)
            self._series = _create_series(self._file, names)
            self._frames = None if n_grains is None else _create_frames(self._file, n_grains)
            self._around = {} if around is None else create_surroundings(self._file, around)
            if grains is not None:
                write_packing(self._file.create_group("grains"), grains)
            self._file.flush()
            self._file.swmr_mode = True

    def append(self, **row: float) -> None:
        """Append one row: a number for every column, by name."""
        if row.keys() != set(self.columns):
            wrong = sorted(row.keys() ^ set(self.columns))
            raise InputError(f"a row needs {', '.join(self.columns)}; missing or unknown: {', '.join(wrong)}")
        self._rows.append(tuple(float(row[name]) for name in self.columns))
        if len(self._rows) >= self._rows_per_chunk:
            self.flush()

    def append_frame(
        self,
        time: float,
        *,
        positions: ArrayLike,
        quaternions: ArrayLike,
        around: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
    ) -> None:
        """Append every grain's position [m], shape (n, 3), and quaternion, shape (n, 4), at one time [s].

        Those of a grain that is absent are NaN. ``around`` are positions, quaternions and gravity of what is around
        them, as a frame of `Surroundings` has them.
        """
        if self._frames is None:
            raise InputError("this history has no frames; give n_grains when it is made")
        values = {"positions": np.asarray(positions, float), "quaternions": np.asarray(quaternions, float)}
        for name, width in (("positions", 3), ("quaternions", 4)):
            if values[name].shape != (self.n_grains, width):
                raise ShapeError(f"{name} must have shape ({self.n_grains}, {width}); got {values[name].shape}")
        if (around is None) == bool(self._around):
            raise InputError("frames need what is around the grains where the history was made with it, and only there")
        moves = {} if around is None else dict(zip(MOVES, (np.asarray(value, float) for value in around), strict=True))
        for name, dataset in self._around.items():
            if moves[name].shape != dataset.shape[1:]:
                raise ShapeError(
                    f"{name} around the grains must have shape {dataset.shape[1:]}; got {moves[name].shape}"
                )
        self.flush()
        check_room(self.path, sum(value.nbytes for value in (*values.values(), *moves.values())))
        with writing(self.path):
            for name, dataset in self._around.items():
                _extend(dataset, moves[name][np.newaxis])
            # The time last: a frame is there when its time is.
            for name, value in (*values.items(), ("times", np.array(time, dtype=np.float64))):
                _extend(self._frames[name], value[np.newaxis])

    def flush(self) -> None:
        """Write the rows that wait, so that readers see them."""
        if not self._rows:
            return
        check_room(self.path, len(self._rows) * self._series.dtype.itemsize)
        with writing(self.path):
            _extend(self._series, np.array(self._rows, dtype=self._series.dtype))
        self._rows.clear()

    def close(self) -> None:
        """Write what waits and close the file; closing twice does nothing."""
        if self._file:
            try:
                self.flush()
            finally:
                self._file.close()
            with suppress(OSError):  # it is whole without: hours of a run do not end in an error for a digest's sake
                seal(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


@gated
def load_history(path: str | os.PathLike[str]) -> dict[str, NDArray[np.float64]]:
    """Read a history that a `HistoryWriter` wrote, while it is being written or after.

    Parameters
    ----------
    path : str or path-like
        Ends in ``.h5`` or ``.hdf5``.

    Returns
    -------
    dict of str to ndarray
        Each column by its name, shape (n_rows,). Where frames were written also ``frame_times`` [s], shape
        (n_frames,), ``positions`` [m], shape (n_frames, n_grains, 3), and ``quaternions``, shape (n_frames,
        n_grains, 4).

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        As in `load`.
    """
    with reading(path, SCHEMA) as file:
        framed = [f"frames/{name}" for name in ("times", "positions", "quaternions")] if "frames" in file else []
        arrays = read_datasets(file, ["series", *framed])
        series = arrays["series"]
        names = series.dtype.names
        if names is None or series.ndim != 1 or any(series.dtype[name] != np.float64 for name in names):
            raise ValueError(f"dataset series must be rows of named numbers; got {series.ndim} axes of {series.dtype}")
        # Rows whose numbers had not reached the disk when a run was killed are all NaN.
        written = ~np.all([np.isnan(series[name]) for name in names], axis=0)
        series = series[: int(np.max(np.flatnonzero(written), initial=-1)) + 1]
        result = {name: np.ascontiguousarray(series[name]) for name in names}
        if framed:
            times, positions, quaternions = (arrays[name] for name in framed)
            _check_frames(times, positions, quaternions)
            n = int(np.argmax(np.isnan(times))) if np.isnan(times).any() else len(times)
            result |= {"frame_times": times[:n], "positions": positions[:n], "quaternions": quaternions[:n]}
        return result


@gated
def load_moved(path: str | os.PathLike[str], packing: Packing) -> Packing:
    """Return the grains that the frames of a history are of.

    Parameters
    ----------
    path : str or path-like
        A history that was written with frames.
    packing : Packing
        The grains at the end of the run: those that moved, unless the history has its own because grains came and went.

    Raises
    ------
    MissingFileError, FileFormatError
        As in `load_history`.
    """
    with reading(path, SCHEMA) as file:
        return read_packing(file["grains"]) if "grains" in file else packing


@gated
def load_motion(path: str | os.PathLike[str]) -> dict[str, NDArray[np.float64]]:
    """Read the frames of a history: what `exporters.replay` and `grainsdem.figures.animate` take.

    Parameters
    ----------
    path : str or path-like
        A history that was written with frames.

    Returns
    -------
    dict of str to ndarray
        ``times`` [s], shape (t,), ``positions`` [m], shape (t, n, 3), and ``quaternions``, shape (t, n, 4); those of a
        grain are NaN where it was absent.

    Raises
    ------
    InputError
        If it has no frame.
    MissingFileError, FileFormatError
        As in `load_history`.
    """
    history = load_history(path)
    if "frame_times" not in history or history["frame_times"].size == 0:
        raise InputError(f"{path}: holds no frames of grains that moved, only series: {', '.join(history)}")
    return {
        "times": history["frame_times"], "positions": history["positions"], "quaternions": history["quaternions"],
    }  # fmt: skip


def _beginning(path: Path) -> AbstractContextManager[Path]:
    """Return where a history is begun: a file that is moved to its place once what is in it can be read.

    Windows moves no file that is open, and HDF5 has a lock of its own on one that it begins.
    """
    return nullcontext(path) if os.name == "nt" else replacing(path, is_held=False)


def _first_size(grains: Packing | None, around: Surroundings | None) -> int:
    """Return at most how many bytes are written before the first row."""
    arrays = [] if grains is None else list(packed_arrays(grains).values())
    arrays += [] if around is None else [around.vertices, around.triangles, around.vertex_bodies]
    # What is compressed may take a little more than it is.
    return sum(array.nbytes + array.nbytes // 100 for array in arrays)


def _check_frames(times: NDArray[Any], positions: NDArray[Any], quaternions: NDArray[Any]) -> None:
    """Raise `ShapeError` unless frames are what a writer makes: the time of one is written after what it holds."""
    shapes = [array.shape for array in (times, positions, quaternions)]
    n = positions.shape[1] if positions.ndim == 3 else -1
    is_real = all(array.dtype == np.float64 for array in (times, positions, quaternions))
    fits = times.ndim == 1 and positions.shape[1:] == (n, 3) and quaternions.shape[1:] == (n, 4)
    if not (is_real and fits and min(len(positions), len(quaternions)) >= len(times)):
        listed = ", ".join(map(str, shapes))
        raise ShapeError(f"frames must be real, of shapes (t,), (t, n, 3) and (t, n, 4); got {listed}")


def _create_series(file: h5py.File, names: list[str]) -> h5py.Dataset:
    dtype = np.dtype([(name, np.float64) for name in names])
    fill = np.full((), np.nan, dtype=dtype)
    return file.create_dataset(
        "series", shape=(0,), maxshape=(None,), dtype=dtype, chunks=(256,), fillvalue=fill, track_times=False
    )


def _create_frames(file: h5py.File, n: int) -> h5py.Group:
    group = file.create_group("frames")
    group.create_dataset(
        "times",
        shape=(0,),
        maxshape=(None,),
        dtype=np.float64,
        chunks=(64,),
        fillvalue=np.nan,
        track_times=False,
    )
    for name, width in (("positions", 3), ("quaternions", 4)):
        group.create_dataset(
            name,
            shape=(0, n, width),
            maxshape=(None, n, width),
            dtype=np.float64,
            chunks=(1, max(n, 1), width),
            track_times=False,
        )
    return group


def _extend(dataset: h5py.Dataset, values: NDArray[Any]) -> None:
    n = len(dataset)
    dataset.resize(n + len(values), axis=0)
    dataset[n:] = values
    dataset.flush()
