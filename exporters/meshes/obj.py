"""Wavefront OBJ: one object a grain. Triangles, since some readers drop larger faces silently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.check import check_choice, check_name, class_texts, grain_names, measured, stretches
from exporters.meshes.union import united, what_united
from exporters.text import filled
from exporters.units import check_units, chosen_units, factors_of
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import triangles

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from exporters.units import Units
    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjOptions:
    """Where the file's origin lies, its units, and whether it is one mesh.

    Parameters
    ----------
    origin : {"world", "domain"}
        That of the packing, or the lower corner of its domain.
    units : {"si", "mm", "grain"} or float
        Metres, millimetres, median grain diameters, or another length in metres: a comment says which.
    merge : bool
        One object of one surface, the union of all grains, in place of one a grain.

    Raises
    ------
    InputError
        If the origin or the units are not among those allowed.
    """

    origin: Literal["world", "domain"] = "world"
    units: Units = "si"
    merge: bool = False

    def __post_init__(self) -> None:
        check_choice("origin", self.origin, ("world", "domain"))
        check_units(self.units)


Options = ObjOptions

LOSES = (
    "Polygons are cut into triangles, and vertices have nine significant digits.",
    "Masses, densities and poses are not carried.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".obj", options: ObjOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the one file: vertices with nine significant digits, one object ``g000000`` a grain.

    Where grains have classes, grain by grain group ``class_2`` says which.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    options = options or ObjOptions()
    length = chosen_units(options.units, measured(packing).volumes, packing.densities).length
    names = [name] if options.merge else grain_names(packing)
    return {f"{name}{suffix}": _objects(united(packing) if options.merge else packing, names, options.origin, length)}


def factors(packing: Packing, options: ObjOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI; it has no masses and no times."""
    scales = chosen_units(options.units, volumes(packing.grains), packing.densities)
    return {**factors_of(scales), "mass": 1.0, "time": 1.0}


def report(packing: Packing, options: ObjOptions) -> dict[str, Any]:
    """Return what merging does to the grains; nothing where they are not merged."""
    return what_united(packing) if options.merge else {}


def _objects(packing: Packing, names: list[str], origin: str, length: float) -> Iterator[bytes]:
    """Yield the file, a stretch of grains at a time."""
    yield b"# metres\n" if length == 1.0 else f"# unit {length!r} m\n".encode()
    shift = packing.domain.lower if origin == "domain" else 0.0
    n_before = packing.grains.vertex_offsets
    for first, part in stretches(packing):
        grains, cut = part.grains, triangles(part.grains)
        vertices = filled("v %.9g %.9g %.9g\n", (world_vertices(part) - shift) / length, np.diff(grains.vertex_offsets))
        counts = np.diff(cut.offsets)
        # Vertices are counted through the file, from one.
        starts = n_before[first : first + len(part)]
        faces = filled("f %d %d %d\n", cut.indices + np.repeat(starts, counts)[:, None] + 1, counts)
        rows = zip(names[first : first + len(part)], class_texts(part, "g class_%d\n"), vertices, faces, strict=True)
        yield "".join([f"o {name}\n{group}{points}{corners}" for name, group, points, corners in rows]).encode()
