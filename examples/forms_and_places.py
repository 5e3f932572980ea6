"""Grow Zingg's four classes in one bed, a lens of sand in gravel, and gravel whose voids are filled with sand.

All of it takes two minutes; run with ``--quick`` for fewer grains.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd

SHARES = {"disc": 0.3, "spheroid": 0.4, "blade": 0.1, "rod": 0.2}


def cut_open(bed: gd.Packing, *, place: float = 0.5) -> gd.Packing:
    """Return the grains behind a plane across y, so that one sees what is inside."""
    behind = bed.positions[:, 1] >= bed.domain.lower[1] + place * bed.domain.lengths[1]
    return gd.subset(bed, np.flatnonzero(behind))


def zingg_bed(n: int, folder: Path) -> str:
    """Draw a bed of Zingg's classes that lie any way, and their diagram."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    found = gd.mixed_cells(gd.Domain.cube(periodic=True), gd.Forms(SHARES), n=n, keep="all", rng=1)
    bed = gd.shrink(gd.carve(found.cells, keep="all"), porosity=0.4)
    axes = gd.box_axes(bed)
    classes = gd.zingg(axes)
    names = list(SHARES)
    numbers = np.array([names.index(name) for name in classes])
    bed = gd.Packing(
        bed.grains, bed.positions, bed.quaternions, bed.densities, bed.domain, classes=numbers.astype(np.int32)
    )
    gd.figures.render(bed, folder / "zingg_bed.png", color_by="class", size=(800, 600))
    figure = Figure(figsize=(5, 5), layout="constrained")
    FigureCanvasAgg(figure)
    plot = figure.subplots()
    b_a, c_b = axes[:, 1] / axes[:, 0], axes[:, 2] / axes[:, 1]
    for k, name in enumerate(names):
        rows = numbers == k
        plot.scatter(c_b[rows], b_a[rows], s=9, label=f"{name} {rows.mean():.3f} (asked {SHARES[name]:g})")
    plot.axhline(2 / 3, color="0.6", lw=0.8)
    plot.axvline(2 / 3, color="0.6", lw=0.8)
    plot.set(xlim=(0.2, 1), ylim=(0.2, 1), xlabel="c/b", ylabel="b/a")
    plot.legend(loc="lower left", fontsize=8)
    figure.savefig(folder / "zingg_diagram.png", dpi=110)
    shares = ", ".join(f"{name} {(classes == name).mean():.3f}" for name in names)
    return f"{len(bed)} grains fill {found.cells.fill:.3f} of the space before they shrink: {shares}"


def lens_bed(n: int, folder: Path) -> str:
    """Draw gravel with a lens of sand, cut open."""
    gravel, sand = gd.Grading([2e-3, 4e-3], [0.0, 1.0]), gd.Grading([1e-3, 2e-3], [0.0, 1.0])
    domain = gd.Domain.box((1.0, 1.0, 0.7))
    lens = gd.Lens((0.5, 0.5, 0.35), (0.42, 0.42, 0.14), trend=0.0, dip=0.15)
    layers = [gd.Layer(gravel), gd.Layer(sand, lens=lens)]
    found = gd.layered_cells(domain, layers, n=n, keep="all", rng=1)
    bed = gd.shrink(gd.carve(found.cells, keep="all", classes=found.classes), porosity=0.35)
    gd.figures.render(cut_open(bed), folder / "lens.png", color_by="class", size=(800, 600))
    share = gd.volumes(bed)[bed.classes == 1].sum() / gd.volumes(bed).sum()
    return f"a lens of {np.count_nonzero(bed.classes == 1)} grains makes up {share:.3f} of the solid"


def infill_bed(n: int, folder: Path) -> str:
    """Draw gravel with sand in its voids, cut open."""
    domain = gd.Domain.cube(0.02)
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=5)
    coarse = gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)
    side = 0.02 / n ** (1 / 3)
    bed = gd.infill(coarse, share=0.2, diameter=0.25 * side, rng=1)
    gd.figures.render(cut_open(bed, place=0.35), folder / "infill.png", color_by="class", size=(800, 600))
    fine = bed.classes == 1
    porosity = gd.porosity(bed, region="domain")
    share = gd.masses(bed)[fine].sum() / gd.masses(bed).sum()
    return f"{np.count_nonzero(fine)} fine grains of {share:.3f} of the mass leave a porosity of {porosity:.3f}"


def main() -> None:
    """Grow and draw the three beds, and print what they have."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer grains")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the pictures")
    arguments = parser.parse_args()
    folder = arguments.output
    counts = (120, 500, 25) if arguments.quick else (800, 2500, 80)
    for make, n in zip((zingg_bed, lens_bed, infill_bed), counts, strict=True):
        print(make(n, folder))


if __name__ == "__main__":
    main()
