"""GLB (binary glTF 2.0): one node and one mesh a grain, for browsers, Blender and game engines."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import check_name, measured, stretches
from exporters.container import GRAIN_COLOURS, shades
from exporters.meshes.fewer import FEWEST, fewer_corners
from exporters.meshes.union import united, what_united
from exporters.text import filled
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from numpy.typing import NDArray

    from grainsdem.model import Packing

FLOAT, UNSIGNED_SHORT, UNSIGNED_INT = 5126, 5123, 5125
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Numbers of the glTF specification."""

_VIEWS = (
    f'{{"buffer":0,"byteOffset":%d,"byteLength":%d,"target":{ARRAY_BUFFER}}},'
    f'{{"buffer":0,"byteOffset":%d,"byteLength":%d,"target":{ELEMENT_ARRAY_BUFFER}}}'
)
_ACCESSORS = (
    f'{{"bufferView":%d,"componentType":{FLOAT},"count":%d,"type":"VEC3",'
    '"min":[%.9g,%.9g,%.9g],"max":[%.9g,%.9g,%.9g]},'
    '{"bufferView":%d,"componentType":%d,"count":%d,"type":"SCALAR"}'
)
_MESH = '{"name":"g%06d","primitives":[{"attributes":{"POSITION":%d},"indices":%d,"material":%d}]}'
_NODE = (
    '{"name":"g%06d","mesh":%d,"translation":[%.17g,%.17g,%.17g],"rotation":[%.17g,%.17g,%.17g,%.17g],'
    '"extras":{"grain":%d,"mass":%.17g,"density":%.17g}}'
)

MOST = 1 << 32
"""Bytes that the length of a GLB file can count."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GlbOptions:
    """How the grains look.

    Parameters
    ----------
    colours : bool
        Whether grains have the colours of minerals; else all are one grey.
    lod : int, optional
        Most corners of a grain, 6 at least: grains that have more are drawn as the convex hull of so many of theirs,
        inside what they are. Masses stay those of the grains.
    merge : bool
        One node and mesh of one surface, the union of all grains, in one grey; what viewers draw much faster.

    Raises
    ------
    InputError
        If ``lod`` is no whole number of 6 or more.
    """

    colours: bool = True
    lod: int | None = None
    merge: bool = False

    def __post_init__(self) -> None:
        is_whole = isinstance(self.lod, (int, np.integer)) and not isinstance(self.lod, bool)
        if self.lod is not None and not (is_whole and self.lod >= FEWEST):
            raise InputError(
                f"lod, the most corners of a grain, must be a whole number from {FEWEST}; got {self.lod!r}"
            )


Options = GlbOptions

LOSES = (
    "Polygons are cut into triangles; vertices and poses are in single precision.",
    "Mass, density and class of each grain stand in its node's extras, which few programs read.",
)
"""What the format does not carry."""


def files(
    packing: Packing, *, name: str = "bed", suffix: str = ".glb", options: GlbOptions | None = None
) -> dict[str, Iterator[bytes]]:
    """Return the one file: a node ``g000000`` a grain with its pose, below one that turns z up into glTF's y up.

    Vertices are about the grain's centroid, in metres.

    Raises
    ------
    InputError
        If the packing is empty or not finite, or the file would be longer than the 4 GiB that the format allows.
    """
    check_name(name)
    masses = packing.densities * measured(packing).volumes
    options = options or GlbOptions()
    n_grains = len(packing)
    packing = _drawn(packing, options)
    if options.merge:
        packing = united(packing, mass=float(masses.sum()))
        masses = masses.sum(keepdims=True)
    # The largest number of 16 bits is no index: it restarts a strip.
    is_wide = int(np.diff(packing.grains.vertex_offsets).max()) > np.iinfo(np.uint16).max
    kind = np.dtype("<u4" if is_wide else "<u2")
    counts = _corner_counts(packing)
    text = list(_document(packing, masses, counts, kind, options))
    length = sum(map(len, text))
    text.append(b" " * (-length % 4))
    length += -length % 4
    binary = _points_size(packing) + kind.itemsize * int((counts + counts % 2).sum())
    total = 12 + 8 + length + 8 + binary
    if total >= MOST:
        raise InputError(f"a GLB file has less than {MOST} bytes; these {n_grains} grains need {total}")
    head = b"glTF" + (2).to_bytes(4, "little") + total.to_bytes(4, "little")
    head += length.to_bytes(4, "little") + b"JSON"
    parts = chain([head], text, [binary.to_bytes(4, "little"), b"BIN\0"], _points(packing), _indices(packing, kind))
    return {f"{name}{suffix}": parts}


def report(packing: Packing, options: GlbOptions) -> dict[str, Any]:
    """Return what fewer corners take from the volume, and what merging does to the grains; of neither, nothing."""
    told: dict[str, Any] = {}
    drawn = _drawn(packing, options)
    if options.lod is not None:
        before, after = volumes(packing.grains), volumes(drawn.grains)
        told["volume_lost"] = float(1.0 - after.sum() / before.sum())
        told["largest_volume_lost_by_a_grain"] = float((1.0 - after / before).max())
        told["triangles_a_grain"] = float(_corner_counts(drawn).mean() / 3)
    return {**told, **what_united(drawn)} if options.merge else told


def _drawn(packing: Packing, options: GlbOptions) -> Packing:
    """Return the grains with as many corners as are drawn."""
    if options.lod is None:
        return packing
    return replace(packing, grains=fewer_corners(packing.grains, options.lod), links=None)


def _corner_counts(packing: Packing) -> NDArray[np.int64]:
    """Return how many corners the triangles of each grain have, shape (n,)."""
    faces = packing.grains.face_offsets
    counts: NDArray[np.int64] = 3 * (np.diff(packing.grains.face_vertex_offsets[faces]) - 2 * np.diff(faces))
    return counts


def _points_size(packing: Packing) -> int:
    return 12 * len(packing.grains.vertices)


def _points(packing: Packing) -> Iterator[bytes]:
    """Yield the vertices of all grains about their centroids."""
    return (part.grains.vertices.astype("<f4").tobytes() for _, part in stretches(packing))


def _indices(packing: Packing, kind: np.dtype[Any]) -> Iterator[bytes]:
    """Yield the corners of all triangles, each grain's beginning at a multiple of four bytes."""
    for _, part in stretches(packing):
        cut = triangles(part.grains, apexes=best_apexes(part.grains))
        counts = 3 * np.diff(cut.offsets)
        starts = offsets_from_counts(counts + counts % 2)
        indices = np.zeros(starts[-1], dtype=kind)
        places = np.arange(cut.indices.size) + np.repeat(starts[:-1] - 3 * cut.offsets[:-1], counts)
        indices[places] = cut.indices.ravel()
        yield indices.tobytes()


