"""From a sieve sheet to a bed: the graded standard sand of ASTM C778, grown, held against its sheet, and poured.

The sheet has the middles of the limits that the standard gives. Grains of 0.075 to 1.18 mm are grown so that what
passes each sieve is what the sheet says; then they are scattered, fall, and the bed is measured again. Run with
``--quick`` for fewer grains and a coarser sand, which are not poured.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import grainsdem as gd

SHEET = Path(__file__).with_name("astm_c778_graded.csv")


def main() -> None:
    """Print what passes each sieve, of the sheet and of the beds, and draw curve and bed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the coarser two thirds of the sand, not poured")
    parser.add_argument("--grains", type=int, default=900, help="number of grains")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for the pictures")
    options = parser.parse_args()

    sheet = gd.read_sieves(SHEET)
    if options.quick:
        sheet = gd.SieveSheet.from_retained(sheet.openings[1:], sheet.weights[2:])
        options.grains = 400
    for line in sheet.open_ends():
        print(line)
    told = gd.sieve_statistics(sheet.bounds, sheet.weights) if not sheet.weights[0] > 5 else None
    if told is not None:
        print(
            f"d50 {1e3 * told.percentiles['d50']:.3f} mm, sorting {told.folk_ward.sorting:.2f} φ: {told.sorting_class}"
        )

    curve = sheet.grading()
    domain = gd.Domain.cube()  # only its shape counts: grains are scaled to the sheet
    found = gd.graded_cells(domain, curve, n=options.grains, keep="all", rng=1)
    bed = gd.shrink(gd.carve(found.cells, keep="all"), porosity=0.45)
    beds = {"grown": gd.resize(bed, diameters=found.diameters)}
    if not options.quick:
        # Not shuffled: a lattice with room for the largest grain at every place would be a hundred times as high.
        beds["poured"] = gd.settle(gd.scatter(beds["grown"], rng=1), friction=0.5).packing

    print(f"{'opening, mm':>12} {'sheet':>8} " + " ".join(f"{name:>8}" for name in beds))
    masses = {name: gd.masses(each) for name, each in beds.items()}
    sizes = {name: gd.sieve_diameters(each) for name, each in beds.items()}
    for opening, percent in zip(sheet.openings[::-1], sheet.passing[::-1], strict=True):
        held = [100 * masses[name][sizes[name] < opening].sum() / masses[name].sum() for name in beds]
        print(f"{1e3 * opening:12.4g} {percent:8.2f} " + " ".join(f"{value:8.2f}" for value in held))
    for name, each in beds.items():
        void = gd.porosity(each, region="cells" if name == "grown" else gd.core_box(each, margin=0.5))
        print(f"{name}: {len(each)} grains, porosity {void:.3f}")
        gd.figures.render(each, options.output / f"sieve_sheet_{name}.png", color_by="diameter")
    path = gd.figures.grading_figure(options.output / "sieve_sheet.png", sheet=sheet, bed=beds["grown"])
    print(f"drawn in {path}")


if __name__ == "__main__":
    main()
