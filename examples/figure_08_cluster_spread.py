"""Figure 8 of Buscombe and Rubin (2012): grain sizes of clustered beds against the spread σ of the clusters.

A thousand parents with ten children each, as in the paper: (a) diameters against σ, (b) their densities. A survey grows
the beds twice: children beyond the walls are lost, as in the paper, so that fewer grains fill the same cube; or they
enter on the other side, so that their number stays and only the clustering changes. Writes ``figure_08.png`` and the
survey's tables; what an interrupted run has is kept. Run with ``--quick`` for small beds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.frame import BLUE, INK, RED, drawing

CHILDREN = 10.0
WALLS = {"clip": ("children beyond walls are lost", RED), "periodic": ("they enter on the other side", BLUE)}


def recipe(walls: str, parents: int, spread: float = 0.1) -> dict[str, dict[str, object]]:
    """Return a recipe of clusters in the unit cube."""
    seeds = {"process": "cluster", "parents": parents, "children": CHILDREN, "spread": spread, "walls": walls}
    return {
        "domain": {"periodic": "xyz" if walls == "periodic" else ""},
        "seeds": seeds,
        "grains": {"scale": 1.0},
    }


def main() -> None:
    """Run both surveys, print their tables and draw them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds, few of them")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for picture and tables")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    parents, repeats = (40, 1) if options.quick else (1000, 3)
    spreads = [0.02, 0.2] if options.quick else [0.005, 0.01, 0.02, 0.03, 0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.375, 0.45]

    print("walls      σ      grains  mean d [1e-3]  spread of d / mean  sphericity")
    with drawing(options.output / "figure_08.png", (9.6, 3.8), dpi=110) as figure:
        means, densities = figure.subplots(1, 2)
        for walls, (label, color) in WALLS.items():
            plan = gd.survey.Survey(recipe(walls, parents), {"seeds.spread": spreads}, repeats=repeats)
            table = gd.survey.run(plan, options.output / f"figure_08_{walls}.csv")
            mean, std = 1e3 * table["mean_diameter"], 1e3 * table["std_diameter"]
            rows = [(table["seeds_spread"] == spread) for spread in spreads]
            for spread, row in zip(spreads, rows, strict=True):
                ratio = (std[row] / mean[row]).mean()
                grains, sphericity = table["n_grains"][row].mean(), table["mean_sphericity"][row].mean()
                print(
                    f"{walls:8} {spread:6.3f} {grains:8.0f} {mean[row].mean():10.1f} {ratio:18.3f} {sphericity:15.3f}"
                )
            means.plot(spreads, [mean[row].mean() for row in rows], color=color, label=label)
            means.plot(table["seeds_spread"], mean, "o", color=color, markersize=3)
            means.plot(spreads, [std[row].mean() for row in rows], color=color, linestyle="--")
        means.plot([], [], color=INK, linestyle="--", label="standard deviations")
        means.set(xlabel="σ  [edges of the cube]", ylabel="mean diameter  [edges / 1000]", ylim=(0, None))
        means.set_title("(a)", loc="left")
        means.legend(frameon=False)
        _draw_densities(densities, parents, [s for s in spreads if s in (0.005, 0.02, 0.05, 0.2, 0.45)])
    print(f"wrote {options.output / 'figure_08.png'}")


def _draw_densities(axes, parents: int, spreads: list[float]) -> None:  # noqa: ANN001  (matplotlib comes without types)
    """Draw the densities of diameters, each relative to its mean, of one bed for each spread."""
    from matplotlib import colormaps

    classes = np.linspace(0, 3, 46)
    for k, spread in enumerate(spreads):
        bed = gd.recipe.grow(gd.recipe.make(rng=8, **recipe("periodic", parents, spread)))
        size = gd.diameters(bed.grains)
        density, _ = np.histogram(size / size.mean(), classes, density=True)
        axes.stairs(
            density, classes, color=colormaps["viridis"](k / len(spreads)), label=f"σ = {spread:g}", linewidth=1.4
        )
    axes.set(xlabel="diameter / mean diameter", ylabel="density", xlim=(0, 3), ylim=(0, None))
    axes.set_title("(b)", loc="left")
    axes.legend(frameon=False)


if __name__ == "__main__":
    main()
