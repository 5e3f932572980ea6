"""Figures 10 and 11 of Buscombe and Rubin (2012): beds whose seeds are as dense as noise, or as an image, says.

Beds of 1000 grains on thirty fields of noise of amplitude 1/f^5, and thirty of 1/f^0.5: no two fields have the same
percentiles, so their mean is shown beside the paper's, with the spread, and so are beds in the cube and their sections.
The field that is drawn is the one whose d90/d10 is nearest to the mean. Then a bed on a photograph, first without its
fine detail, whose light parts are taken as coarse. With ``--image`` give your own, such as a photograph of ripples;
without it scikit-image's of gravel is taken. Writes ``figure_10_11.png``. Run with ``--quick`` for fewer grains and
fields.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import t as student

import grainsdem as gd
from grainsdem.figures.frame import BLUE, GREY, INK, RED, drawing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    Row = tuple[Axes, Axes, Axes, Axes]

PAPER = {5.0: (61, 164, 297), 0.5: (121, 210, 311)}
"""Percentiles d10, d50 and d90 [pixels] of the paper's two beds, by the exponent of their noise."""

SHARES = np.linspace(0, 100, 101)
"""Percentiles at which curves of sizes are drawn."""


def grow(seeds: NDArray[np.float64], domain: gd.Domain) -> tuple[gd.Packing, NDArray[np.float64]]:
    """Return the cells of seeds in a slab, and the diameters of the circles of equal area of those inside."""
    cells = gd.tessellate(seeds, domain)
    inside = gd.volumes(gd.carve(cells).grains) / domain.lengths[2]
    return gd.carve(cells, keep="all"), np.sqrt(4 * inside / np.pi)


def draw(axes: Row, field: NDArray[np.float64], seeds: NDArray[np.float64], bed: gd.Packing) -> None:
    """Draw a field whose axes are x and y, the seeds, and their cells."""
    from matplotlib.collections import PolyCollection

    first, second, third, _ = axes
    size = bed.domain.lengths
    extent = (0, size[0], 0, size[1])
    first.imshow(field.T[::-1], cmap="gray", extent=extent)
    second.plot(seeds[:, 0], seeds[:, 1], ".", color=INK, markersize=1.6)
    cut = gd.section(bed, z=0.5 * size[2])
    polygons = [cut.polygon(k) for k in range(len(cut))]
    third.add_collection(PolyCollection(polygons, facecolors="white", edgecolors=INK, linewidths=0.5))
    for panel in axes[:3]:
        panel.set(xlim=extent[:2], ylim=extent[2:], aspect="equal", xticks=[], yticks=[])
        panel.spines[["top", "right"]].set_visible(True)


def interval(values: NDArray[np.float64]) -> str:
    """Return the mean of a quantity over fields, and half the width of its interval of 95 % (Student)."""
    half = student.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return f"{values.mean():.3f} ± {half:.3f}"


