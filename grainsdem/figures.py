"""Pictures: a render of the packing, the grain-size curve, coordination, and energy over time. All PNG.

The same input gives the same plot to the byte: nothing in it knows the date or the version that drew it. No window is
opened, and the global state of matplotlib is left as it was.
"""

from __future__ import annotations

from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError, InputError, MissingPackageError, ShapeError
from grainsdem.geometry.rotations import world_vertices
from grainsdem.measures import diameters, masses, percentiles, sphericities

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import ContactGraph, Packing

QUANTITIES = ("diameter", "sphericity", "height", "id")
"""What `render` colours grains by, besides an array."""

_INK, _BLUE, _RED = "#22272e", "#2f6690", "#b5452c"
_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.edgecolor": _INK,
    "axes.labelcolor": _INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": _INK,
    "ytick.color": _INK,
    "text.color": _INK,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


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
    target = _check_suffix(path)
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
            _add_light_and_camera(pv, plotter, packing)
            plotter.screenshot(str(temporary))
        finally:
            plotter.close()
    return target


def size_histogram(packing: Packing, path: str | os.PathLike[str], *, sieves: Sequence[float] | None = None) -> Path:
    """Draw the grain-size curve: mass passing against diameter, over the mass in each class.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    path : str or path-like
        Ends in ``.png``.
    sieves : sequence of float
        Openings [m] to draw as lines; they also part the classes where there are two or more. Without them the
        classes are equal.

    Returns
    -------
    pathlib.Path
        The file. Diameters are those of the spheres of equal volume, d10, d50 and d90 are by mass.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is no grain or a sieve is not positive, or the file cannot be written.
    """
    target = _check_suffix(path)
    if len(packing) == 0:
        raise InputError("there is nothing to draw: the packing has no grains")
    openings = np.sort(np.asarray([] if sieves is None else sieves, dtype=np.float64))
    if openings.size and not (np.isfinite(openings).all() and openings[0] > 0):
        raise InputError(f"sieve openings must be positive and finite; got {openings.tolist()}")
    factor, unit = _length_unit(float(np.median(diameters(packing.grains))))
    d, w = diameters(packing.grains) * factor, masses(packing)
    openings = openings * factor
    with _drawing(target) as figure:
        shares = figure.add_subplot()
        inside = openings[(openings > d.min()) & (openings < d.max())]
        classes = _classes(d, inside)
        heights, _ = np.histogram(d, classes, weights=100 * w / w.sum())
        shares.bar(classes[:-1], heights, np.diff(classes), align="edge", color=_BLUE, alpha=0.35, edgecolor="white")
        shares.set(xlabel=f"equal-volume diameter  [{unit}]", ylabel="mass in class  [%]", ylim=(0, None))
        passing = shares.twinx()
        order = np.argsort(d, kind="stable")
        running = np.cumsum(w[order]) / w.sum() * 100
        passing.step(np.r_[d[order][0], d[order]], np.r_[0.0, running], where="post", color=_INK, linewidth=1.6)
        passing.set(ylabel="mass passing  [%]", ylim=(0, 102))
        passing.spines["right"].set_visible(True)
        for opening in openings:
            passing.axvline(opening, color=_RED, linewidth=0.8, linestyle=(0, (4, 3)))
        _mark_percentiles(passing, d, w, unit)
    return target


