"""Renders: the grains in three dimensions, drawn off screen by VTK."""

from __future__ import annotations

from contextlib import contextmanager
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import InputError, MissingPackageError
from grainsdem.figures.frame import GREY, INK, check_suffix, length_unit
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters, sphericities

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

QUANTITIES = ("diameter", "sphericity", "height", "id")
"""What `render` colours grains by, besides an array."""

MARGIN = 0.95
"""How much of a picture the container may fill, from its middle to its borders."""


def render(
    packing: Packing,
    path: str | os.PathLike[str],
    *,
    color_by: str | ArrayLike = "diameter",
    size: tuple[int, int] = (1200, 900),
) -> Path:
    """Draw the grains in three dimensions, with the container's outline.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    path : str or path-like
        Ends in ``.png``; replaced if it exists.
    color_by : {"diameter", "sphericity", "height", "id"} or array_like, shape (n,)
        What the colour of a grain shows: a quantity with a scale beside it, or ``"id"`` to tell neighbours apart.
    size : tuple of int
        Width and height [pixels].

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError
        If the suffix is another.
    InputError
        If there is no grain, or ``color_by`` or ``size`` is not one of the above.
    MissingPackageError
        Where PyVista is not installed.
    WriteError
        If the file cannot be written.

    Notes
    -----
    VTK draws off screen through EGL or OSMesa and needs no display.
    """
    target = check_suffix(path)
    if len(packing) == 0:
        raise InputError("there is nothing to draw: the packing has no grains")
    if min(size) < 16 or max(size) > 16384:
        raise InputError(f"size must be 16 to 16384 pixels each way; got {size[0]} × {size[1]}")
    values, label = _quantity(packing, color_by)
    pv = _pyvista()
    with replacing(target) as temporary, _quiet_vtk():
        plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
        try:
            _add_grains(pv, plotter, packing, values, label)
            _add_light_and_camera(pv, plotter, packing, right=MARGIN if label is None else 0.70)
            plotter.screenshot(str(temporary))
        finally:
            plotter.close()
    return target


def _quantity(packing: Packing, color_by: str | ArrayLike) -> tuple[NDArray[np.float64], str | None]:
    """Return one value a grain and the title of its scale; None for a scale that says nothing."""
    if not isinstance(color_by, str):
        values = np.asarray(color_by, dtype=np.float64)
        if values.shape != (len(packing),) or not np.isfinite(values).all():
            raise InputError(f"color_by must hold one finite value a grain, {len(packing)}; got shape {values.shape}")
        return values, ""
    if color_by not in QUANTITIES:
        raise InputError(f"color_by must be {', '.join(QUANTITIES)} or one value a grain; got {color_by!r}")
    if color_by == "id":
        # Multiples of the golden ratio: ids that follow one another get colours far apart.
        return np.mod(np.arange(len(packing)) * 0.6180339887498949, 1.0), None
    if color_by == "sphericity":
        return sphericities(packing.grains), "sphericity"
    values = diameters(packing.grains) if color_by == "diameter" else packing.positions[:, 2]
    factor, unit = length_unit(float(np.median(np.abs(values))))
    return values * factor, f"{color_by}  [{unit}]"


def _pyvista() -> Any:
    try:
        import pyvista
    except ImportError as error:
        raise MissingPackageError('render needs PyVista: pip install "grainsdem[viz]"') from error
    return pyvista


@contextmanager
def _quiet_vtk() -> Iterator[None]:
    """Keep VTK from telling on stderr that there is no X server before it turns to EGL."""
    from vtkmodules.vtkCommonCore import vtkLogger  # noqa: PLC0415  (comes with PyVista)

    before = vtkLogger.GetCurrentVerbosityCutoff()
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)
    try:
        yield
    finally:
        vtkLogger.SetStderrVerbosity(before)


