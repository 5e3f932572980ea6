"""GLB (binary glTF 2.0): one node and one mesh a grain, for browsers, Blender and game engines."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.check import check_name, grain_names, measured
from exporters.container import GRAIN_COLOURS, shades
from grainsdem.errors import InputError
from grainsdem.geometry.triangles import best_apexes, triangles
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.geometry.integrals import Integrals
    from grainsdem.model import Packing

FLOAT, UNSIGNED_SHORT = 5126, 5123
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Numbers of the glTF specification."""

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
) -> dict[str, bytes]:
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
    document = _document(packing, integrals, points, (starts, counts), options)
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    binary = points.nbytes + indices.nbytes
    total = 12 + 8 + len(text) + 8 + binary
    if total >= MOST:
        raise InputError(f"a GLB file has less than {MOST} bytes; these {len(packing)} grains need {total}")
    head = b"glTF" + (2).to_bytes(4, "little") + total.to_bytes(4, "little")
    parts = [head, len(text).to_bytes(4, "little"), b"JSON", text, binary.to_bytes(4, "little"), b"BIN\0"]
    return {f"{name}{suffix}": b"".join([*parts, points.tobytes(), indices.tobytes()])}


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
) -> dict[str, Any]:
    """Return the JSON part."""
    offsets = packing.grains.vertex_offsets
    n = len(packing)
    lower = np.minimum.reduceat(points, offsets[:-1]).tolist()
    upper = np.maximum.reduceat(points, offsets[:-1]).tolist()
    starts, counts = (part.tolist() for part in triangle_corners)
    vertex_counts = np.diff(offsets).tolist()
    shade = (shades(n) if options.colours else np.zeros(n, dtype=np.int64)).tolist()
    masses = (packing.densities * integrals.volumes).tolist()
    quaternions = np.roll(packing.quaternions, -1, axis=1).tolist()
    views, accessors, meshes, nodes = [], [], [], []
    for i, name in enumerate(grain_names(packing)):
        views.append({
            "buffer": 0, "byteOffset": 12 * int(offsets[i]), "byteLength": 12 * vertex_counts[i],
            "target": ARRAY_BUFFER,
        })  # fmt: skip
        views.append({
            "buffer": 0, "byteOffset": points.nbytes + 2 * starts[i], "byteLength": 2 * counts[i],
            "target": ELEMENT_ARRAY_BUFFER,
        })  # fmt: skip
        accessors.append({
            "bufferView": 2 * i, "componentType": FLOAT, "count": vertex_counts[i], "type": "VEC3",
            "min": lower[i], "max": upper[i],
        })  # fmt: skip
        accessors.append({
            "bufferView": 2 * i + 1, "componentType": UNSIGNED_SHORT, "count": counts[i], "type": "SCALAR",
        })  # fmt: skip
        # No normals: a reader must then shade every triangle flat, as grains are.
        primitive = {"attributes": {"POSITION": 2 * i}, "indices": 2 * i + 1, "material": shade[i]}
        meshes.append({"name": name, "primitives": [primitive]})
        nodes.append({
            "name": name, "mesh": i, "translation": packing.positions[i].tolist(), "rotation": quaternions[i],
            "extras": {"grain": i, "mass": masses[i], "density": float(packing.densities[i])},
        })  # fmt: skip
    turn = float(np.sqrt(0.5))
    nodes.append({"name": "grains", "rotation": [-turn, 0.0, 0.0, turn], "children": list(range(n))})
    colours = list(GRAIN_COLOURS.items()) if options.colours else [("grain", (0.6, 0.6, 0.6))]
    materials = [
        {"name": word, "pbrMetallicRoughness": {
            "baseColorFactor": [*colour, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.8,
        }}
        for word, colour in colours
    ]  # fmt: skip
    return {
        "asset": {"version": "2.0", "generator": "grainsdem", "extras": {"unit": "metre"}},
        "scene": 0,
        "scenes": [{"nodes": [n]}],
        "nodes": nodes,
        "meshes": meshes,
        "materials": materials,
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": points.nbytes + 2 * (starts[-1] + counts[-1] + counts[-1] % 2)}],
    }