def in_the_cube(beta: float, n: int, rng: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the diameters of a bed on noise in the unit cube, and of its sections."""
    cube = gd.Domain.cube()
    bed = gd.carve(gd.tessellate(gd.points.pink_noise(cube, n, beta=beta, rng=rng), cube))
    cuts = [gd.section_table(gd.section(bed, z=z))["diameter"] for z in np.linspace(0.1, 0.9, 17)]
    return gd.diameters(bed.grains), np.concatenate(cuts)


def on_noise(beta: float, n: int, n_fields: int, axes: Row) -> None:
    """Grow a bed on each field in the unit square and cube, print the sizes' means, and draw the nearest to them."""
    domain = gd.Domain.slab((1.0, 1.0), 0.01)
    places = [gd.points.pink_noise(domain, n, beta=beta, resolution=256, rng=rng) for rng in range(n_fields)]
    beds, sizes = zip(*(grow(seeds, domain) for seeds in places), strict=True)
    solids, cuts = zip(*(in_the_cube(beta, n, rng) for rng in range(n_fields)), strict=True)
    for name, found in {"square": sizes, "cube": solids, "cuts of it": cuts}.items():
        low, middle, high = np.array([np.percentile(d, (10, 50, 90)) for d in found]).T
        ratios = (low / middle, high / middle, high / low)
        print(f"  β = {beta:<4g} {name:<11}" + "".join(f"{interval(ratio):>18}" for ratio in ratios))
    low, middle, high = PAPER[beta]
    print(f"  β = {beta:<4g} paper      " + "".join(f"{r:>18.3f}" for r in (low / middle, high / middle, high / low)))
    order = np.array([gd.points.clark_evans(seeds, domain) for seeds in places])
    contrast = np.array([np.percentile(d, 90) / np.percentile(d, 10) for d in sizes])
    shown = int(np.argmin(np.abs(contrast - contrast.mean())))
    print(
        f"  β = {beta:<4g} Clark and Evans's index in the square {interval(order)}; drawn is field {shown}, "
        f"d90/d10 from {contrast.min():.2f} to {contrast.max():.2f}"
    )
    draw(axes, gd.points.noise_field((256, 256), beta, rng=shown), places[shown], beds[shown])
    axes[0].set_title(f"1/f$^{{{beta:g}}}$", loc="left")
    curves = np.array([np.percentile(d / np.median(d), SHARES) for d in sizes])
    for curve in curves:
        axes[3].plot(curve, SHARES, color=GREY, linewidth=0.4)
    axes[3].plot(curves.mean(axis=0), SHARES, color=INK, linewidth=1.8, label=f"mean of {n_fields} fields")
    axes[3].plot(np.array(PAPER[beta]) / PAPER[beta][1], (10, 50, 90), "o", color=RED, markersize=4.5, label="paper")
    axes[3].legend(frameon=False, fontsize=8, loc="lower right")
    axes[3].set(xlim=(0, 3))


def on_image(image: Path | NDArray[np.float64], n: int, axes: Row) -> None:
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
    for chosen, color, name in ((is_light, RED, "where it is light"), (~is_light, BLUE, "where it is dark")):
        d = np.sqrt(4 * areas[chosen] / np.pi)
        axes[3].plot(np.percentile(d, SHARES) / np.sqrt(4 * np.median(areas) / np.pi), SHARES, color=color, label=name)
    axes[3].legend(frameon=False, fontsize=8, loc="lower right")
    axes[3].set(xlim=(0, 3))
    print(
        f"  image   {len(bed)} grains; median area {np.median(areas[is_light]):.0f} pixels where it is light, "
        f"{np.median(areas[~is_light]):.0f} where it is dark"
    )


def photograph() -> NDArray[np.float64]:
    """Return scikit-image's photograph of gravel, or end with what brings it."""
    try:
        from skimage.data import gravel  # noqa: PLC0415  (only here, and by an extra)
    except ImportError:
        raise SystemExit(
            'without --image this example needs scikit-image: pip install ".[examples]" in a checkout'
        ) from None
    return gravel()


def main() -> None:
    """Grow the beds, print their sizes and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="fewer grains and fields")
    parser.add_argument("--image", type=Path, help="a photograph of your own")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the picture")
    options = parser.parse_args()
    image = photograph() if options.image is None else options.image
    options.output.mkdir(parents=True, exist_ok=True)
    n, n_fields = (200, 3) if options.quick else (1000, 30)

    with drawing(options.output / "figure_10_11.png", (11.2, 8.6), dpi=100) as figure:
        rows = figure.subplots(3, 4)
        print(f"{n} grains on each of {n_fields} fields; mean and its interval of 95 %:")
        print(f"{'':23}{'d10/d50':>18}{'d90/d50':>18}{'d90/d10':>18}")
        for row, beta in zip(rows, PAPER, strict=False):
            on_noise(beta, n, n_fields, tuple(row))
        on_image(image, n, tuple(rows[2]))
        for row in rows:
            row[3].set(xlabel="diameter / median", ylabel="smaller  [%]", ylim=(0, 100), box_aspect=0.9)
        rows[0][3].set_title("how large", loc="left")
    print(f"wrote {options.output / 'figure_10_11.png'}")


if __name__ == "__main__":
    main()