def _document(
    packing: Packing, masses: NDArray[np.float64], counts: NDArray[np.int64], kind: np.dtype[Any], options: GlbOptions
) -> Iterator[bytes]:
    """Yield the JSON part: what each grain has as text made from patterns, the rest by the library."""
    grains, n = packing.grains, len(packing)
    width = kind.itemsize
    starts = _points_size(packing) + width * offsets_from_counts(counts + counts % 2)
    is_coloured = options.colours and not options.merge
    colours = list(GRAIN_COLOURS.items()) if is_coloured else [("grain", (0.6, 0.6, 0.6))]
    shade = shades(n) if is_coloured else np.zeros(n, dtype=np.int64)
    turn = float(np.sqrt(0.5))
    rest = {
        "asset": {"version": "2.0", "generator": "grainsdem", "extras": {"unit": "metre"}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "materials": [
            {
                "name": word,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8,
                },
            }
            for word, colour in colours
        ],
        "buffers": [{"byteLength": int(starts[-1])}],
    }  # fmt: skip
    root = {"name": "grains", "rotation": [-turn, 0.0, 0.0, turn], "children": list(range(1, n + 1))}
    component = np.full(n, UNSIGNED_INT if width == 4 else UNSIGNED_SHORT)

    def views(i: NDArray[np.int64], _: Packing) -> list[NDArray[Any]]:
        offsets = grains.vertex_offsets
        return [12 * offsets[i], 12 * (offsets[i + 1] - offsets[i]), starts[i], width * counts[i]]

    def accessors(i: NDArray[np.int64], part: Packing) -> list[NDArray[Any]]:
        points, firsts = part.grains.vertices.astype("<f4"), part.grains.vertex_offsets
        bounds = [*np.minimum.reduceat(points, firsts[:-1]).T, *np.maximum.reduceat(points, firsts[:-1]).T]
        return [2 * i, np.diff(firsts), *bounds, 2 * i + 1, component[i], counts[i]]

    def meshes(i: NDArray[np.int64], _: Packing) -> list[NDArray[Any]]:
        # No normals: a reader must then shade every triangle flat, as grains are.
        return [i, 2 * i, 2 * i + 1, shade[i]]

    def nodes(i: NDArray[np.int64], part: Packing) -> list[NDArray[Any]]:
        turns = np.roll(part.quaternions, -1, axis=1)
        own = [] if part.classes is None else [part.classes]
        return [i, i, *part.positions.T, *turns.T, i, masses[i], part.densities, *own]

    naming = "bed%d" if options.merge else "g%06d"
    node = (_NODE if packing.classes is None else _NODE.replace("}}", ',"class":%d}}')).replace("g%06d", naming)
    yield json.dumps(rest, separators=(",", ":"))[:-1].encode()
    for key, pattern, columns in (
        ("bufferViews", _VIEWS, views),
        ("accessors", _ACCESSORS, accessors),
        ("meshes", _MESH.replace("g%06d", naming), meshes),
    ):
        yield f',"{key}":['.encode()
        yield from _rows(packing, pattern, columns)
        yield b"]"
    yield b',"nodes":[' + json.dumps(root, separators=(",", ":")).encode() + b","
    yield from _rows(packing, node, nodes)
    yield b"]}"


def _rows(
    packing: Packing, pattern: str, columns: Callable[[NDArray[np.int64], Packing], list[NDArray[Any]]]
) -> Iterator[bytes]:
    """Yield the pattern filled once a grain, separated by commas, a stretch of grains at a time."""
    for first, part in stretches(packing):
        # In double precision whole numbers of the file's size are exact, and so are single ones.
        numbers = np.arange(first, first + len(part))
        values = np.column_stack([np.asarray(column, dtype=np.float64) for column in columns(numbers, part)])
        rows = ",".join(filled(pattern, values, np.ones(len(values), dtype=np.int64)))
        yield ("," * (first > 0) + rows).encode()
