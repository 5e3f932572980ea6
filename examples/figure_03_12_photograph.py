"""Figures 3 and 12 of Buscombe and Rubin (2012): a tessellation of grain centres picked on a photograph, drawn on it.

The photograph is scikit-image's of gravel, or your own with ``--image``. Where the paper picks centres by eye, here
they are the places farthest from shadow, and a watershed gives each grain the area that it seems to have: all that is
nearer to it than to another, since from above no void is seen. The cells of the centres are held against these areas,
one by one and as distributions; so are Laguerre cells, whose weights are the squares of the depths of the centres. Then
the centres are parents of a cluster process, as the paper proposes: the spread at which its cells vary as much as the
photograph's grains is found. Writes ``figure_03_12.png``. Run with ``--quick`` for a corner of the photograph.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage
from skimage.data import gravel
from skimage.feature import peak_local_max
from skimage.filters import gaussian, threshold_local
from skimage.segmentation import clear_border, watershed

import grainsdem as gd
from grainsdem.figures.frame import BLUE, INK, RED, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

LOWER = -5
"""The first of the two walls that every cell of a slab touches."""

SHOWN = 220
"""Pixels of the photograph that are drawn, from its upper left corner."""


class Picked(NamedTuple):
    """What is seen on a photograph: centres [pixels, y upwards], how far they are from shadow, and apparent areas."""

    centres: NDArray[np.float64]
    depths: NDArray[np.float64]
    areas: NDArray[np.float64]
    is_whole: NDArray[np.bool_]


def pick(grey: NDArray[np.float64]) -> Picked:
    """Find grains by light and shade: brighter than what is about them, and farthest from shadow in the middle."""
    smooth = gaussian(grey, 1.2)
    is_grain = ndimage.binary_opening(smooth > threshold_local(smooth, 51, offset=0.02))
    depth = gaussian(ndimage.distance_transform_edt(is_grain), 1.0)
    pieces, _ = ndimage.label(is_grain)
    peaks = peak_local_max(depth, min_distance=5, labels=pieces, exclude_border=False)
    markers = np.zeros(grey.shape, dtype=int)
    markers[tuple(peaks.T)] = np.arange(1, len(peaks) + 1)
    shadow = ndimage.distance_transform_edt(~is_grain)
    labels = watershed(np.where(is_grain, -depth, shadow), markers)
    whole = np.unique(clear_border(labels))
    areas = np.bincount(labels.ravel(), minlength=len(peaks) + 1)[1:]
    centres = np.column_stack([peaks[:, 1] + 0.5, grey.shape[0] - peaks[:, 0] - 0.5])
    depths = depth[tuple(peaks.T)]
    return Picked(centres, depths, areas.astype(float), np.isin(np.arange(1, len(peaks) + 1), whole))


def outlines(cells: gd.Tessellation) -> list[NDArray[np.float64]]:
    """Return the polygon of every cell of a slab."""
    cut = gd.section(gd.carve(cells, keep="all"), z=0.5 * cells.domain.lengths[2])
    return [cut.polygon(k) for k in range(len(cut))]


def cell_areas(cells: gd.Tessellation) -> NDArray[np.float64]:
    """Return the area of every cell of a slab."""
    return gd.volumes(cells.cells) / cells.domain.lengths[2]


def inside(cells: gd.Tessellation) -> NDArray[np.bool_]:
    """Return which cells touch no edge of the photograph."""
    owner = np.repeat(np.arange(len(cells)), np.diff(cells.cells.face_offsets))
    at_edge = (cells.neighbors < 0) & (cells.neighbors > LOWER)
    return ~np.isin(np.arange(len(cells)), owner[at_edge])


def variation(areas: NDArray[np.float64]) -> float:
    """Return the standard deviation over the mean."""
    return float(areas.std() / areas.mean())


def tune(picked: Picked, domain: gd.Domain, wanted: float) -> tuple[float, gd.Tessellation]:
    """Return the spread [mean spacings] at which clusters about the centres vary as wanted, and such a bed."""
    n = len(picked.centres)
    spacing = np.sqrt(domain.lengths[0] * domain.lengths[1] / n)
    beds = {}
    for spread in np.arange(0.05, 0.55, 0.05):
        seeds = gd.points.cluster_poisson(
            domain, n, parents=picked.centres, spread=spread * spacing, walls="reflect", rng=3
        )
        cells = gd.tessellate(seeds, domain)
        beds[float(spread)] = (abs(variation(cell_areas(cells)[inside(cells)]) - wanted), cells)
    best = min(beds, key=lambda spread: beds[spread][0])
    return best, beds[best][1]


def show(axes: Axes, title: str, grey: NDArray[np.float64] | None, polygons: list[NDArray[np.float64]]) -> None:
    """Draw the corner of a photograph, or white, and polygons over it."""
    from matplotlib.collections import PolyCollection

    height = grey.shape[0] if grey is not None else max(polygon[:, 1].max() for polygon in polygons)
    if grey is not None:
        axes.imshow(grey, cmap="gray", extent=(0, grey.shape[1], 0, grey.shape[0]), interpolation="nearest")
    color = RED if grey is not None else INK
    axes.add_collection(PolyCollection(polygons, facecolors="none", edgecolors=color, linewidths=0.8))
    axes.set(xlim=(0, SHOWN), ylim=(height - SHOWN, height), aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, loc="left")


def main() -> None:
    """Pick the centres, tessellate them, print the areas and draw all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a corner of the photograph")
    parser.add_argument("--image", type=Path, help="a photograph of your own")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the picture")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    grey = gd.points.image_density(options.image or gravel(), light="fine")[:, ::-1].T
    grey = grey[: SHOWN + 20, : SHOWN + 20] if options.quick else grey

    picked = pick(grey)
    domain = gd.Domain.slab(grey.shape[::-1], 10.0)
    cells = gd.tessellate(picked.centres, domain)
    weighted = gd.tessellate(picked.centres, domain, weights=picked.depths**2)
    kept = inside(cells) & inside(weighted) & picked.is_whole
    ours, better, theirs = cell_areas(cells)[kept], cell_areas(weighted)[kept], picked.areas[kept]
    print(f"{len(picked.centres)} centres, {kept.sum()} whole grains and cells; areas in pixels:")
    print("                   mean   s.d.    d10    d50    d90  correlation  larger than the grain")
    for name, areas in {"apparent": theirs, "Voronoi cells": ours, "Laguerre cells": better}.items():
        low, middle, high = np.percentile(areas, (10, 50, 90))
        likeness = f"{np.corrcoef(areas, theirs)[0, 1]:12.3f} {(areas > theirs).mean():22.1%}"
        print(
            f"  {name:<14} {areas.mean():7.1f} {areas.std():6.1f} {low:6.1f} {middle:6.1f} {high:6.1f}"
            f"{likeness if areas is not theirs else ''}"
        )
    print(f"Clark and Evans's index of the centres: {gd.points.clark_evans(picked.centres, domain):.3f}")
    spread, clusters = tune(picked, domain, variation(theirs))
    again = cell_areas(clusters)[inside(clusters)]
    print(
        f"clusters about the centres vary as the grains do, {variation(again):.3f} and {variation(theirs):.3f} of the "
        f"mean, at a spread of {spread:.2f} spacings"
    )

    with drawing(options.output / "figure_03_12.png", (9.6, 6.6), dpi=90) as figure:
        ((first, second, third), (fourth, fifth, sixth)) = figure.subplots(2, 3)
        show(first, "(a) centres", grey, [])
        first.plot(*picked.centres.T, ".", color=RED, markersize=4)
        show(second, "(b) their cells", None, outlines(cells))
        show(third, "(c) both", grey, outlines(cells))
        bins = np.linspace(0, np.percentile(theirs, 99.5), 24)
        fourth.hist(theirs, bins, color=BLUE, alpha=0.4, label="apparent")
        fourth.hist(ours, bins, histtype="step", color=RED, linewidth=1.4, label="Voronoi")
        fourth.hist(better, bins, histtype="step", color=INK, linewidth=1.0, label="Laguerre")
        fourth.set(xlabel="area  [pixels]", ylabel="grains")
        fourth.legend(frameon=False, fontsize=8)
        fourth.set_title("(d) areas", loc="left")
        fifth.plot(theirs, better, ".", color=INK, markersize=2)
        fifth.plot(theirs, ours, ".", color=RED, markersize=2)
        most = float(np.percentile(theirs, 99.5))
        fifth.plot([0, most], [0, most], "-", color=BLUE, linewidth=1)
        fifth.set(xlabel="apparent area  [pixels]", ylabel="cell area  [pixels]", xlim=(0, most), ylim=(0, most))
        fifth.set_title("(e) one by one", loc="left")
        show(sixth, "(f) clusters about the centres", None, outlines(clusters))
    print(f"wrote {options.output / 'figure_03_12.png'}")


if __name__ == "__main__":
    main()
