"""What every reader ends with: shapes and poses made a packing."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import FileFormatError, name_offenders, shown
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.geometry.rotations import identity_quaternions
from grainsdem.model import QUARTZ_DENSITY, Domain, Packing, Polyhedra
from grainsdem.model.arrays import LONGEST, SHORTEST
from grainsdem.ragged import offsets_from_counts, owners

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]


_UNIT = re.compile(r"^\s*(#|grainsdem,)?\s*unit\b|\bunit\s+([-+.\d]|\S+\s+m\b)")
"""A first line that says what length is one."""


@dataclass(frozen=True, slots=True, eq=False)
class Shape:
    """One grain of a file.

    Parameters
    ----------
    points : ndarray, shape (k, 3)
        Vertices [m] in the grain's frame.
    corners : ndarray of int, shape (c,)
        Vertices of its faces, one face after another.
    counts : ndarray of int, shape (f,)
        Number of corners of each face.
    """

    points: Floats
    corners: NDArray[np.int32]
    counts: NDArray[np.int32]


def refuse_several(path: Path, names: list[str]) -> None:
    """Raise `FileFormatError` where a body has more than one mesh; ``names`` is the body of each mesh."""
    several = [name for name, count in Counter(names).items() if count > 1]
    if several:
        raise FileFormatError(f"{path}: a grain is a body with one mesh; not so: {name_offenders(several)}")


def gather(path: Path, shapes: list[Shape]) -> Polyhedra:
    """Return the shapes as flat arrays, or raise `FileFormatError` where there is none."""
    if not shapes:
        raise FileFormatError(f"{path}: holds no grains")
    return Polyhedra(
        np.concatenate([shape.points for shape in shapes]),
        offsets_from_counts([len(shape.points) for shape in shapes]),
        offsets_from_counts([len(shape.counts) for shape in shapes]),
        np.concatenate([shape.corners for shape in shapes]),
        offsets_from_counts(np.concatenate([shape.counts for shape in shapes])),
    )


def placed(
    shapes: Polyhedra, positions: Floats, quaternions: Floats, masses: Floats, domain: Domain | None = None
) -> Packing:
    """Return shapes with poses and masses [kg] as a packing; a grain without volume gets the density of quartz."""
    sizes = volumes(shapes)
    densities = np.divide(masses, sizes, out=np.full(len(shapes), QUARTZ_DENSITY), where=sizes > 0)
    return Packing(shapes, positions, quaternions, densities, domain or _box_around(shapes, positions))


def from_soup(
    path: Path,
    corners: NDArray[np.float32],
    offsets: NDArray[np.int64],
    grain_of: NDArray[np.int64],
    length: float = 1.0,
) -> Packing:
    """Return polygons in the world as a packing; corners of one grain that are equal to the bit are one vertex.

    Parameters
    ----------
    path : Path
        Where they are from.
    corners : ndarray of float32, shape (c, 3)
        Corners of the polygons, one after another.
    offsets : ndarray of int64, shape (m + 1,)
        Corners of polygon i are ``corners[offsets[i]:offsets[i + 1]]``.
    grain_of : ndarray of int64, shape (m,)
        Grain of each polygon, from 0 without gaps, not falling.
    length : float
        What length [m] is one.
    """
    if not len(grain_of):
        raise FileFormatError(f"{path}: holds no faces")
    n = int(grain_of[-1]) + 1
    # Rows of numbers that sort as one: the grain, then the bits of the coordinates. Zero has two signs; it gets one.
    rows = np.empty((len(corners), 4), dtype=np.int64)
    rows[:, 0] = np.repeat(grain_of, np.diff(offsets))
    rows[:, 1:] = (corners.astype(np.float32) + np.float32(0.0)).view(np.int32)
    vertices, first, index = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    vertex_offsets = offsets_from_counts(np.bincount(vertices[:, 0], minlength=n))
    points = corners.astype(np.float64)[first] * length
    owner = owners(vertex_offsets)
    sums = np.stack([np.bincount(owner, points[:, k], n) for k in range(3)], axis=1)
    positions: Floats = sums / np.diff(vertex_offsets)[:, None]
    shapes = Polyhedra(
        points - positions[owner],
        vertex_offsets,
        offsets_from_counts(np.bincount(grain_of, minlength=n)),
        (index.ravel() - vertex_offsets[rows[:, 0]]).astype(np.int32),
        offsets,
    )
    shapes, positions = _about_centroids(shapes, positions)
    return placed(shapes, positions, identity_quaternions(n), QUARTZ_DENSITY * volumes(shapes))


def with_classes(packing: Packing, numbers: ArrayLike) -> Packing:
    """Return a packing whose grains have classes, or as it is where one of the numbers is no class."""
    told = np.asarray(numbers)
    is_class = told.size == len(packing) and bool(((told >= 0) & (told == np.floor(told)) & (told < 2**31)).all())
    return replace(packing, classes=told.astype(np.int32)) if is_class else packing


def unit_of(line: str) -> float:
    """Return what length [m] is one, as our writers say in the first line where it is not a metre.

    Another's line may speak of a unit, too: a name that holds the word says nothing, a number behind it does.
    """
    if not _UNIT.search(line):
        return 1.0
    told = re.search(r"\bunit\s+(\d+(?:\.\d+)?(?:e[-+]?\d+)?)\s+m\b", line)
    length = float(told[1]) if told else 0.0
    if not SHORTEST <= length <= LONGEST:
        raise FileFormatError(
            f"the unit in its first line must be a length above 0, such as 'unit 0.001 m'; got {shown(line.strip())}"
        )
    return length


def _about_centroids(shapes: Polyhedra, positions: Floats) -> tuple[Polyhedra, Floats]:
    """Move the origin of each shape to its centroid, where it has one: an open or flat shape may have none."""
    measured = integrate(shapes)
    has_one = (measured.volumes > 0) & np.isfinite(measured.centroids).all(axis=1)
    centroids = np.where(has_one[:, None], measured.centroids, 0.0)
    moved = replace(shapes, vertices=shapes.vertices - centroids[owners(shapes.vertex_offsets)])
    return moved, positions + centroids


def _box_around(shapes: Polyhedra, positions: Floats) -> Domain:
    """Return a box around spheres that hold the grains, whatever their rotations."""
    owner = owners(shapes.vertex_offsets)
    radii = np.zeros(len(shapes))
    np.fmax.at(radii, owner, np.linalg.norm(shapes.vertices, axis=1))
    held = np.isfinite(positions).all(axis=1) & np.isfinite(radii)
    if not held.any():
        raise FileFormatError("none of its grains has vertices that are all finite")
    lower = (positions - radii[:, None])[held].min(axis=0)
    upper = (positions + radii[:, None])[held].max(axis=0)
    return Domain(lower, np.maximum(upper, np.nextafter(lower, np.inf)))
