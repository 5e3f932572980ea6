"""Writers of packings: one module a format, one row in `FORMATS`.

A module of a format holds

``Options``
    A frozen dataclass of keyword-only options, each with a default, checked when it is made.
``files(packing, *, name, suffix, options)``
    Returns a dictionary, the main file first: file name to content. A name may have folders, parted by ``/``; files of
    different formats with the same ``name`` must not share a file name. Content is bytes, or an iterable of bytes made
    while it is written, for files that are larger than what they are made from. All input is checked before it returns:
    `exporters.check.measured` and `check_name` do so. The same packing gives the same bytes.
``LOSES``
    A tuple of plain sentences: what of a packing the format does not carry.
``factors(packing, options)``, unless the file is in SI
    Returns the factors from the file's units to SI: ``{"length": m, "mass": kg, "time": s}``. They also stand in the
    file, for `read`.
``report(packing, options)``, where writing changes the grains
    Returns what it did to them, as JSON values for the manifest.

Options that all formats have (`SHARED`) are done before: ``min_edge`` gives each the grains of `grainsdem.merge_edges`.
What puts a skin around grains has a field of that name besides, for the cores.

Other distributions add formats through entry points of the group ``grainsdem.exporters``: the name of the format, and a
module as above with ``SUFFIXES`` besides, a tuple, empty for a format that is a folder.
"""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters import manifest, programs
from exporters.formats import FORMATS, Format, find, find_for, known
from exporters.programs import PROGRAMS, opening
from exporters.reading import READERS, read, rounding
from exporters.replays import replay
from grainsdem.atomic import write_all
from grainsdem.errors import InputError, RefusedError
from grainsdem.gate import gated
from grainsdem.packing import merge_edges
from grainsdem.packing.blunting import check_min_edge

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from types import ModuleType

    from exporters.formats import Found
    from grainsdem.model import Packing

__all__ = [
    "FORMATS", "PROGRAMS", "READERS", "SHARED", "Format", "files", "find", "known", "module_for", "opening",
    "options_for", "read", "replay", "rounding", "write",
]  # fmt: skip

SHARED = ("min_edge",)
"""Options that all formats have."""


@gated
def write(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    format: str | None = None,  # noqa: A002  (the field's word for it)
    formats: str | Sequence[str] | None = None,
    program: str | None = None,
    name: str = "bed",
    overwrite: bool = True,
    min_edge: float | None = None,
    **options: Any,
) -> list[Path]:
    """Write a packing: one file whose suffix picks the format, or a folder with many formats and a manifest.

    Parameters
    ----------
    packing : Packing
        Any packing of at least one grain.
    path : path-like
        File to write; with ``formats`` a folder, made if it is not there.
    format : str, optional
        Name of the format of the one file, where its suffix is not that format's own.
    formats : str or sequence of str, optional
        Names or suffixes of formats, `known` lists them. Beside their files stands ``manifest.json``: see
        `exporters.manifest`.
    program : str, optional
        Program that the one file is for, one of `PROGRAMS`: it picks format, suffix and options. Those that are given
        besides go before them; `opening` gives the lines that open the file there.
    name : str
        Name of the files in a folder, without suffix.
    overwrite : bool
        Whether files that exist are replaced.
    min_edge : float, optional
        Shortest edge of a grain, in its diameters: shorter ones are merged before (`grainsdem.merge_edges`), in every
        format alike. The manifest says under ``provenance`` what that took.
    **options
        Fields of the format's options, `exporters.mjcf.MjcfOptions` for one; with many formats each gets those that it
        has.

    Returns
    -------
    list of Path
        The files written, the one that was asked for first. All are there, each whole, or none.

    Raises
    ------
    InputError
        If a format or an option is unknown, an option is out of range, or the packing is empty or not finite. Nothing
        is written.
    RefusedError
        If some of many formats cannot take the packing. The files of the others are written; the error and the
        manifest say which formats and why.
    WriteError
        If a file exists and ``overwrite`` is false, or cannot be written.
    """
    path = Path(path)
    if program is not None:
        if format is not None or formats is not None:
            raise InputError(f"a program picks the format; got the program {program} and another format besides")
        wanted = programs.program(program)
        path, format = programs.path_for(path, wanted, program), wanted.format  # noqa: A001
        options = {**wanted.options, **options}
    packing, options = _prepared(packing, min_edge, options)
    if formats is None:
        found = find_for(path, format)
        return write_all(path.parent, _content(packing, found, path.stem, options), overwrite=overwrite)
    several = [find(word) for word in ([formats] if isinstance(formats, str) else formats)]
    content, refused = manifest.together(packing, several, name, _shared(several, options))
    written = write_all(path, content, overwrite=overwrite, make_folder=True)
    if refused:
        raise RefusedError(refused, written)
    return written


