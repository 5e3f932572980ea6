"""Shear dense and loose packs of one sand triaxially: at large strain they meet in angle and in void ratio.

Less friction while a pack is compressed makes it denser. Five packs of each are sheared; the dense ones are stronger at
first and dilate, the loose ones contract. Run with ``--quick`` for few spheres and little strain, or at another rate
with ``--inertial-number``.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.dynamics import ensemble, triaxial
from grainsdem.dynamics.mechanics import friction_angle
from grainsdem.figures.curves import Panel, curve_figure

COMPACTION = {"dense": 0.05, "loose": 1.0}
"""Coefficient of friction while each kind of pack is compressed; 0.5 while it is sheared."""


def make_grains(n: int) -> gd.Packing:
    """Return grains of about a millimetre and of nearly one size, so that few make a sample that is wide enough."""
    domain = gd.Domain.cube(1e-3 * n ** (1 / 3))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=20)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)


def main() -> None:
    """Print what both kinds end with, with their intervals, and draw angle and void ratio over strain."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="few spheres, little strain, two seeds")
    parser.add_argument("--grains", type=int, default=343, help="in each pack")
    parser.add_argument("--seeds", type=int, default=5, help="packs of each kind")
    parser.add_argument("--inertial-number", type=float, default=0.02, help="rate of the shear")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    n, seeds, strain, rate = arguments.grains, arguments.seeds, 0.4, arguments.inertial_number
    if arguments.quick:
        n, seeds, strain, rate = 27, 2, 0.03, 0.05
    grains = make_grains(n)
    angles, ratios = {}, {}
    for name, friction in COMPACTION.items():
        runs = ensemble(
            triaxial,
            grains,
            seeds=seeds,
            through="processes",
            strain=strain,
            inertial_number=rate,
            compaction_friction=friction,
            spheres=arguments.quick,
        )
        mean, width = runs.mean(), runs.half_width()
        for key in ("peak_friction_angle", "critical_friction_angle"):
            print(f"{name}: {key.replace('_', ' ')} {np.degrees(mean[key]):.1f}° ± {np.degrees(width[key]):.1f}°")
        for key in (
            "initial_solid_fraction",
            "final_solid_fraction",
            "volumetric_strain",
            "coordination",
            "sliding_fraction",
        ):
            print(f"{name}: {key.replace('_', ' ')} {mean[key]:+.3f} ± {width[key]:.3f}")
        x, axial, error = runs.curve("axial_strain", "axial_stress", points=30)
        lateral = runs.curve("axial_strain", "lateral_stress", points=30)[1]
        middle = friction_angle(np.stack([axial, lateral], axis=1))
        upper = friction_angle(np.stack([axial + error, lateral], axis=1))
        angles[name] = x, np.degrees(middle), np.degrees(upper - middle)
        x, solid, error = runs.curve("axial_strain", "solid_fraction", points=60)
        ratios[name] = x, 1 / solid - 1, error / solid**2
    figure = curve_figure(
        [
            Panel("axial strain", "mobilised friction angle  [°]", angles),
            Panel("axial strain", "void ratio", ratios),
        ],
        arguments.output / "critical_state.png",
    )
    print(f"drawn in {figure}")


if __name__ == "__main__":
    main()