def coordination_histogram(graph: ContactGraph, path: str | os.PathLike[str]) -> Path:
    """Draw how many grains have how many contacts.

    Parameters
    ----------
    graph : ContactGraph
        Contacts of at least one grain.
    path : str or path-like
        Ends in ``.png``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is no grain, or the file cannot be written.
    """
    target = _check_suffix(path)
    if graph.n_grains == 0:
        raise InputError("there is nothing to draw: the graph has no grains")
    from matplotlib.ticker import MaxNLocator

    z = graph.coordination()
    counts = np.bincount(z)
    with _drawing(target) as figure:
        axes = figure.add_subplot()
        axes.bar(np.arange(counts.size), 100 * counts / z.size, width=0.82, color=_BLUE, alpha=0.85)
        axes.axvline(z.mean(), color=_RED, linewidth=1.2)
        axes.annotate(
            f"mean {z.mean():.2f}",
            (z.mean(), 1.0),
            xytext=(5, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
            color=_RED,
        )
        axes.set(xlabel="contacts of a grain", ylabel="grains  [%]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return target


def energy_plot(history: Mapping[str, ArrayLike], path: str | os.PathLike[str]) -> Path:
    """Draw kinetic energy over time.

    Parameters
    ----------
    history : mapping of str to array_like
        ``time`` [s] and ``kinetic_energy``, the mean of a grain in m g d; both of shape (n,), n at least 1.
    path : str or path-like
        Ends in ``.png``.

    Returns
    -------
    pathlib.Path
        The file. The energy axis is logarithmic; samples of no energy are left out.

    Raises
    ------
    FileFormatError, InputError, ShapeError, WriteError
        If the suffix is another, a series is missing or empty, the two differ in length, or the file cannot be written.
    """
    target = _check_suffix(path)
    missing = sorted({"time", "kinetic_energy"} - set(history))
    if missing:
        raise InputError(f"the history needs time and kinetic_energy; it lacks {', '.join(missing)}")
    time = np.asarray(history["time"], dtype=np.float64)
    energy = np.asarray(history["kinetic_energy"], dtype=np.float64)
    if time.ndim != 1 or time.shape != energy.shape:
        raise ShapeError(f"time and kinetic_energy must have the same shape (n,); got {time.shape} and {energy.shape}")
    moving = energy > 0
    if not moving.any():
        raise InputError("there is nothing to draw: no sample of the history has kinetic energy")
    with _drawing(target) as figure:
        axes = figure.add_subplot()
        axes.semilogy(time[moving], energy[moving], color=_BLUE, linewidth=1.4)
        axes.set(xlabel="time  [s]", ylabel="kinetic energy of a grain  [m g d]", xlim=(min(time[0], 0), None))
        axes.grid(which="major", axis="y", color="#d8dce2", linewidth=0.6)
        axes.set_axisbelow(True)
    return target


def _check_suffix(path: str | os.PathLike[str]) -> Path:
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise FileFormatError(f"{target}: figures are written as .png; got {target.suffix or 'no suffix'!r}")
    return target


@contextmanager
def _drawing(target: Path) -> Iterator[Figure]:
    """Yield an empty figure and write it when the block ends well."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=(6.4, 4.2), dpi=200, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        with replacing(target) as temporary:
            # Without its metadata the file does not name the version that drew it.
            figure.savefig(temporary, format="png", metadata={"Software": None})


def _length_unit(length: float) -> tuple[float, str]:
    """Return the factor from metres, and the name, of the unit in which a length reads well."""
    for unit, factor in (("m", 1.0), ("mm", 1e3), ("µm", 1e6)):
        if length * factor >= 0.1:
            return factor, unit
    return 1e9, "nm"


def _classes(d: NDArray[np.float64], sieves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of the classes: the sieves where they part the grains, else equal steps."""
    if sieves.size >= 2:
        return np.concatenate([[d.min()], sieves, [d.max()]])
    low, high = d.min(), d.max()
    if high - low <= 1e-9 * high:  # one size: a class of its own, a hundredth wide
        return np.array([0.995 * low, 1.005 * high])
    return np.linspace(low, high, int(np.clip(np.sqrt(d.size), 6, 40)) + 1)


def _mark_percentiles(axes: Axes, d: NDArray[np.float64], w: NDArray[np.float64], unit: str) -> None:
    """Mark d10, d50 and d90 on the curve and name them."""
    q = (10, 50, 90)
    marks = percentiles(d, q, weights=w)
    axes.plot(marks, q, "o", color=_INK, markersize=4.5, markerfacecolor="white", zorder=5)
    for x, y in zip(marks, q, strict=True):
        # Left of the curve, which rises to the right, there is room.
        axes.annotate(
            f"d$_{{{y}}}$ = {x:#.3g} {unit}",
            (x, y),
            xytext=(-8, 3),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=9,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 1},
        )


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
    factor, unit = _length_unit(float(np.median(np.abs(values))))
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
        "color": _INK,
    }
    plotter.add_mesh(
        mesh,
        scalars="value",
        cmap="Spectral" if label is None else "viridis",
        clim=None if spread else (0.99 * values[0], 1.01 * values[0]),
        show_scalar_bar=label is not None,
        scalar_bar_args=scale,
        show_edges=True,
        edge_color=_INK,
        edge_opacity=0.35,
        line_width=1.0,
        interpolation="flat",
        ambient=0.25,
        diffuse=0.8,
        specular=0.05,
    )


def _reach(plotter: Any, bounds: NDArray[np.float64]) -> float:
    """Return how far the box reaches from the middle of the picture; 1 is its border."""
    width, height = plotter.window_size
    matrix = plotter.camera.GetCompositeProjectionTransformMatrix(width / height, -1.0, 1.0)
    rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    corners = np.array([[*corner, 1.0] for corner in product(bounds[:2], bounds[2:4], bounds[4:])]) @ rows.T
    return float(np.abs(corners[:, :2] / corners[:, 3:]).max())


def _add_light_and_camera(pv: Any, plotter: Any, packing: Packing) -> None:
    domain = packing.domain
    # A container much higher than its bed would leave the bed small: it is drawn to a little above the grains.
    upper = domain.upper.copy()
    top = world_vertices(packing)[:, 2].max() + 0.5 * diameters(packing.grains).mean()
    upper[2] = max(min(upper[2], top), domain.lower[2] + 1e-3 * domain.lengths[2])
    bounds = np.stack([domain.lower, upper], axis=1).ravel()
    plotter.add_mesh(pv.Box(bounds).extract_feature_edges(), color="#7a828c", line_width=1.5, lighting=False)
    plotter.set_background("white")
    plotter.enable_anti_aliasing("ssaa")
    plotter.camera_position = [(3.0, -4.2, 2.2), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]
    plotter.camera.view_angle = 22.0
    plotter.reset_camera()
    plotter.camera.zoom(0.94 / _reach(plotter, bounds))
    for position, strength in (((-2.0, -3.0, 4.0), 0.75), ((4.0, -2.0, 2.0), 0.35), ((0.0, 4.0, 1.0), 0.2)):
        plotter.add_light(pv.Light(position=position, focal_point=(0, 0, 0), intensity=strength))
