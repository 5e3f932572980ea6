"""Shear polyhedra and spheres of the same volumes in a ring under a constant normal stress.

Prints friction and dilation, and draws them over the strain, with the profile of the
velocity. Run with ``--quick`` for fewer grains and less strain.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure


def make_grains(n: int) -> gd.Packing:
    """Return grains of an angular sand of about a millimetre."""
    domain = gd.Domain.cube(1e-3 * n ** (1 / 3))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2)
    return gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)


def main() -> None:
    """Print what both kinds of grains did, and draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer grains, less strain, one seed")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figure")
    arguments = parser.parse_args()
    n, seeds, strain, rate = (60, 1, 0.1, 0.1) if arguments.quick else (400, 2, 1.5, 0.03)
    grains = make_grains(n)
    ratios, dilations, profiles = {}, {}, {}
    for name, spheres in (("polyhedra", False), ("spheres", True)):
        runs = gd.ensemble(
            gd.ring_shear,
            grains,
            seeds=seeds,
            through="processes",
            normal_stress=1e4,
            strain=strain,
            inertial_number=rate,
            spheres=spheres,
        )
        mean = runs.mean()
        print(
            f"{name:>9}: friction {mean['steady_friction']:.2f} of the lid, {mean['steady_friction_contacts']:.2f} of "
            f"the contacts; dilation {mean['dilation']:+.3f}; {runs.outcomes[0].report.n_steps} steps"
        )
        x, shear, _ = runs.curve("shear_strain", "shear_stress", points=40)
        ratios[name] = x, shear / runs.curve("shear_strain", "normal_stress", points=40)[1]
        dilations[name] = runs.curve("shear_strain", "volumetric_strain", points=60)[:2]
        profile = runs.outcomes[0].profile
        profiles[name] = profile["velocity"], profile["height"]
    figure = curve_figure(
        [
            Panel("shear strain", "τ / σ of the lid", ratios),
            Panel("shear strain", "dilation", dilations),
            Panel("speed around the axis / that of the lid", "height / that of the ring", {}, profiles),
        ],
        arguments.output / "ring_shear.png",
    )
    print(f"drawn in {figure}")


if __name__ == "__main__":
    main()
