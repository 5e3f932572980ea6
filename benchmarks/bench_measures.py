"""Tables and fits at the paper's largest bed: ``python benchmarks/bench_measures.py [grains]`` prints one table.

Times are the best of three, with the processor time of all threads beside: the cores may be busy. The fit's peer is
scipy's own density, searched by scipy.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.optimize import minimize

import grainsdem as gd


def best(work, times=3):
    """Return the shortest time of a few runs and the least processor time, and the last result."""
    shortest, busy = np.inf, np.inf
    for _ in range(times):
        start, start_busy = time.perf_counter(), time.process_time()
        result = work()
        shortest = min(shortest, time.perf_counter() - start)
        busy = min(busy, time.process_time() - start_busy)
    return shortest, busy, result


def row(work, seconds, busy, note=""):
    print(f"{work:<44} {seconds:8.2f} s {busy:8.2f} s of processors   {note}", flush=True)


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 128_000
    domain = gd.Domain.cube()
    bed = gd.carve(gd.tessellate(gd.points.poisson(domain, int(1.11 * n) + 60, rng=1), domain))
    gd.table(bed)  # compiled before it is timed
    print(f"{len(bed)} Poisson grains")
    seconds, busy, rows = best(lambda: gd.table(bed, sieves=False))
    row("table: axes, boxes, classes, neighbours; without sieve diameters", seconds, busy)
    seconds, busy, _ = best(lambda: gd.sieve_diameters(bed), 1)
    row("sieve diameters", seconds, busy, f"{1e3 * busy / len(bed):.2f} ms a grain")
    seconds, busy, edges = best(lambda: gd.neighbor_table(bed))
    row("table of neighbours", seconds, busy, f"{len(edges)} rows")
    seconds, busy, _ = best(lambda: gd.size_distribution(bed))
    row("distribution: statistics and three fits", seconds, busy)
    with tempfile.TemporaryDirectory() as folder:
        for suffix in (".csv", ".parquet", ".h5"):
            path = Path(folder) / f"rows{suffix}"
            seconds, busy, _ = best(lambda path=path: gd.write_table(rows, path), 1)
            row(f"write the table as {suffix}", seconds, busy, f"{path.stat().st_size / 1e6:.0f} MB")
    bench_fit()


def bench_fit():
    h = gd.LogHyperbolic(5.0, 3.2, 1 / np.sqrt(5.0**2 - 3.2**2), 0.0)
    d = h.draw(20_000, rng=1)
    x = np.log(d)

    def missing(p):
        mu, log_delta, log_gamma, beta = p
        delta, alpha = np.exp(log_delta), np.hypot(np.exp(log_gamma), beta)
        return -stats.genhyperbolic.logpdf(x, p=1, a=alpha * delta, b=beta * delta, loc=mu, scale=delta).sum()

    seconds, busy, fit = best(lambda: gd.fit_sizes(d))
    row("fit 20 000 log-hyperbolic draws, intervals", seconds, busy)
    truth = [h.mu, np.log(h.delta), np.log(h.gamma), h.beta]
    seconds, busy, found = best(lambda: minimize(missing, truth, method="Nelder-Mead", options={"xatol": 1e-6}), 1)
    row(
        "scipy: Nelder and Mead, from the truth",
        seconds,
        busy,
        f"likelihood {-found.fun - x.sum() - fit.log_likelihood:+.1e}",
    )


if __name__ == "__main__":
    main()
