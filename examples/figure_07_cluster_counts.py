"""Figure 7 of Buscombe and Rubin (2012): how many grains clusters make, by their parents M and mean children λ.

A survey grows beds with a spread σ² = 0.2 in the unit cube, as in the paper: most children of so wide a cluster fall
outside, and are lost. How many stay has a closed form, which the counts are held against. Writes ``figure_07.png`` and
the survey's table; what an interrupted run has is kept. Run with ``--quick`` for small beds.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from scipy.special import ndtr

import grainsdem as gd
from grainsdem.figures.frame import INK, RED, drawing

SPREAD = float(np.sqrt(0.2))


def share_inside(spread: float) -> float:
    """Return the share of children that stay in the unit cube, their parents uniform in it.

    Along one axis a child at x + σ Z stays with chance Φ((1 - x)/σ) - Φ(-x/σ); the mean of that over x in [0, 1] is
    2 Φ(1/σ) - 1 - 2 σ (φ(0) - φ(1/σ)), and the three axes are independent.
    """
    reach = 1 / spread
    along = 2 * ndtr(reach) - 1 - 2 * spread * (1 - np.exp(-0.5 * reach**2)) / np.sqrt(2 * np.pi)
    return float(along**3)


def main() -> None:
    """Run the survey, print its table and draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds, few of them")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for picture and table")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    parents = [20, 40] if options.quick else [100, 200, 300, 400, 500, 600, 700, 800, 900, 1000]
    children = [50.0, 100.0] if options.quick else [10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0]

    seeds = {"process": "cluster", "spread": SPREAD, "walls": "clip"}
    base = {"rng": 7, "seeds": seeds, "grains": {"scale": 1.0}}
    plan = gd.survey.Survey(base, {"seeds.parents": parents, "seeds.children": children})
    table = gd.survey.run(plan, options.output / "figure_07.csv")
    made = table["seeds_parents"] * table["seeds_children"]
    inside = share_inside(SPREAD)
    # Given M and λ the count is Poisson about each parent's share; that of parents varies, too, but by less.
    ratio = table["n_seeds"] / (made * inside)
    print(f"of the children {inside:.1%} stay in the cube; σ = {SPREAD:.4f} of its edge")
    print(f"count over λ M and that share: {ratio.mean():.4f} ± {ratio.std() / np.sqrt(ratio.size):.4f}")
    print("   M     λ    λ M   seeds  grains inside the walls")
    for row in table[:: 1 if options.quick else 11]:
        m, lam = row["seeds_parents"], row["seeds_children"]
        print(f"{m:4} {lam:5.0f} {m * lam:6.0f} {row['n_seeds']:7} {row['n_grains']:7}")
    with drawing(options.output / "figure_07.png", (9.6, 3.9), dpi=110) as figure:
        left, right = figure.subplots(1, 2)
        shape = (len(parents), len(children))
        mesh = left.pcolormesh(parents, children, table["n_grains"].reshape(shape).T, cmap="viridis", shading="nearest")
        figure.colorbar(mesh, ax=left, label="grains inside the walls")
        left.set(xlabel="parents M", ylabel="mean children λ")
        left.set_title("(a)", loc="left")
        right.loglog(made, table["n_seeds"], "o", color=RED, markersize=3, label="seeds in the cube")
        right.loglog(made, table["n_grains"], "s", color=INK, markersize=3, label="grains inside the walls")
        line = np.array([made.min(), made.max()])
        right.loglog(line, line, ":", color=INK, linewidth=1, label="λ M")
        right.loglog(line, inside * line, "-", color=RED, linewidth=1, label=f"{inside:.3f} λ M, the closed form")
        right.set(xlabel="λ M", ylabel="count")
        right.set_title("(b)", loc="left")
        right.legend(frameon=False, fontsize=8)
    print(f"wrote {options.output / 'figure_07.png'}")


if __name__ == "__main__":
    main()
