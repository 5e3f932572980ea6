"""Places on disk that are held by one process while it lives: its death lets them go, however it comes.

A place is held by a lock of the system on a file or folder there. What a dead process has left is therefore known by
nobody holding it, whoever's process numbers those are, and on whatever machine of a shared disk it ran.
"""

from __future__ import annotations

import errno
import os
import shutil
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from grainsdem.errors import WriteError

try:
    import fcntl
except ImportError:  # Windows has no such locks: nothing is refused there, and nothing left behind is removed
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

_NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP}
"""Errors of disks that have none."""

MOST = 1000
"""Names that are tried for one temporary file: as many processes may write it at once."""


class NoLocksError(Exception):
    """The disk, or the system, has no locks."""


def claim(path: Path, *, is_folder: bool = False) -> int | None:
    """Return a descriptor that holds a path, which is made where it is not there, or None where another holds it.

    Raises
    ------
    OSError
        If it can be neither opened nor made.
    NoLocksError
        If nothing can be held there.
    """
    if fcntl is None:
        raise NoLocksError
    kind = os.O_RDONLY | os.O_DIRECTORY if is_folder else os.O_RDWR | os.O_CREAT
    while True:
        if is_folder:
            with suppress(FileExistsError):
                path.mkdir(mode=0o700)
        try:
            handle = os.open(path, kind | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
        except FileNotFoundError:
            if is_folder and path.parent.exists():  # its holder has just removed it
                continue
            raise
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            os.close(handle)
            if error.errno in _NO_LOCKS:
                raise NoLocksError from error
            if error.errno in {errno.EWOULDBLOCK, errno.EACCES}:
                return None
            raise
        # The one who held it may have moved or removed it before it was ours.
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(handle), path.lstat()):
                return handle
        os.close(handle)


def claim_one(folder: Path, stem: str, suffix: str = "", *, is_folder: bool = False) -> tuple[Path, int]:
    """Return a hidden path in a folder that nobody holds, and its descriptor; what dead processes left is removed.

    Raises
    ------
    OSError
        If none can be made.
    NoLocksError
        If nothing can be held there.
    """
    for number in range(1, MOST):
        path = folder / f".{stem}-{number}{suffix}"
        handle = _claim_old(path, is_folder=is_folder)
        if handle is None:
            continue
        _empty(path, handle, is_folder=is_folder)
        _remove_left(folder, stem, suffix, number + 1, is_folder=is_folder)
        return path, handle
    raise OSError(errno.EEXIST, f"{MOST} temporary files of that name are there", str(folder))


def _claim_old(path: Path, *, is_folder: bool) -> int | None:
    """Claim a path; one that is there and is not ours to open counts as held."""
    try:
        return claim(path, is_folder=is_folder)
    except OSError:
        if not os.path.lexists(path):
            raise
        return None


def _empty(path: Path, handle: int, *, is_folder: bool) -> None:
    """Remove what is in a file or folder that is held."""
    if not is_folder:
        os.ftruncate(handle, 0)
        return
    for inner in path.iterdir():
        if inner.is_dir() and not inner.is_symlink():
            shutil.rmtree(inner, ignore_errors=True)
        else:
            inner.unlink(missing_ok=True)


def _remove_left(folder: Path, stem: str, suffix: str, number: int, *, is_folder: bool) -> None:
    """Remove what dead processes left under the names that follow."""
    while os.path.lexists(path := folder / f".{stem}-{number}{suffix}"):
        number += 1
        with suppress(OSError):
            handle = claim(path, is_folder=is_folder)
            if handle is not None:
                shutil.rmtree(path, ignore_errors=True) if is_folder else path.unlink()
                os.close(handle)


@contextmanager
def held(path: Path) -> Iterator[None]:
    """Hold what a long run writes, a file or a folder that is there, for as long as the block lasts.

    Raises
    ------
    WriteError
        If another run that lives is writing it, or its folder cannot be written.
    """
    lock = path / ".lock" if path.is_dir() else path.with_name(f".{path.name}.lock")
    try:
        handle = claim(lock)
    except NoLocksError:
        yield
        return
    except OSError as error:
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
    if handle is None:
        raise WriteError(f"{path}: another run is writing it; wait for its end, or give another place")
    try:
        yield
    finally:
        with suppress(OSError):
            lock.unlink()
        os.close(handle)
