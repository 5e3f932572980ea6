"""Figures 10 and 11 of Buscombe and Rubin (2012): beds whose seeds are as dense as noise, or as an image, says.

Two beds of 1000 grains on noise of amplitude 1/f^5 and 1/f^0.5, with the percentiles of their diameters beside the
paper's, and those of a bed in the cube and of its sections; then a bed on a photograph, first without its fine detail,
whose light parts are taken as coarse. With ``--image`` give your own, such as a photograph of ripples; without it
scikit-image's of gravel is taken. Writes ``figure_10_11.png``. Run with ``--quick`` for fewer grains.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from skimage.data import gravel

import grainsdem as gd
from grainsdem.figures.frame import INK, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

PAPER = {5.0: (61, 164, 297), 0.5: (121, 210, 311)}
"""Percentiles d10, d50 and d90 [pixels] of the paper's two beds, by the exponent of their noise."""


def grow(seeds: NDArray[np.float64], domain: gd.Domain) -> tuple[gd.Packing, NDArray[np.float64]]:
    """Return the cells of seeds in a slab, and the diameters of the circles of equal area of those inside."""
    cells = gd.tessellate(seeds, domain)
    inside = gd.volumes(gd.carve(cells).grains) / domain.lengths[2]
    return gd.carve(cells, keep="all"), np.sqrt(4 * inside / np.pi)


def draw(
    axes: tuple[Axes, Axes, Axes], field: NDArray[np.float64], seeds: NDArray[np.float64], bed: gd.Packing
) -> None:
    """Draw a field whose axes are x and y, the seeds, and their cells."""
    from matplotlib.collections import PolyCollection

    first, second, third = axes
    size = bed.domain.lengths
    extent = (0, size[0], 0, size[1])
    first.imshow(field.T[::-1], cmap="gray", extent=extent)
    second.plot(seeds[:, 0], seeds[:, 1], ".", color=INK, markersize=1.6)
    cut = gd.section(bed, z=0.5 * size[2])
    polygons = [cut.polygon(k) for k in range(len(cut))]
    third.add_collection(PolyCollection(polygons, facecolors="white", edgecolors=INK, linewidths=0.5))
    for panel in axes:
        panel.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xticks=[], yticks=[])


def on_noise(beta: float, n: int, axes: tuple[Axes, Axes, Axes]) -> None:
    """Draw a bed on noise in a unit square, and print its sizes and those of a bed in the unit cube."""
    domain = gd.Domain.slab((1.0, 1.0), 0.01)
    seeds = gd.points.pink_noise(domain, n, beta=beta, resolution=256, rng=10)
    bed, sizes = grow(seeds, domain)
    draw(axes, gd.points.noise_field((256, 256), beta, rng=10), seeds, bed)
    axes[0].set_title(f"1/f$^{{{beta:g}}}$", loc="left")
    cube = gd.Domain.cube()
    solid = gd.carve(gd.tessellate(gd.points.pink_noise(cube, n, beta=beta, rng=10), cube))
    cuts = [gd.section_table(gd.section(solid, z=z))["diameter"] for z in np.linspace(0.1, 0.9, 17)]
    order = gd.points.clark_evans(seeds, domain)
    beds = {"square": sizes, "cube": gd.diameters(solid.grains), "cuts of it": np.concatenate(cuts), "paper": None}
    for name, values in beds.items():
        low, middle, high = PAPER[beta] if values is None else np.percentile(values, (10, 50, 90))
        index = f"   Clark and Evans's index {order:.3f}" if name == "square" else ""
        print(f"  β = {beta:<4g} {name:<10} d10/d50 {low / middle:.3f}   d90/d50 {high / middle:.3f}{index}")


def on_image(image: Path | NDArray[np.float64], n: int, axes: tuple[Axes, Axes, Axes]) -> None:
    """Draw a bed on a photograph, and print how its cells go with light and dark."""
    columns, rows = gd.points.image_density(image).shape
    # A part of the middle, as the paper takes one.
    region = (columns // 8, rows // 8, columns - columns // 8, rows - rows // 8)
    options = {"region": region, "low_pass": 0.02, "gain": 8.0, "cutoff": 0.5, "floor": 0.1}
    density = gd.points.image_density(image, light="coarse", **options)
    domain = gd.Domain.slab(density.shape, 10.0)
    seeds = gd.points.from_image(domain, n, image, light="coarse", **options, rng=11)
    bed, _ = grow(seeds, domain)
    draw(axes, 1.0 - density, seeds, bed)
    axes[0].set_title("photograph, a part", loc="left")
    extent = (0, density.shape[0], 0, density.shape[1])
    axes[0].imshow(gd.points.image_density(image, light="fine", region=region).T[::-1], cmap="gray", extent=extent)
    axes[1].set_title("low-passed, light is coarse", loc="left")
    axes[1].imshow((1.0 - density).T[::-1], cmap="gray", extent=extent, alpha=0.6)
    pixel = tuple(seeds[:, :2].astype(int).T)
    areas = gd.volumes(bed.grains) / domain.lengths[2]
    is_light = density[pixel] < np.median(density)
    print(
        f"  image   {len(bed)} grains; median area {np.median(areas[is_light]):.0f} pixels where it is light, "
        f"{np.median(areas[~is_light]):.0f} where it is dark"
    )


def main() -> None:
    """Grow the three beds, print their sizes and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer grains")
    parser.add_argument("--image", type=Path, help="a photograph of your own")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the picture")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    n = 200 if options.quick else 1000

    with drawing(options.output / "figure_10_11.png", (8.4, 8.6), dpi=90) as figure:
        rows = figure.subplots(3, 3)
        print(f"{n} grains each; diameters over their median:")
        for row, beta in zip(rows, PAPER, strict=False):
            on_noise(beta, n, tuple(row))
        on_image(gravel() if options.image is None else options.image, n, tuple(rows[2]))
    print(f"wrote {options.output / 'figure_10_11.png'}")


if __name__ == "__main__":
    main()
