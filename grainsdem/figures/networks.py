"""The network of contact forces as a picture: lines as wide as their forces, force chains in colour."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.figures.frame import GREY, INK, RED, check_suffix, drawing, length_unit

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.model import ContactGraph, Packing

WIDEST = 4.0
"""Width of a line [points] whose force is `FULL` times the mean."""

FULL = 3.0
"""Normal force, over its mean, from which lines are no wider."""


def force_figure(
    packing: Packing,
    graph: ContactGraph,
    columns: Mapping[str, NDArray[np.float64]],
    path: str | os.PathLike[str],
) -> Path:
    """Draw the contact forces of a bed, seen along y (along z in planar work).

    Parameters
    ----------
    packing : Packing
        Where the grains are.
    graph : ContactGraph
        Who presses on whom.
    columns : mapping of str to ndarray
        ``normal_force`` [N] and ``chain`` of each contact (`grainsdem.dynamics.mechanics.contact_forces`).
    path : str or path-like
        Ends in ``.png``.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is no contact that presses, or the file cannot be written.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    target = check_suffix(path)
    pressing, chain = columns["normal_force"], columns["chain"]
    kept = np.flatnonzero(pressing > 0)
    if not kept.size:
        raise InputError("there is nothing to draw: no contact presses")
    kept = kept[np.argsort(pressing[kept], kind="stable")]  # the strongest on top
    axes_shown = [0, 1] if packing.domain.is_planar else [0, 2]
    i, j = graph.pairs[kept].T
    # A part has no centre: its line ends at the contact.
    here = np.where((i >= 0)[:, None], packing.positions[np.maximum(i, 0)], graph.points[kept])
    there = np.where((j >= 0)[:, None], packing.positions[np.maximum(j, 0)], graph.points[kept])
    factor, unit = length_unit(float(packing.domain.lengths.max()))
    lines = factor * np.stack([here, there], axis=1)[:, :, axes_shown]
    widths = WIDEST * np.minimum(pressing[kept] / pressing[kept].mean() / FULL, 1.0)
    sides = packing.domain.lengths[axes_shown]
    height = 1.5 + 5.6 * float(np.clip(sides[1] / sides[0], 0.3, 2.0))
    with drawing(target, (6.4, height), dpi=130) as figure:
        axes, handles = figure.subplots(), []
        is_in_chain = chain[kept] >= 0
        for chosen, colour, name in ((~is_in_chain, GREY, "other contacts"), (is_in_chain, RED, "force chains")):
            if chosen.any():
                shown = LineCollection(list(lines[chosen]), linewidths=widths[chosen], colors=colour, capstyle="round")
                axes.add_collection(shown)
                handles.append(Line2D([], [], color=colour, linewidth=3, label=name))
        points = factor * packing.positions[:, axes_shown]
        axes.scatter(points[:, 0], points[:, 1], s=4, color=INK, zorder=3)
        labels = ("x", "y") if packing.domain.is_planar else ("x", "z")
        axes.set(xlabel=f"{labels[0]}  [{unit}]", ylabel=f"{labels[1]}  [{unit}]", aspect="equal")
        axes.autoscale_view()
        mean = float(pressing[kept].mean())
        axes.set_title(f"{kept.size} contacts, mean normal force {mean:.3g} N", fontsize=10)
        figure.legend(handles=handles, frameon=False, loc="outside lower center", ncols=2)
    return target
