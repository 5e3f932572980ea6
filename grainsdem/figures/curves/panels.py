"""Curves above each other: what an experiment measured, with bands where several runs give an interval."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.figures.frame import BLUE, GREY, INK, RED, check_suffix, drawing

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.panels import Panel

    Floats = NDArray[np.float64]

_COLOURS = (BLUE, RED, INK, "#4f7f4f", "#8a6bb1", GREY)


def curve_figure(panels: Sequence[Panel], path: str | os.PathLike[str]) -> Path:
    """Draw panels of curves above each other.

    Parameters
    ----------
    panels : sequence of Panel
        At least one, from the top down.
    path : str or path-like
        Ends in ``.png``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, InputError, ShapeError, WriteError
        If the suffix is another, there is no panel, the series of a curve differ in length, or the file cannot be
        written.
    """
    target = check_suffix(path)
    if not panels:
        raise InputError("there is nothing to draw: a figure of curves needs a panel")
    with drawing(target, (6.4, 0.6 + 2.8 * len(panels)), dpi=130) as figure:
        for axes, panel in zip(np.atleast_1d(figure.subplots(len(panels), 1)), panels, strict=True):
            _draw(axes, panel)
    return target


def _draw(axes: Axes, panel: Panel) -> None:
    """Draw the curves, bands and dots of one panel."""
    names = [*panel.curves, *(name for name in panel.points if name not in panel.curves)]
    colours = {name: _COLOURS[k % len(_COLOURS)] for k, name in enumerate(names)}
    for name, rows in panel.curves.items():
        x, y, *width = _series(name, rows)
        axes.plot(x, y, color=colours[name], linewidth=1.5, label=name or None)
        if width:
            axes.fill_between(x, y - width[0], y + width[0], color=colours[name], alpha=0.2, linewidth=0)
    for name, rows in panel.points.items():
        x, y, *width = _series(name, rows)
        label = name if name and name not in panel.curves else None
        errors = width[0] if width else None
        axes.errorbar(x, y, errors, fmt="o", color=colours[name], markersize=4, capsize=3, linewidth=1, label=label)
    axes.set(xlabel=panel.x_label, ylabel=panel.y_label)
    axes.grid(color="#e3e6ea", linewidth=0.6)
    axes.set_axisbelow(True)
    if any(names):
        axes.legend(frameon=False)


def _series(name: str, rows: tuple[ArrayLike, ...]) -> list[Floats]:
    """Return the series of a curve as arrays of one length."""
    arrays = [np.asarray(row, dtype=np.float64) for row in rows]
    if len(arrays) not in (2, 3) or any(row.ndim != 1 or row.shape != arrays[0].shape for row in arrays):
        shapes = ", ".join(str(row.shape) for row in arrays)
        raise ShapeError(f"curve {name!r} must be two or three series of the same shape (n,); got {shapes}")
    return arrays
