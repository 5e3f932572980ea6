"""Let a scoop of one's own drive into a heap, and weigh what it lifts.

The scoop is a file for MuJoCo in SI, `parts/bucket.xml`, and what it does a table, `parts/scoop.csv`. Prints what it
bears and what is in it, and draws both. Run with ``--quick`` for fewer grains.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

import grainsdem as gd

PARTS = Path(__file__).parent / "parts"

PLATES = [
    ((0.15, 1.2, 0.9), (0.0, 0.0, 0.75)),
    ((1.3, 1.2, 0.15), (1.3, 0.0, 0.0)),
    ((1.3, 0.15, 0.9), (1.3, 1.2, 0.75)),
]
"""Half sizes and middles [mm] of the plates of the scoop, as in its file; the near one is left out: one looks in."""


def make_heap(n: int) -> gd.Packing:
    """Return n grains of about a millimetre, poured and at rest, with 4 mm of bare floor before them."""
    domain = gd.Domain.box((5e-3, 3.4e-3, 1e-9 * n / (5e-3 * 3.4e-3)))
    seeds = gd.relax(gd.points.poisson(domain, n, rng=1), domain, iterations=2)
    grains = gd.shrink(gd.carve(gd.tessellate(seeds, domain), keep="all"), porosity=0.4)
    heap = gd.settle(grains, start="pour", friction=0.3, rng=1).packing
    height = float(gd.world_vertices(heap)[:, 2].max()) + 3e-3
    return replace(heap, domain=gd.Domain([-4e-3, 0.0, 0.0], [5e-3, 3.4e-3, height]))


def with_plates(packing: gd.Packing, place: np.ndarray, pitch: float) -> gd.Packing:
    """Return the grains and, as if they were grains, the plates of a scoop at a place [m] with a pitch [rad]."""
    corner = np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    box = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    turn = np.array([[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]])
    grains, n = packing.grains, len(PLATES)
    shapes = gd.Polyhedra(
        np.vstack([grains.vertices, *(1e-3 * np.array(half) * corner for half, _ in PLATES)]),
        np.append(grains.vertex_offsets, grains.vertex_offsets[-1] + 8 * np.arange(1, n + 1)),
        np.append(grains.face_offsets, grains.face_offsets[-1] + 6 * np.arange(1, n + 1)),
        np.append(grains.face_vertices, np.tile(box.ravel(), n)),
        np.append(grains.face_vertex_offsets, grains.face_vertex_offsets[-1] + 4 * np.arange(1, 6 * n + 1)),
    )
    places = [place + turn @ (1e-3 * np.array(middle)) for _, middle in PLATES]
    quaternion = [np.cos(pitch / 2), 0.0, np.sin(pitch / 2), 0.0]
    return replace(
        packing,
        grains=shapes,
        positions=np.vstack([packing.positions, places]),
        quaternions=np.vstack([packing.quaternions, np.tile(quaternion, (n, 1))]),
        densities=np.append(packing.densities, np.full(n, 2700.0)),
    )


def main() -> None:
    """Print what the scoop bears, and draw it with what is in it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer grains")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the picture")
    arguments = parser.parse_args()
    heap = make_heap(15 if arguments.quick else 60)
    start = np.array([-3.5e-3, 1.7e-3, 0.2e-3])
    x, y, z = start.tolist()
    scooped = gd.dynamics.own_part(
        heap, model=str(PARTS / "bucket.xml"), motion=str(PARTS / "scoop.csv"), x=x, y=y, z=z, friction=0.3
    )
    report, history = scooped.report, scooped.history
    print(
        f"{report.carried_grains} grains of {1e6 * report.carried_mass:.2f} mg hang on the scoop, which bears "
        f"{1e6 * report.borne_mass:.2f} mg; largest force {1e3 * report.largest_force:.2f} mN"
    )
    place = start + np.array([history["forward"][-1], 0.0, history["lift"][-1]])
    picture = with_plates(scooped.packing, place, float(history["pitch"][-1]))
    colours = np.append(gd.diameters(heap.grains), np.full(len(PLATES), np.nanmin(gd.diameters(heap.grains))))
    print(f"drawn in {gd.figures.render(picture, arguments.output / 'scoop.png', color_by=colours, size=(800, 600))}")


if __name__ == "__main__":
    main()
