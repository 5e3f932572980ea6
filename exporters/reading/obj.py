"""Wavefront OBJ, one object a grain, kept in single precision as most readers keep it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from exporters.reading.rebuild import from_soup
from grainsdem.errors import FileFormatError

if TYPE_CHECKING:
    from pathlib import Path

    from grainsdem.model import Packing

IS_LOCAL = False
ROUNDINGS = 1


def read(path: Path) -> Packing:
    """Read an OBJ file of triangles; every ``o`` begins a grain."""
    points: list[list[str]] = []
    loops: list[list[int]] = []
    grain_of: list[int] = []
    grain, length = -1, 1.0
    try:
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            words = line.split()
            if not words:
                continue
            if words[:2] == ["#", "unit"]:
                length = float(words[2])
            elif words[0] == "o":
                grain += 1
            elif words[0] == "v":
                points.append(words[1:4])
            elif words[0] == "f":
                loops.append([int(word.split("/")[0]) for word in words[1:]])
                grain_of.append(max(grain, 0))
        vertices = np.array(points, dtype=np.float32).reshape(-1, 3)
        faces = np.array(loops, dtype=np.int64).reshape(-1, 3)
    except ValueError as error:
        raise FileFormatError(f"{path}: not vertices of three numbers and faces of three vertices") from error
    faces = np.where(faces < 0, faces + len(vertices), faces - 1)
    if faces.size and not (faces.min() >= 0 and faces.max() < len(vertices)):
        raise FileFormatError(f"{path}: faces name vertices up to {faces.max() + 1}; there are {len(vertices)}")
    _, dense = np.unique(np.array(grain_of, dtype=np.int64), return_inverse=True)
    return from_soup(path, vertices[faces], dense, length)
