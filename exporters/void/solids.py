"""Grains as solids for a mesher: touching or overlapping ones are parted, capped, bridged or fused."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import triangles
from grainsdem.packing import contacts, heal

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from exporters.void.region import Region
    from grainsdem.model import ContactGraph, Packing

    Floats = NDArray[np.float64]

TREATMENTS = ("shrink", "cap", "bridge", "union", "none")
"""What is done where grains are nearer than the gap."""

SEGMENTS = 16
"""Sides of the prism that bridges two grains."""


class Frame(NamedTuple):
    """Where solids live: about a region's lower corner, in units of a grain's size, where manifold3d is exact.

    Parameters
    ----------
    origin : ndarray, shape (3,)
        Origin [m].
    length : float
        What is 1 [m].
    """

    origin: Floats
    length: float


class Solids(NamedTuple):
    """Closed bodies that do not overlap one another, and the round bridges that were added to them.

    Parameters
    ----------
    bodies : list of Manifold
        In the frame's units; one a grain, perhaps empty, where grains stay apart.
    growth : float
        Factor that grains were made larger by about their centroids.
    bridges : ndarray, shape (k, 2, 3)
        Ends [m] of the bridges' axes.
    radius : float
        Their radius [m].
    """

    bodies: list[Any]
    growth: float = 1.0
    bridges: Floats = np.empty((0, 2, 3))
    radius: float = 0.0


def treat(grains: Packing, kind: str, gap: float, frame: Frame) -> Solids:
    """Return the grains as solids, their near contacts treated.

    Parameters
    ----------
    grains : Packing
        Convex grains.
    kind : {"shrink", "cap", "bridge", "union", "none"}
        ``"shrink"`` insets the faces of the grains concerned until ``gap`` is left; ``"cap"`` cuts both grains by
        planes ``gap`` apart across the contact; ``"bridge"`` joins them by a short prism, of three gaps' radius;
        ``"union"`` makes all grains larger by a gap a diameter, so that near ones overlap, and fuses them.
    gap : float
        Gap [m].
    frame : Frame
        Where the solids live.
    """
    if kind == "shrink":
        return Solids(as_manifolds(heal(grains, gap=gap, by="inset").packing, frame))
    if kind == "none":
        return Solids(as_manifolds(grains, frame))
    if kind == "union":
        growth = 1.0 + gap / frame.length
        return Solids(fused(as_manifolds(grains, frame, growth)), growth)
    graph = contacts(grains, within=gap)
    if kind == "cap":
        return Solids(_capped(as_manifolds(grains, frame), graph, gap, frame))
    return _bridged(as_manifolds(grains, frame), graph, gap, frame)


def as_manifolds(grains: Packing, frame: Frame, growth: float = 1.0) -> list[Any]:
    """Return each grain as a manifold, larger by a factor about its centroid."""
    import manifold3d

    mesh = triangles(grains.grains)
    offsets = grains.grains.vertex_offsets
    world = world_vertices(grains)
    centres = np.repeat(grains.positions, np.diff(offsets), axis=0)
    points = (centres + growth * (world - centres) - frame.origin) / frame.length
    corners = mesh.indices.astype(np.uint64)
    return [
        manifold3d.Manifold(
            manifold3d.Mesh64(
                points[offsets[i] : offsets[i + 1]].copy(), corners[mesh.offsets[i] : mesh.offsets[i + 1]].copy()
            )
        )
        for i in range(len(grains))
    ]


def fused(bodies: list[Any]) -> list[Any]:
    """Return the union of solids, as one that may have many parts."""
    import manifold3d

    return [manifold3d.Manifold.batch_boolean(bodies, manifold3d.OpType.Add)]


def cut(bodies: list[Any], region: Region, frame: Frame) -> list[Any]:
    """Return what of the solids lies in a box, each cut by the planes that cross it."""
    lower = (region.lower - frame.origin) / frame.length
    upper = (region.upper - frame.origin) / frame.length
    kept = []
    for body in bodies:
        if body.is_empty():
            continue
        inside = body
        for axis in range(3):
            normal = np.zeros(3)
            normal[axis] = 1.0
            bounds = inside.bounding_box()
            if bounds[axis] < lower[axis]:
                inside = inside.trim_by_plane(normal.tolist(), float(lower[axis]))
            if not inside.is_empty() and bounds[axis + 3] > upper[axis]:
                inside = inside.trim_by_plane((-normal).tolist(), float(-upper[axis]))
            if inside.is_empty():
                break
        if not inside.is_empty():
            kept.append(inside)
    return kept


def flow_domain(region: Region, frame: Frame, *, longer: tuple[int, float] | None = None) -> Any:
    """Return the region as a solid; ``longer`` names an axis along which it reaches so far [m] beyond its ends."""
    import manifold3d

    lower, upper = region.lower.copy(), region.upper.copy()
    if longer is not None:
        axis, reach = longer
        lower[axis] -= reach
        upper[axis] += reach
    box = manifold3d.Manifold.cube(((upper - lower) / frame.length).tolist())
    box = box.translate(((lower - frame.origin) / frame.length).tolist())
    for plane in region.planes:
        height = float(plane[3] - plane[:3] @ frame.origin) / frame.length
        box = box.trim_by_plane((-plane[:3]).tolist(), -height)
    return box


def void(bodies: list[Any], region: Region, frame: Frame) -> Any:
    """Return the region minus the solids."""
    import manifold3d

    return manifold3d.Manifold.batch_boolean([flow_domain(region, frame), *bodies], manifold3d.OpType.Subtract)


def _capped(bodies: list[Any], graph: ContactGraph, gap: float, frame: Frame) -> list[Any]:
    points = (graph.points - frame.origin) / frame.length
    half = 0.5 * gap / frame.length
    for (i, j), point, normal in zip(graph.pairs.tolist(), points, graph.normals, strict=True):
        height = float(point @ normal)
        # What stays lies in the direction of the vector from the plane.
        bodies[i] = bodies[i].trim_by_plane((-normal).tolist(), half - height)
        bodies[j] = bodies[j].trim_by_plane(normal.tolist(), height + half)
    return bodies


def _bridged(bodies: list[Any], graph: ContactGraph, gap: float, frame: Frame) -> Solids:
    import manifold3d

    radius = 3 * gap
    # As deep into each grain as the prism is wide, so that it ends inside.
    reach = 0.5 * np.abs(graph.gaps) + radius
    ends = graph.points[:, None] + np.stack([-reach, reach], axis=1)[:, :, None] * graph.normals[:, None]
    prisms = []
    for (first, last), normal in zip((ends - frame.origin) / frame.length, graph.normals, strict=True):
        height = float(np.linalg.norm(last - first))
        prism = manifold3d.Manifold.cylinder(height, radius / frame.length, circular_segments=SEGMENTS)
        across = np.linalg.svd(normal[None])[2]
        turn = np.column_stack([across[1], np.cross(normal, across[1]), normal, first])
        prisms.append(prism.transform(turn.tolist()))
    return Solids(fused([*bodies, *prisms]), 1.0, ends, radius)
