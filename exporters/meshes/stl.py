"""STL, binary or ASCII: triangles in metres for CFD meshers, printers and viewers.

Every reader keeps STL in single precision, so the surface is made from rounded vertices: whatever the rounding does,
each grain is closed and no triangle is without area.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from exporters.check import (
    STRETCH,
    check_choice,
    check_name,
    class_texts,
    grain_names,
    measured,
    refuse,
    shapes_of,
    stretches,
)
from exporters.meshes.union import united, what_united
from exporters.text import filled
from exporters.units import check_units, chosen_units
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import Facets, best_fans, facets, vector_areas
from grainsdem.model import Packing, Polyhedra
from grainsdem.ragged import offsets_from_counts, owners, sum_rows
from grainsdem.roots import cube_roots

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from numpy.typing import NDArray

    from exporters.units import Units

    Singles = NDArray[np.float32]
    Offsets = NDArray[np.int64]

RECORD = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
"""One triangle of binary STL."""

TABLE = ".triangles.csv"
"""What the table beside a binary file ends in: which triangles are which grain's."""

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
    merge : bool
        One surface, the union of all grains, without a table.
    origin : {"world", "domain"}
        Where the file's origin lies: that of the packing, or the lower corner of its domain, for a packing so far
        from its origin that single precision would blur it.
    units : {"si", "mm", "grain"} or float
        Metres, millimetres, median grain diameters, or another length in metres. What is not metres is said in the
        header of a binary file and after the name of a solid.

    Raises
    ------
    InputError
        If the origin or the units are not among those allowed, or grains are to be merged and written one by one.
    """

    binary: bool = True
    per_grain: bool = False
    merge: bool = False
    origin: Literal["world", "domain"] = "world"
    units: Units = "si"

    def __post_init__(self) -> None:
        check_choice("origin", self.origin, ("world", "domain"))
        check_units(self.units)
        if self.merge and self.per_grain:
            raise InputError(
                "grains are either merged into one surface or written to a file each; got merge and per_grain"
            )


Options = StlOptions

LOSES = (
    (
        "Polygons are cut into triangles, and vertices are rounded to single precision: a grain's volume changes by up "
        "to some 1e-7 of its distance from the origin over its diameter, by 2.3e-6 at worst in a bed of 16 000."
    ),
    "Masses, densities and poses are not carried; which triangles are which grain's stands in the table beside it.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".stl", options: StlOptions | None = None
) -> dict[str, bytes | Iterable[bytes]]:
    """Return the surface of all grains, and for binary ``bed.triangles.csv``.

    The table has a row a grain: its number, its first triangle, its number of triangles, and where grains have classes
    its own. In ASCII a solid's name is followed by its class, ``solid g000007 class 2``; a binary file of one grain
    alone says it in its header.

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
    if options.merge:
        packing = united(packing)
        sizes = integrate(packing.grains).volumes
    plan = _planned(packing, sizes, options.origin, length)
    if options.per_grain:
        return _one_a_grain(packing, name, suffix, options, length)
    if not options.binary:
        return {f"{name}{suffix}": _ascii(packing, plan)}
    if options.merge:
        return {f"{name}{suffix}": _binary(packing, plan)}
    return {
        f"{name}{suffix}": _binary(packing, plan),
        f"{name}{TABLE}": _table(plan.counts, packing.classes),
    }


def factors(packing: Packing, options: StlOptions) -> dict[str, float]:
    """Return the factors from the file's units to SI; it has no masses and no times."""
    length = chosen_units(options.units, integrate(packing.grains).volumes, packing.densities).length
    return {"length": length, "mass": 1.0, "time": 1.0}


def report(packing: Packing, options: StlOptions) -> dict[str, Any]:
    """Return what single precision does to volumes: of all grains together, and of the grain that it changes most.

    Where grains are merged it is what that does to them.
    """
    if options.merge:
        return what_united(packing)
    sizes = measured(packing).volumes
    length = chosen_units(options.units, sizes, packing.densities).length
    plan = _planned(packing, sizes, options.origin, length)
    kept = length**3 * np.concatenate([_volumes(part) for _, part in _surfaces(packing, plan)])
    return {
        "volume_change": float(kept.sum() / sizes.sum() - 1.0),
        "largest_volume_change_of_a_grain": float(np.abs(kept / sizes - 1.0).max()),
    }


