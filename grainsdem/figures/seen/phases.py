"""What voxels say of both phases: the two-point correlation, and the chords."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.figures.frame import BLUE, INK, RED, check_suffix, drawing, length_unit
from grainsdem.gate import gated

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from grainsdem.measures.voxels import Chords, Correlation


@gated
def phase_figure(correlation: Correlation, chords: Chords, path: str | os.PathLike[str]) -> Path:
    """Draw the two-point correlation of the solid, and the distributions of chords in grains and in the void.

    Parameters
    ----------
    correlation : Correlation
        What `two_point_correlation` returns.
    chords : Chords
        What `chord_lengths` returns.
    path : str or path-like
        Ends in ``.png``.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, WriteError
        If the suffix is another, or the file cannot be written.
    """
    target = check_suffix(path)
    factor, unit = length_unit(0.2 * float(np.nanmax(correlation.distances)))
    with drawing(target, (8.4, 3.6), dpi=140) as figure:
        left, right = figure.subplots(1, 2)
        solid = correlation.solid_fraction
        left.plot(correlation.distances * factor, correlation.values, color=BLUE, linewidth=1.6)
        for level, name in ((solid, "1 − φ"), (solid**2, "(1 − φ)²")):
            left.axhline(level, color=INK, linewidth=0.7, linestyle=(0, (4, 3)))
            left.annotate(
                name,
                (1.0, level),
                xycoords=("axes fraction", "data"),
                xytext=(-4, 4),
                ha="right",
                textcoords="offset points",
                color=INK,
            )
        left.set(xlabel=f"distance  [{unit}]", ylabel="S₂", xlim=(0, None))
        for counts, color, name in ((chords.solid, BLUE, "in grains"), (chords.void, RED, "in the void")):
            step = float(chords.lengths[1]) * factor if len(chords.lengths) > 1 else 1.0
            share = counts / max(int(counts.sum()), 1) / step
            right.step(chords.lengths * factor, share, where="mid", color=color, linewidth=1.2, label=name)
        # Long chords of the void are rare, and would leave the others little room.
        running = np.cumsum(chords.solid + chords.void)
        longest = float(chords.lengths[np.searchsorted(running, 0.999 * running[-1])]) * factor
        right.set(xlabel=f"chord  [{unit}]", ylabel=f"density  [1/{unit}]", xlim=(0, longest or None), ylim=(0, None))
        right.legend(frameon=False)
    return target
