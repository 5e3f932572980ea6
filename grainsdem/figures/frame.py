"""What all figures share: PNG files, the canvas, ink, and the unit in which a length reads well."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, BLUE, RED, GREY = "#22272e", "#2f6690", "#b5452c", "#808080"

_STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 10,
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "text.color": INK,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def check_suffix(path: str | os.PathLike[str]) -> Path:
    """Return the path, or raise `FileFormatError` unless it ends in ``.png``."""
    target = Path(path)
    if target.suffix.lower() != ".png":
        raise FileFormatError(f"{target}: figures are written as .png; got {target.suffix or 'no suffix'!r}")
    return target


def length_unit(length: float) -> tuple[float, str]:
    """Return the factor from metres, and the name, of the unit in which a length reads well."""
    for unit, factor in (("m", 1.0), ("mm", 1e3), ("µm", 1e6)):
        if length * factor >= 0.1:
            return factor, unit
    return 1e9, "nm"


def scale_sizes(axes: Axes, limits: tuple[float, float], *, label: str = "", factor: float, unit: str) -> Axes:
    """Make x an axis of grain sizes: logarithmic, with φ = −log₂(d / 1 mm) along the top.

    Parameters
    ----------
    axes : Axes
        Its x axis is scaled; other axes that share it follow.
    limits : tuple of float
        Smallest and largest size to be seen, in the unit.
    label : str
        What the sizes are of; none is written by default.
    factor, unit : float, str
        What `length_unit` returns.

    Returns
    -------
    Axes
        That of φ; it shares y.
    """
    from matplotlib.ticker import FixedLocator, FuncFormatter, MaxNLocator, NullLocator

    margin = max(limits[1] / limits[0], 1.01) ** 0.04
    low, high = limits[0] / margin, limits[1] * margin
    axes.set_xscale("log")
    axes.set(xlim=(low, high), xlabel=f"{label}  [{unit}]" if label else "")
    axes.xaxis.set_major_locator(FixedLocator(_round_sizes(low, high)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda size, _: f"{size:.6g}"))
    top = axes.twiny()
    # φ is linear in the logarithm of the size, and rises as sizes fall.
    top.set(xlim=tuple(-np.log2(np.array([low, high]) / factor * 1e3)), xlabel="φ")
    top.spines["top"].set_visible(True)
    top.xaxis.set_major_locator(MaxNLocator(nbins=6, steps=[1, 2, 5, 10]))
    top.xaxis.set_major_formatter(FuncFormatter(lambda phi, _: f"{phi:.6g}".replace("-", "−")))
    return top


def _round_sizes(low: float, high: float) -> list[float]:
    """Return round sizes within limits: 1, 2 and 5 of each decade where there are several, else equal steps."""
    from matplotlib.ticker import MaxNLocator

    if high / low > 5:
        first, last = int(np.floor(np.log10(low))), int(np.ceil(np.log10(high)))
        mantissas = (1, 2, 5) if last - first <= 4 else (1,)
        sizes = [m * 10.0**power for power in range(first, last + 1) for m in mantissas]
    else:
        sizes = [float(size) for size in MaxNLocator(nbins=5, steps=[1, 2, 5, 10]).tick_values(low, high)]
    return [size for size in sizes if low <= size <= high]


@contextmanager
def drawing(target: Path, size: tuple[float, float] = (6.4, 4.2), *, dpi: int = 200) -> Iterator[Figure]:
    """Yield an empty figure, its size in inches, and write it when the block ends well."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        figure = Figure(figsize=size, dpi=dpi, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure
        with replacing(target) as temporary:
            # Without its metadata the file does not name the version that drew it.
            figure.savefig(temporary, format="png", metadata={"Software": None})
