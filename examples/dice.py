"""Pour and tap dice, the five Platonic solids, and set their solid fractions beside those of Baker & Kudrolli (2010).

Three hundred dice of a kind are poured into a box 8 d across and tapped, d being the diameter of the sphere of equal
volume. What is told is the solid fraction of the core: 1.5 d from the walls and one from floor and surface. What each
run measured is kept in a JSON file of the output folder beside its bed, and is not run again. All of it takes an hour
on one core; run with ``--quick`` for a few dice of two kinds.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

import grainsdem as gd
from grainsdem.dynamics.ensembles import half_width
from grainsdem.figures.curves import Panel, curve_figure

SIZE = 1e-2  # m, of the sphere of equal volume
LOOSE = {"tetrahedron": 0.51, "cube": 0.54, "octahedron": 0.52, "dodecahedron": 0.51, "icosahedron": 0.50}
DENSE = {"tetrahedron": 0.64, "cube": 0.67, "octahedron": 0.64, "dodecahedron": 0.63, "icosahedron": 0.59}


def make_dice(kind: str, n: int, across: float) -> gd.Packing:
    """Return dice, all in one place, in a box so many diameters across: they are to be poured."""
    dice = gd.shapes.together(*[gd.shapes.platonic(kind, diameter=SIZE)] * n)
    box = gd.Domain.box(np.full(3, across * SIZE))
    return gd.Packing(dice, np.tile(0.5 * box.upper, (n, 1)), np.tile([1.0, 0, 0, 0], (n, 1)), np.full(n, 1100.0), box)


def solid_fraction(packing: gd.Packing, walls: float) -> float:
    """Return the solid fraction of the core, so many diameters from the walls and one from floor and surface."""
    lower, upper = gd.core_box(packing, margin=1.0)
    more = np.array([walls - 1.0, walls - 1.0, 0.0]) * SIZE
    return 1 - gd.porosity(packing, region=(lower + more, upper - more))


def measure(
    kind: str, seed: int, kept: Path, *, n: int, across: float, walls: float, taps: int
) -> dict[str, float | bool | list[float]]:
    """Pour dice and tap them, keep the bed, and return what was measured."""
    how = {"friction": 0.4, "time_step": 0.02}
    poured = gd.settle(make_dice(kind, n, across), start="pour", rng=seed, **how)
    tapped = gd.dynamics.tap(poured.packing, taps=taps, **how)
    gd.save(tapped.packing, kept)
    return {
        "poured": solid_fraction(poured.packing, walls),
        "tapped": solid_fraction(tapped.packing, walls),
        "all_poured": 1 - tapped.report.initial_porosity,
        "all_tapped": 1 - tapped.report.final_porosity,
        "taps": [1 - float(porosity) for porosity in tapped.profile["porosity"]],
        "at_rest": poured.report.at_rest and tapped.report.at_rest,
    }


def measure_all(kinds: list[str], seeds: range, folder: Path, **how: float) -> dict[str, list[dict]]:
    """Return what each kind measured with each seed; runs that a file has are read from it."""
    found: dict[str, list[dict]] = {kind: [] for kind in kinds}
    for seed in seeds:
        for kind in kinds:
            kept = folder / f"dice_{kind}_{how['n']}_{seed}.json"
            if not kept.exists():
                kept.write_text(json.dumps(measure(kind, seed, kept.with_suffix(".h5"), **how)))
            found[kind].append(json.loads(kept.read_text()))
    return found


def main() -> None:
    """Print ten solid fractions beside the published ones, and draw those of the whole bed over the taps."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a few dice of two kinds, one tap")
    parser.add_argument("--output", type=Path, default=Path(), help="folder for runs and figure")
    arguments = parser.parse_args()
    if arguments.quick:
        kinds, seeds, how = ["tetrahedron", "cube"], range(1), {"n": 40, "across": 4.0, "walls": 1.0, "taps": 1}
    else:
        kinds, seeds, how = list(gd.shapes.PLATONIC), range(3), {"n": 300, "across": 8.0, "walls": 1.5, "taps": 10}
    found = measure_all(kinds, seeds, arguments.output, **how)
    print("solid fraction      poured          published, loose   tapped          published, dense")
    curves = {}
    for kind, runs in found.items():
        values = {key: np.array([run[key] for run in runs]) for key in ("poured", "tapped")}
        told = {key: f"{row.mean():.3f}" for key, row in values.items()}
        if len(runs) > 1:
            told = {key: f"{words} ± {half_width(values[key]):.3f}" for key, words in told.items()}
        print(f"{kind:<20}{told['poured']:<16}{LOOSE[kind]:<19}{told['tapped']:<16}{DENSE[kind]}")
        curves[kind] = np.arange(how["taps"] + 1), np.mean([run["taps"] for run in runs], axis=0)
    panel = Panel("taps", "solid fraction of the whole bed", curves)
    print(f"drawn in {curve_figure([panel], arguments.output / 'dice.png')}")


if __name__ == "__main__":
    main()
