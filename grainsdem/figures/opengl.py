"""Renders by PyVista and VTK, off screen."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.figures.frame import GREY, INK
from grainsdem.figures.scene import AMBIENT, DIFFUSE, EYES, LIGHTS
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters

if TYPE_CHECKING:
    from pathlib import Path

    from grainsdem.figures.scene import Scene

MARGIN = 0.95
"""How much of a picture the container may fill, from its middle to its borders."""

GLASS = 0.25
"""How much a body around the grains hides of what is behind it."""


def draw(scene: Scene, path: Path, size: tuple[int, int], *, fine: bool = True) -> None:
    """Draw a scene into a PNG file of a size in pixels; ``fine`` with shade in the gaps and smooth edges."""
    import pyvista

    pv: Any = pyvista  # its decorators hide its signatures from type checkers
    plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
    try:
        if len(scene.packing):
            _add_grains(pv, plotter, scene)
        if scene.outline is not None:
            outline = pv.Box(np.stack(scene.outline, axis=1).ravel()).extract_feature_edges()
            plotter.add_mesh(outline, color=GREY, line_width=1.5, lighting=False)
        _add_bodies(pv, plotter, scene)
        _light(pv, plotter, scene, fine=fine)
        middle = 0.5 * (scene.lower + scene.upper)
        [eye] = scene.directions([EYES[scene.view]])
        plotter.camera_position = [middle + eye, middle, scene.upright]
        plotter.camera.view_angle = 22.0
        plotter.reset_camera(bounds=np.stack([scene.lower, scene.upper], axis=1).ravel())
        if scene.is_flat:
            plotter.enable_parallel_projection()
        # Right of the container there is room for the scale.
        _fit(plotter, scene, right=MARGIN if scene.label is None else 0.70)
        plotter.reset_camera_clipping_range()  # bodies may reach out of the picture
        plotter.screenshot(str(path))
    finally:
        plotter.close()


def _add_grains(pv: Any, plotter: Any, scene: Scene) -> None:
    grains = scene.packing.grains
    n_faces = np.diff(grains.face_offsets)
    corners = grains.face_vertices + np.repeat(
        grains.vertex_offsets[:-1], np.diff(grains.face_vertex_offsets[grains.face_offsets])
    )
    # VTK wants the number of corners before the corners of every face.
    faces = np.insert(corners, grains.face_vertex_offsets[:-1], np.diff(grains.face_vertex_offsets))
    mesh = pv.PolyData(world_vertices(scene.packing), faces=faces)
    mesh.cell_data["value"] = np.repeat(scene.values, n_faces)
    # In a picture narrower than the default its title would reach over the edge.
    letter = min(1.0, plotter.window_size[0] / 1200)
    scale = {
        "title": f"{scene.label}\n",  # a line of air above the topmost number
        "title_font_size": max(6, round(20 * letter)),
        "label_font_size": max(6, round(18 * letter)),
        "vertical": True,
        "position_x": 0.90,
        "position_y": 0.25,
        "width": 0.05,
        "height": 0.5,
        "n_labels": 0 if scene.steps else 5,
        "fmt": "%#.3g",
        "color": INK,
    }
    plotter.add_mesh(
        mesh,
        scalars="value",
        cmap=scene.colors,
        n_colors=len(scene.steps) or 256,
        annotations={float(k): word for k, word in enumerate(scene.steps)},
        clim=scene.limits,
        show_scalar_bar=scene.label is not None,
        scalar_bar_args=scale,
        show_edges=True,
        edge_color=INK,
        edge_opacity=0.35,
        line_width=1.0,
        interpolation="flat",
        ambient=AMBIENT,
        diffuse=DIFFUSE,
        specular=0.05,
    )


def _add_bodies(pv: Any, plotter: Any, scene: Scene) -> None:
    """Add what is around the grains, as glass with edges: nothing behind it is hidden."""
    for corners, triangles in scene.bodies:
        mesh = pv.PolyData(corners, faces=np.insert(triangles, 0, 3, axis=1).ravel())
        plotter.add_mesh(mesh, color=GREY, opacity=GLASS, lighting=False)
        # Between triangles of one face and along what is round there is no edge.
        plotter.add_mesh(mesh.extract_feature_edges(30.0), color=INK, line_width=1.5, lighting=False)


def _light(pv: Any, plotter: Any, scene: Scene, *, fine: bool) -> None:
    plotter.set_background("white")
    if fine:
        # Shade in the gaps, as far as a grain reaches, tells grains apart that have one colour.
        d = float(diameters(scene.packing.grains).mean())
        plotter.enable_ssao(radius=0.7 * d, bias=0.02 * d, kernel_size=64, blur=True)
        plotter.enable_anti_aliasing("ssaa")
    for position, (_, strength) in zip(scene.directions([way for way, _ in LIGHTS]), LIGHTS, strict=True):
        plotter.add_light(pv.Light(position=position, focal_point=(0, 0, 0), intensity=strength))


def _fit(plotter: Any, scene: Scene, *, right: float) -> None:
    """Turn and zoom the camera so that a box fills the picture from the left border to ``right`` (1: that border)."""
    camera = plotter.camera
    width, height = plotter.window_size
    matrix = camera.GetCompositeProjectionTransformMatrix(width / height, -1.0, 1.0)
    rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    corners = np.array([[*corner, 1.0] for corner in product(*zip(scene.lower, scene.upper, strict=True))]) @ rows.T
    seen = corners[:, :2] / corners[:, 3:]
    low, high = seen.min(axis=0), seen.max(axis=0)
    if scene.is_turning:  # whatever its turn, it is within a circle about the middle
        circle = np.hypot(*(seen * [width / height, 1.0]).T).max()
        high = np.array([circle * height / width, circle])
        low = -high
    room = np.array([right + MARGIN, 2 * MARGIN])
    zoom = float((room / (high - low)).min())
    if scene.is_flat:
        camera.parallel_scale /= zoom
    else:
        camera.view_angle = 2 * np.degrees(np.arctan(np.tan(np.radians(camera.view_angle) / 2) / zoom))
    middle = zoom * (low + high) / 2 - [(right - MARGIN) / 2, 0.0]
    camera.SetWindowCenter(*middle)
