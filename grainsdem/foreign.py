"""Files of others: whatever parsers make of damage is one error of ours, and sizes are looked at before reading."""

from __future__ import annotations

import json
import math
import tomllib
import warnings
import zipfile
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.lib import format as npy

from grainsdem.errors import FileFormatError, GrainsDEMError, MissingFileError, shown
from grainsdem.memory import allow_memory

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path
    from typing import BinaryIO

    from numpy.typing import NDArray

_COPIES = 4
"""How many times the bytes of an array are taken while it is read and checked."""

_DEPTH = 50
"""Tables of a file within each other: ours have five."""

_KINDS = {"biuf": "real numbers", "U": "texts"}
"""What arrays of those types hold."""

_WORD = 2000
"""Bytes without a blank or a separator that no number has: what tells numbers from words takes the square of them."""


@contextmanager
def refusing(path: Path, what: str) -> Iterator[None]:
    """Turn whatever a reader meets in a file into one `FileFormatError` that names it.

    Parameters
    ----------
    path : Path
        The file.
    what : str
        What it is said not to be where the reader's error is not ours: "not TOML", "damaged or incomplete".
    """
    try:
        yield
    except ImportError:  # a package that is not installed is no fault of the file
        raise
    except GrainsDEMError as error:
        words = " ".join(str(error).splitlines())
        kind = MissingFileError if isinstance(error, MissingFileError) else FileFormatError
        raise kind(words if words.startswith(str(path)) else f"{path}: {words}") from error
    except RecursionError as error:
        raise FileFormatError(f"{path}: {what}: nested too deep") from error
    except MemoryError as error:
        raise FileFormatError(f"{path}: {what}: it would take more memory than there is") from error
    except Exception as error:
        raise FileFormatError(f"{path}: {what}: {said(error)}") from error


def said(error: BaseException) -> str:
    """Return what an error says, in one line."""
    text = str(error.args[0]) if isinstance(error, KeyError) and error.args else str(error)
    return " ".join(text.split())[:300] or type(error).__name__


def _parsed(parse: Callable[[str], Any], text: str, language: str) -> Any:
    """Return what a parser makes of a text, or raise `FileFormatError`."""
    try:
        return parse(text)
    except RecursionError as error:
        raise FileFormatError(f"not {language} that can be read: nested too deep") from error
    except ValueError as error:
        raise FileFormatError(f"not {language}: {said(error)}") from error


def toml(text: str) -> dict[str, Any]:
    """Return the tables of a TOML text, or raise `FileFormatError`.

    Numbers of thousands of digits and tables nested a thousand deep are errors of their own to Python.
    """
    found: dict[str, Any] = _parsed(tomllib.loads, text, "TOML")
    _hold_depth(found, "TOML")
    return found


def json_object(text: str) -> dict[str, Any]:
    """Return the JSON object that a text holds, or raise `FileFormatError`."""
    found = _parsed(json.loads, text, "JSON")
    if not isinstance(found, dict):
        raise FileFormatError(f"not a JSON object; got {shown(found)}")
    _hold_depth(found, "JSON")
    return found


def _hold_depth(found: dict[str, Any], language: str) -> None:
    """Raise `FileFormatError` where tables are nested so deep that going through them has no end."""
    level: list[Any] = [found]
    for _ in range(_DEPTH):
        level = [one for held in level for one in (held.values() if isinstance(held, dict) else held)]
        level = [one for one in level if isinstance(one, dict | list)]
        if not level:
            return
    raise FileFormatError(f"not {language} that can be read: nested more than {_DEPTH} deep")


def array_of(path: Path, name: str | None = None, *, kinds: str = "biuf") -> NDArray[Any]:
    """Return the array of an ``.npy`` file, or one of an ``.npz``: that of the given name, else the only one.

    Its type is of one of the ``kinds`` that numpy has letters for: real numbers, unless told otherwise.

    Raises
    ------
    FileFormatError
        If it holds no such array, one of another kind, or one that it is too short for.
    InputError
        If reading it would take more memory than may be taken.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of heads that are not quite as they should be
        if path.suffix.lower() == ".npy":
            with path.open("rb") as stream:
                return _array(stream, path.stat().st_size, kinds)
        with zipfile.ZipFile(path) as archive:
            members = [one for one in archive.infolist() if one.filename.endswith(".npy")]
            wanted = [one for one in members if one.filename == f"{name}.npy"] or (members if len(members) == 1 else [])
            if not wanted:
                names = ", ".join(one.filename.removesuffix(".npy") for one in members) or "none"
                raise FileFormatError(f"expected one array, or one named {name!r}; got {names}")
            with archive.open(wanted[0]) as member:
                return _array(member, wanted[0].file_size, kinds)  # type: ignore[arg-type]  # it is read and sought like any


def _array(stream: BinaryIO, size: int, kinds: str) -> NDArray[Any]:
    """Return the array of a stream of so many bytes, once its head has been looked at."""
    heads = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    version = npy.read_magic(stream)
    if version not in heads:
        raise FileFormatError(f"not an array of version 1.0 or 2.0 of its format; got {'.'.join(map(str, version))}")
    try:
        shape, _, dtype = heads[version](stream)
    except Exception as error:
        raise FileFormatError(f"an array whose head makes no sense: {said(error)}") from error
    if dtype.kind not in kinds or min(shape, default=0) < 0:
        raise FileFormatError(f"an array of {dtype} and shape {shape}; {_KINDS.get(kinds, kinds)} are read")
    n_bytes = math.prod(shape) * dtype.itemsize
    if n_bytes > size - stream.tell():
        raise FileFormatError(f"an array of shape {shape} takes {n_bytes} bytes; the file has {size - stream.tell()}")
    allow_memory(n_bytes, _COPIES, "bytes of an array")
    stream.seek(0)
    found: NDArray[Any] = npy.read_array(stream, allow_pickle=False)
    return found


def hold_words(content: bytes) -> None:
    """Raise `FileFormatError` where a text has a word of thousands of signs, which is no number."""
    signs = np.frombuffer(content, np.uint8)
    rows = signs[: signs.size // _WORD * _WORD].reshape(-1, _WORD)
    # Blanks, quotes, commas and the like come first in ASCII, and then the semicolon.
    if not ((rows <= ord(",")) | (rows == ord(";"))).any(axis=1).all():
        raise FileFormatError(f"a word or number of more than {_WORD} signs")
