"""Figure 14 of Buscombe and Rubin (2012): the sphericity of grains by the model of their seeds, and by how they shrink.

Left: Wadell's sphericity of the grains of five models, with regular solids for comparison. Right: its mean against
porosity. The paper's factor F scales every grain and keeps its shape; moving all faces inward by one distance, as
erosion does, does not. The table has the mean sphericity of many settings of the models beside the paper's, as measured
and not tuned. Writes ``figure_14.png``. Run with ``--quick`` for small beds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.frame import INK, drawing

SOLIDS = {"tetrahedron": 0.671, "cube": 0.806, "octahedron": 0.846, "dodecahedron": 0.910, "icosahedron": 0.939}

COLORS = {
    "Poisson": "#2f6690",
    "CVT-uniform, 5 iterations": "#3a7d44",
    "CVT-Halton, 20 iterations": "#7a5195",
    "Strauss, δ = 0.8, c = 0.05": "#b5452c",
    "clusters, 20 children, σ = 0.5": "#d08c2a",
}

Seeds = Callable[[gd.Domain, int], np.ndarray]


def models(n: int) -> dict[str, tuple[Seeds, str]]:
    """Return seeds of each model, and what the paper says of its sphericity; lengths in mean distances of seeds."""
    spacing = n ** (-1 / 3)

    def relaxed(seeds: Seeds, iterations: int) -> Seeds:
        return lambda domain, n: gd.relax(seeds(domain, n), domain, iterations=iterations)

    def poisson(domain: gd.Domain, n: int) -> np.ndarray:
        return gd.points.poisson(domain, n, rng=14)

    def strauss(distance: float, inhibition: float) -> Seeds:
        return lambda domain, n: gd.points.strauss(
            domain, n, distance=distance * spacing, inhibition=inhibition, rng=14
        )

    def clusters(children: int, spread: float) -> Seeds:
        return lambda domain, n: gd.points.cluster_poisson(
            domain, n, parents=max(2, n // children), spread=spread * spacing, rng=14
        )

    found: dict[str, tuple[Seeds, str]] = {
        "Poisson": (poisson, "0.87"),
        "Halton": (gd.points.halton, "–"),
        "CVT-uniform, 1 iteration": (relaxed(poisson, 1), "0.87"),
        "CVT-uniform, 5 iterations": (relaxed(poisson, 5), "0.87"),
        "CVT-Halton, 5 iterations": (relaxed(gd.points.halton, 5), "0.87–0.9"),
        "CVT-Halton, 20 iterations": (relaxed(gd.points.halton, 20), "0.87–0.9"),
    }
    for distance, inhibition in ((3.0, 0.98), (0.5, 0.5), (0.8, 0.5), (0.8, 0.05), (0.8, 0.0)):
        found[f"Strauss, δ = {distance:g}, c = {inhibition:g}"] = (strauss(distance, inhibition), "0.75–0.78")
    for children, spread in ((5, 0.5), (20, 1.0), (20, 0.5), (20, 0.25), (100, 0.5), (20, 0.1)):
        found[f"clusters, {children} children, σ = {spread:g}"] = (clusters(children, spread), "0.65–0.8")
    return found


def main() -> None:
    """Grow the beds, print their sphericity and draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the picture")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    n = 400 if options.quick else 10_000

    print("seeds in the unit cube             grains  mean sphericity   sd  below 0.7   paper   scaled to F = 0.7")
    domain, beds = gd.Domain.cube(), {}
    for name, (seeds, paper) in models(n).items():
        bed = gd.carve(gd.tessellate(seeds(domain, n), domain))
        s = gd.sphericities(bed.grains)
        small = gd.sphericities(gd.shrink(bed, scale=0.7).grains)
        error, few = s.std() / np.sqrt(s.size), (s < 0.7).mean()
        print(
            f"{name:34} {s.size:6} {s.mean():8.4f} ± {error:.4f} {s.std():6.3f} {few:8.1%} {paper:>10}"
            f" {small.mean():12.4f}"
        )
        if name in COLORS:
            beds[name] = bed
    with drawing(options.output / "figure_14.png", (9.6, 4.2), dpi=110) as figure:
        left, right = figure.subplots(1, 2)
        _draw_distributions(left, {name: gd.sphericities(bed.grains) for name, bed in beds.items()})
        _draw_porosity(right, beds)
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    print(f"wrote {options.output / 'figure_14.png'}")


def _draw_distributions(axes, sphericities: dict[str, np.ndarray]) -> None:  # noqa: ANN001  (matplotlib comes without types)
    classes = np.linspace(0.4, 1.0, 81)
    for name, s in sphericities.items():
        density, _ = np.histogram(s, classes, density=True)
        axes.stairs(density, classes, color=COLORS[name], label=name, linewidth=1.4)
    top = axes.get_ylim()[1]
    for name, s in SOLIDS.items():
        axes.axvline(s, color=INK, linewidth=0.7, linestyle=(0, (2, 3)))
        axes.annotate(name, (s, top), rotation=90, ha="right", va="top", fontsize=7, color=INK)
    axes.set(xlabel="sphericity S", ylabel="density", xlim=(0.45, 0.97), ylim=(0, top))
    axes.set_title("(a) cells as grown", loc="left")


def _draw_porosity(axes, beds: dict[str, gd.Packing]) -> None:  # noqa: ANN001  (matplotlib comes without types)
    """Draw the mean sphericity of grains that are scaled, and of the same grains with their faces moved inward."""
    for name, bed in beds.items():
        scaled = [gd.shrink(bed, scale=scale) for scale in (1.0, 0.9, 0.8, 0.7)]
        axes.plot([gd.porosity(b) for b in scaled], [_mean(b) for b in scaled], "-o", color=COLORS[name], markersize=3)
        # The smallest grain's nearest face bounds what can be taken from all.
        most = min(0.9 * float(gd.face_planes(bed.grains).heights.min()), 0.13 * float(gd.diameters(bed.grains).mean()))
        inset = [gd.inset(bed, share * most) for share in (0.0, 0.33, 0.67, 1.0)]
        axes.plot([gd.porosity(b) for b in inset], [_mean(b) for b in inset], "--s", color=COLORS[name], markersize=3)
    axes.plot([], [], "-o", color=INK, markersize=3, label="scaled by F")
    axes.plot([], [], "--s", color=INK, markersize=3, label="faces moved inward")
    axes.set(xlabel="porosity of the cells", ylabel="mean sphericity")
    axes.set_title("(b) shrunk", loc="left")
    axes.legend(frameon=False, fontsize=8)


def _mean(bed: gd.Packing) -> float:
    return float(gd.sphericities(bed.grains).mean())


if __name__ == "__main__":
    main()
