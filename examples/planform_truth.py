"""Images of known truth: a bed seen from above, and what its grains seem beside what they are.

Grows a bed of grains from clustered seeds, whose sizes spread, and with ``--pour`` rotates, pours and settles a smaller
one instead; photographs it at three resolutions, writes image, label map, depth map and truth of each, and a picture
of the sharpest; then prints how the sizes in each image compare with the bed's. Run with ``--quick`` for a small bed.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import grainsdem as gd


def make(*, quick: bool, pour: bool) -> gd.Packing:
    """Return a bed of about one grain a cubic millimetre; one that is not poured goes on beyond its sides."""
    n = 400 if quick else 700 if pour else 8000
    side = 1e-3 * n ** (1 / 3)
    domain = gd.Domain.box((1.4 * side, 1.4 * side, 0.5 * side), periodic=(not pour, not pour, False))
    walls = "reflect" if pour else "periodic"
    seeds = gd.points.cluster_poisson(domain, n, parents=n // 8, spread=0.8e-3, walls=walls, rng=4)
    cells = gd.tessellate(gd.relax(seeds, domain, iterations=2), domain)
    # Cells at the flat top are dropped, so that the bed has a surface of its own.
    bed = gd.shrink(gd.carve(cells, keep="all" if pour else "inside"), porosity=0.35)
    return gd.settle(gd.scatter(bed, rng=4), friction=0.5).packing if pour else bed


def main() -> None:
    """Photograph a bed and print its bias table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small bed, grown")
    parser.add_argument("--pour", action="store_true", help="a bed that is poured and settles: minutes")
    parser.add_argument("--output", type=Path, default=Path("figures"), help="folder for images and truth")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    bed = make(quick=options.quick, pour=options.pour and not options.quick)

    print("pixels a diameter  grains seen  b, apparent / true: d16  d50  d84 by number    d16  d50  d84 by area")
    for per_diameter in (30, 15, 8):
        view = gd.planform(bed, per_diameter=per_diameter)
        camera = {"blur": 0.7, "noise": 0.01, "rng": 1}
        folder = options.output / f"planform_{per_diameter}"
        gd.write_planform(view, bed, folder, least_pixels=12, overwrite=True, **camera)
        rows = gd.planform_table(view, bed)
        bias = {row["statistic"]: row for row in gd.planform_bias(rows, bed, least_pixels=12)}
        numbers, areas = (
            "".join(f"{bias[q][name]:8.3f}" for q in ("d16", "d50", "d84")) for name in ("number_bias", "area_bias")
        )
        print(f"{per_diameter:17} {len(rows):12} {numbers:>37} {areas:>32}")
        if per_diameter == 30:
            image = gd.photograph(view, bed, **camera)
            gd.figures.planform_figure(view, bed, image, options.output / "planform_truth.png", least_pixels=12)
    print(f"wrote images and truth to {options.output}")


if __name__ == "__main__":
    main()
