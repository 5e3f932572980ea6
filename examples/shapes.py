"""Draw shapes in a row, pour a mixture of them, and set the void ratio of a round sand beside that of broken stone.

All of it takes some 25 minutes on one core; run with ``--quick`` for a few grains.
"""

from __future__ import annotations

import argparse
import logging
from pathlib import Path

import numpy as np
from scipy import stats

import grainsdem as gd

SIZE = 1e-3  # m
HOW = {"friction": 0.4, "time_step": 0.02}


def in_rows(shapes: gd.Polyhedra, columns: int) -> gd.Packing:
    """Return shapes side by side on a shelf."""
    n = len(shapes)
    index, pitch = np.arange(n), 1.7 * SIZE
    rows = -(-n // columns)
    low = np.minimum.reduceat(shapes.vertices[:, 2], shapes.vertex_offsets[:-1])
    places = np.column_stack([(index % columns + 0.5) * pitch, (rows - index // columns - 0.5) * pitch, -low])
    shelf = gd.Domain.box((columns * pitch, rows * pitch, 1.5 * SIZE))
    return gd.Packing(shapes, places, np.tile([1.0, 0, 0, 0], (n, 1)), np.full(n, 2650.0), shelf)


def some_of_each() -> gd.Polyhedra:
    """Return three rows: solids, round shapes, rocks from angular to round."""
    rocks = [gd.shapes.rock(elongation=0.8, flatness=0.7, roundness=r, rng=5) for r in (0.15, 0.3, 0.45, 0.6, 0.72)]
    row = gd.shapes.together(
        *(gd.shapes.platonic(name) for name in gd.shapes.PLATONIC),
        gd.shapes.ellipsoid(1.4, 1.1, 0.7, n_vertices=64),
        gd.shapes.superellipsoid(1.2, 1.0, 0.8, exponents=(0.3, 0.3), n_vertices=64),
        gd.shapes.superellipsoid(1.0, 1.0, 1.2, exponents=(0.25, 1.0), n_vertices=64),
        gd.shapes.prism(6, aspect=0.3),
        gd.shapes.rounded(gd.shapes.platonic("cube"), 0.5),
        *rocks,
    )
    return gd.shapes.sized(row, SIZE)


def void_ratio(shapes: gd.Polyhedra, n: int, margin: float, seed: int) -> float:
    """Return the void ratio of the core of a poured bed, some diameters from walls and surface."""
    side = (n / 0.3) ** (1 / 3) * 0.8 * SIZE
    law = stats.lognorm(s=0.12, scale=SIZE)
    loose = gd.pack(shapes, law, gd.Domain.box((side, side, side)), n=n, rng=seed)
    poured = gd.settle(loose, rng=seed, **HOW).packing
    porosity = gd.porosity(poured, region=gd.core_box(poured, margin=margin))
    return porosity / (1 - porosity)


def main() -> None:
    """Draw a row of shapes and a poured mixture, and print two void ratios with their intervals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few grains")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the pictures")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.WARNING)
    n, different, margin, seeds = (48, 3, 0.5, 2) if arguments.quick else (700, 100, 1.0, 5)
    row = in_rows(some_of_each(), 5)
    print(f"drawn in {gd.figures.render(row, arguments.output / 'shapes.png', color_by='id', size=(960, 720))}")
    kinds = [
        gd.shapes.rock(different, elongation=0.7, flatness=0.6, rng=1),
        gd.shapes.prism(6, aspect=3.0),
        gd.shapes.platonic("cube"),
        gd.shapes.ellipsoid(1.0, 1.0, 1.0),
    ]
    side = 1.1e-3 * n ** (1 / 3)
    loose = gd.pack(kinds, stats.lognorm(s=0.3, scale=SIZE), gd.Domain.box((side, side, side)), n=n, by="mass", rng=1)
    poured = gd.settle(loose, **HOW).packing
    path = gd.figures.render(poured, arguments.output / "shapes_poured.png", color_by="class", size=(800, 600))
    print(f"drawn in {path}")
    round_sand = gd.shapes.rock(different, elongation=0.85, flatness=0.85, roundness=0.7, rng=2)
    broken = gd.shapes.rock(different, elongation=0.75, flatness=0.7, roundness=0.2, rng=2)
    for name, shapes in (("round sand", round_sand), ("broken stone", broken)):
        told = f"roundness {gd.roundness(shapes).mean():.2f}, sphericity {gd.sphericities(shapes).mean():.2f}"
        ratios = [void_ratio(shapes, n, margin, seed) for seed in range(1, seeds + 1)]
        width = stats.t.ppf(0.975, seeds - 1) * stats.sem(ratios)
        print(f"{name}: {told}, poured void ratio {np.mean(ratios):.2f} ± {width:.2f}, {seeds} beds")


if __name__ == "__main__":
    main()
