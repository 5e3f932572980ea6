"""Sections drawn as the paper's figures 2, 6 and 9 are: grains and the void between them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.figures.frame import INK, RED, check_suffix, drawing, length_unit
from grainsdem.gate import gated
from grainsdem.measures.sections import Section, section_table

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

SAND = "#d8c49a"


@gated
def section_figure(
    sections: Section | Sequence[Section],
    path: str | os.PathLike[str],
    *,
    titles: Sequence[str] = (),
    color_by: Literal["diameter", "id"] | None = None,
    columns: int | None = None,
    marks: ArrayLike | None = None,
    note: str = "",
) -> Path:
    """Draw one section, or several side by side, each with a scale.

    Parameters
    ----------
    sections : Section or sequence of Section
        What is drawn, each within the outline of its domain.
    path : str or path-like
        Ends in ``.png``.
    titles : sequence of str
        One a section, or none.
    color_by : {"diameter", "id"} or None
        Colours show the apparent diameter, with a scale beside them, or tell grains apart; None draws all alike.
    columns : int, optional
        Sections in a row; by default as many as make the figure about square.
    marks : array_like, optional, shape (k, 3)
        Points [m], such as the parents of clusters: a cross where each is seen along the normal, smaller the farther it
        is from the plane.
    note : str
        What is written below.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, InputError, ShapeError, WriteError
        If the suffix is another, there is no section, titles are not as many, marks are no points, or the file cannot
        be written.
    """
    target = check_suffix(path)
    panels = [sections] if isinstance(sections, Section) else list(sections)
    _check(panels, titles, color_by, columns)
    points = _points(marks)
    n_columns = min(columns or int(np.ceil(np.sqrt(len(panels)))), len(panels))
    n_rows = -(-len(panels) // n_columns)
    tables = [section_table(panel) for panel in panels]
    longest = max(float(np.ptp(panel.outline, axis=0).max()) for panel in panels)
    factor, unit = length_unit(0.1 * longest)
    largest = factor * max((float(table["diameter"].max(initial=0.0)) for table in tables), default=0.0)
    side = 5.2 if len(panels) == 1 else 3.1
    size = (side * n_columns + (1.0 if color_by == "diameter" else 0.2), (side + 0.3 * bool(titles)) * n_rows)
    with drawing(target, size, dpi=180 if len(panels) == 1 else 110) as figure:
        axes = figure.subplots(n_rows, n_columns, squeeze=False).ravel()
        for axis in axes[len(panels) :]:
            axis.set_axis_off()
        drawn: Any = None
        for k, (axis, panel, table) in enumerate(zip(axes, panels, tables, strict=False)):
            values = None if color_by is None else _values(panel, table["diameter"] * factor, color_by)
            drawn = _draw(axis, panel, values, factor, largest if color_by == "diameter" else 1.0)
            if titles:
                axis.set_title(titles[k], fontsize=10, loc="left")
            if len(panels) == 1:
                axis.set(xlabel=f"u  [{unit}]", ylabel=f"v  [{unit}]")
            else:
                axis.set(xticks=[], yticks=[])
                _draw_scale(axis, longest * factor, unit)
            _mark(axis, panel, points, factor)
        figure.supxlabel(note, fontsize=9)
        if color_by == "diameter":
            figure.colorbar(drawn, ax=axes[: len(panels)].tolist(), label=f"apparent diameter  [{unit}]", shrink=0.8)
    return target


def _check(panels: list[Section], titles: Sequence[str], color_by: str | None, columns: int | None) -> None:
    """Raise `InputError` where there is nothing to draw, or it cannot be drawn so."""
    if not panels:
        raise InputError("there is nothing to draw: no section is given")
    if titles and len(titles) != len(panels):
        raise InputError(f"titles must be as many as the {len(panels)} sections, or none; got {len(titles)}")
    if color_by not in (None, "diameter", "id"):
        raise InputError(f"color_by must be 'diameter', 'id' or None; got {color_by!r}")
    if columns is not None and columns < 1:
        raise InputError(f"columns must be one at least; got {columns}")


def _points(marks: ArrayLike | None) -> NDArray[np.float64]:
    """Return marks as points [m], shape (k, 3); none by default."""
    points = np.empty((0, 3)) if marks is None else np.asarray(marks, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise ShapeError(f"marks must be points of shape (k, 3); got {points.shape}")
    return points


def _values(section: Section, diameters: Any, color_by: str) -> Any:
    # Multiples of the golden ratio: ids that follow one another get colours far apart.
    return diameters if color_by == "diameter" else np.mod(section.ids * 0.6180339887498949, 1.0)


def _draw(axis: Axes, section: Section, values: Any, factor: float, largest: float) -> Any:
    """Draw the polygons within the outline, and return them."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Polygon

    polygons = [section.polygon(j) * factor for j in range(len(section))]
    width = float(np.clip(12 / np.sqrt(max(len(section), 1)), 0.2, 0.9))
    grains = PolyCollection(polygons, facecolors=SAND, edgecolors=INK, linewidths=width)
    if values is not None:
        grains.set_array(values)
        grains.set_cmap("viridis" if largest != 1.0 else "Spectral")
        grains.set_clim(0.0, largest)
    outline = Polygon(section.outline * factor, closed=True, facecolor="white", edgecolor=INK, linewidth=0.8)
    axis.add_patch(outline)
    axis.add_collection(grains)
    grains.set_clip_path(outline)
    low, high = (section.outline * factor).min(axis=0), (section.outline * factor).max(axis=0)
    margin = 0.01 * float((high - low).max())
    axis.set(xlim=(low[0] - margin, high[0] + margin), ylim=(low[1] - margin, high[1] + margin), aspect="equal")
    for spine in axis.spines.values():
        spine.set_visible(False)
    return grains


def _draw_scale(axis: Axes, longest: float, unit: str) -> None:
    """Draw a bar below a panel, a round length of about a fifth of the longest outline."""
    power = 10.0 ** np.floor(np.log10(0.2 * longest))
    length = max(m * power for m in (1, 2, 5) if m * power <= 0.2 * longest)
    left, _ = axis.get_xlim()
    start = left + 0.01 * longest
    # Lengths along the axis, heights in shares of the panel.
    across = axis.get_xaxis_transform()
    axis.plot([start, start + length], [-0.035, -0.035], color=INK, linewidth=2.2, transform=across, clip_on=False)
    place = (start + length + 0.02 * longest, -0.035)
    axis.text(*place, f"{length:g} {unit}", fontsize=8, va="center", transform=across)


def _mark(axis: Axes, section: Section, points: NDArray[np.float64], factor: float) -> None:
    """Draw crosses at points in the world, seen along the normal of the section."""
    u, v = factor * (section.frame[:2] @ points.T)
    far = np.abs(points @ section.frame[2] - section.distance) / np.ptp(section.outline, axis=0).max()
    axis.scatter(u, v, s=90 * np.clip(1 - 1.4 * far, 0.15, 1), marker="x", color=RED, linewidths=1.8, zorder=4)
