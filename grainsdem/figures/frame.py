"""What all figures share: PNG files, the canvas, ink, and the unit in which a length reads well."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grainsdem.atomic import replacing
from grainsdem.errors import FileFormatError

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator

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
