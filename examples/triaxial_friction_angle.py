"""Shear polyhedra and spheres of the same volumes triaxially, and compare their angles of friction with those of sand.

Five random packs of each are compressed by six smooth walls and sheared. Polyhedra are stronger than spheres and dilate
more; the intervals of 95 % confidence lie apart. Run with ``--quick`` for smaller packs and less strain.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.dynamics import ensemble, triaxial
from grainsdem.dynamics.mechanics import friction_angle
from grainsdem.figures.curves import Panel, curve_figure

PUBLISHED = {
    "critical state, siliceous sands of all shapes (Szypcio, Geosciences 10 (2020) 29)": "30-36°",
    "critical state, 42° - 17° R with R = 0.1-0.3 (Cho, Dodds & Santamarina 2006, as commonly cited)": "37-40°",
}


def make_grains(n: int) -> gd.Packing:
    """Return grains of an angular sand of about a millimetre."""
    domain = gd.Domain.cube(1e-3 * n ** (1 / 3))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)


def main() -> None:
    """Print peak and critical angles and dilation with their intervals, and draw the curves."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="smaller packs, less strain, two seeds")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    n, seeds, strain, rate = (27, 2, 0.06, 0.05) if arguments.quick else (216, 5, 0.3, 0.02)
    grains = make_grains(n)
    angles, dilations = {}, {}
    for name, spheres in (("polyhedra", False), ("spheres", True)):
        runs = ensemble(
            triaxial,
            grains,
            seeds=seeds,
            through="processes",
            strain=strain,
            inertial_number=rate,
            compaction_friction=0.2,
            spheres=spheres,
        )
        mean, width = runs.mean(), runs.half_width()
        for key in ("peak_friction_angle", "critical_friction_angle", "dilatancy_angle"):
            print(f"{name:>9}: {key.replace('_', ' ')} {np.degrees(mean[key]):.1f}° ± {np.degrees(width[key]):.1f}°")
        for key in (
            "initial_solid_fraction",
            "volumetric_strain",
            "confining_fluctuation",
            "coordination",
            "sliding_fraction",
        ):
            print(f"{name:>9}: {key.replace('_', ' ')} {mean[key]:+.3f} ± {width[key]:.3f}")
        print(f"{name:>9}: stress of walls and of contacts differ by {mean['stress_mismatch']:.2%}")
        x, axial, error = runs.curve("axial_strain", "axial_stress", points=30)
        lateral = runs.curve("axial_strain", "lateral_stress", points=30)[1]
        middle = friction_angle(np.stack([axial, lateral], axis=1))
        upper = friction_angle(np.stack([axial + error, lateral], axis=1))
        angles[name] = x, np.degrees(middle), np.degrees(upper - middle)
        dilations[name] = runs.curve("axial_strain", "volumetric_strain", points=60)
    for source, value in PUBLISHED.items():
        print(f"{value}: {source}")
    figure = curve_figure(
        [
            Panel("axial strain", "mobilised friction angle  [°]", angles),
            Panel("axial strain", "volumetric strain (dilation)", dilations),
        ],
        arguments.output / "triaxial.png",
    )
    print(f"drawn in {figure}")


if __name__ == "__main__":
    main()
