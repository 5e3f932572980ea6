"""Pour grains, take a wall away, and measure the slope they come to rest at; then tilt a long bed until it fails.

Heaps of the same grains differ by 5 to 10°: the answer is the mean of five, with its interval. Rougher grains stand
steeper. Run with ``--quick`` for fewer grains, two heaps and one coefficient of friction.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure


def make_grains(n: int) -> gd.Packing:
    """Return grains of about a millimetre in a box that is narrow across the slope."""
    domain = gd.Domain.box(1e-3 * n ** (1 / 3) * np.array([1.2, 0.7, 1.2]))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)


def make_prisms(n: int) -> gd.Packing:
    """Return a planar bed, long and shallow: walls hardly hold it when it is tilted."""
    domain = gd.Domain.slab(1e-3 * np.array([1.8, 0.55]) * n**0.5, 1e-3)
    seeds = gd.points.poisson(domain, n, rng=1)
    cells = gd.tessellate(gd.relax(seeds, domain, iterations=2), domain)
    return gd.shrink(gd.carve(cells, keep="all"), porosity=0.25)


def main() -> None:
    """Print angles of repose and the angle at which a bed fails, and draw the surfaces."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer grains, two heaps, one coefficient of friction")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    n, frictions, seeds = (30, (0.6,), 2) if arguments.quick else (220, (0.3, 0.6), 5)
    grains = make_grains(n)
    surfaces = {}
    for friction in frictions:
        heaps = gd.ensemble(gd.collapse, grains, seeds=range(1, seeds + 1), release=["wall_x1"], friction=friction)
        angles, widths = np.degrees(heaps.values()["repose_angle"]), heaps.half_width()
        print(
            f"μ = {friction}: angle of repose {angles.mean():.1f}° ± {np.degrees(widths['repose_angle']):.1f}° "
            f"(95 % of the mean of {seeds} heaps, {angles.min():.1f} to {angles.max():.1f}°), "
            f"run-out {heaps.mean()['relative_run_out']:+.0%}, "
            f"{sum(heap.report.at_rest for heap in heaps.outcomes)} of {seeds} at rest"
        )
        first = heaps.outcomes[0].profile
        surfaces[f"μ = {friction}"] = 1e3 * first["distance"], 1e3 * first["height"]
    curves = [Panel("distance from the wall  [mm]", "height of the surface  [mm]", surfaces, surfaces)]
    if not arguments.quick:
        bed = gd.tilt(make_prisms(140), friction=0.6, rate=0.02, rng=1)
        fails = "stands" if not bed.report.has_failed else f"fails at {np.degrees(bed.report.failure_angle):.1f}°"
        print(f"μ = 0.6: a long planar bed, tilted between its walls, {fails}")
        angles, gone = np.degrees(bed.history["angle"]), 100 * bed.history["gone_fraction"]
        curves.append(Panel("angle  [°]", "grains that have moved by a diameter  [%]", {"": (angles, gone)}))
    print(f"drawn in {curve_figure(curves, arguments.output / 'repose.png')}")


if __name__ == "__main__":
    main()
