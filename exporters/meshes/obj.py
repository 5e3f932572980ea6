"""Wavefront OBJ: one object a grain, in metres. Triangles, since some readers drop larger faces silently."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_name, grain_names, measured
from exporters.text import filled
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import triangles

if TYPE_CHECKING:
    from grainsdem.model import Packing


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjOptions:
    """Where the file's origin lies.

    Parameters
    ----------
    origin : {"world", "domain"}
        That of the packing, or the lower corner of its domain.

    Raises
    ------
    InputError
        If the origin is not one of those allowed.
    """

    origin: Literal["world", "domain"] = "world"

    def __post_init__(self) -> None:
        check_choice("origin", self.origin, ("world", "domain"))


Options = ObjOptions

LOSES = (
    "Polygons are cut into triangles, and vertices have nine significant digits.",
    "Masses, densities and poses are not carried.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".obj", options: ObjOptions | None = None
) -> dict[str, bytes]:
    """Return the one file: vertices with nine significant digits, one object ``g000000`` a grain.

    Raises
    ------
    InputError
        If the packing is empty or not finite.
    """
    check_name(name)
    measured(packing)
    options = options or ObjOptions()
    world = world_vertices(packing) - (packing.domain.lower if options.origin == "domain" else 0.0)
    grains = packing.grains
    cut = triangles(grains)
    vertices = filled("v %.9g %.9g %.9g\n", world, np.diff(grains.vertex_offsets))
    counts = np.diff(cut.offsets)
    numbers = cut.indices + np.repeat(grains.vertex_offsets[:-1], counts)[:, None] + 1
    faces = filled("f %d %d %d\n", numbers, counts)
    objects = [f"o {n}\n{v}{f}" for n, v, f in zip(grain_names(packing), vertices, faces, strict=True)]
    return {f"{name}{suffix}": ("# metres\n" + "".join(objects)).encode()}
