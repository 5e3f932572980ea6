"""Let a silo with a flat floor run out through openings of several widths, and hold the rates against Beverloo's law.

What left is fed in again above the bed, so that the flow is steady. The rate to the power 2/5 (2/3 in a plane) goes
linearly with the opening, and vanishes at k diameters. Run with ``--quick`` for a planar bed of discs and two openings.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure


def make_grains(n: int) -> gd.Packing:
    """Return grains of about a millimetre in a box that is more than twice as wide as the widest opening."""
    domain = gd.Domain.box(1e-3 * np.array([11.5, 11.5, n / 132.25]))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=3)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)


def make_prisms(n: int) -> gd.Packing:
    """Return prisms of about a millimetre in a silo as high as it is wide."""
    domain = gd.Domain.slab(1e-3 * np.array([1.0, 1.0]) * n**0.5, 1e-3)
    cells = gd.tessellate(gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=3), domain)
    return gd.shrink(gd.carve(cells, keep="all"), porosity=0.3)


def main() -> None:
    """Print the rates and the exponent, and draw Beverloo's straight line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a planar bed of discs, two openings")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    grains = make_prisms(25) if arguments.quick else make_grains(800)
    widths = np.array([3.0, 4.0]) if arguments.quick else np.array([3.4, 4.0, 4.6, 5.2])
    law = 1.5 if arguments.quick else 2.5
    bed = gd.settle(grains, start="pour", spheres=True, friction=0.3, rng=1).packing
    diameter = float(np.median(gd.diameters(bed)))
    flowing, rates = [], []
    for width in widths:
        report = gd.discharge(
            bed,
            opening=float(width * diameter),
            spheres=True,
            friction=0.3,
            refill=True,
            max_time=10.0 if arguments.quick else 30.0,
        ).report
        print(
            f"opening {width} d: {report.grain_rate:.0f} ± {report.grain_rate * report.rate_error / report.rate:.0f} "
            f"grains/s, constant {report.beverloo:.2f}{', jammed' if report.is_jammed else ''}"
        )
        if not report.is_jammed:
            flowing.append(width)
            rates.append(report.grain_rate)
    widths = np.array(flowing)
    exponent = np.polyfit(np.log(widths - 1.4), np.log(rates), 1)[0]
    print(f"rate goes with the opening less 1.4 d to the power {exponent:.2f} (Beverloo: {law})")
    line = np.polyfit(widths, np.array(rates) ** (1 / law), 1)
    print(f"it vanishes at {-line[1] / line[0]:.2f} d")
    at = np.array([-line[1] / line[0], widths.max()])
    power = "2/3" if arguments.quick else "2/5"
    curves = Panel(
        "opening / d",
        f"rate to the power {power}  [(grains/s)^({power})]",
        {"line": (at, np.polyval(line, at))},
        {"measured": (widths, np.array(rates) ** (1 / law))},
    )
    print(f"drawn in {curve_figure([curves], arguments.output / 'silo.png')}")


if __name__ == "__main__":
    main()
