"""The whole generator at the paper's largest number of grains, 128 000 seeds a model; prints a table.

    python benchmarks/bench_models.py             every model, each in a process of its own
    python benchmarks/bench_models.py poisson     one: poisson, cvt_uniform, cvt_halton, cluster, strauss,
                                                  strauss_process, noise or image

Seeds, Lloyd's iterations where the model has any, cells, grains, porosity. Kernels are compiled and cached
before. The processor's time stands beside the wall's, which feels what else the machine does.
"""

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

N = 128_000
BAR = 60.0
"""Seconds that a model may take on two cores."""

SPACING = N ** (-1 / 3)
"""Length of the cube that each seed would have to itself, in edges of the domain."""

ITERATIONS = 20
"""Of Lloyd's, for the centroidal models: as many as the paper's authors take in their public code."""


def photograph(folder, pixels=1024):
    """Return the path of a grey image with blobs of all sizes."""
    from PIL import Image

    from grainsdem.points import noise_field

    field = noise_field((pixels, pixels), 1.0, rng=1)
    grey = np.uint8(255 * (field - field.min()) / np.ptp(field))
    Image.fromarray(grey).save(Path(folder) / "image.png")
    return Path(folder) / "image.png"


def models(folder):
    """Return what places the seeds of each model, and how often they are relaxed."""
    from grainsdem import points

    return {
        "poisson": (lambda d, n: points.poisson(d, n, rng=1), 0),
        "cvt_uniform": (lambda d, n: points.poisson(d, n, rng=1), ITERATIONS),
        "cvt_halton": (points.halton, ITERATIONS),
        "cluster": (lambda d, n: points.cluster_poisson(d, n, parents=max(1, n // 100), spread=0.02, rng=1), 0),
        "strauss": (lambda d, n: points.strauss(d, n, distance=0.6 * n ** (-1 / 3), inhibition=0.1, rng=1), 0),
        "strauss_process": (
            lambda d, n: points.strauss_process(d, n, distance=0.6 * n ** (-1 / 3), inhibition=0.1, rng=1),
            0,
        ),
        "noise": (lambda d, n: points.pink_noise(d, n, beta=1.0, rng=1), 0),
        "image": (lambda d, n: points.from_image(d, n, photograph(folder), low_pass=0.1, rng=1), 0),
    }


def steps(name, folder, n):
    """Yield each step's name as it is done, and the packing at last."""
    from grainsdem import carve, relax, shrink, tessellate
    from grainsdem.model import Domain

    place, iterations = models(folder)[name]
    domain = Domain.cube()
    seeds = place(domain, n)
    yield "seeds", seeds
    if iterations:
        seeds = relax(seeds, domain, iterations=iterations)
    yield "relax", seeds
    cells = tessellate(seeds, domain)
    yield "cells", cells
    packing = carve(cells)
    yield "carve", packing
    yield "shrink", shrink(packing, porosity=0.4)


def one(name):
    """Time one model, and print its row."""
    from grainsdem import measures

    with tempfile.TemporaryDirectory() as folder:
        list(steps(name, folder, 2000))
        times, packing = {}, None
        before, busy = time.perf_counter(), time.process_time()
        for step, made in steps(name, folder, N):
            now = time.perf_counter()
            times[step], before, packing = now - before, now, made
    total, busy = sum(times.values()), time.process_time() - busy
    assert abs(measures.porosity(packing) - 0.4) < 1e-12
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    columns = " | ".join(f"{seconds:.2f}" for seconds in times.values())
    shown = f"{total:.1f}" if total < BAR else f"**{total:.1f}**"
    print(
        f"| {name.replace('_', ' ')} | {len(packing):,} | {columns} | {shown} | {busy:.1f} | {peak:.2f} |".replace(
            ",", " "
        )
    )


def main():
    if sys.argv[1:]:
        for name in sys.argv[1:]:
            one(name)
        return
    print("| model, 128 000 seeds | grains | seeds | relax | cells | carve | shrink | all [s] | CPU [s] | peak [GB] |")
    print("|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for name in models("."):
        subprocess.run([sys.executable, __file__, name], check=True)  # noqa: S603  (our own code)


if __name__ == "__main__":
    main()
