"""A line behind the end of an HDF5 file that tells what its bytes were when they were written.

HDF5 reads no further than its own end, and cuts off what is behind it when a file is opened for writing: a file that
another program changed has no seal, rather than a wrong one.
"""

from __future__ import annotations

import errno
import hashlib
import os
from typing import TYPE_CHECKING

from grainsdem.errors import FileFormatError

if TYPE_CHECKING:
    from pathlib import Path

_MARK = b"\ngrainsdem sha256 "

_LENGTH = len(_MARK) + 64 + 1
"""Bytes of a seal: the mark, a digest, the end of the line."""

_SIGNATURE = b"\x89HDF\r\n\x1a\n"

_BLOCK = 1 << 20


def seal(path: Path) -> None:
    """Append the digest of a file to it, or leave it as it is and raise `OSError`."""
    size = path.stat().st_size
    digest = _digest(path, size)
    written = 0
    try:
        with path.open("ab", buffering=0) as file:
            written = file.write(_MARK + digest + b"\n")
    finally:
        if written < _LENGTH:
            os.truncate(path, size)
    if written < _LENGTH:
        raise OSError(errno.ENOSPC, "no room for its digest")


def is_sealed(path: Path) -> bool:
    """Return whether a file carries a digest, and raise `FileFormatError` where its bytes have another."""
    size = path.stat().st_size
    with path.open("rb") as file:
        file.seek(max(size - _LENGTH, 0))
        tail = file.read()
    start = tail.find(_MARK)
    if start < 0:
        return False
    if start or len(tail) != _LENGTH:
        raise FileFormatError(f"{path}: damaged or incomplete: cut off within the last {_LENGTH} bytes")
    if tail[len(_MARK) : -1] != _digest(path, size - _LENGTH):
        raise FileFormatError(f"{path}: damaged or incomplete: its bytes are not those that were written")
    return True


def has_signature(path: Path) -> bool:
    """Return whether a file begins as HDF5 files do, be it behind a block of a user's own."""
    size, place = path.stat().st_size, 0
    with path.open("rb") as file:
        while place < size:
            file.seek(place)
            if file.read(len(_SIGNATURE)) == _SIGNATURE:
                return True
            place = max(512, 2 * place)
    return False


def _digest(path: Path, size: int) -> bytes:
    """Return the digest of the first bytes of a file, as text."""
    found = hashlib.sha256()
    with path.open("rb") as file:
        while size > 0 and (block := file.read(min(size, _BLOCK))):
            size -= len(block)
            found.update(block)
    return found.hexdigest().encode()
