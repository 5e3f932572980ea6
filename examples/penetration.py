"""Press a plate and a wedge into a bed of discs in a plane, and roll a wheel over one at several slips.

Prints how force rises with depth, and drawbar pull and sinkage of the wheel, and draws them. Run with ``--quick`` for
fewer grains and one seed.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.figures.curves import Panel, curve_figure
from grainsdem.figures.seen import section_figure

LOAD = 1.5e-4
"""What the wheel presses with [N]: the weight of a dozen grains."""


def make_prisms(n: int, shape: tuple[float, float]) -> gd.Packing:
    """Return n grains of about a millimetre in a plane, whose box has sides like these two numbers."""
    domain = gd.Domain.slab(1e-3 * np.array(shape) * (n / np.prod(shape)) ** 0.5, 1e-3)
    cells = gd.tessellate(gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2), domain)
    return gd.shrink(gd.carve(cells, keep="all"), porosity=0.25)


def draw_plate(bed: gd.Packing, size: dict[str, float], path: Path) -> None:
    """Draw a plate in a bed, cut through the plane: the plate as if it were one more grain."""
    pressed = gd.dynamics.penetration(bed, body="plate", spheres=True, rng=1, **size)
    grains, domain, half = pressed.packing.grains, pressed.packing.domain, 0.5 * size["width"]
    corners = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    box = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    shapes = gd.Polyhedra(
        np.vstack([grains.vertices, [half, half, 0.5 * domain.lengths[2]] * corners]),
        np.append(grains.vertex_offsets, grains.vertex_offsets[-1] + 8),
        np.append(grains.face_offsets, grains.face_offsets[-1] + 6),
        np.append(grains.face_vertices, box.ravel()),
        np.append(grains.face_vertex_offsets, grains.face_vertex_offsets[-1] + 4 * np.arange(1, 7)),
    )
    place = 0.5 * (domain.lower + domain.upper)
    place[1] = domain.lower[1] + pressed.report.floor_distance + half
    upper = domain.upper.copy()
    upper[1] = max(place[1], pressed.packing.positions[:, 1].max()) + 2 * half
    both = replace(
        pressed.packing,
        grains=shapes,
        positions=np.vstack([pressed.packing.positions, place]),
        quaternions=np.vstack([pressed.packing.quaternions, [1.0, 0.0, 0.0, 0.0]]),
        densities=np.append(pressed.packing.densities, 2700.0),
        domain=replace(domain, upper=upper),
    )
    print(f"drawn in {section_figure(gd.section(both, z=float(place[2])), path, color_by='diameter')}")


def main() -> None:
    """Print and draw what the bed does to a plate, a wedge and a wheel."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer grains, one seed")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the figures")
    arguments = parser.parse_args()
    n, seeds, slips = (16, 1, (0.2,)) if arguments.quick else (110, 6, (0.0, 0.3, 0.6))
    deep, long = make_prisms(n, (1.2, 1.0)), make_prisms(n, (4.0, 1.0))
    size = {"width": 1e-3, "depth": 0.3e-3} if arguments.quick else {"width": 2.5e-3, "depth": 2e-3}
    radius, speed = (0.5e-3, 0.02) if arguments.quick else (2e-3, 0.02)
    draw_plate(deep, size, arguments.output / "plate.png")
    curves, works = {}, {}
    for body in ("plate", "cone"):
        runs = gd.ensemble(
            gd.dynamics.penetration,
            deep,
            seeds=seeds,
            through="processes",
            workers=1,
            body=body,
            spheres=True,
            **size,
        )
        mean, spread = runs.mean(), runs.half_width()
        print(
            f"{body}: {1e3 * mean['stiffness']:.3g} ± {1e3 * spread['stiffness']:.2g} mN/m, exponent "
            f"{mean['exponent']:.2f} ± {spread['exponent']:.2f}, level force "
            f"{1e3 * mean['force_along_x']:+.3f} ± {1e3 * spread['force_along_x']:.3f} mN, largest upward "
            f"{1e3 * mean['largest_force']:.1f} mN"
        )
        # What it does over a way, over that way, is the mean of a force that jumps as grains give way.
        depth, work, half = runs.curve("depth", "work", points=11)
        curves[body] = 1e3 * 0.5 * (depth[1:] + depth[:-1]), 1e3 * np.diff(work) / np.diff(depth)
        works[body] = 1e3 * depth, 1e6 * work, 1e6 * half
    rows = []
    for slip in slips:
        runs = gd.ensemble(
            gd.dynamics.penetration, long, seeds=seeds, through="processes", workers=1, body="wheel", mode="roll",
            spheres=True, width=2 * radius, load=LOAD, forward_speed=speed, angular_speed=speed / radius / (1 - slip),
            travel=4e-3,
        )  # fmt: skip
        mean, spread = runs.mean(), runs.half_width()
        rows.append(
            [slip, *(f * m[k] for k, f in (("drawbar_pull", 1 / LOAD), ("sinkage", 1e3)) for m in (mean, spread))]
        )
        print(
            f"wheel, slip {slip}: drawbar pull {rows[-1][1]:+.2f} ± {rows[-1][2]:.2f} of its load, sinkage "
            f"{rows[-1][3]:.2f} ± {rows[-1][4]:.2f} mm"
        )
    slip, pull, pull_half, sinkage, sinkage_half = np.array(rows).T
    panels = [
        Panel("depth  [mm]", "upward force  [mN]", curves, curves),
        Panel("depth  [mm]", "work  [µJ]", works),
        Panel("slip", "drawbar pull / load", {"": (slip, pull, pull_half)}),
        Panel("slip", "sinkage  [mm]", {"": (slip, sinkage, sinkage_half)}),
    ]
    print(f"drawn in {curve_figure(panels, arguments.output / 'penetration.png')}")


if __name__ == "__main__":
    main()
