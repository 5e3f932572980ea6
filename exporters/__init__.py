"""Writers of packings: one module a format, one row in `FORMATS`."""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from exporters.reading import READERS, read, rounding
from grainsdem.atomic import write_all
from grainsdem.errors import InputError, WriteError

if TYPE_CHECKING:
    import os
    from types import ModuleType

    from grainsdem.model import Packing

__all__ = ["FORMATS", "READERS", "files", "module_for", "read", "rounding", "write"]

FORMATS = {
    ".xml": "exporters.mjcf",
    ".usda": "exporters.usd",
    ".usdc": "exporters.usd",
    ".stl": "exporters.stl",
    ".obj": "exporters.obj",
}
"""Suffix of a file and the module that writes it. A module has ``Options``, a dataclass, and ``files``."""


def write(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    overwrite: bool = True,
    **options: Any,
) -> list[Path]:
    """Write a packing; the suffix of the path picks the format.

    Parameters
    ----------
    packing : Packing
        Any packing of at least one grain.
    path : path-like
        Where to write: ``.xml`` is MJCF, ``.usda`` and ``.usdc`` USD, ``.stl`` STL, ``.obj`` OBJ.
    overwrite : bool
        Whether files that exist are replaced.
    **options
        Fields of the format's options: `exporters.mjcf.MjcfOptions`, `exporters.usd.UsdOptions` or
        `exporters.stl.StlOptions`.

    Returns
    -------
    list of Path
        The files written, the one that was asked for first. Each is whole or not there.

    Raises
    ------
    InputError
        If the suffix or an option is unknown, an option is out of range, or the packing is empty or not
        finite.
    WriteError
        If a file exists and ``overwrite`` is false, or cannot be written.
    """
    path = Path(path)
    content = files(packing, path.suffix, name=path.stem, **options)
    if not overwrite:
        for name in content:
            if (path.parent / name).exists():
                raise WriteError(f"{path.parent / name}: exists already; pass overwrite=True to replace it")
    return write_all(path.parent, content)


def files(
    packing: Packing,
    suffix: str,
    *,
    name: str = "bed",
    **options: Any,
) -> dict[str, bytes]:
    """Return what `write` would write: file name to bytes.

    Parameters
    ----------
    packing : Packing
        Any packing of at least one grain.
    suffix : str
        Format, as a suffix: ``".xml"``, ``".usda"``, ``".usdc"``, ``".stl"``.
    name : str
        Name of the files without suffix.
    **options
        Fields of the format's options.

    Raises
    ------
    InputError
        As `write`.
    """
    module = module_for(suffix)
    known = [field.name for field in fields(module.Options)]
    unknown = [option for option in options if option not in known]
    if unknown:
        raise InputError(f"{suffix} has no option {', '.join(unknown)}; it has {', '.join(known)}")
    content: dict[str, bytes] = module.files(packing, name=name, suffix=suffix, options=module.Options(**options))
    return content


def module_for(suffix: str) -> ModuleType:
    """Return the module that writes files of a suffix, imported when it is needed."""
    if suffix.lower() not in FORMATS:
        raise InputError(f"no format has the suffix {suffix!r}; known are {', '.join(FORMATS)}")
    return import_module(FORMATS[suffix.lower()])
