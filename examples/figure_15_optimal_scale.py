"""Figure 15 of Buscombe and Rubin (2012): the scale F at which a bed's void ratio fits the shape of its grains.

Natural sands have the void ratio e = 1.6 - 0.86 S in their loosest state, S the mean sphericity (Cho, Dodds and
Santamarina 2006). One survey grows beds by seven models and many numbers of seeds, and shrinks each until it lies on
that line: once with the void of the grains' own cells, and once with that of the whole cube, in which cells removed at
the walls count as void. (a) Where the beds lie on the line; (b) the F that put them there, of the cells; (c) that of
the cube. Writes a picture and the survey's table; what an interrupted run has is kept. Run with ``--quick`` for small
beds.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import grainsdem as gd
from grainsdem.figures.frame import INK, drawing

MARKERS = {
    "Poisson": ("o", "#2f6690"),
    "CVT-uniform": ("s", "#3a7d44"),
    "CVT-Halton": ("*", "#7a5195"),
    "Strauss": ("D", "#b5452c"),
    "clusters": ("^", "#d08c2a"),
    "same clusters": ("P", "#c46a9a"),
    "1/f noise": ("v", "#22272e"),
}

INHOMOGENEOUS = "clusters", "same clusters", "1/f noise"
"""Models whose seeds are denser in one place than in another."""


def seeds(model: str, n: int) -> dict[str, Any]:
    """Return the seeds table of a model.

    Lengths are in the mean distance of seeds, so that beds of all sizes have one structure; but "same clusters" keep
    their parents and their spread while children become more.
    """
    spacing = n ** (-1 / 3)
    return {
        "Poisson": {"process": "poisson", "count": n},
        "CVT-uniform": {"process": "poisson", "count": n, "relax": 5},
        "CVT-Halton": {"process": "halton", "count": n, "relax": 20, "scramble": "shift"},  # else repeats are copies
        "Strauss": {"process": "strauss", "count": n, "distance": 0.8 * spacing, "inhibition": 0.05},
        "clusters": {"process": "cluster", "count": n, "parents": max(2, n // 20), "spread": 0.5 * spacing},
        "same clusters": {"process": "cluster", "count": n, "parents": 100, "spread": 0.05},
        "1/f noise": {"process": "noise", "count": n, "beta": 1.0, "gain": 12.0, "resolution": 64},
    }[model]


def main() -> None:
    """Run the survey, print its table and draw it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="small beds, few of them")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for picture and table")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    counts = [150, 300] if options.quick else [500, 1000, 2000, 4000, 8000, 16_000, 32_000]

    cases = [(model, n) for model in MARKERS for n in counts]
    plan = gd.survey.Survey(
        {"rng": 15, "seeds": {}, "grains": {"relation": "cho_2006_max"}},
        {"seeds": [seeds(*case) for case in cases], "grains.region": ["cells", "domain"]},
        repeats=1 if options.quick else 2,
    )
    table = gd.survey.run(plan, options.output / "figure_15.csv")
    model_of = np.repeat([model for model, _ in cases], 2 * plan.repeats)
    count_of = np.repeat([n for _, n in cases], 2 * plan.repeats)
    is_cells = table["grains_region"] == "cells"

    print("model          seeds  grains  sphericity  void ratio  F of the cells  F of the cube")
    for model, n in cases:
        mine = (model_of == model) & (count_of == n)
        cells, cube = table[mine & is_cells], table[mine & ~is_cells]
        print(
            f"{model:13} {n:6} {cells['n_grains'].mean():7.0f} {cells['mean_sphericity'].mean():10.3f} "
            f"{cells['void_ratio'].mean():11.3f} {cells['scale'].mean():12.4f} {cube['scale'].mean():15.4f}"
        )
    with drawing(options.output / "figure_15.png", (12.0, 4.4), dpi=110) as figure:
        left, middle, right = figure.subplots(1, 3)
        line = np.array([0.74, 0.91])
        left.plot(line, 1.6 - 0.86 * line, "--", color=INK, linewidth=1, label="Cho et al. 2006, loosest")
        for model, (marker, color) in MARKERS.items():
            mine = model_of == model
            rows = table[mine & is_cells]
            left.plot(rows["mean_sphericity"], rows["void_ratio"], marker, color=color, label=model, markersize=5)
            for axes, chosen in ((middle, is_cells), (right, ~is_cells)):
                found = [table["scale"][mine & chosen & (count_of == n)].mean() for n in counts]
                # Inhomogeneous models are dashed, and tell from afar.
                style = "--" if model in INHOMOGENEOUS else "-"
                axes.semilogx(counts, found, style, marker=marker, color=color, markersize=5, linewidth=1.2)
        left.set(xlabel="mean sphericity S", ylabel="void ratio e", xlim=line, ylim=(0.82, 0.97))
        left.set_title("(a) where the beds lie", loc="left")
        middle.set(xlabel="seeds", ylabel="optimal scale F")
        middle.set_title("(b) void of the grains' own cells", loc="left")
        right.set(xlabel="seeds", ylabel="optimal scale F")
        right.set_title("(c) void of the whole cube", loc="left")
        handles, labels = left.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=8, frameon=False, fontsize=9)
    print(f"wrote {options.output / 'figure_15.png'}")


if __name__ == "__main__":
    main()
