"""STL, binary or ASCII: triangles in metres for CFD meshers, printers and viewers.

Every reader keeps STL in single precision, so the surface is made from rounded vertices: whatever the rounding does,
each grain is closed and no triangle is without area.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from exporters.check import (
    STRETCH,
    check_choice,
    check_name,
    grain_names,
    measured,
    refuse,
    shapes_of,
    stretches,
)
from exporters.text import filled
from exporters.units import check_units, chosen_units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles, vector_areas
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts, owners, sum_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.units import Units
    from grainsdem.model import Packing

    Singles = NDArray[np.float32]
    Offsets = NDArray[np.int64]

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of binary STL."""

_FACET = """\
  facet normal %.9g %.9g %.9g
    outer loop
      vertex %.9g %.9g %.9g
      vertex %.9g %.9g %.9g
      vertex %.9g %.9g %.9g
    endloop
  endfacet
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class StlOptions:
    """What kind of STL is written.

    Parameters
    ----------
    binary : bool
        Binary, with a table beside it that says which triangles are which grain's; else ASCII, one named solid a grain.
    per_grain : bool
        One file a grain, ``bed/g000000.stl`` and on, in place of one for all.
    origin : {"world", "domain"}
        Where the file's origin lies: that of the packing, or the lower corner of its domain, for a packing so far
        from its origin that single precision would blur it.
    units : {"si", "mm", "grain"} or float
        Metres, millimetres, median grain diameters, or another length in metres. What is not metres is said in the
        header of a binary file and after the name of a solid.

    Raises
    ------
    InputError
        If the origin or the units are not among those allowed.
    """

    binary: bool = True
    per_grain: bool = False
    origin: Literal["world", "domain"] = "world"
    units: Units = "si"

    def __post_init__(self) -> None:
        check_choice("origin", self.origin, ("world", "domain"))
        check_units(self.units)


Options = StlOptions

LOSES = (
    "Polygons are cut into triangles, and vertices are rounded to single precision.",
    "Masses, densities and poses are not carried; which triangles are which grain's stands in the table beside it.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".stl", options: StlOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the surface of all grains, and for binary ``bed.grains.csv``: grain, first triangle, number of triangles.

    Raises
    ------
    InputError
        If the packing is empty or not finite, lies so far from the origin that single precision would move vertices by
        more than 1e-4 diameters, or a grain is too flat to keep a volume in single precision.
    """
    check_name(name)
    options = options or StlOptions()
    sizes = measured(packing).volumes
    length = chosen_units(options.units, sizes, packing.densities).length
    counts = _counted(packing, sizes, options.origin, length)
    if options.per_grain:
        return _one_a_grain(packing, name, suffix, options, length)
    if not options.binary:
        return {f"{name}{suffix}": _ascii(packing, options.origin, length)}
    return {
        f"{name}{suffix}": _binary(packing, int(counts.sum()), options.origin, length),
        f"{name}.grains.csv": _table(counts),
    }


