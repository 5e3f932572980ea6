"""Figure 13 of Buscombe and Rubin (2012): how grain sizes of CVT-Halton beds are distributed, and what fits them.

Beds of 2500 to 40 000 seeds of Halton's sequence, relaxed 20 times: in space (left) and, like the images of the paper's
figure, in the plane (right). Symbols are the grains, lines their log-hyperbolic fits by maximum likelihood, dotted ones
lognormal. The table holds the three families against one another by AIC and by the distance of Kolmogorov and Smirnov,
for these beds and for other models. Writes ``figure_13.png``. Run with ``--quick`` for small beds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.frame import INK, drawing

MARKERS = ("*", "P", "D", "o", "s")
COLORS = ("#2f6690", "#3a7d44", "#7a5195", "#b5452c", "#d08c2a")


def grow(model: str, n: int, *, planar: bool = False) -> np.ndarray:
    """Return the equal-volume, or equal-area, diameters of the grains of one model inside the walls."""
    domain = gd.Domain.slab((1.0, 1.0), 0.1 / np.sqrt(n)) if planar else gd.Domain.cube()
    spacing = n ** (-1 / 3)
    if model == "CVT-Halton":
        seeds = gd.relax(gd.points.halton(domain, n), domain, iterations=20)
    elif model == "CVT-uniform":
        seeds = gd.relax(gd.points.poisson(domain, n, rng=13), domain, iterations=5)
    elif model == "Strauss":
        seeds = gd.points.strauss(domain, n, distance=0.8 * spacing, inhibition=0.05, rng=13)
    elif model == "clusters":
        seeds = gd.points.cluster_poisson(domain, n, parents=n // 20, spread=0.5 * spacing, rng=13)
    else:
        seeds = gd.points.poisson(domain, n, rng=13)
    return gd.table(gd.carve(gd.tessellate(seeds, domain)))["diameter"]


def tell(name: str, d: np.ndarray) -> dict[str, gd.SizeFit]:
    """Fit the three families to sizes and print a row of the table."""
    fits = {family: gd.fit_sizes(d, family) for family in ("normal", "lognormal", "log-hyperbolic")}
    best = min(fit.aic for fit in fits.values())
    hyperbolic = fits["log-hyperbolic"]
    low, high = hyperbolic.intervals["xi"]
    print(
        f"{name:22} {d.size:6} {d.std() / d.mean():6.3f} "
        + " ".join(f"{fit.aic - best:9.1f}" for fit in fits.values())
        + "  "
        + " ".join(f"{fit.ks:.4f}" for fit in fits.values())
        + f" {hyperbolic.ks_p_value:6.2f}  {hyperbolic.parameters['chi']:6.3f} {hyperbolic.parameters['xi']:6.3f}"
        + f" [{low:.3f}, {high:.3f}] {hyperbolic.edge or ''}"
    )
    return fits


def main() -> None:
    """Grow the beds, print the fits and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds, few of them")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for the picture")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    counts = [300, 600] if options.quick else [2500, 5000, 10_000, 20_000, 40_000]

    print(
        "bed                    grains std/mean  AIC above the best: n, ln, lh    K–S: n, ln, lh     p(lh)    χ      ξ"
    )
    with drawing(options.output / "figure_13.png", (9.6, 4.2), dpi=110) as figure:
        for axes, planar in zip(figure.subplots(1, 2), (False, True), strict=True):
            for n, marker, color in zip(counts, MARKERS, COLORS, strict=False):
                d = grow("CVT-Halton", n, planar=planar)
                fits = tell(f"CVT-Halton {n}{' planar' if planar else ''}", d)
                _draw(axes, d, fits, marker=marker, color=color, label=f"{n} seeds")
            size = "area" if planar else "volume"
            axes.set(xscale="log", yscale="log", ylabel="density of ln d")
            axes.set(xlabel=f"equal-{size} diameter d  [edges of the {'square' if planar else 'cube'}]")
            axes.set_title("(b) in the plane" if planar else "(a) in space", loc="left")
        axes.plot([], [], "-", color=INK, label="log-hyperbolic")
        axes.plot([], [], ":", color=INK, label="lognormal")
        axes.legend(frameon=False, fontsize=8)
    for model in ("Poisson", "CVT-uniform", "Strauss", "clusters"):
        n = counts[len(counts) // 2]
        tell(f"{model} {n}", grow(model, n))
    print(f"wrote {options.output / 'figure_13.png'}")


def _draw(axes, d: np.ndarray, fits: dict[str, gd.SizeFit], *, marker: str, color: str, label: str) -> None:  # noqa: ANN001  (matplotlib comes without types)
    """Draw the density of ln d in classes with five grains or more, and the fits."""
    edges = np.linspace(np.log(d.min()), np.log(d.max()), 41)
    counts, _ = np.histogram(np.log(d), edges)
    middles, width = np.exp(0.5 * (edges[1:] + edges[:-1])), edges[1] - edges[0]
    enough = counts >= 5
    axes.plot(middles[enough], counts[enough] / (d.size * width), marker, color=color, markersize=4, label=label)
    line = np.exp(np.linspace(edges[0], edges[-1], 300))
    for family, style in (("log-hyperbolic", "-"), ("lognormal", ":")):
        density = line * fits[family].distribution.density(line)
        drawn = density > 2.0 / (d.size * width)
        axes.plot(line[drawn], density[drawn], style, color=color, linewidth=1)


if __name__ == "__main__":
    main()