def _add_grains(pv: Any, plotter: Any, packing: Packing, values: NDArray[np.float64], label: str | None) -> None:
    grains = packing.grains
    n_faces = np.diff(grains.face_offsets)
    corners = grains.face_vertices + np.repeat(
        grains.vertex_offsets[:-1], np.diff(grains.face_vertex_offsets[grains.face_offsets])
    )
    # VTK wants the number of corners before the corners of every face.
    faces = np.insert(corners, grains.face_vertex_offsets[:-1], np.diff(grains.face_vertex_offsets))
    mesh = pv.PolyData(world_vertices(packing), faces=faces)
    mesh.cell_data["value"] = np.repeat(values, n_faces)
    spread = float(np.ptp(values)) > 1e-9 * float(np.abs(values).max())
    scale = {
        "title": f"{label}\n",  # a line of air above the topmost number
        "title_font_size": 20,
        "label_font_size": 18,
        "vertical": True,
        "position_x": 0.90,
        "position_y": 0.25,
        "width": 0.05,
        "height": 0.5,
        "n_labels": 5,
        "fmt": "%#.3g",
        "color": INK,
    }
    plotter.add_mesh(
        mesh,
        scalars="value",
        cmap="Spectral" if label is None else "viridis",
        clim=None if spread else (0.99 * values[0], 1.01 * values[0]),
        show_scalar_bar=label is not None,
        scalar_bar_args=scale,
        show_edges=True,
        edge_color=INK,
        edge_opacity=0.35,
        line_width=1.0,
        interpolation="flat",
        ambient=0.25,
        diffuse=0.8,
        specular=0.05,
    )


def _add_light_and_camera(pv: Any, plotter: Any, packing: Packing, *, right: float) -> None:
    domain = packing.domain
    # A container much higher than its bed would leave the bed small: it is drawn to a little above the grains.
    upper = domain.upper.copy()
    top = world_vertices(packing)[:, 2].max() + 0.5 * diameters(packing.grains).mean()
    upper[2] = max(min(upper[2], top), domain.lower[2] + 1e-3 * domain.lengths[2])
    bounds = np.stack([domain.lower, upper], axis=1).ravel()
    plotter.add_mesh(pv.Box(bounds).extract_feature_edges(), color=GREY, line_width=1.5, lighting=False)
    plotter.set_background("white")
    # Shade in the gaps, as far as a grain reaches, tells grains apart that have one colour.
    d = float(diameters(packing.grains).mean())
    plotter.enable_ssao(radius=0.7 * d, bias=0.02 * d, kernel_size=64, blur=True)
    plotter.enable_anti_aliasing("ssaa")
    plotter.camera_position = [(3.0, -4.2, 2.2), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = 22.0
    plotter.reset_camera()
    _fit(plotter, bounds, right=right)
    for position, strength in (((-2.0, -3.0, 4.0), 0.85), ((4.0, -2.0, 2.0), 0.45), ((0.0, 4.0, 1.0), 0.2)):
        plotter.add_light(pv.Light(position=position, focal_point=(0, 0, 0), intensity=strength))


def _fit(plotter: Any, bounds: NDArray[np.float64], *, right: float) -> None:
    """Turn and zoom the camera so that a box fills the picture from the left border to ``right`` (1: that border)."""
    camera = plotter.camera
    width, height = plotter.window_size
    matrix = camera.GetCompositeProjectionTransformMatrix(width / height, -1.0, 1.0)
    rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    corners = np.array([[*corner, 1.0] for corner in product(bounds[:2], bounds[2:4], bounds[4:])]) @ rows.T
    seen = corners[:, :2] / corners[:, 3:]
    low, high = seen.min(axis=0), seen.max(axis=0)
    room = np.array([right + MARGIN, 2 * MARGIN])
    zoom = float((room / (high - low)).min())
    camera.view_angle = 2 * np.degrees(np.arctan(np.tan(np.radians(camera.view_angle) / 2) / zoom))
    middle = zoom * (low + high) / 2 - [(right - MARGIN) / 2, 0.0]
    camera.SetWindowCenter(*middle)