def factors(packing: Packing, options: StlOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI; it has no masses and no times."""
    length = chosen_units(options.units, integrate(packing.grains).volumes, packing.densities).length
    return {"length": length, "mass": 1.0, "time": 1.0}


def surface(packing: Packing, origin: Literal["world", "domain"] = "world") -> tuple[Singles, Offsets]:
    """Return the triangles of all grains in single precision, each grain closed, none without area.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    origin : {"world", "domain"}
        Where the origin lies.

    Returns
    -------
    corners : ndarray of float32, shape (m, 3, 3)
        Corners [m] of each triangle, counter-clockwise seen from outside.
    offsets : ndarray of int64, shape (n + 1,)
        Triangles of grain i are ``corners[offsets[i]:offsets[i + 1]]``.

    Raises
    ------
    InputError
        As `files`.
    """
    counts = _counted(packing, measured(packing).volumes, origin, 1.0)
    corners = [part.corners for _, part in _surfaces(packing, origin, 1.0)]
    return np.concatenate(corners), offsets_from_counts(counts)


class _Surface(NamedTuple):
    """The triangles of some grains, where each grain's begin, and what is left of them."""

    corners: Singles
    offsets: Offsets
    grains: Polyhedra
    is_flat: NDArray[np.bool_]


def _surfaces(packing: Packing, origin: str, length: float) -> Iterator[tuple[int, _Surface]]:
    """Yield the number of the first grain of each stretch, and the surface of its grains in lengths of the file."""
    shift = packing.domain.lower if origin == "domain" else 0.0
    for first, part in stretches(packing):
        world = (world_vertices(part) - shift) / length
        yield first, _surface(replace(part.grains, vertices=world.astype(np.float32).astype(np.float64)))


def _surface(grains: Polyhedra) -> _Surface:
    """Return the surface of grains whose vertices are rounded already."""
    corners, offsets = _cut(grains)
    flat = owners(offsets)[_without_area(corners)]
    if flat.size:
        grains = _without_doubles(grains, np.unique(flat))
        corners, offsets = _cut(grains)
        flat = owners(offsets)[_without_area(corners)]
    is_flat = np.zeros(len(grains), dtype=bool)
    is_flat[flat] = True
    return _Surface(corners, offsets, grains, is_flat)


def _without_area(corners: Singles) -> NDArray[np.int64]:
    """Return the triangles that have no area."""
    areas = vector_areas(corners)
    return np.flatnonzero((areas[:, 0] == 0) & (areas[:, 1] == 0) & (areas[:, 2] == 0))


def _counted(packing: Packing, volumes: NDArray[np.float64], origin: str, length: float) -> Offsets:
    """Return the number of triangles of each grain, once all grains are known to keep their volume."""
    farthest = 0.0
    counts = np.empty(len(packing), dtype=np.int64)
    bad = np.empty(len(packing), dtype=bool)
    for first, part in _surfaces(packing, origin, length):
        grains = slice(first, first + len(part.grains))
        counts[grains] = np.diff(part.offsets)
        farthest = max(farthest, float(np.abs(part.grains.vertices).max()) * length)
        # A hundredth of the volume: what is left of a flake is closed, but no longer the grain.
        kept = integrate(part.grains).volumes * length**3
        bad[grains] = part.is_flat | (np.abs(kept / volumes[grains] - 1.0) > 0.01)
    _refuse_far(farthest, float(np.cbrt(volumes.min() * 6.0 / np.pi)))
    refuse("grains must not be so flat or small that single precision takes their volume", bad)
    return counts


def _refuse_far(farthest: float, diameter: float) -> None:
    """Raise `InputError` where single precision would move a vertex by more than 1e-4 diameters."""
    step = float(np.spacing(np.float32(farthest)))
    if step > 1e-4 * diameter:
        raise InputError(
            f"STL is read in single precision: {farthest:.4g} m from the origin its step is {step:.2g} m, more than "
            f"1e-4 of the smallest grain's {diameter:.4g} m; move the packing to the origin, or pass origin='domain'"
        )


def _cut(grains: Polyhedra) -> tuple[Singles, Offsets]:
    """Return the corners of the triangles, shape (m, 3, 3), and the offsets of each grain's."""
    cut = triangles(grains, apexes=best_apexes(grains))
    firsts = np.repeat(grains.vertex_offsets[:-1], np.diff(cut.offsets))
    return grains.vertices.astype(np.float32)[cut.indices + firsts[:, None]], cut.offsets


def _without_doubles(grains: Polyhedra, rows: NDArray[np.int64]) -> Polyhedra:
    """Return the grains, edges and faces that rounding made points or lines taken out of the given ones.

    An edge whose ends have become one vertex vanishes from both of its faces, and a face left with two corners vanishes
    between its neighbours, which then share that edge: what was closed stays closed.
    """
    corners = grains.face_vertices.copy()
    is_kept = np.ones(corners.size, dtype=bool)
    keeps_face = np.ones(grains.n_faces, dtype=bool)
    starts = grains.face_vertex_offsets
    for i in rows.tolist():
        _, first, inverse = np.unique(grains.vertices_of(i), axis=0, return_index=True, return_inverse=True)
        same_as = first[inverse.ravel()]
        for f in range(grains.face_offsets[i], grains.face_offsets[i + 1]):
            loop = same_as[corners[starts[f] : starts[f + 1]]]
            corners[starts[f] : starts[f + 1]] = loop
            differs = loop != np.roll(loop, 1)
            keeps_face[f] = np.count_nonzero(differs) > 2
            is_kept[starts[f] : starts[f + 1]] = differs & keeps_face[f]
    counts = sum_rows(is_kept.astype(np.int64), starts)[keeps_face]
    face_counts = sum_rows(keeps_face.astype(np.int64), grains.face_offsets)
    return Polyhedra(
        grains.vertices, grains.vertex_offsets, offsets_from_counts(face_counts), corners[is_kept],
        offsets_from_counts(counts),
    )  # fmt: skip


def _unit_normals(corners: Singles) -> NDArray[np.float64]:
    """Return the outward unit normal of each triangle, shape (m, 3)."""
    normals = vector_areas(corners)
    lengths = np.sqrt(np.einsum("ij,ij->i", normals, normals))
    normals /= lengths[:, None]
    return normals


def binary(corners: Singles) -> bytes:
    """Return binary STL: 80 bytes of header, the number of triangles, 50 bytes each."""
    return _head(len(corners), 1.0) + _records(corners)


def _head(n_triangles: int, length: float) -> bytes:
    """Return the header of a binary file and the number of its triangles."""
    unit = "metres" if length == 1.0 else f"unit {length!r} m"
    # It must not begin with "solid", which is ASCII's mark.
    return f"grainsdem, {unit}".encode().ljust(80) + n_triangles.to_bytes(4, "little")


def _records(corners: Singles) -> bytes:
    """Return fifty bytes a triangle."""
    records = np.zeros(len(corners), dtype=RECORD)
    records["normal"] = _unit_normals(corners)
    records["corners"] = corners
    return records.tobytes()


def _binary(packing: Packing, n_triangles: int, origin: str, length: float) -> Iterator[bytes]:
    """Yield binary STL, a stretch of grains at a time."""
    yield _head(n_triangles, length)
    for _, part in _surfaces(packing, origin, length):
        yield _records(part.corners)


def _table(counts: Offsets) -> Iterator[bytes]:
    """Yield which triangles are which grain's."""
    yield b"grain,first_triangle,n_triangles\n"
    table = np.stack([np.arange(counts.size), np.cumsum(counts) - counts, counts], axis=1)
    for start in range(0, counts.size, STRETCH):
        rows = table[start : start + STRETCH]
        yield "".join(filled("%d,%d,%d\n", rows, np.ones(len(rows), dtype=np.int64))).encode()


def _ascii(packing: Packing, origin: str, length: float) -> Iterator[bytes]:
    """Yield ASCII STL: one solid a grain."""
    names = grain_names(packing)
    unit = "" if length == 1.0 else f" unit {length!r} m"
    for first, part in _surfaces(packing, origin, length):
        normals = _unit_normals(part.corners)[:, None, :]
        facets = filled(
            _FACET, np.concatenate([normals, part.corners.astype(np.float64)], axis=1), np.diff(part.offsets)
        )
        rows = zip(names[first:], facets, strict=False)  # names of the stretches after this one are left over
        yield "".join([f"solid {name}{unit}\n{body}endsolid {name}\n" for name, body in rows]).encode()


def _one_a_grain(
    packing: Packing, name: str, suffix: str, options: StlOptions, length: float
) -> dict[str, bytes | Iterable[bytes]]:
    """Return a file for every grain in a folder, made as it is written."""

    def content(i: int) -> Iterator[bytes]:
        alone = replace(
            packing,
            grains=shapes_of(packing.grains, i, i + 1),
            positions=packing.positions[i : i + 1],
            quaternions=packing.quaternions[i : i + 1],
            densities=packing.densities[i : i + 1],
            links=None,
        )
        for _, part in _surfaces(alone, options.origin, length):
            yield binary(part.corners)

    return {f"{name}/{grain}{suffix}": content(i) for i, grain in enumerate(grain_names(packing))}
