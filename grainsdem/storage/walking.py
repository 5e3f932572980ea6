"""All that an HDF5 file holds, read and forgotten: where that ends well, reading a part of it does."""

from __future__ import annotations

from contextlib import suppress
from typing import TYPE_CHECKING, Any

import h5py

from grainsdem.errors import InputError
from grainsdem.memory import allow_memory

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

_MOST = 10_000
"""Objects of a file that are looked at: ours have some thirty."""

_VERSION, _FLAGS, _IS_WRITTEN = 8, 11, b"\x05"
"""Of HDF5's superblock: the bytes that say its version, and that it is being written while others may look on."""

_SHUN = (RuntimeError, KeyError, ValueError, TypeError, AttributeError, OverflowError, OSError)
"""What is raised in order, and will be again where it matters."""


def opened(path: Path) -> h5py.File:
    """Open for reading; a file whose writer is alive or was killed opens only as one that is being written.

    None but such a one is opened so: at a checksum that is wrong HDF5 then waits for the writer to mend it.
    """
    with path.open("rb") as file:
        head = file.read(_FLAGS + 1)
    is_written = head[_VERSION : _VERSION + 1] == b"\x03" and head[_FLAGS:] == _IS_WRITTEN
    return h5py.File(path, "r", swmr=is_written)


def read_all(path: Path) -> dict[str, NDArray[Any]]:
    """Read every attribute and dataset of a file, and return nothing."""
    with opened(path) as file:
        waiting: list[Any] = [file["/"]]
        seen: set[int] = set()
        while waiting and len(seen) < _MOST:
            one = waiting.pop()
            with suppress(*_SHUN):
                place = h5py.h5o.get_info(one.id).addr
                if place not in seen:
                    seen.add(place)
                    _look(one, waiting)
    return {}


def _look(one: Any, waiting: list[Any]) -> None:
    """Read one object, and note those that hang from it."""
    for name in one.attrs:
        with suppress(*_SHUN):
            one.attrs[name]
    if isinstance(one, h5py.Dataset) and not one.external and not one.is_virtual:
        with suppress(InputError):
            allow_memory(one.size * one.dtype.itemsize, 3, "bytes of a dataset")
            one[()]
    elif isinstance(one, h5py.Group):
        # A link to elsewhere is none that we follow.
        waiting.extend(one[name] for name in one if isinstance(one.get(name, getlink=True), h5py.HardLink))
