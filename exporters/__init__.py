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

from pathlib import Path
from typing import TYPE_CHECKING, Any

from exporters import manifest, programs
from exporters.formats import FORMATS, SHARED, Format, find, find_for, known, parted, shared
from exporters.programs import PROGRAMS, opening
from exporters.reading import READERS, read, rounding
from exporters.replays import replay
from grainsdem.atomic import write_all
from grainsdem.errors import InputError, RefusedError
from grainsdem.gate import gated
from grainsdem.packing import merge_edges

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
    content, refused = manifest.together(packing, several, name, shared(several, options))
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
    [chosen] = shared([found], options)
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
    shared(found, options)
    return parted(found, options)
