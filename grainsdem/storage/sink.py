"""A new HDF5 file, written so that a disk without room is an error and not the end of the interpreter."""

from __future__ import annotations

import io
import os
import signal
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import h5py

from grainsdem.storage.hdf5 import LIBVER

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Any


@contextmanager
def created(path: Path) -> Iterator[h5py.File]:
    """Yield a new HDF5 file at a path.

    Raises
    ------
    OSError
        Where the block ends, if not all of it could be written.
    """
    with io.FileIO(path, "w+b") as raw:
        sink = _Sink(raw)
        with _uninterrupted(), h5py.File(sink, "w", libver=LIBVER, track_order=False) as file:
            yield file
        if sink.error is not None:
            raise sink.error


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let signals wait while the block lasts: HDF5, which calls us, cannot bear an exception."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    heard: list[int] = []
    known = {int(number): signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    before = {number: handler for number, handler in known.items() if callable(handler)}
    for number in before:
        signal.signal(number, lambda number, _: heard.append(number))
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        for number in heard:
            signal.raise_signal(number)


class _Sink:
    """The file that HDF5 writes: what there is no room for goes to memory, for HDF5 crashes where a write fails."""

    def __init__(self, file: io.FileIO) -> None:
        self._file: io.FileIO | io.BytesIO = file
        self.error: OSError | None = None

    def seek(self, *place: int) -> int:
        return self._file.seek(*place)

    def tell(self) -> int:
        return self._file.tell()

    def read(self, size: int = -1) -> bytes | None:
        return self._file.read(size)

    def readinto(self, room: Any) -> int | None:
        return self._file.readinto(room)

    def flush(self) -> None:
        self._file.flush()

    def truncate(self, size: int) -> int:
        try:
            return self._file.truncate(size)
        except OSError as error:
            return self._without_room(error).truncate(size)

    def write(self, content: Any) -> int:
        begin, rest = self._file.tell(), memoryview(content).cast("B")
        try:
            while rest:
                rest = rest[self._file.write(rest) :]
        except OSError as error:
            memory = self._without_room(error)
            memory.seek(begin)
            memory.write(content)
        return len(content)

    def _without_room(self, error: OSError) -> io.BytesIO:
        """Go on in memory, with what was written so far."""
        self.error = error
        self._file.seek(0)
        memory = io.BytesIO(self._file.read())
        memory.seek(0, os.SEEK_END)
        self._file = memory
        return memory
