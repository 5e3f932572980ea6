"""Renders where no OpenGL is: grains painted from the farthest to the nearest by matplotlib.

Grains are convex, so the faces of one that are turned to the eye never hide each other. Grains that are apart are
painted in order of distance; where a small one leans over a large one this may err by a pixel's width of an edge.
"""

from __future__ import annotations

from itertools import combinations, product
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.figures.frame import GREY, INK
from grainsdem.figures.scene import AMBIENT, DIFFUSE, EYES, LIGHTS
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.rotations import to_matrices, world_vertices
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.figures.scene import Scene
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]


SIGNS = tuple(product((0, 1), repeat=3))
"""Corners of a box: 0 for its lower sides, 1 for its upper ones."""


def draw(scene: Scene, path: Path, size: tuple[int, int]) -> None:
    """Draw a scene into a PNG file of a size in pixels."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    dpi = 150
    figure = Figure(figsize=(size[0] / dpi, size[1] / dpi), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    view = _View(scene)
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_axis_off()
    colors = mpl.colormaps[scene.colors]
    scale = ScalarMappable(Normalize(*scene.limits), colors.resampled(len(scene.steps)) if scene.steps else colors)
    lights = list(zip(scene.directions([way for way, _ in LIGHTS]), [strength for _, strength in LIGHTS], strict=True))
    polygons, shades = _faces(scene.packing, view, scale.to_rgba(scene.values)[:, :3], lights)
    behind, before = _outline(scene, view)
    for lines, order in ((behind, 1), (before, 3)):
        axes.add_collection(LineCollection(lines, colors=GREY, linewidths=0.8, zorder=order))
    edges = 0.55 * shades
    axes.add_collection(PolyCollection(polygons, facecolors=shades, edgecolors=edges, linewidths=0.4, zorder=2))
    axes.update_datalim(view.project(_corners(scene.lower, scene.upper)))
    if scene.is_turning:
        reach = np.linalg.norm(scene.upper - scene.lower) / 2
        axes.update_datalim(view.project(view.middle + reach * np.concatenate([view.axes[:2], -view.axes[:2]])))
    axes.autoscale_view()
    for order, glass in _bodies(scene, view):
        axes.add_collection(PolyCollection(glass, facecolors=GREY, alpha=0.12, zorder=order), autolim=False)
    if scene.label is not None:
        bar = figure.colorbar(scale, ax=axes, shrink=0.5, aspect=18, pad=0.02)
        bar.set_label(scene.label, color=INK)
        if scene.steps:
            bar.set_ticks(range(len(scene.steps)), labels=scene.steps)
        bar.outline.set_visible(False)
    figure.savefig(path, format="png", metadata={"Software": None})


class _View:
    """A pinhole camera that looks at a point from an offset; straight on, from so far that nothing gets smaller."""

    def __init__(self, scene: Scene) -> None:
        # Far enough that the whole container is in a view of about twenty degrees.
        distance = 3.0 * np.linalg.norm(scene.upper - scene.lower) * (1e4 if scene.is_flat else 1.0)
        [eye] = scene.directions([EYES[scene.view]])
        offset = distance * eye / np.linalg.norm(eye)
        self.middle = 0.5 * (scene.lower + scene.upper)
        self.position = self.middle + offset
        forward = -offset / np.linalg.norm(offset)
        right = np.cross(forward, scene.upright)
        right /= np.linalg.norm(right)
        self.axes = np.stack([right, np.cross(right, forward), forward])

    def project(self, points: Floats) -> Floats:
        """Return the place of points in the picture, shape (n, 2)."""
        x, y, depth = self.axes @ (points - self.position).T
        return np.stack([x / depth, y / depth], axis=1)


def _faces(
    packing: Packing, view: _View, colors: Floats, lights: list[tuple[Floats, float]]
) -> tuple[list[Floats], Floats]:
    """Return the faces turned to the eye as polygons in the picture, farthest grain first, and their colours."""
    grains = packing.grains
    owner = owners(grains.face_offsets)
    points = world_vertices(packing)
    normals = np.einsum("fij,fj->fi", to_matrices(packing.quaternions)[owner], face_planes(grains).normals)
    starts = grains.face_vertex_offsets
    corners = grains.face_vertices + np.repeat(grains.vertex_offsets[owner], np.diff(starts))
    turned = np.einsum("fi,fi->f", normals, view.position - points[corners[starts[:-1]]]) > 0
    distance = np.linalg.norm(packing.positions - view.position, axis=1)
    seen = np.flatnonzero(turned)
    seen = seen[np.argsort(-distance[owner[seen]], kind="stable")]
    flat = view.project(points)
    shade = np.full(len(normals), AMBIENT)
    for direction, strength in lights:
        shade += DIFFUSE * strength * np.clip(normals @ (direction / np.linalg.norm(direction)), 0.0, None)
    rgb = np.clip(colors[owner[seen]] * shade[seen, None], 0.0, 1.0)
    return [flat[corners[starts[f] : starts[f + 1]]] for f in seen], rgb


def _bodies(scene: Scene, view: _View) -> list[tuple[int, list[Floats]]]:
    """Return the faces of what is around the grains: those turned away, behind all, and those turned to the eye."""
    parts: tuple[list[Floats], list[Floats]] = ([], [])
    for corners, triangles in scene.bodies:
        flat = view.project(corners)[triangles]
        across, along = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        for polygon, is_near in zip(flat, across[:, 0] * along[:, 1] - across[:, 1] * along[:, 0] > 0, strict=True):
            parts[int(is_near)].append(polygon)
    return [(1, parts[0]), (3, parts[1])]


def _corners(lower: Floats, upper: Floats) -> Floats:
    """Return the corners of a box, shape (8, 3)."""
    return np.where(np.array(SIGNS) == 0, lower, upper)


def _outline(scene: Scene, view: _View) -> tuple[list[Floats], list[Floats]]:
    """Return the edges of the container in the picture: those behind what it holds, and those before it."""
    parts: tuple[list[Any], list[Any]] = ([], [])
    if scene.outline is not None:
        corners = _corners(*scene.outline)
        flat = view.project(corners)
        nearest = int(np.argmin(np.linalg.norm(corners - view.position, axis=1)))
        signs = np.array(SIGNS)
        for a, b in combinations(range(8), 2):
            if np.abs(signs[a] - signs[b]).sum() == 1:
                parts[int(nearest in (a, b))].append(flat[[a, b]])
    return parts
