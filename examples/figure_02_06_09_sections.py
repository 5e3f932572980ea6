"""Figures 2, 6 and 9 of Buscombe and Rubin (2012): sections through beds.

Figure 2: pore space before and after grains are moved within their cells, at a porosity of 0.3. Figure 6: Poisson,
relaxed Poisson and relaxed Halton seeds, from disorder to order. Figure 9: clusters about the same six parents, with
more and more children, and the sizes of three of those beds; with the paper's spread, and with one that leaves the
clusters apart. Writes ``figure_02.png``, ``figure_06.png``, ``figure_09.png``, ``figure_09_sizes.png`` and the last two
again as ``figure_09_tight``. Run with ``--quick`` for small beds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.frame import BLUE, RED, drawing

KEPT = "Cells at the walls are kept. The square is a face of the unit cube."


def figure_02(folder: Path, n: int) -> None:
    """Draw two levels of a bed as it was grown, and with every grain moved within its cell."""
    domain = gd.Domain.cube(1.0)
    seeds = gd.relax(gd.points.halton(domain, n), domain, iterations=10)
    grown = gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.3)
    moved = gd.jitter_throats(grown, rng=2)
    beds = {"as grown": grown, "moved": moved}
    cuts = [gd.section(bed, z=level) for bed in beds.values() for level in (0.35, 0.65)]
    titles = [f"{name}, z = {level}" for name in beds for level in (0.35, 0.65)]
    gd.figures.section_figure(cuts, folder / "figure_02.png", titles=titles, note=KEPT)
    print("figure 2        porosity  throats: mean  standard deviation")
    for name, bed in beds.items():
        widths = gd.throat_widths(bed)
        void = 1 - np.mean(
            [gd.section_summary(gd.section(bed, z=z))["area_fraction"] for z in np.linspace(0.1, 0.9, 33)]
        )
        print(f"{name:15} {void:8.3f} {widths.mean():14.4f} {widths.std():14.4f}")


def figure_06(folder: Path, n: int) -> None:
    """Draw sections of three beds that grow more and more regular."""
    domain = gd.Domain.cube(1.0)
    poisson, halton = gd.points.poisson(domain, n, rng=6), gd.points.halton(domain, n)
    models = {
        "(a) NVT-Poisson": poisson,
        "(b) CVT-Uniform": gd.relax(poisson, domain, iterations=10),
        "(c) CVT-Halton": gd.relax(halton, domain, iterations=10),
    }
    cuts = []
    print("figure 6         sd/mean of volumes  of areas in sections  six corners  sphericity  number / expected")
    for name, seeds in models.items():
        cells = gd.carve(gd.tessellate(seeds, domain), keep="all")
        cuts.append(gd.section(gd.shrink(cells, porosity=0.3), z=0.5))
        tables = [gd.section_table(gd.section(cells, z=z)) for z in np.linspace(0.2, 0.8, 13)]
        # Cells that the walls bound have other shapes.
        inside = np.concatenate([t[(np.abs([t["u"] - 0.5, t["v"] - 0.5]) < 0.35).all(axis=0)] for t in tables])
        volumes = gd.volumes(cells.grains)[(np.abs(cells.positions - 0.5) < 0.35).all(axis=1)]
        areas, number = inside["area"], np.mean([len(t) for t in tables])
        expected = gd.expected_section(cells, normal=[0, 0, 1])["n_per_area"]
        print(
            f"{name:15} {volumes.std() / volumes.mean():15.3f} {areas.std() / areas.mean():20.3f} "
            f"{np.mean(inside['n_corners'] == 6):15.3f} {gd.sphericities(cells.grains).mean():11.3f}"
            f"{number / expected:15.3f}"
        )
    gd.figures.section_figure(cuts, folder / "figure_06.png", titles=list(models), columns=3, note=KEPT)


def figure_09(folder: Path, children: list[int], spread: float, name: str) -> None:
    """Draw sections of clusters with more and more children, and the sizes of the first, middle and last bed."""
    domain = gd.Domain.cube(1.0)
    parents = gd.points.poisson(domain, 6, rng=9)
    beds = []
    for count in children:
        seeds = gd.points.cluster_poisson(domain, parents=parents, children=count, spread=spread, rng=count)
        beds.append(gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), scale=0.93))
    letters = "abcdefghi"
    titles = [f"({a}) λ = {count}: {len(bed)} grains" for a, count, bed in zip(letters, children, beds, strict=False)]
    note = f"{KEPT} Crosses: the six parents as seen from above, smaller the farther from the plane."
    cuts = [gd.section(bed, z=0.5) for bed in beds]
    gd.figures.section_figure(cuts, folder / f"{name}.png", titles=titles, marks=parents, note=note)
    print(f"σ² = {spread**2:.3g}: λ   grains  in the section  mean diameter  sd / mean")
    for count, bed in zip(children, beds, strict=True):
        d = gd.diameters(bed.grains)
        seen = len(gd.section(bed, z=0.5))
        print(f"{count:13} {len(bed):8} {seen:11} {d.mean():14.3f} {d.std() / d.mean():12.3f}")
    shown = [0, len(beds) // 2, len(beds) - 1]
    with drawing(folder / f"{name}_sizes.png", (9.0, 2.8), dpi=110) as figure:
        for axes, k in zip(figure.subplots(1, 3), shown, strict=True):
            true = gd.diameters(beds[k].grains)
            apparent = gd.section_table(gd.section(beds[k], z=0.5))["diameter"]
            classes = np.linspace(0, 1.1 * true.max(), 16)
            axes.hist(true, classes, density=True, color=BLUE, alpha=0.5, label="grains")
            axes.hist(
                apparent, classes, density=True, histtype="step", color=RED, linewidth=1.4, label="in the section"
            )
            axes.set(xlabel="diameter  [edges of the cube]", ylabel="density", xlim=(0, None))
            axes.set_title(titles[k], loc="left", fontsize=9)
        axes.legend(frameon=False, fontsize=8)


def main() -> None:
    """Make the three figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the pictures")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    figure_02(options.output, 60 if options.quick else 250)
    figure_06(options.output, 200 if options.quick else 4000)
    children = [20, 60, 100] if options.quick else [10, 20, 30, 40, 50, 60, 70, 85, 100]
    figure_09(options.output, children, np.sqrt(0.2), "figure_09")
    figure_09(options.output, children, 0.1, "figure_09_tight")
    print(f"wrote the sections to {options.output}")


if __name__ == "__main__":
    main()
