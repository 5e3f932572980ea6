"""Fabric of a bed: axes of its grains on Schmidt's net, and a rose of their trends."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.figures.frame import BLUE, GREY, INK, RED, check_suffix, drawing
from grainsdem.gate import gated
from grainsdem.measures.grains.directions import AXES, orientation_tensor, principal_axes, trend_and_plunge

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PETALS = 36
"""Petals of the rose, over the whole circle."""

_NAMES = {"a": "long", "b": "middle", "c": "short"}


@gated
def stereonet(packing: Packing, path: str | os.PathLike[str], *, axis: str = "a") -> Path:
    """Draw where an axis of each grain points: on the lower hemisphere, areas true, and as a rose of trends.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    path : str or path-like
        Ends in ``.png``.
    axis : {"a", "b", "c"}
        The long, the middle or the short axis: poles of flat grains are short axes.

    Returns
    -------
    pathlib.Path
        The file. +x is on the right, +y on top; the cross is the mean axis, the first eigenvector of the orientation
        tensor, whose eigenvalues are told. The rose has each axis at both of its ends, petals of an area that goes with
        the number of grains. In a planar bed it stands alone.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is no grain, the axis is unknown, or the file cannot be written.
    """
    target = check_suffix(path)
    if len(packing) == 0:
        raise InputError("there is nothing to draw: the packing has no grains")
    values, vectors = np.linalg.eigh(orientation_tensor(packing, axis))
    lines = principal_axes(packing)[:, AXES.index(axis)]
    trend, plunge = trend_and_plunge(lines)
    flat = packing.domain.is_planar
    with drawing(target, (4.2 if flat else 8.0, 4.4), dpi=130) as figure:
        if not flat:
            net = figure.add_subplot(1, 2, 1)
            _draw_net(net)
            net.plot(*_projected(trend, plunge), ".", color=BLUE, markersize=4, alpha=0.6, markeredgewidth=0)
            net.plot(*_projected(*trend_and_plunge(vectors[:, 2][None])), "P", color=RED, markersize=9)
            told = ", ".join(f"{value:.2f}" for value in values[::-1])
            net.set_title(f"{_NAMES[axis]} axes of {len(packing)} grains\nS1, S2, S3 = {told}", fontsize=9)
        rose = figure.add_subplot(1, 1 if flat else 2, 1 if flat else 2, projection="polar")
        both = np.concatenate([trend, trend + np.pi]) % (2 * np.pi)
        counts, edges = np.histogram(both, np.linspace(0, 2 * np.pi, PETALS + 1))
        rose.bar(
            edges[:-1], np.sqrt(counts), np.diff(edges), align="edge", color=BLUE, edgecolor="white", linewidth=0.5
        )
        rose.set(yticklabels=[], xticks=np.arange(8) * np.pi / 4)
        rose.set_title("trends" if not flat else f"{_NAMES[axis]} axes of {len(packing)} grains", fontsize=9)
        rose.tick_params(labelsize=8)
    return target


def _projected(trend: Floats, plunge: Floats) -> tuple[Floats, Floats]:
    """Return where lines lie in Lambert's projection of the lower hemisphere, areas true, the rim at one."""
    radius = np.sqrt(2) * np.sin(0.25 * np.pi - 0.5 * plunge)
    return radius * np.cos(trend), radius * np.sin(trend)


def _draw_net(axes: Axes) -> None:
    """Draw rim, plunges of 30 and 60°, and the directions of the axes."""
    turn = np.linspace(0, 2 * np.pi, 181)
    for plunge in (0.0, np.pi / 6, np.pi / 3):
        x, y = _projected(turn, np.full(turn.shape, plunge))
        axes.plot(x, y, color=INK if plunge == 0 else GREY, linewidth=1.0 if plunge == 0 else 0.5)
    axes.plot([-1, 1], [0, 0], color=GREY, linewidth=0.5)
    axes.plot([0, 0], [-1, 1], color=GREY, linewidth=0.5)
    for text, at in (("+x", (1.08, 0.0)), ("+y", (0.0, 1.08))):
        axes.text(*at, text, ha="center", va="center", fontsize=8)
    axes.set(aspect="equal", xlim=(-1.2, 1.2), ylim=(-1.2, 1.2))
    axes.axis("off")
