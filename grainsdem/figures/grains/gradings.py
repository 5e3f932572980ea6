"""Sieve curves: what a laboratory found, what was fitted to it, and what a bed has."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.figures.frame import BLUE, GREY, INK, RED, check_suffix, drawing, length_unit, scale_sizes
from grainsdem.gate import gated
from grainsdem.measures.grains.sizes import diameters, masses, sieve_diameters
from grainsdem.model.grading import Diameter, Distribution  # noqa: TC001  (read at the door: `grainsdem.gate`)

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from grainsdem.measures.distributions.sheets.sheet import SieveSheet
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

_LINES = ((BLUE, (0, (5, 2))), (RED, (0, (2, 2))), ("#4f7f4f", (0, (6, 2, 1, 2))), (GREY, (0, (1, 1))))

POINTS = 300
"""Points of a fitted curve."""


@gated
def grading_figure(
    path: str | os.PathLike[str],
    *,
    sheet: SieveSheet | None = None,
    fits: Mapping[str, Distribution] | None = None,
    bed: Packing | None = None,
    diameter: Diameter = "sieve",
) -> Path:
    """Draw per cent passing by mass over size, of a sieve sheet, of distributions and of a bed.

    Parameters
    ----------
    path : str or path-like
        Ends in ``.png``.
    sheet : SieveSheet, optional
        Its points, and lines between them.
    fits : mapping of str to distribution, optional
        Curves by name: the ``distribution`` of a `SizeFit`.
    bed : Packing, optional
        Grains, whose own curve is drawn as steps.
    diameter : {"sieve", "equal-volume"}
        What size of the bed's grains is meant.

    Returns
    -------
    pathlib.Path
        The file. Sizes are on a logarithmic axis with φ along the top.

    Raises
    ------
    FileFormatError, InputError, WriteError
        If the suffix is another, there is neither a sheet nor a bed, or the file cannot be written.
    """
    target = check_suffix(path)
    if sheet is None and bed is None:
        raise InputError("there is nothing to draw: give a sheet or a bed")
    sizes, shares = np.empty(0), np.empty(0)
    if bed is not None:
        sizes = sieve_diameters(bed) if diameter == "sieve" else diameters(bed)
        order = np.argsort(sizes, kind="stable")
        sizes, shares = sizes[order], 100 * masses(bed)[order] / masses(bed).sum()
    ends = np.concatenate([sizes[[0, -1]] if sizes.size else sizes, [] if sheet is None else sheet.openings])
    factor, unit = length_unit(float(np.median(ends)))
    with drawing(target, (6.4, 4.6), dpi=130) as figure:
        axes = figure.add_subplot()
        if bed is not None:
            passed = np.append(0.0, np.cumsum(shares))
            told = f"bed, {len(bed)} grains"
            axes.step(factor * np.append(sizes[0], sizes), passed, where="post", color=GREY, linewidth=2.2, label=told)
        over = np.geomspace(ends.min(), ends.max(), POINTS)
        for (name, law), (colour, dashes) in zip((fits or {}).items(), _LINES, strict=False):
            axes.plot(factor * over, 100 * law.cdf(over), color=colour, linestyle=dashes, linewidth=1.2, label=name)
        if sheet is not None:
            axes.plot(
                factor * sheet.openings, sheet.passing, "o-", color=INK, markersize=4, linewidth=1, label="sieves"
            )
        scale_sizes(axes, (float(factor * ends.min()), float(factor * ends.max())), factor=factor, unit=unit)
        axes.set(ylabel="mass passing  [%]", ylim=(0, 102))
        axes.set_xlabel(f"{'opening of a sieve' if diameter == 'sieve' else 'equal-volume diameter'}  [{unit}]")
        axes.legend(frameon=False, loc="upper left")
    return target
