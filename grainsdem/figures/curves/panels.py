"""Curves above each other: what an experiment measured, with bands where several runs give an interval."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.figures.frame import BLUE, GREY, INK, RED, check_suffix, drawing

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

_COLOURS = (BLUE, RED, INK, "#4f7f4f", "#8a6bb1", GREY)

_SMOOTHED = 40
"""Points that a curve is smoothed to, each the mean of those around it: forces of a few hundred grains fluctuate."""


class Panel(NamedTuple):
    """One set of axes.

    Parameters
    ----------
    x_label, y_label : str
        What the axes show.
    curves : mapping of str to tuple of array_like
        For each name x, y, and, where there is a third one, half the width of a band around y; each of shape (n,).
    points : mapping of str to tuple of array_like
        The same for what is drawn as dots.
    """

    x_label: str
    y_label: str
    curves: Mapping[str, tuple[ArrayLike, ...]]
    points: Mapping[str, tuple[ArrayLike, ...]] = {}


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


def experiment_figure(
    history: Mapping[str, ArrayLike],
    path: str | os.PathLike[str],
    *,
    profile: Mapping[str, ArrayLike] | None = None,
) -> Path:
    """Draw what an experiment measured: stresses or angles over strain or time, and its profile where it has one.

    Parameters
    ----------
    history : mapping of str to array_like
        Series of a compaction, tapping, triaxial, ring shear, direct shear, collapse or tilt experiment.
    path : str or path-like
        Ends in ``.png``.
    profile : mapping of str to array_like, optional
        ``height`` and ``velocity`` of a ring shear test, ``distance`` and ``height`` of a heap, or ``taps`` and
        ``porosity``.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, the history is of no such experiment, or the file cannot be written.
    """
    return curve_figure([*experiment_panels(history), *_profile_panels(profile or {})], path)


def experiment_panels(history: Mapping[str, ArrayLike]) -> list[Panel]:
    """Return the panels that show an experiment's history: its second stage, after compression or rest.

    Of compaction and of tapping it is the whole.
    """
    if "porosity" in history:
        return _compaction_panels({name: np.asarray(values, dtype=np.float64) for name, values in history.items()})
    if "stage" not in history:
        raise InputError("the history has no stages: it is of no experiment that has curves")
    series = {name: np.asarray(values, dtype=np.float64) for name, values in history.items()}
    chosen = series["stage"] == 1.0
    if not chosen.any():
        raise InputError("there is nothing to draw: the experiment never came to its second stage")
    series = {name: values[chosen] for name, values in series.items()}
    if "axial_strain" in series:
        return _triaxial_panels(series)
    for strain, label in (("shear_strain", "shear strain"), ("displacement", "displacement over length of the box")):
        if strain in series and "friction" in series:
            return _shear_panels(series, strain, label)
    if "run_out" in series:
        return [
            Panel("time  [s]", "length  [m]", {name.replace("_", "-"): (series["time"], series[name]) for name in pair})
            for pair in (("height", "run_out"),)
        ]
    if "gone_fraction" in series:
        gone = 100 * series["gone_fraction"]
        return [Panel("angle  [°]", "grains that have moved  [%]", {"": (np.degrees(series["angle"]), gone)})]
    raise InputError(f"the history is of no experiment that has curves; it has {', '.join(history)}")


def _compaction_panels(series: Mapping[str, Floats]) -> list[Panel]:
    panels = [Panel("time  [s]", "porosity", {"": (series["time"], series["porosity"])})]
    if "pressure" in series:
        names = {"walls": "pressure", "contacts": "pressure_contacts"}
        panels.append(
            Panel("time  [s]", "pressure  [Pa]", {who: (series["time"], series[name]) for who, name in names.items()})
        )
    return panels


def _triaxial_panels(series: Mapping[str, Floats]) -> list[Panel]:
    strain = series["axial_strain"]
    angles = {}
    for name, suffix in (("walls", ""), ("contacts", "_contacts")):
        axial, lateral = (_smoothed(series[f"{side}_stress{suffix}"]) for side in ("axial", "lateral"))
        angles[name] = _smoothed(strain), np.degrees(np.arcsin((axial - lateral) / (axial + lateral)))
    return [
        Panel("axial strain", "mobilised friction angle  [°]", angles),
        Panel("axial strain", "volumetric strain (dilation)", {"": (strain, series["volumetric_strain"])}),
    ]


def _shear_panels(series: Mapping[str, Floats], name: str, label: str) -> list[Panel]:
    strain = series[name]
    ratios = {
        "lid" if name == "shear_strain" else "box": (
            _smoothed(strain),
            _smoothed(series["shear_stress"]) / _smoothed(series["normal_stress"]),
        ),
        "contacts": (
            _smoothed(strain),
            _smoothed(series["shear_stress_contacts"]) / _smoothed(series["normal_stress_contacts"]),
        ),
    }
    return [
        Panel(label, "τ / σ", ratios),
        Panel(label, "volumetric strain (dilation)", {"": (strain, series["volumetric_strain"])}),
    ]


def _profile_panels(profile: Mapping[str, ArrayLike]) -> list[Panel]:
    if "velocity" in profile:
        curve = (profile["velocity"], profile["height"])
        return [Panel("speed around the axis / that of the lid", "height / that of the ring", {}, {"": curve})]
    if "taps" in profile:
        return [Panel("taps", "porosity at rest", {}, {"": (profile["taps"], profile["porosity"])})]
    if "distance" in profile:
        curve = (profile["distance"], profile["height"])
        return [Panel("distance  [m]", "height of the surface  [m]", {}, {"": curve})]
    return []


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


def _smoothed(values: Floats) -> Floats:
    """Return means of equal parts of a series."""
    return np.array([part.mean() for part in np.array_split(values, min(_SMOOTHED, len(values)))])
