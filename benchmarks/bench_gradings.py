"""Beds grown from a sieve sheet, against their bars: ``python benchmarks/bench_gradings.py [--quick]`` prints a table.

The sheet has classes of equal mass between 1 and 10 mm, of holes that grains pass; cells at walls are dropped. The peer
is what a user had before: the same sizes given to all cells, those at walls dropped with theirs.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from grainsdem.geometry.integrals import volumes
from grainsdem.measures import sieve_diameters
from grainsdem.model import Domain, Grading
from grainsdem.packing import carve, resize, shrink
from grainsdem.packing.carve import unwarned
from grainsdem.tessellation import graded_cells, sized_cells

CLASSES = 6
RATIO = 10.0
BARS = {3000: 30.0, 20_000: 180.0}


def grading():
    """Return the curve."""
    return Grading(np.geomspace(1e-3, 1e-3 * RATIO, CLASSES + 1), np.linspace(0, 1, CLASSES + 1), "sieve")


def off(cells, diameters):
    """Return how far the curve of the grains inside is off, as a share of their mass, and how many they are."""
    with unwarned():
        bed = resize(shrink(carve(cells), porosity=0.4), diameters=diameters)
    sizes = sieve_diameters(bed)
    return grading().deviation(sizes, volumes(bed.grains)), len(bed)


def main() -> None:
    """Print seconds and deviations of both ways."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="3000 grains only")
    counts = [3000] if parser.parse_args().quick else list(BARS)
    graded_cells(Domain.cube(), Grading([1.0, 2.0], [0, 1], "sieve"), n=100, keep="all", rng=1)  # compiled
    for n in counts:
        start, cpu = time.perf_counter(), time.process_time()
        found = graded_cells(Domain.cube(), grading(), n=n, rng=1)
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
        start = time.perf_counter()
        drawn = np.random.default_rng(1).permutation(grading().draw(n))
        plain = sized_cells(Domain.cube(), drawn, rng=1)
        before = time.perf_counter() - start
        (ours, kept), (theirs, _) = off(found.cells, found.diameters), off(plain, drawn)
        print(
            f"{n} cells, {kept} inside: {wall:.1f} s by the clock (bar {BARS[n]:g}), {cpu:.1f} s of processor, curve "
            f"off by {100 * ours:.2f} %; sizes given once: {before:.1f} s, off by {100 * theirs:.1f} %",
            flush=True,
        )


if __name__ == "__main__":
    main()
