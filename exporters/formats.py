"""The table of formats, and where other distributions add theirs."""

from __future__ import annotations

from dataclasses import fields
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.packing.blunting import check_min_edge

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from importlib.metadata import EntryPoint
    from pathlib import PurePath
    from types import ModuleType

GROUP = "grainsdem.exporters"
"""Entry points of this group are formats of other distributions: name to module."""


SHARED = ("min_edge",)
"""Options that all formats have: what they say is done before."""


class Format(NamedTuple):
    """One format.

    Parameters
    ----------
    module : str
        Module that writes it; what it must hold is said in `exporters`.
    suffixes : tuple of str
        Suffixes of its main file, the usual one first; none for a format that is a folder.
    """

    module: str
    suffixes: tuple[str, ...] = ()


FORMATS = {
    "mjcf": Format("exporters.mjcf", (".xml",)),
    "usd": Format("exporters.usd", (".usdc", ".usda", ".usdz")),
    "stl": Format("exporters.meshes.stl", (".stl",)),
    "obj": Format("exporters.meshes.obj", (".obj",)),
    "ply": Format("exporters.meshes.ply", (".ply",)),
    "glb": Format("exporters.meshes.glb", (".glb",)),
    "3mf": Format("exporters.meshes.threemf", (".3mf",)),
    "vtk": Format("exporters.meshes.vtk", (".vtp", ".vtu")),
    "msh": Format("exporters.meshes.msh", (".msh",)),
    "grains": Format("exporters.tables.grains", (".csv", ".parquet")),
    "contacts": Format("exporters.tables.contacts", (".graphml", ".csv", ".parquet", ".vtp")),
    "rockable": Format("exporters.dem.rockable", (".conf",)),
    "lammps": Format("exporters.dem.lammps", (".in",)),
    "yade": Format("exporters.dem.yade", (".py",)),
    "3dec": Format("exporters.dem.threedec", (".3ddat",)),
    "sdf": Format("exporters.dem.sdf", (".sdf",)),
    "openfoam": Format("exporters.openfoam"),
}
"""Name of a format and its row. A suffix that several share is that of the first; the others go by name."""


class Found(NamedTuple):
    """A format that was asked for.

    Parameters
    ----------
    name : str
        Its name.
    suffix : str
        Suffix of its main file as it was asked for; empty for a folder.
    module : ModuleType
        What writes it.
    """

    name: str
    suffix: str
    module: ModuleType


@gated
def known() -> list[str]:
    """Return the names and suffixes that formats go by, ours before those of other distributions."""
    suffixes = dict.fromkeys(suffix for row in FORMATS.values() for suffix in row.suffixes)
    return [*suffixes, *FORMATS, *(name for name in _others() if name not in FORMATS)]


@gated
def find(word: str, suffix: str = "") -> Found:
    """Return the format of a name (``"mjcf"``) or a suffix (``".xml"``, ``"xml"``).

    Parameters
    ----------
    word : str
        Name or suffix, capitals or not.
    suffix : str
        Suffix of the main file, where a name is to be written under another than its usual one.

    Raises
    ------
    InputError
        If there is no such format; the message lists those that are known.
    """
    wanted = word.lower()
    given = word if word.startswith(".") else f".{word}"
    dotted = given.lower()
    # A name goes before a suffix: "stl" is both.
    if wanted in FORMATS:
        row = FORMATS[wanted]
        return Found(wanted, suffix or _first(row.suffixes), import_module(row.module))
    for name, row in FORMATS.items():
        if dotted in row.suffixes:
            return Found(name, suffix or given, import_module(row.module))
    others = _others()
    if wanted in others:
        module = _load(others[wanted])
        return Found(wanted, suffix or _first(module.SUFFIXES), module)
    for name, entry in others.items():
        module = _load(entry)
        if dotted in module.SUFFIXES:
            return Found(name, suffix or given, module)
    raise InputError(f"no format has the name or suffix {word!r}; known are {', '.join(known())}")


def find_for(path: PurePath, name: str | None = None) -> Found:
    """Return the format of a path: that of its suffix, or the one that is named."""
    return find(path.suffix) if name is None else find(name, path.suffix)


def _first(suffixes: tuple[str, ...]) -> str:
    return suffixes[0] if suffixes else ""


def _others() -> dict[str, EntryPoint]:
    """Return the formats of other distributions by name, in the order of their names."""
    return {entry.name.lower(): entry for entry in sorted(entry_points(group=GROUP), key=lambda entry: entry.name)}


def _load(entry: EntryPoint) -> ModuleType:
    """Import the module of an entry point, and see that it is a format's."""
    module: ModuleType = entry.load()
    lacking = [part for part in ("SUFFIXES", "LOSES", "Options", "files") if not hasattr(module, part)]
    if lacking:
        raise InputError(f"{entry.value}, a format by entry point {entry.name!r}, lacks {', '.join(lacking)}")
    return module


def shared(found: Sequence[Found], options: Mapping[str, Any]) -> list[Any]:
    """Return the options of each format: those of the given that it has."""
    if options.get("min_edge") is not None:
        check_min_edge(options["min_edge"])
    names = [_names(one) for one in found]
    parts = parted(found, options)
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


def parted(found: Sequence[Found], options: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return which of the given options each format has; all must be known."""
    known_to = [[*_names(one), *SHARED] for one in found]
    unknown = [option for option in options if not any(option in names for names in known_to)]
    if unknown:
        names = dict.fromkeys(name for one in known_to for name in one)
        formats = ", ".join(one.suffix or one.name for one in found) or "no format"
        raise InputError(f"{formats} has no option {', '.join(unknown)}; it has {', '.join(names)}")
    return [{key: value for key, value in options.items() if key in names} for names in known_to]