@gated
def files(
    packing: Packing,
    suffix: str,
    *,
    name: str = "bed",
    min_edge: float | None = None,
    **options: Any,
) -> dict[str, bytes]:
    """Return what `write` would write: file name to bytes.

    Parameters
    ----------
    packing : Packing
        Any packing of at least one grain.
    suffix : str
        Format, as a suffix (``".usda"``) or a name (``"usd"``).
    name : str
        Name of the files without suffix.
    min_edge, **options
        As of `write`.

    Raises
    ------
    InputError
        As `write`.
    """
    packing, options = _prepared(packing, min_edge, options)
    written = _content(packing, find(suffix), name, options)
    return {file: part if isinstance(part, bytes) else b"".join(part) for file, part in written.items()}


@gated
def module_for(suffix: str) -> ModuleType:
    """Return the module that writes files of a suffix, imported when it is needed."""
    return find(suffix).module


def _prepared(packing: Packing, min_edge: float | None, options: dict[str, Any]) -> tuple[Packing, dict[str, Any]]:
    """Return the grains as every format gets them, and the options with those that all have."""
    if min_edge is None:
        return packing, options
    return merge_edges(packing, min_edge).packing, {**options, "min_edge": min_edge}


def _content(packing: Packing, found: Found, name: str, options: dict[str, Any]) -> dict[str, Any]:
    """Return the files of one format, all of whose options must be known."""
    [chosen] = _shared([found], options)
    content: dict[str, Any] = found.module.files(packing, name=name, suffix=found.suffix, options=chosen)
    return content


@gated
def options_for(words: Sequence[str], options: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return for each of several formats those of the options that it has.

    Parameters
    ----------
    words : sequence of str
        Names or suffixes of formats.
    options : mapping of str to any
        Fields of their options; each must be one of at least one format.

    Raises
    ------
    InputError
        If a format or an option is unknown, or an option is out of range.
    """
    found = [find(word) for word in words]
    _shared(found, options)
    return _parted(found, options)


def _shared(found: Sequence[Found], options: Mapping[str, Any]) -> list[Any]:
    """Return the options of each format: those of the given that it has."""
    if options.get("min_edge") is not None:
        check_min_edge(options["min_edge"])
    names = [_names(one) for one in found]
    parts = _parted(found, options)
    for one, part in zip(found, parts, strict=True):
        _check_switches(one, part)
    return [
        one.module.Options(**{key: value for key, value in part.items() if key in own})
        for one, own, part in zip(found, names, parts, strict=True)
    ]


def _check_switches(one: Found, given: Mapping[str, Any]) -> None:
    """Raise `InputError` where an option that is on or off is neither: any word would be on."""
    for field in fields(one.module.Options):
        value = given.get(field.name, False)
        if field.type in {"bool", bool} and not isinstance(value, (bool, np.bool_)):
            raise InputError(f"{field.name} of {one.suffix or one.name} must be true or false; got {value!r}")


def _names(one: Found) -> list[str]:
    """Return the names of the options that a format has of its own."""
    return [field.name for field in fields(one.module.Options)]


def _parted(found: Sequence[Found], options: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return which of the given options each format has; all must be known."""
    known_to = [[*_names(one), *SHARED] for one in found]
    unknown = [option for option in options if not any(option in names for names in known_to)]
    if unknown:
        names = dict.fromkeys(name for one in known_to for name in one)
        formats = ", ".join(one.suffix or one.name for one in found) or "no format"
        raise InputError(f"{formats} has no option {', '.join(unknown)}; it has {', '.join(names)}")
    return [{key: value for key, value in options.items() if key in names} for names in known_to]
