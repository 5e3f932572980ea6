"""Voxels, sections and planforms of large beds: ``python benchmarks/bench_seeing.py [grains]`` prints one table.

Kernels are compiled first on a small bed; times are the best of a few, so that a busy machine counts less.
"""

from __future__ import annotations

import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import grainsdem as gd


def bed(n):
    domain = gd.Domain.cube(1e-3 * n ** (1 / 3))
    return gd.shrink(gd.carve(gd.tessellate(gd.points.halton(domain, n), domain), keep="all"), porosity=0.4)


def best(work, times=3):
    """Return the shortest wall and processor time of a few runs, and the last result."""
    shortest = np.full(2, np.inf)
    for _ in range(times):
        start = time.perf_counter(), time.process_time()
        result = work()
        shortest = np.minimum(shortest, [time.perf_counter() - start[0], time.process_time() - start[1]])
    return shortest, result


def work_through(packing, times):
    side = float(packing.domain.lengths[0])
    steps = {}
    with tempfile.TemporaryDirectory() as folder:
        steps["voxels, 20 a diameter, streamed to .npy as one byte each"], file = best(
            lambda: gd.write_voxels(packing, Path(folder) / "a.npy", per_diameter=20, phase=True), min(times, 2)
        )
    steps["a section by any plane, and its table"], _ = best(
        lambda: gd.section_table(gd.section(packing, plane=[1, 2, 3, 3 * side])), times
    )
    steps["a profile of 32 levels"], _ = best(lambda: gd.section_profile(packing, 32), times)
    steps["a planform, 20 pixels a diameter"], view = best(lambda: gd.planform(packing), times)
    steps["its photograph, with shadows, sky, blur and noise"], _ = best(
        lambda: gd.photograph(view, packing, blur=0.7, noise=0.01, rng=1), times
    )
    steps["its truth and bias"], _ = best(lambda: gd.planform_bias(gd.planform_table(view, packing), packing), times)
    box = packing.domain.lower, packing.domain.lower + min(side, 15e-3)
    steps["voxels of a box of 15 diameters, 20 a diameter"], voxels = best(
        lambda: gd.voxelize(packing, per_diameter=20, region=box), times
    )
    steps["their two-point correlation"], _ = best(lambda: gd.two_point_correlation(voxels), times)
    steps["their specific surface"], _ = best(lambda: gd.specific_surface(voxels), times)
    steps["their chords along x, y and z"], _ = best(lambda: [gd.chord_lengths(voxels, a) for a in "xyz"], times)
    return steps, file, view, voxels


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 128_000
    work_through(bed(300), 1)
    packing = bed(n)
    steps, file, view, voxels = work_through(packing, 3)
    shapes = [" × ".join(map(str, shape)) for shape in (file.counts, view.labels.shape, voxels.labels.shape)]
    print(f"{len(packing)} grains; voxels {shapes[0]}, pixels {shapes[1]}, box {shapes[2]}\n")
    print("| work | wall [s] | processor [s] |\n|---|---|---|")
    for name, (wall, processor) in steps.items():
        print(f"| {name} | {wall:.2f} | {processor:.2f} |")
    print(f"\nporosity of the voxels {file.porosity:.6f}; ", end="")
    print(f"most memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
