"""What all figures share: PNG files, ink, and the unit in which a length reads well."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from grainsdem.errors import FileFormatError

if TYPE_CHECKING:
    import os

INK, BLUE, RED, GREY = "#22272e", "#2f6690", "#b5452c", "#808080"


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
