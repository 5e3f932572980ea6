"""What every HDF5 file of ours has in common: suffix, schema, version, and one clear error for what is wrong."""

from __future__ import annotations

import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np

import grainsdem
from grainsdem.apart import read_apart
from grainsdem.errors import FileFormatError, MissingFileError, WriteError, name_offenders
from grainsdem.memory import allow_memory
from grainsdem.storage.seals import has_signature, is_sealed
from grainsdem.storage.walking import opened, read_all

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Iterator
    from typing import Any

    from numpy.typing import NDArray

SUFFIXES = (".h5", ".hdf5")
SCHEMA_VERSION = "1.0"
"""Version of every schema. A new minor version only adds; a new major version is refused by older readers."""

RESERVE = 1 << 18
"""Room [bytes] that is kept for what HDF5 writes when it closes a file."""

_SQUEEZED = 1100
"""How many times more than it is stored as a dataset is at most: what gzip can do."""

_UNWRITTEN = 1 << 28
"""Bytes of a dataset besides that were not yet written when a run was killed."""

LIBVER = ("v110", "v110")
"""One file format, read by every HDF5 from 1.10 on: bytes repeat, long attributes fit, readers may look on."""


def describe(file: h5py.File, schema: str) -> None:
    """Write what every file says of itself."""
    file.attrs["schema"] = schema
    file.attrs["schema_version"] = SCHEMA_VERSION
    file.attrs["grainsdem_version"] = grainsdem.__version__


def check_suffix(path: str | os.PathLike[str]) -> Path:
    """Return the path, or raise `FileFormatError` unless it ends as HDF5 files do."""
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        given = target.suffix or "no suffix"
        raise FileFormatError(f"{target}: HDF5 files end in {' or '.join(SUFFIXES)}; got {given!r}")
    return target


def check_room(path: Path, n_bytes: int) -> None:
    """Raise `WriteError` where a file cannot grow by so many bytes and by what closing it takes.

    HDF5 must not find that out itself: a write that fails makes it crash when the file is closed.
    """
    free = shutil.disk_usage(path.parent).free
    limit = _size_limit()
    if limit is not None:
        free = min(free, limit - (path.stat().st_size if path.exists() else 0))
    if free < n_bytes + RESERVE:
        raise WriteError(f"{path}: cannot be written: no room for {n_bytes + RESERVE} bytes more; {free} are left")


def _size_limit() -> int | None:
    """Return how large [bytes] the system lets this process make a file, or nothing for any size."""
    try:
        import resource  # noqa: PLC0415  (there is none on Windows)
    except ImportError:
        return None
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turn the errors of HDF5 into one of ours."""
    try:
        yield
    except WriteError:
        raise
    except (OSError, RuntimeError) as error:
        raise WriteError(f"{path}: cannot be written: {_first_line(error)}") from error


@contextmanager
def reading(path: str | os.PathLike[str], schema: str) -> Iterator[h5py.File]:
    """Open a file of the given schema and turn whatever is wrong with it into one clear error.

    HDF5 itself is kept from damage, at which it may crash or go round for ever: a file that carries its digest is held
    against it before HDF5 sees it, and every other one is first read in another process.
    """
    source = check_suffix(path)
    if not source.is_file():
        raise MissingFileError(f"{source}: no such file")
    try:
        if not is_sealed(source):
            _try_once(source)
        with opened(source) as file:
            _check_schema(source, file, schema)
            yield file
    except (FileFormatError, MissingFileError):
        raise
    except Exception as error:  # what arrays of odd shapes and types make of what is done with them has no end
        raise FileFormatError(f"{source}: damaged or incomplete: {_first_line(error)}") from error


def read_dataset(file: h5py.Group, name: str) -> NDArray[Any]:
    """Return the whole dataset, or raise `KeyError` where there is none."""
    return read_datasets(file, [name])[name]


def read_datasets(file: h5py.Group, names: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Return whole datasets by their names, once it is known that memory holds them all.

    Raises
    ------
    KeyError
        If one is missing.
    ValueError
        If one holds no numbers, lies in another file, or they would take too much memory.
    """
    found = {name: _dataset(file, name) for name in names}
    for name, data in found.items():
        if data.size * data.dtype.itemsize > _SQUEEZED * data.id.get_storage_size() + _UNWRITTEN:
            raise ValueError(f"dataset {name} says that it is of shape {data.shape}, and nearly all of that is missing")
    # As they are stored, as they are checked, and what is made of them.
    allow_memory(sum(data.size * data.dtype.itemsize for data in found.values()), 3, "bytes of its datasets")
    return {name: np.asarray(data[()]) for name, data in found.items()}


def _dataset(file: h5py.Group, name: str) -> h5py.Dataset:
    """Return a dataset of this very file, whose numbers are in it."""
    found: Any = file
    for part in name.split("/"):
        inside = isinstance(found, h5py.Group)
        if not inside or not isinstance(found.get(part, getlink=True), h5py.HardLink):
            raise KeyError(f"dataset {name} is missing")
        found = found[part]
    if not isinstance(found, h5py.Dataset):
        raise KeyError(f"dataset {name} is missing")
    if found.external or found.is_virtual:
        raise ValueError(f"dataset {name} lies in another file")
    kinds = [found.dtype[k] for k in found.dtype.names] if found.dtype.names else [found.dtype]
    if any(kind.kind not in "biuf" for kind in kinds):
        raise ValueError(f"dataset {name} must hold numbers; got {found.dtype}")
    return found


_MOST_TRIED = 1000
"""Files that are kept in mind."""

_tried: dict[tuple[Any, ...], None] = {}
"""Files that another process has read to their end, as they were then."""


def _try_once(path: Path) -> None:
    """Raise `FileFormatError` where reading all of a file ends another process, or does not end."""
    if not has_signature(path):
        raise FileFormatError(f"{path}: not an HDF5 file; a file that `save` or a history wrote is needed")
    about = path.stat()
    state = (path.resolve(), about.st_dev, about.st_ino, about.st_size, about.st_mtime_ns)
    if state not in _tried:
        read_apart(read_all, path)
        if len(_tried) >= _MOST_TRIED:  # one that is being written is another file whenever it is looked at
            _tried.clear()
        _tried[state] = None


def _check_schema(path: Path, file: h5py.File, schema: str) -> None:
    found = to_text(file.attrs.get("schema", ""))
    if found != schema:
        what = f"schema {found!r}" if found else f"no schema, but {name_offenders(file.keys()) or 'nothing'}"
        raise FileFormatError(f"{path}: an HDF5 file of another kind: {what}; schema {schema!r} is needed")
    version = to_text(file.attrs.get("schema_version", ""))
    if version.split(".")[0] != SCHEMA_VERSION.split(".", maxsplit=1)[0]:
        raise FileFormatError(
            f"{path}: version {version or 'unknown'!r} of {schema}; grainsdem {grainsdem.__version__} reads "
            f"{SCHEMA_VERSION.split('.', maxsplit=1)[0]}.x"
        )


def to_text(value: object) -> str:
    """Return an attribute as text; some writers store bytes."""
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _first_line(error: BaseException) -> str:
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    if isinstance(error, OSError) and error.filename is not None:  # which is told beside it
        text = error.strerror or text
    return text.splitlines()[0] if text else type(error).__name__
