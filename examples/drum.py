"""Turn grains in a drum at several speeds: the dynamic angle of repose rises, and two halves mix.

Run with ``--quick`` for few prisms and one speed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure


def make_prisms(n: int) -> gd.Packing:
    """Return prisms of about a millimetre."""
    domain = gd.Domain.slab(1e-3 * np.array([1.0, 1.0]) * n**0.5, 1e-3)
    cells = gd.tessellate(gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=3), domain)
    return gd.shrink(gd.carve(cells, keep="all"), porosity=0.3)


def main() -> None:
    """Print angles and mixing of each speed, and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few prisms, one speed")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    n, froude_numbers, turns = (25, (0.03,), 0.1) if arguments.quick else (100, (1e-2, 5e-2, 0.2), 1.0)
    grains = make_prisms(n)
    radius = gd.drum(grains, turns=1e-3, rng=1).report.radius
    angles, spreads, mixed = [], [], {}
    for froude in froude_numbers:
        period = 2 * np.pi * np.sqrt(radius / 9.81 / froude)
        outcome = gd.drum(grains, period=period, turns=turns, rng=1)
        report = outcome.report
        print(
            f"Froude number {froude:g} ({report.regime}): {np.degrees(report.dynamic_angle):.1f}° ± "
            f"{np.degrees(report.dynamic_angle_spread):.1f}° in time, mixing {report.mixing:.2f}, torque over weight "
            f"times lever {report.torque / report.lift_torque:.3f}"
        )
        angles.append(np.degrees(report.dynamic_angle))
        spreads.append(np.degrees(report.dynamic_angle_spread))
        turning = outcome.history["stage"] == 1.0
        mixed[f"Fr = {froude:g}"] = outcome.history["turns"][turning], outcome.history["mixing"][turning]
    curves = [
        Panel("logarithm of the Froude number", "angle  [°]", {}, {"": (np.log10(froude_numbers), np.array(angles))}),
        Panel("turns", "mixing index", mixed),
    ]
    print(f"drawn in {curve_figure(curves, arguments.output / 'drum.png')}")


if __name__ == "__main__":
    main()
