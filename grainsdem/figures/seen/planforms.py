"""A planform and its truth: the photograph, who is seen where, how deep, and how large grains seem."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.figures.frame import BLUE, INK, RED, check_suffix, drawing, length_unit, scale_sizes
from grainsdem.gate import gated
from grainsdem.geometry.integrals import volumes
from grainsdem.measures.planform.truth import planform_table, true_sizes

if TYPE_CHECKING:
    import os
    from pathlib import Path

    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    from grainsdem.measures.planform import Planform
    from grainsdem.model import Packing


@gated
def planform_figure(
    view: Planform,
    packing: Packing,
    image: NDArray[np.float64],
    path: str | os.PathLike[str],
    *,
    least_pixels: int = 1,
) -> Path:
    """Draw a photograph, the grains and the depths that it shows, and the curves of apparent and true sizes.

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    image : ndarray, shape (ny, nx) or (ny, nx, 3)
        What `photograph` returns of the view.
    path : str or path-like
        Ends in ``.png``.
    least_pixels : int
        Grains of which fewer are seen are left out of the curves.

    Returns
    -------
    pathlib.Path
        The file.

    Raises
    ------
    FileFormatError, InputError, ShapeError, WriteError
        If the suffix is another, no grain is seen, the image is of another shape, or the file cannot be written.
    """
    target = check_suffix(path)
    if image.shape not in {view.labels.shape, (*view.labels.shape, 3)}:
        raise ShapeError(f"the image must have the view's shape {view.labels.shape}; got {image.shape}")
    rows = planform_table(view, packing)
    rows = rows[rows["n_pixels"] >= least_pixels]
    if rows.size == 0:
        raise InputError(f"there is nothing to draw: no grain is seen through {least_pixels} pixels or more")
    ny, nx = view.labels.shape
    factor, unit = length_unit(0.1 * float(max(view.pixel * [nx, ny])))
    low, high = view.corner * factor, (view.corner + view.pixel * [nx, ny]) * factor
    place: Any = {"extent": (low[0], high[0], low[1], high[1]), "interpolation": "nearest"}
    with drawing(target, (8.4, 7.6), dpi=130) as figure:
        (photo, labels), (depth, curves) = figure.subplots(2, 2)
        photo.imshow(image, cmap="gray", vmin=0, vmax=1, **place)
        # Multiples of the golden ratio: ids that follow one another get colours far apart.
        hues = np.where(view.labels > 0, np.mod(view.labels * 0.6180339887498949, 1.0), np.nan)
        labels.imshow(hues, cmap="Spectral", vmin=0, vmax=1, **place)
        depths = view.depths() * factor
        # A few narrow pits would take most of the scale.
        shown = depth.imshow(depths, cmap="cividis_r", vmin=0, vmax=float(np.nanpercentile(depths, 99)), **place)
        figure.colorbar(shown, ax=depth, label=f"depth  [{unit}]", shrink=0.8, extend="max")
        for axis, title in ((photo, "photograph"), (labels, "who is seen"), (depth, "how deep")):
            axis.set(xlabel=f"x  [{unit}]", ylabel=f"y  [{unit}]")
            axis.set_title(title, fontsize=10, loc="left")
        _draw_curves(curves, rows, packing)
    return target


def _draw_curves(axis: Axes, rows: NDArray[np.void], packing: Packing) -> None:
    """Draw the cumulated apparent axes b over the true ones."""
    b = true_sizes(packing)["b"]
    factor, unit = length_unit(float(np.median(b)))
    mass = volumes(packing.grains) * packing.densities
    for sizes, weights, color, style, name in (
        (b, np.ones(b.size), INK, "-", "bed, by number"),
        (b, mass, INK, "--", "bed, by mass"),
        (rows["apparent_b"], np.ones(rows.size), BLUE, "-", "image, by number"),
        (rows["apparent_b"], rows["visible_area"], RED, "--", "image, by area"),
    ):
        order = np.argsort(sizes, kind="stable")
        passing = 100 * np.cumsum(weights[order]) / weights.sum()
        axis.plot(sizes[order] * factor, passing, color=color, linestyle=style, linewidth=1.4, label=name)
    axis.set(ylabel="smaller  [%]", ylim=(0, 100))
    smallest, largest = min(b.min(), rows["apparent_b"].min()), max(b.max(), rows["apparent_b"].max())
    scale_sizes(axis, (smallest * factor, largest * factor), label="axis b", factor=factor, unit=unit)
    axis.set_title("how large", fontsize=10, loc="left")
    axis.legend(frameon=False, fontsize=8, loc="upper left")
