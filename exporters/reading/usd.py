"""USD through pxr: every rigid body with a mesh below it, its points in single precision."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exporters.reading.rebuild import placed, with_classes
from exporters.reading.stages import arrays
from grainsdem.apart import read_apart
from grainsdem.errors import FileFormatError
from grainsdem.model import Domain, Polyhedra

if TYPE_CHECKING:
    from pathlib import Path

    from grainsdem.model import Packing

IS_LOCAL = True
ROUNDINGS = 1


def read(path: Path) -> Packing:
    """Read the rigid bodies of a stage, in metres and kilograms whatever its units, in another process."""
    import pxr  # noqa: F401  (told here where it is not installed)

    found = read_apart(arrays, path)
    names = ("vertices", "vertex_offsets", "face_offsets", "face_vertices", "face_vertex_offsets")
    shapes = Polyhedra(*(found[name] for name in names))
    positions, turns = found["poses"][:, :3], found["poses"][:, 3:]
    norms = np.linalg.norm(turns, axis=1, keepdims=True)
    if not (np.isfinite(found["poses"]).all() and (norms > 0).all()):
        raise FileFormatError(f"{path}: its bodies must have places and turns of finite numbers")
    domain = Domain(found["lower"], found["upper"], found["periodic"]) if "lower" in found else None
    packing = placed(shapes, positions, turns / norms, found["masses"], domain)
    return with_classes(packing, found["classes"]) if "classes" in found else packing