def _volumes(part: Facets) -> NDArray[np.float64]:
    """Return the volume that the triangles of each grain enclose."""
    corners = part.corners.astype(np.float64)
    # About a corner of each grain: far from the origin little would be left of the differences.
    corners -= corners[part.offsets[:-1], 0][owners(part.offsets)][:, None]
    parts = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    return sum_rows(parts, part.offsets)


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
    plan = _planned(packing, measured(packing).volumes, origin, 1.0)
    corners = [part.corners for _, part in _surfaces(packing, plan)]
    return np.concatenate(corners), offsets_from_counts(plan.counts)


class _Plan(NamedTuple):
    """What is known of a surface before it is made: where it lies, and how the faces of each stretch are cut.

    Stretches that lose faces or corners have nothing noted; they are looked at again.
    """

    shift: NDArray[np.float64] | float
    length: float
    counts: Offsets
    apexes: list[NDArray[np.int32] | None]


def _planned(packing: Packing, volumes: NDArray[np.float64], origin: str, length: float) -> _Plan:
    """Return the plan of a surface, once all grains are known to keep their volume in single precision."""
    shift = packing.domain.lower if origin == "domain" else 0.0
    plan = _Plan(shift, length, np.empty(len(packing), dtype=np.int64), [])
    bad = np.empty(len(packing), dtype=bool)
    farthest = 0.0
    for first, part in stretches(packing):
        rounded = _rounded(part, plan)
        grains, apexes, is_flat = _cut(rounded)
        plan.apexes.append(apexes.astype(np.int32) if grains is rounded else None)
        rows = slice(first, first + len(part))
        counts = np.maximum(np.diff(grains.face_vertex_offsets) - 2, 0)
        plan.counts[rows] = sum_rows(counts, grains.face_offsets)
        farthest = max(farthest, float(np.abs(grains.vertices).max()) * length)
        # A hundredth of the volume: what is left of a flake is closed, but no longer the grain.
        kept = integrate(grains).volumes * length**3
        bad[rows] = is_flat | (np.abs(kept / volumes[rows] - 1.0) > 0.01)
    _refuse_far(farthest, float(cube_roots(volumes.min() * 6.0 / np.pi)))
    refuse("grains must not be so flat or small that single precision takes their volume", bad)
    return plan


def _rounded(part: Packing, plan: _Plan) -> Polyhedra:
    """Return grains where they stand, in lengths of the file, their vertices rounded to single precision."""
    world = (world_vertices(part) - plan.shift) / plan.length
    return replace(part.grains, vertices=world.astype(np.float32).astype(np.float64))


def _cut(grains: Polyhedra) -> tuple[Polyhedra, NDArray[np.int64], NDArray[np.bool_]]:
    """Return grains without what rounding made points or lines, the apexes of their faces, and which are flat still."""
    apexes, has_flat = best_fans(grains)
    if has_flat.any():
        grains = _without_doubles(grains, np.unique(owners(grains.face_offsets)[has_flat]))
        apexes, has_flat = best_fans(grains)
    is_flat = np.zeros(len(grains), dtype=bool)
    is_flat[owners(grains.face_offsets)[has_flat]] = True
    return grains, apexes, is_flat


def _surfaces(packing: Packing, plan: _Plan) -> Iterator[tuple[int, Facets]]:
    """Yield the number of the first grain of each stretch, and the surface of its grains."""
    for (first, part), apexes in zip(stretches(packing), plan.apexes, strict=True):
        rounded = _rounded(part, plan)
        yield first, facets(*_cut(rounded)[:2]) if apexes is None else facets(rounded, apexes)


