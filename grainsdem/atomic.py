"""Files that are whole or not there: written to a temporary name beside their place, then moved."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from grainsdem.claims import NoLocksError, claim_one, held
from grainsdem.errors import WriteError

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping


@contextmanager
def replacing(path: str | os.PathLike[str], *, is_held: bool = True) -> Iterator[Path]:
    """Yield a temporary path in the folder of ``path``; move it there when the block ends well, else remove it.

    Parameters
    ----------
    path : str or path-like
        What is written, or replaced.
    is_held : bool
        Whether the temporary file is held while the block lasts; what is not must be by whoever writes it.

    Raises
    ------
    WriteError
        If the folder does not exist or cannot be written, the disk is full, or the move fails.
    """
    path = Path(path)
    temporary: Path | None = None
    handle: int | None = None
    try:
        # The suffix is kept: some writers choose their format by it.
        try:
            temporary, handle = claim_one(path.parent, path.stem, path.suffix)
        except NoLocksError:
            handle, name = tempfile.mkstemp(prefix=f".{path.stem}-", suffix=path.suffix, dir=path.parent)
            temporary, is_held = Path(name), False
        if not is_held:
            os.close(handle)
            handle = None
        yield temporary
        temporary.chmod(0o666 & ~_umask())
        temporary.replace(path)
        temporary = None
    except OSError as error:
        if isinstance(error, WriteError):
            raise
        raise WriteError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink()
        if handle is not None:  # held to the end: nobody takes it for what a dead process left
            os.close(handle)


def write_all(
    folder: str | os.PathLike[str],
    files: Mapping[str, bytes | Iterable[bytes]],
    *,
    overwrite: bool = True,
    make_folder: bool = False,
) -> list[Path]:
    """Write several files into one folder, all of them or none, and return their paths.

    Parameters
    ----------
    folder : str or path-like
        Where they go.
    files : mapping of str to bytes or iterable of bytes
        Content of each file, in the order that it is written; an iterable is written as it comes. A name may have
        folders, parted by ``/``, that are made. A file that begins with ``#!`` may be run.
    overwrite : bool
        Whether files that exist are replaced.
    make_folder : bool
        Whether ``folder`` itself is made where it is not there.

    Raises
    ------
    WriteError
        If a file exists and ``overwrite`` is false, a folder does not exist, or the disk is full. Nothing is left
        behind.
    """
    folder = Path(folder)
    paths = [folder / name for name in files]
    existing = [path for path in paths if path.exists()]
    if existing and not overwrite:
        raise WriteError(f"{existing[0]}: exists already; pass overwrite=True (--force) to replace it")
    place = paths[0] if paths else folder
    made: list[Path] = []
    try:
        if make_folder:
            _make(folder, made)
        # Beside their places, so that moving them is renaming them.
        with _staging(folder) as staging:
            staged: list[Path] = []
            for place, content in zip(paths, files.values(), strict=True):
                staged.append(staging / f"{len(staged)}-{place.name}")
                _fill(staged[-1], content)
            for place, temporary in zip(paths, staged, strict=True):
                _make(place.parent, made)
                temporary.replace(place)
    except BaseException as error:
        _unmake(made)
        if isinstance(error, OSError) and not isinstance(error, WriteError):
            raise WriteError(f"{place}: cannot be written: {error.strerror or error}") from error
        raise
    return paths


@contextmanager
def working_in(folder: str | os.PathLike[str]) -> Iterator[Path]:
    """Make a folder where it is not there and hold it while the block lasts; one left empty by an error is removed.

    Raises
    ------
    WriteError
        If it cannot be made, or another run is writing it.
    """
    folder = Path(folder)
    made: list[Path] = []
    try:
        _make(folder, made)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be made a folder: {error.strerror or error}") from error
    try:
        with held(folder):
            yield folder
    except BaseException:
        _unmake(made)
        raise


@contextmanager
def _staging(folder: Path) -> Iterator[Path]:
    """Yield a folder in a folder for files that wait to be moved, and remove it."""
    try:
        staging, handle = claim_one(folder, "writing", is_folder=True)
    except NoLocksError:
        with tempfile.TemporaryDirectory(prefix=".writing-", dir=folder) as name:
            yield Path(name)
        return
    try:
        yield staging
    finally:
        shutil.rmtree(staging, ignore_errors=True)
        os.close(handle)


def _unmake(made: list[Path]) -> None:
    """Remove the folders that were made, as far as they are empty."""
    for folder in reversed(made):
        with suppress(OSError):
            folder.rmdir()


def check_place(path: Path, *, is_folder: bool = False) -> None:
    """Raise `WriteError` where a file, or a folder that may have to be made, cannot be written; nothing is made.

    What only trying tells, such as a disk without room, is told by trying.
    """
    try:
        code = _obstacle(path, is_folder=is_folder)
        reason = os.strerror(code) if code else ""
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        raise WriteError(f"{path}: cannot be {'made a folder' if is_folder else 'written'}: {reason}")


def _obstacle(path: Path, *, is_folder: bool) -> int:
    """Return the number of the system's error for a place where nothing can be written, or 0."""
    place = path if is_folder else path.parent
    if not is_folder:
        if path.is_dir():
            return errno.EISDIR
        with suppress(FileNotFoundError):  # that its name is too long is told before
            path.with_name(f".{path.stem}-1{path.suffix}").lstat()
    while is_folder and not os.path.lexists(place):
        place = place.parent
    if not place.is_dir():
        return errno.ENOTDIR if place.exists() else errno.ENOENT
    return 0 if os.access(place, os.W_OK | os.X_OK) else errno.EACCES


def _fill(path: Path, content: bytes | Iterable[bytes]) -> None:
    """Write content to a path, block by block where it comes so."""
    with path.open("w+b") as file:
        for block in [content] if isinstance(content, bytes) else content:
            file.write(block)
        file.seek(0)
        is_script = file.read(2) == b"#!"
    if is_script:
        path.chmod(0o777 & ~_umask())


def _make(folder: Path, made: list[Path]) -> None:
    """Make a folder and those above it, and note those that were not there."""
    made += reversed([parent for parent in (folder, *folder.parents) if not parent.exists()])
    folder.mkdir(parents=True, exist_ok=True)


def _umask() -> int:
    """Return the process's umask, which can be read only by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
