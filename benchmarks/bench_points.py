"""Every point process at the paper's largest count: ``python benchmarks/bench_points.py [seeds]`` prints one table.

All run on one thread: times are processor time, which a busy machine changes least, and the better of two runs, kernels
compiled.
"""

from __future__ import annotations

import sys
import time

import numpy as np

from grainsdem import points
from grainsdem.model import Domain


def best(work, times=2):
    shortest = np.inf
    for _ in range(times):
        start = time.process_time()
        result = work()
        shortest = min(shortest, time.process_time() - start)
    return shortest, result


def processes(domain, n):
    """Return the processes by name, as functions of how many seeds they place."""
    spacing = (1.0 / n) ** (1 / (2 if domain.is_planar else 3))
    inhibited = {"distance": 0.6 * spacing, "rng": 1}
    shape = (512, 512) if domain.is_planar else (128, 128, 128)
    density = np.random.default_rng(1).random(shape)
    image = np.random.default_rng(2).random((512, 512))
    return {
        "poisson": lambda n: points.poisson(domain, n, rng=1),
        "halton": lambda n: points.halton(domain, n),
        "cluster, 1000 parents": lambda n: points.cluster_poisson(domain, n, parents=1000, spread=0.05, rng=1),
        "strauss, c = 0.1": lambda n: points.strauss(domain, n, inhibition=0.1, **inhibited),
        "strauss, c = 0": lambda n: points.strauss(domain, n, inhibition=0.0, **inhibited),
        "strauss_process, c = 0.1, 100 sweeps": lambda n: points.strauss_process(
            domain, n, inhibition=0.1, **inhibited
        ),
        "strauss_process by intensity, c = 0.5": lambda n: points.strauss_process(
            domain, intensity=float(n), inhibition=0.5, **inhibited
        ),
        f"density of {' × '.join(map(str, shape))} voxels": lambda n: points.from_density(domain, n, density, rng=1),
        "noise, β = 2, 128 voxels an edge": lambda n: points.pink_noise(domain, n, beta=2.0, rng=1),
        "image of 512 × 512 pixels, low-passed": lambda n: points.from_image(domain, n, image, low_pass=0.05, rng=1),
    }


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 128_000
    print(f"{'process':<50} {'3-D [s]':>9} {'2-D [s]':>9}")
    domains = (Domain.cube(periodic=True), Domain.slab((1.0, 1.0), 0.01, periodic=True))
    tables = [processes(domain, n) for domain in domains]
    found = []
    for (name, solid), flat in zip(tables[0].items(), tables[1].values(), strict=True):
        figures = []
        for work in (solid, flat):
            work(100)  # compiled before it is timed
            seconds, seeds = best(lambda work=work: work(n))
            figures.append(seconds)
            found.append(seeds)
        print(f"{name.replace('512 × 512 voxels', 'voxels'):<50} {figures[0]:>9.2f} {figures[1]:>9.2f}", flush=True)
    for name, work in {
        "nearest_distances": points.nearest_distances,
        "describe: nearest, K and g to three mean spacings": points.describe,
    }.items():
        figures = [best(lambda s=s, d=d, work=work: work(s, d), 1)[0] for s, d in zip(found[:2], domains, strict=True)]
        print(f"{name:<50} {figures[0]:>9.2f} {figures[1]:>9.2f}", flush=True)


if __name__ == "__main__":
    main()