def _refuse_far(farthest: float, diameter: float) -> None:
    """Raise `InputError` where single precision would move a vertex by more than 1e-4 diameters."""
    step = float(np.spacing(np.float32(farthest)))
    if step > 1e-4 * diameter:
        raise InputError(
            f"STL is read in single precision: {farthest:.4g} m from the origin its step is {step:.2g} m, more than "
            f"1e-4 of the smallest grain's {diameter:.4g} m; move the packing to the origin, or pass origin='domain'"
        )


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


def binary(corners: Singles) -> bytes:
    """Return binary STL: 80 bytes of header, the number of triangles, 50 bytes each."""
    normals = vector_areas(corners)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return _head(len(corners), 1.0) + _records(corners, normals)


def _head(n_triangles: int, length: float, own: str = "") -> bytes:
    """Return the header of a binary file, with what it says of one grain alone, and the number of its triangles."""
    unit = "metres" if length == 1.0 else f"unit {length!r} m"
    # It must not begin with "solid", which is ASCII's mark.
    return f"grainsdem, {unit}{own}".encode().ljust(80) + n_triangles.to_bytes(4, "little")


def _records(corners: Singles, normals: NDArray[np.float64]) -> bytes:
    """Return fifty bytes a triangle."""
    records = np.zeros(len(corners), dtype=RECORD)
    records["normal"] = normals
    records["corners"] = corners
    return records.tobytes()


def _binary(packing: Packing, plan: _Plan) -> Iterator[bytes]:
    """Yield binary STL, a stretch of grains at a time."""
    own = class_texts(packing, ", class %d")[0] if len(packing) == 1 else ""
    yield _head(int(plan.counts.sum()), plan.length, own)
    for _, part in _surfaces(packing, plan):
        yield _records(part.corners, part.normals)


def _table(counts: Offsets, classes: NDArray[np.int32] | None) -> Iterator[bytes]:
    """Yield which triangles are which grain's, and of which class it is."""
    columns = {"grain": np.arange(counts.size), "first_triangle": np.cumsum(counts) - counts, "n_triangles": counts}
    if classes is not None:
        columns["class"] = classes.astype(np.int64)
    yield (",".join(columns) + "\n").encode()
    table = np.column_stack(list(columns.values()))
    pattern = ",".join(["%d"] * len(columns)) + "\n"
    for start in range(0, counts.size, STRETCH):
        rows = table[start : start + STRETCH]
        yield "".join(filled(pattern, rows, np.ones(len(rows), dtype=np.int64))).encode()


def _ascii(packing: Packing, plan: _Plan, number: int = 0) -> Iterator[bytes]:
    """Yield ASCII STL, one solid a grain, named from a number on."""
    names = [f"g{i:06d}" for i in range(number, number + len(packing))]
    unit = "" if plan.length == 1.0 else f" unit {plan.length!r} m"
    classes = class_texts(packing, " class %d")
    for first, part in _surfaces(packing, plan):
        numbers = np.concatenate([part.normals[:, None, :], part.corners.astype(np.float64)], axis=1)
        bodies = filled(_FACET, numbers, np.diff(part.offsets))
        # Names of the stretches after this one are left over.
        rows = zip(names[first:], classes[first:], bodies, strict=False)
        yield "".join([f"solid {name}{own}{unit}\n{body}endsolid {name}\n" for name, own, body in rows]).encode()


def _one_a_grain(
    packing: Packing, name: str, suffix: str, options: StlOptions, length: float
) -> dict[str, bytes | Iterable[bytes]]:
    """Return a file for every grain in a folder, made as it is written."""
    volumes = integrate(packing.grains).volumes

    def content(i: int) -> Iterator[bytes]:
        alone = Packing(
            shapes_of(packing.grains, i, i + 1),
            packing.positions[i : i + 1],
            packing.quaternions[i : i + 1],
            packing.densities[i : i + 1],
            packing.domain,
            classes=packing.classes_of(slice(i, i + 1)),
        )
        plan = _planned(alone, volumes[i : i + 1], options.origin, length)
        yield from _binary(alone, plan) if options.binary else _ascii(alone, plan, i)

    return {f"{name}/{grain}{suffix}": content(i) for i, grain in enumerate(grain_names(packing))}
