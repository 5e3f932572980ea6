"""A contact sheet: many photographs side by side."""

from __future__ import annotations

from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

from grainsdem.errors import InputError, MissingFileError
from grainsdem.figures.frame import check_suffix, drawing
from grainsdem.gate import gated

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence


@gated
def contact_sheet(
    pictures: Sequence[str | os.PathLike[str]],
    path: str | os.PathLike[str],
    *,
    columns: int = 4,
    titles: Sequence[str] | None = None,
) -> Path:
    """Draw photographs side by side, row by row.

    Parameters
    ----------
    pictures : sequence of str or path-like
        Images (.png), as `grainsdem.images` writes them.
    path : str or path-like
        Ends in ``.png``.
    columns : int
        How many stand in a row, at most.
    titles : sequence of str, optional
        What stands above each.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, InputError, MissingFileError, WriteError
        If the suffix is another, there is nothing to draw or no title for each, an image is missing, or the file cannot
        be written.
    """
    target = check_suffix(path)
    if not pictures or columns < 1 or (titles is not None and len(titles) != len(pictures)):
        raise InputError(
            f"a sheet has an image or more, a column or more, and a title for each; got {len(pictures)} images, "
            f"{columns} columns" + ("" if titles is None else f", {len(titles)} titles")
        )
    missing = [picture for picture in pictures if not Path(picture).is_file()]
    if missing:
        raise MissingFileError(f"{missing[0]}: no such file")
    from matplotlib.image import imread

    columns = min(columns, len(pictures))
    rows = ceil(len(pictures) / columns)
    with drawing(target, (1.6 * columns, (1.6 + 0.2 * (titles is not None)) * rows), dpi=130) as figure:
        for k, picture in enumerate(pictures):
            axes = figure.add_subplot(rows, columns, k + 1)
            axes.imshow(imread(str(picture)), cmap="gray", vmin=0, vmax=1)
            axes.axis("off")
            if titles is not None:
                axes.set_title(titles[k], fontsize=6, pad=2)
    return target
