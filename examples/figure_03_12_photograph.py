"""Figures 3 and 12 of Buscombe and Rubin (2012): a tessellation of grain centres picked on a photograph, drawn on it.

The first photograph, of well-sorted grains, is scikit-image's of gravel, or your own with ``--image``. Where the paper
picks centres by eye, here they are the places farthest from shadow, and a watershed gives each grain the area that it
seems to have: all that is nearer to it than to another, since from above no void is seen. The second, of cobbles with
sand between them, is of a bed of our own, for want of a free one: who is seen in each of its pixels is known, and so
are the centres and areas.

The cells of the centres are held against these areas, one by one and as distributions; so are Laguerre cells, whose
weights are the squares of the depths of the centres. Then the centres are parents of a cluster process, as the paper
proposes: the spread at which its cells vary as much as the photograph's grains is found. Writes ``figure_03.png`` and
``figure_12.png``. Run with ``--quick`` for a corner of the photograph and a small bed.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

import grainsdem as gd
from grainsdem.figures.frame import BLUE, INK, RED, drawing
from grainsdem.validation.overlaps import take

try:
    from skimage.data import gravel
    from skimage.feature import peak_local_max
    from skimage.filters import gaussian, threshold_local
    from skimage.segmentation import clear_border, watershed
except ImportError:
    raise SystemExit('this example needs scikit-image: pip install ".[examples]" in a checkout') from None

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

LOWER = -5
"""The first of the two walls that every cell of a slab touches."""

SHOWN = 220
"""Pixels of a photograph that are drawn, from its upper left corner."""

LEAST = 12
"""Pixels through which a grain must be seen to be picked."""


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


def cobbles_and_sand(side: float) -> gd.Packing:
    """Return a bed of sand of diameter 0.7, out of which cobbles of 3 look to the half."""
    domain = gd.Domain.box((side, side, 4.2))
    rng = np.random.default_rng(12)
    line = np.arange(2.8, side - 2.7, 3.6)
    places = np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    # Near the places of a square lattice, with sand below them and above.
    cobbles = np.column_stack([places + rng.uniform(-0.3, 0.3, places.shape), np.full(len(places), 2.1)])
    void = domain.volume - len(cobbles) * np.pi * 3.0**3 / 6
    sand = gd.points.poisson(domain, int(void / (np.pi * 0.7**3 / 6)), rng=rng)
    sizes = np.repeat([3.0, 0.7], [len(cobbles), len(sand)])
    cells = gd.sized_cells(domain, sizes, seeds=np.concatenate([cobbles, sand]), tolerance=0.05)
    bed = gd.shrink(gd.carve(cells), porosity=0.3)
    is_cobble = gd.diameters(bed.grains) > 1.5
    return take(bed, np.flatnonzero(is_cobble | (bed.positions[:, 2] < 2.3)))


def look(bed: gd.Packing, side: float) -> tuple[NDArray[np.float64], Picked]:
    """Return a photograph of a bed from above, away from its walls, and what is known of it."""
    view = gd.planform(bed, pixel=0.05, region=((2.0, 2.0), (side - 2.0, side - 2.0)))
    rows = gd.planform_table(view, bed)
    rows = rows[rows["n_pixels"] >= LEAST]
    picked = np.isin(view.labels - 1, rows["id"])
    # As on the other photograph, what is nearer to a grain than to another is taken for its own.
    _, nearest = ndimage.distance_transform_edt(~picked, return_indices=True)
    labels = view.labels[tuple(nearest)]
    ids = rows["id"] + 1
    # A pixel is inside where all about it are of the same grain.
    edge = ndimage.maximum_filter(labels, 3) != ndimage.minimum_filter(labels, 3)
    depth = ndimage.distance_transform_edt(~edge)
    down, across = np.array(ndimage.center_of_mass(np.ones(labels.shape), labels, ids)).T
    centres = np.column_stack([across + 0.5, labels.shape[0] - down - 0.5])
    areas = np.bincount(labels.ravel(), minlength=ids.max() + 1)[ids].astype(float)
    is_whole = np.isin(ids, np.unique(clear_border(labels)))
    grey = gd.photograph(view, bed, blur=0.7, noise=0.01, rng=1)
    return grey, Picked(centres, np.asarray(ndimage.maximum(depth, labels, ids)), areas, is_whole)


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
    shown = min(SHOWN, height)
    if grey is not None:
        axes.imshow(grey, cmap="gray", extent=(0, grey.shape[1], 0, grey.shape[0]), interpolation="nearest")
    color = RED if grey is not None else INK
    axes.add_collection(PolyCollection(polygons, facecolors="none", edgecolors=color, linewidths=0.8))
    axes.set(xlim=(0, shown), ylim=(height - shown, height), aspect="equal", xticks=[], yticks=[])
    axes.set_title(title, loc="left")


def study(grey: NDArray[np.float64], picked: Picked, path: Path) -> None:
    """Tessellate the centres of a photograph, print the areas and draw all."""
    domain = gd.Domain.slab(grey.shape[::-1], 10.0)
    cells = gd.tessellate(picked.centres, domain)
    weighted = gd.tessellate(picked.centres, domain, weights=picked.depths**2)
    kept = inside(cells) & inside(weighted) & picked.is_whole
    ours, better, theirs = cell_areas(cells)[kept], cell_areas(weighted)[kept], picked.areas[kept]
    print(f"{len(picked.centres)} centres, {kept.sum()} whole grains and cells; areas in pixels:")
    print("                   mean   s.d.    d10    d50    d90   most  correlation  larger than the grain")
    for name, areas in {"apparent": theirs, "Voronoi cells": ours, "Laguerre cells": better}.items():
        percentiles = "".join(f"{q:7.1f}" for q in np.percentile(areas, (10, 50, 90, 100)))
        likeness = f"{np.corrcoef(areas, theirs)[0, 1]:12.3f} {(areas > theirs).mean():22.1%}"
        print(
            f"  {name:<14} {areas.mean():7.1f}{areas.std():7.1f}{percentiles}{likeness if areas is not theirs else ''}"
        )
    print(f"Clark and Evans's index of the centres: {gd.points.clark_evans(picked.centres, domain):.3f}")
    spread, clusters = tune(picked, domain, variation(theirs))
    again = cell_areas(clusters)[inside(clusters)]
    print(
        f"clusters about the centres vary as the grains do, {variation(again):.3f} and {variation(theirs):.3f} of the "
        f"mean, at a spread of {spread:.2f} spacings"
    )
    from matplotlib.ticker import NullFormatter

    with drawing(path, (9.6, 6.6), dpi=100) as figure:
        ((first, second, third), (fourth, fifth, sixth)) = figure.subplots(2, 3)
        show(first, "(a) centres", grey, [])
        first.plot(*picked.centres.T, ".", color=RED, markersize=4)
        show(second, "(b) their cells", None, outlines(cells))
        show(third, "(c) both", grey, outlines(cells))
        least, most = np.percentile(theirs, 0.5), 1.1 * theirs.max()
        bins = np.geomspace(least, most, 24)
        fourth.hist(theirs, bins, color=BLUE, alpha=0.4, label="apparent")
        fourth.hist(ours, bins, histtype="step", color=RED, linewidth=1.4, label="Voronoi")
        fourth.hist(better, bins, histtype="step", color=INK, linewidth=1.0, label="Laguerre")
        fourth.set(xlabel="area  [pixels]", ylabel="grains", xscale="log")
        # Where nearly all grains are small, the few large ones would not be seen.
        if theirs.max() > 8 * np.median(theirs):
            fourth.set_yscale("log")
        fourth.legend(frameon=False, fontsize=8)
        fourth.set_title("(d) areas", loc="left")
        fifth.loglog(theirs, better, ".", color=INK, markersize=2)
        fifth.loglog(theirs, ours, ".", color=RED, markersize=2)
        fifth.plot([least, most], [least, most], "-", color=BLUE, linewidth=1)
        fifth.set(xlabel="apparent area  [pixels]", ylabel="cell area  [pixels]")
        fifth.set(xlim=(least, most), ylim=(least, most), aspect="equal")
        fifth.set_title("(e) one by one", loc="left")
        for axis in (fourth.xaxis, fourth.yaxis, fifth.xaxis, fifth.yaxis):
            axis.set_minor_formatter(NullFormatter())
        show(sixth, "(f) clusters about the centres", None, outlines(clusters))
    print(f"wrote {path}")


def main() -> None:
    """Study both photographs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a corner of the photograph, and a small bed")
    parser.add_argument("--image", type=Path, help="a photograph of your own, instead of the gravel")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the pictures")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    grey = gd.points.image_density(options.image or gravel(), light="fine")[:, ::-1].T
    grey = grey[: SHOWN + 20, : SHOWN + 20] if options.quick else grey
    print("figure 3: gravel, well sorted" if options.image is None else f"figure 3: {options.image}")
    study(grey, pick(grey), options.output / "figure_03.png")
    print("figure 12: cobbles and sand")
    side = 9.2 if options.quick else 20.0
    study(*look(cobbles_and_sand(side), side), options.output / "figure_12.png")


if __name__ == "__main__":
    main()
