"""STL, binary or ASCII: triangles in metres for CFD meshers, printers and viewers.

Every reader keeps STL in single precision, so the surface is made from rounded vertices: whatever the rounding does,
each grain is closed and no triangle is without area.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from exporters.check import check_choice, check_name, grain_names, measured, refuse
from exporters.text import filled
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import best_apexes, triangles, vector_areas
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts, owners, sum_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
    origin : {"world", "domain"}
        Where the file's origin lies: that of the packing, or the lower corner of its domain, for a packing so far
        from its origin that single precision would blur it.

    Raises
    ------
    InputError
        If the origin is not one of those allowed.
    """

    binary: bool = True
    origin: Literal["world", "domain"] = "world"

    def __post_init__(self) -> None:
        check_choice("origin", self.origin, ("world", "domain"))


Options = StlOptions

LOSES = (
    "Polygons are cut into triangles, and vertices are rounded to single precision.",
    "Masses, densities and poses are not carried; which triangles are which grain's stands in the table beside it.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".stl", options: StlOptions | None = None
) -> dict[str, bytes]:
    """Return the surface of all grains, and for binary ``bed.grains.csv``: grain, first triangle, number of triangles.

    Raises
    ------
    InputError
        If the packing is empty or not finite, lies so far from the origin that single precision would move vertices by
        more than 1e-4 diameters, or a grain is too flat to keep a volume in single precision.
    """
    check_name(name)
    options = options or StlOptions()
    corners, offsets = surface(packing, options.origin)
    if not options.binary:
        return {f"{name}{suffix}": _ascii(packing, corners, offsets)}
    table = np.stack([np.arange(len(packing)), offsets[:-1], np.diff(offsets)], axis=1)
    rows = filled("%d,%d,%d\n", table, np.ones(len(packing), dtype=np.int64))
    ranges = "grain,first_triangle,n_triangles\n" + "".join(rows)
    return {f"{name}{suffix}": binary(corners), f"{name}.grains.csv": ranges.encode()}


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
    volumes = measured(packing).volumes
    world = world_vertices(packing) - (packing.domain.lower if origin == "domain" else 0.0)
    _refuse_far(world, np.cbrt(volumes.min() * 6.0 / np.pi))
    grains = replace(packing.grains, vertices=world.astype(np.float32).astype(np.float64))
    corners, offsets = _cut(grains)
    flat = owners(offsets)[~vector_areas(corners).any(axis=1)]
    if flat.size:
        grains = _without_doubles(grains, np.unique(flat))
        corners, offsets = _cut(grains)
        flat = owners(offsets)[~vector_areas(corners).any(axis=1)]
    # A hundredth of the volume: what is left of a flake is closed, but no longer the grain.
    bad = np.abs(integrate(grains).volumes / volumes - 1.0) > 0.01
    bad[flat] = True
    refuse("grains must not be so flat or small that single precision takes their volume", bad)
    return corners, offsets


def _refuse_far(vertices: NDArray[np.float64], diameter: float) -> None:
    """Raise `InputError` where single precision would move a vertex by more than 1e-4 diameters."""
    farthest = float(np.abs(vertices).max())
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
    records = np.zeros(len(corners), dtype=RECORD)
    records["normal"] = _unit_normals(corners)
    records["corners"] = corners
    header = b"grainsdem, metres".ljust(80)  # must not begin with "solid", which is ASCII's mark
    return b"".join([header, len(corners).to_bytes(4, "little"), records.tobytes()])


def _ascii(packing: Packing, corners: Singles, offsets: Offsets) -> bytes:
    """Return ASCII STL: one solid a grain."""
    numbers = np.concatenate([_unit_normals(corners)[:, None, :], corners.astype(np.float64)], axis=1)
    facets = filled(_FACET, numbers, np.diff(offsets))
    solids = [f"solid {name}\n{body}endsolid {name}\n" for name, body in zip(grain_names(packing), facets, strict=True)]
    return "".join(solids).encode()
