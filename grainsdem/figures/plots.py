"""Plots: the grain-size curve, coordination, and energy over time.

The same input gives the same plot to the byte: nothing in it knows the date or the version that drew it, and the global
state of matplotlib is left as it was.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.figures.frame import BLUE, INK, RED, check_suffix, drawing, length_unit, scale_sizes
from grainsdem.gate import gated
from grainsdem.measures import diameters, masses, percentiles

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import ContactGraph, Packing

NAMED = 0.28
"""Share of the frame's width that the name and value of a percentile take."""


@gated
def size_histogram(packing: Packing, path: str | os.PathLike[str], *, sieves: Sequence[float] | None = None) -> Path:
    """Draw the grain-size curve, mass passing against diameter, and below it the mass in each class.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    path : str or path-like
        Ends in ``.png``.
    sieves : sequence of float
        Openings [m] to draw as lines; they also part the classes where there are two or more. Without them the
        classes are equal steps of φ.

    Returns
    -------
    pathlib.Path
        The file. Diameters are those of the spheres of equal volume, on a logarithmic axis with φ along the top; d10,
        d50 and d90 are by mass.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is no grain or a sieve is not positive, or the file cannot be written.
    """
    target = check_suffix(path)
    if len(packing) == 0:
        raise InputError("there is nothing to draw: the packing has no grains")
    openings = np.sort(np.asarray([] if sieves is None else sieves, dtype=np.float64))
    if openings.size and not (np.isfinite(openings).all() and openings[0] > 0):
        raise InputError(f"sieve openings must be positive and finite; got {openings.tolist()}")
    factor, unit = length_unit(float(np.median(diameters(packing.grains))))
    d, w = diameters(packing.grains) * factor, masses(packing)
    openings = openings * factor
    with drawing(target) as figure:
        passing, shares = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        inside = openings[(openings > d.min()) & (openings < d.max())]
        classes = _classes(d, inside)
        heights, _ = np.histogram(d, classes, weights=100 * w / w.sum())
        shares.bar(classes[:-1], heights, np.diff(classes), align="edge", color=BLUE, alpha=0.35, edgecolor="white")
        shares.set(ylabel="mass in class  [%]", ylim=(0, None))
        order = np.argsort(d, kind="stable")
        running = np.cumsum(w[order]) / w.sum() * 100
        passing.step(np.r_[d[order][0], d[order]], np.r_[0.0, running], where="post", color=INK, linewidth=1.6)
        passing.set(ylabel="mass passing  [%]", ylim=(0, 102))
        for opening in openings:
            for axes in (passing, shares):
                axes.axvline(opening, color=RED, linewidth=0.8, linestyle=(0, (4, 3)))
        edges = np.concatenate([classes[[0, -1]], openings])
        scale_sizes(passing, (float(edges.min()), float(edges.max())), factor=factor, unit=unit)
        shares.set_xlabel(f"equal-volume diameter  [{unit}]")
        _mark_percentiles(passing, d, w, unit)
    return target


@gated
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
    target = check_suffix(path)
    if graph.n_grains == 0:
        raise InputError("there is nothing to draw: the graph has no grains")
    from matplotlib.ticker import MaxNLocator

    z = graph.coordination()
    counts = np.bincount(z)
    with drawing(target) as figure:
        axes = figure.add_subplot()
        axes.bar(np.arange(counts.size), 100 * counts / z.size, width=0.82, color=BLUE, alpha=0.85)
        axes.axvline(z.mean(), color=RED, linewidth=1.2)
        axes.annotate(
            f"mean {z.mean():.2f}",
            (z.mean(), 1.0),
            xytext=(5, -2),
            xycoords=("data", "axes fraction"),
            textcoords="offset points",
            va="top",
            color=RED,
        )
        axes.set(xlabel="contacts of a grain", ylabel="grains  [%]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return target


@gated
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
    target = check_suffix(path)
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
    with drawing(target) as figure:
        axes = figure.add_subplot()
        axes.semilogy(time[moving], energy[moving], color=BLUE, linewidth=1.4)
        axes.set(xlabel="time  [s]", ylabel="kinetic energy of a grain  [m g d]", xlim=(min(time[0], 0), None))
        axes.grid(which="major", axis="y", color="#d8dce2", linewidth=0.6)
        axes.set_axisbelow(True)
    return target


def _classes(d: NDArray[np.float64], sieves: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of the classes: the sieves where they part the grains, else equal steps of φ."""
    if sieves.size >= 2:
        return np.concatenate([[d.min()], sieves, [d.max()]])
    low, high = d.min(), d.max()
    if high - low <= 1e-9 * high:  # one size: a class of its own, a hundredth wide
        return np.array([0.995 * low, 1.005 * high])
    return np.geomspace(low, high, int(np.clip(np.sqrt(d.size), 6, 40)) + 1)


def _mark_percentiles(axes: Axes, d: NDArray[np.float64], w: NDArray[np.float64], unit: str) -> None:
    """Mark d10, d50 and d90 on the curve and name them."""
    q = (10, 50, 90)
    marks = percentiles(d, q, weights=w)
    axes.plot(marks, q, "o", color=INK, markersize=4.5, markerfacecolor="white", zorder=5)
    low, high = np.log(axes.get_xlim())
    for x, y in zip(marks, q, strict=True):
        # The curve rises to the right: there is room above it on the left, and where that is too near the frame, below
        # it on the right.
        on_left = (np.log(x) - low) / (high - low) > NAMED
        axes.annotate(
            f"d$_{{{y}}}$ = {x:#.3g} {unit}",
            (x, y),
            xytext=(-8, 3) if on_left else (8, -3),
            textcoords="offset points",
            ha="right" if on_left else "left",
            va="bottom" if on_left else "top",
            fontsize=9,
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 1},
        )
