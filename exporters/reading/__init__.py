"""Readers beside the writers: a file becomes a packing again, rounded as the program that it is for rounds it."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import FileFormatError, MissingFileError
from grainsdem.foreign import refusing
from grainsdem.gate import gated
from grainsdem.geometry.rotations import world_vertices

if TYPE_CHECKING:
    import os

    from grainsdem.model import Packing

__all__ = ["READERS", "read", "rounding"]

READERS = {
    ".xml": "exporters.reading.mjcf",
    ".usda": "exporters.reading.usd",
    ".usdc": "exporters.reading.usd",
    ".usdz": "exporters.reading.usd",
    ".stl": "exporters.reading.stl",
    ".obj": "exporters.reading.obj",
}
"""Suffix of a file and the module that reads it. A module has ``read``; ``IS_LOCAL``, whether vertices are rounded in
the grain's own frame or in the world; and ``ROUNDINGS``, how often they are.
"""


@gated
def read(path: str | os.PathLike[str]) -> Packing:
    """Read a packing from a file that `exporters.write` wrote, as the program that it is for reads it.

    Parameters
    ----------
    path : str or path-like
        ``.xml`` (MJCF, through MuJoCo's compiler), ``.usda``, ``.usdc`` or ``.usdz`` (through pxr), ``.stl``, ``.obj``.

    Returns
    -------
    Packing
        Grains in the order of the file, in SI. Faces are those of the file: triangles, as a rule. Surfaces of STL and
        OBJ are parted into their pieces, a grain each, even within one solid or object. What a format does not hold is
        a default: the density of quartz, and a box around the grains as domain.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If the suffix is unknown, the file is damaged or holds no grains, or a body of it has several meshes. Shapes
        that are open, turned inside out or not convex are read as they are: `grainsdem.validate` names them.
    """
    path = Path(path)
    if path.suffix.lower() not in READERS:
        raise FileFormatError(f"{path}: files are read from {', '.join(READERS)}; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    # What overflows is infinite, which validation names.
    with refusing(path, "damaged or incomplete"), np.errstate(all="ignore"):
        packing: Packing = import_module(READERS[path.suffix.lower()]).read(path)
    return packing.with_step("read", format=path.suffix.lower())


@gated
def rounding(packing: Packing, suffix: str) -> float:
    """Return how far [m] single precision may have moved the vertices of a packing that was read off their planes.

    Zero for a suffix that is not read here: HDF5 keeps every digit.
    """
    if suffix.lower() not in READERS:
        return 0.0
    module = import_module(READERS[suffix.lower()])
    vertices = packing.grains.vertices if module.IS_LOCAL else world_vertices(packing)
    farthest = float(np.nanmax(np.abs(vertices), initial=0.0))
    # Half a step along each of three axes, for a vertex and for the plane that it should lie in.
    return float(module.ROUNDINGS * np.sqrt(3) * np.spacing(np.float32(farthest)))
