"""GLB (binary glTF 2.0): one node and one mesh a grain, for browsers, Blender and game engines."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import check_name, measured
from exporters.container import GRAIN_COLOURS, shades
from exporters.text import filled
from grainsdem.errors import InputError
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing

FLOAT, UNSIGNED_SHORT = 5126, 5123
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Numbers of the glTF specification."""

_VIEWS = (
    f'{{"buffer":0,"byteOffset":%d,"byteLength":%d,"target":{ARRAY_BUFFER}}},'
    f'{{"buffer":0,"byteOffset":%d,"byteLength":%d,"target":{ELEMENT_ARRAY_BUFFER}}}'
)
_ACCESSORS = (
    f'{{"bufferView":%d,"componentType":{FLOAT},"count":%d,"type":"VEC3",'
    '"min":[%.9g,%.9g,%.9g],"max":[%.9g,%.9g,%.9g]},'
    f'{{"bufferView":%d,"componentType":{UNSIGNED_SHORT},"count":%d,"type":"SCALAR"}}'
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
    """

    colours: bool = True


Options = GlbOptions

LOSES = (
    "Polygons are cut into triangles; vertices and poses are in single precision.",
    "Mass and density of each grain stand in its node's extras, which few programs read.",
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
        If the packing is empty or not finite, a grain has more vertices than 16 bits count, or the file would be longer
        than the 4 GiB that the format allows.
    """
    check_name(name)
    integrals = measured(packing)
    options = options or GlbOptions()
    most = int(np.diff(packing.grains.vertex_offsets).max())
    if most > np.iinfo(np.uint16).max:
        raise InputError(f"a grain of a GLB file has at most {np.iinfo(np.uint16).max} vertices; got one of {most}")
    points = packing.grains.vertices.astype("<f4")
    cut = triangles(packing.grains, apexes=best_apexes(packing.grains))
    indices, starts, counts = _padded(cut.indices, cut.offsets)
    text = _document(packing, integrals, points, (starts, counts), options)
    text += b" " * (-len(text) % 4)
    binary = points.nbytes + indices.nbytes
    total = 12 + 8 + len(text) + 8 + binary
    if total >= MOST:
        raise InputError(f"a GLB file has less than {MOST} bytes; these {len(packing)} grains need {total}")
    head = b"glTF" + (2).to_bytes(4, "little") + total.to_bytes(4, "little")
    head += len(text).to_bytes(4, "little") + b"JSON"
    parts = (head, text, binary.to_bytes(4, "little"), b"BIN\0", points, indices)
    return {f"{name}{suffix}": (part if isinstance(part, bytes) else part.tobytes() for part in parts)}


def _padded(
    triangle_indices: NDArray[np.int32], offsets: NDArray[np.int64]
) -> tuple[NDArray[np.uint16], NDArray[np.int64], NDArray[np.int64]]:
    """Return the corners of all triangles, each grain's beginning at a multiple of four bytes; starts and counts."""
    counts = 3 * np.diff(offsets)
    starts = offsets_from_counts(counts + counts % 2)
    indices = np.zeros(starts[-1], dtype="<u2")
    places = np.arange(triangle_indices.size) + np.repeat(starts[:-1] - 3 * offsets[:-1], counts)
    indices[places] = triangle_indices.ravel()
    return indices, starts[:-1], counts


def _document(
    packing: Packing,
    integrals: Integrals,
    points: NDArray[np.float32],
    triangle_corners: tuple[NDArray[np.int64], NDArray[np.int64]],
    options: GlbOptions,
) -> bytes:
    """Return the JSON part: what each grain has as text made from patterns, the rest by the library."""
    offsets = packing.grains.vertex_offsets
    n = len(packing)
    starts, counts = triangle_corners
    numbers = np.arange(n)
    vertex_counts = np.diff(offsets)
    shade = shades(n) if options.colours else np.zeros(n, dtype=np.int64)
    colours = list(GRAIN_COLOURS.items()) if options.colours else [("grain", (0.6, 0.6, 0.6))]
    turn = float(np.sqrt(0.5))
    rest = {
        "asset": {"version": "2.0", "generator": "grainsdem", "extras": {"unit": "metre"}},
        "scene": 0,
        "scenes": [{"nodes": [n]}],
        "materials": [
            {
                "name": word,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8,
                },
            }
            for word, colour in colours
        ],
        "buffers": [{"byteLength": points.nbytes + 2 * int(starts[-1] + counts[-1] + counts[-1] % 2)}],
    }  # fmt: skip
    root = {"name": "grains", "rotation": [-turn, 0.0, 0.0, turn], "children": list(range(n))}
    lists = {
        "bufferViews": [_rows(_VIEWS, [12 * offsets[:-1], 12 * vertex_counts, points.nbytes + 2 * starts, 2 * counts])],
        "accessors": [
            _rows(
                _ACCESSORS,
                [
                    2 * numbers, vertex_counts, *np.minimum.reduceat(points, offsets[:-1]).T,
                    *np.maximum.reduceat(points, offsets[:-1]).T, 2 * numbers + 1, counts,
                ],
            )
        ],
        # No normals: a reader must then shade every triangle flat, as grains are.
        "meshes": [_rows(_MESH, [numbers, 2 * numbers, 2 * numbers + 1, shade])],
        "nodes": [
            _rows(
                _NODE,
                [
                    numbers, numbers, *packing.positions.T, *np.roll(packing.quaternions, -1, axis=1).T, numbers,
                    packing.densities * integrals.volumes, packing.densities,
                ],
            ),
            json.dumps(root, separators=(",", ":")),
        ],
    }  # fmt: skip
    body = ",".join(f'"{key}":[{",".join(rows)}]' for key, rows in lists.items())
    return f"{json.dumps(rest, separators=(',', ':'))[:-1]},{body}}}".encode()


def _rows(pattern: str, columns: list[NDArray[Any]]) -> str:
    """Return the pattern filled once a grain, separated by commas."""
    # In double precision whole numbers of the file's size are exact, and so are single ones.
    values = np.column_stack([np.asarray(column, dtype=np.float64) for column in columns])
    return ",".join(filled(pattern, values, np.ones(len(values), dtype=np.int64)))
