"""The tessellation engine beside Voro++ (native, multivoro) and Qhull (scipy), in one run; prints the page's table.

    python benchmarks/bench_tessellation.py             everything
    python benchmarks/bench_tessellation.py ratios      one part: ratios, million, growth, lloyd, clusters, sized or
                                                        compile, native

Native Voro++ needs a compiler and the library: apt-get install g++ voro++-dev.

Wall times are the best of some runs that take turns, so that a busy machine slows all alike; the processor's time
stands beside them, since it hardly feels what else runs.
"""

import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

N = 128_000


def timed(work, repeats=1):
    """Return the least wall time and the least processor time [s] of some runs."""
    best = [np.inf, np.inf]
    for _ in range(repeats):
        wall, processor = time.perf_counter(), time.process_time()
        work()
        best = [min(best[0], time.perf_counter() - wall), min(best[1], time.process_time() - processor)]
    return best


def on_threads(threads, work):
    """Return a function that runs ``work`` on so many threads."""
    import numba

    def run():
        before = numba.get_num_threads()
        numba.set_num_threads(threads)
        try:
            work()
        finally:
            numba.set_num_threads(before)

    return run


def full_cells(seeds, domain):
    from grainsdem.geometry.integrals import integrate
    from grainsdem.tessellation import tessellate

    integrate(tessellate(seeds, domain).cells)


def light_pass(seeds, domain):
    from grainsdem.tessellation.engine.frame import Frame
    from grainsdem.tessellation.engine.light import moments
    from grainsdem.tessellation.engine.tree import build

    frame = Frame.of(domain)
    moments(build(frame.inward(seeds), np.zeros(len(seeds))), frame)


def voropp(seeds, threads):
    import multivoro

    limits = np.array([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]])
    multivoro.compute_voronoi(seeds, limits=limits, radii=np.zeros(len(seeds)), n_threads=threads)


def native():
    """Compare native Voro++, every cell with neighbours and volume, with ours, turn by turn on one and two threads."""
    if shutil.which("g++") is None:
        print("native Voro++ is left out: apt-get install g++ voro++-dev")
        return
    seeds, domain = inputs(N)
    warm_up()
    with tempfile.TemporaryDirectory() as folder:
        program, data = Path(folder) / "voropp", Path(folder) / "seeds"
        source = Path(__file__).with_name("voropp.cc")
        command = ["g++", "-O3", "-pthread", str(source), "-o", str(program), "-lvoro++"]
        subprocess.run(command, check=True)  # noqa: S603  (our own code)
        seeds.tofile(data)
        for threads in (1, 2):
            theirs, others, ours, light = (np.full(2, np.inf) for _ in range(4))
            for _ in range(3):
                done = subprocess.run(  # noqa: S603  (our own code)
                    [program, data, str(N), str(threads)], capture_output=True, text=True, check=True
                )
                volume, *times = (float(word) for word in done.stdout.split())
                assert abs(volume - 1) < 1e-9
                theirs = np.minimum(theirs, times)
                others = np.minimum(others, timed(lambda t=threads: voropp(seeds, t)))
                ours = np.minimum(ours, timed(on_threads(threads, lambda: full_cells(seeds, domain))))
                light = np.minimum(light, timed(on_threads(threads, lambda: light_pass(seeds, domain))))
            for name, found in (("native Voro++", theirs), ("multivoro", others), ("light pass", light)):
                wall, processor = found / ours
                print(
                    f"{name} over full cells, {threads} threads: {wall:.2f} wall, {processor:.2f} processor", flush=True
                )
            print(
                f"µs of processor a cell: {', '.join(f'{1e6 * x[1] / N:.1f}' for x in (theirs, others, light, ours))}"
            )


def qhull(seeds):
    from scipy.spatial import Voronoi

    Voronoi(seeds)


def inputs(n, rng=1):
    from grainsdem.model import Domain
    from grainsdem.points import poisson

    domain = Domain.cube()
    return poisson(domain, n, rng=rng), domain


def warm_up():
    seeds, domain = inputs(100)
    full_cells(seeds, domain)
    light_pass(seeds, domain)


def ratios(repeats=6):
    """Time the same 128 000 seeds in every program, turn by turn."""
    seeds, domain = inputs(N)
    warm_up()
    work = {
        "full cells and their integrals, 1 thread": on_threads(1, lambda: full_cells(seeds, domain)),
        "full cells and their integrals, 2 threads": on_threads(2, lambda: full_cells(seeds, domain)),
        "light pass, 1 thread": on_threads(1, lambda: light_pass(seeds, domain)),
        "light pass, 2 threads": on_threads(2, lambda: light_pass(seeds, domain)),
        "multivoro, 1 thread": lambda: voropp(seeds, 1),
        "multivoro, 2 threads": lambda: voropp(seeds, 2),
        "scipy.spatial.Voronoi": lambda: qhull(seeds),
    }
    times = {name: [np.inf, np.inf] for name in work}
    for turn in range(repeats):
        for name, run in work.items():
            if turn % 3 and name.startswith(("scipy", "multivoro")):
                continue  # ten seconds each
            times[name] = np.minimum(times[name], timed(run)).tolist()
    print("| work, 128 000 Poisson seeds | wall [s] | cells/s | processor [µs a cell] |")
    print("|---|---|---|---|")
    for name, (wall, processor) in times.items():
        print(f"| {name} | {wall:.2f} | {N / wall:,.0f} | {processor / N * 1e6:.1f} |")
    one, two = (times[f"full cells and their integrals, {k}"] for k in ("1 thread", "2 threads"))
    peer, scipy, light = times["multivoro, 1 thread"], times["scipy.spatial.Voronoi"], times["light pass, 1 thread"]
    print("| ratio | wall | processor | bar |")
    print("|---|---|---|---|")
    print(f"| full, 2 threads, to multivoro | {peer[0] / two[0]:.1f} | | 5 |")
    print(f"| full, 1 thread, to multivoro | {peer[0] / one[0]:.1f} | {peer[1] / one[1]:.1f} | 2.5 |")
    print(f"| full, 2 threads, to scipy | {scipy[0] / two[0]:.1f} | | 8 |")
    print(f"| full, 1 thread, to scipy | {scipy[0] / one[0]:.1f} | {scipy[1] / one[1]:.1f} | |")
    print(f"| light, 1 thread, to multivoro | {peer[0] / light[0]:.1f} | {peer[1] / light[1]:.1f} | 3.5 |")


def million():
    """Make a million full cells, in this process alone: the peak of memory is that of its whole life."""
    warm_up()
    seeds, domain = inputs(1_000_000)
    wall, processor = timed(on_threads(2, lambda: full_cells(seeds, domain)))
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6
    print(
        f"1 000 000 full cells, 2 threads: {wall:.1f} s wall, {processor:.1f} s processor (12 s), "
        f"peak memory {peak:.2f} GB (3.5 GB)"
    )


def growth():
    """Fit the exponent of time from 10⁴ to 10⁶ seeds, each time in a fresh process with warm kernels.

    In one process small beds are written into memory that the allocator kept, while large ones pay for fresh pages:
    some 2 µs a cell on one thread, whatever the number of cells. A user's first bed pays for them at any size.
    """
    code = (
        "import sys, time; sys.path.insert(0, sys.argv[2]); import bench_tessellation as b; b.warm_up();"
        "s, d = b.inputs(int(sys.argv[1])); w, p = time.perf_counter(), time.process_time(); b.full_cells(s, d);"
        "print(time.perf_counter() - w, time.process_time() - p)"
    )
    sizes = [10_000, 100_000, 1_000_000]
    times = np.full((3, 2), np.inf)
    for _ in range(5):
        for k, n in enumerate(sizes):
            command = [sys.executable, "-c", code, str(n), str(Path(__file__).parent)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603  (our own code)
            times[k] = np.minimum(times[k], [float(word) for word in done.stdout.split()])
    for kind, values in zip(("wall", "processor"), times.T, strict=True):
        exponent = np.polyfit(np.log(sizes), np.log(values), 1)[0]
        per_cell = ", ".join(f"{1e6 * t / n:.1f}" for t, n in zip(values, sizes, strict=True))
        print(f"{kind}: {per_cell} µs a cell for 10⁴, 10⁵, 10⁶; exponent {exponent:.3f} (1.05)")


def lloyd():
    """Relax 128 000 seeds twenty times."""
    from grainsdem.tessellation import relax

    warm_up()
    seeds, domain = inputs(N)
    wall, processor = timed(on_threads(2, lambda: relax(seeds, domain, iterations=20)))
    print(f"Lloyd, 128 000 seeds, 20 iterations, 2 threads: {wall:.1f} s wall, {processor:.1f} s processor (25 s)")


def clusters():
    """Compare a cell in Thomas clusters, 140 times the mean density at their middles, with a Poisson cell."""
    warm_up()
    seeds, domain = inputs(40_000)
    generator = np.random.default_rng(3)
    centres = generator.random((20, 3))[generator.integers(0, 20, 40_000)]
    clustered = np.mod(centres + 0.02 * generator.standard_normal((40_000, 3)), 1.0)
    for name, work in (("full", full_cells), ("light", light_pass)):
        plain = timed(on_threads(1, lambda w=work: w(seeds, domain)), 3)
        dense = timed(on_threads(1, lambda w=work: w(clustered, domain)), 3)
        print(f"clusters to Poisson, {name}: {dense[0] / plain[0]:.2f} wall, {dense[1] / plain[1]:.2f} processor (3)")


def sized():
    """Give 20 000 cells volumes of a lognormal law to 1 %."""
    from scipy import stats

    from grainsdem.geometry.integrals import volumes
    from grainsdem.model import Domain
    from grainsdem.tessellation import sized_cells

    warm_up()
    for spread in (0.2, 0.35):
        law, steps, made = stats.lognorm(spread), [], []

        def tell(step, worst, steps=steps):
            steps.append((step, worst))

        def work(law=law, tell=tell, made=made):
            made.append(sized_cells(Domain.cube(), law, n=20_000, rng=1, progress=tell))

        wall, processor = timed(on_threads(2, work))
        found = volumes(made[0].cells)
        print(
            f"20 000 cells of lognormal sizes, σ = {spread}, volumes from 1 to {found.max() / found.min():.0f}: "
            f"{wall:.0f} s wall, {processor:.0f} s processor, {steps[-1][0]} steps, largest error {steps[-1][1]:.2g}"
        )


def compile_time():
    """Time a first call in fresh processes, without and with a cache."""
    code = (
        "import time, numpy as np; from grainsdem.model import Domain;"
        "from grainsdem.tessellation import tessellate, relax;"
        "s = np.random.default_rng(1).random((50, 3)); t = time.perf_counter(); tessellate(s, Domain.cube());"
        "print(f'{time.perf_counter() - t:.1f} s', end=' ');"
        "t = time.perf_counter(); relax(s, Domain.cube()); print(f'and {time.perf_counter() - t:.1f} s')"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in ("empty", "filled"):
            done = subprocess.run(  # noqa: S603  (our own code)
                [sys.executable, "-c", code],
                env={**os.environ, "NUMBA_CACHE_DIR": folder},
                capture_output=True,
                text=True,
                check=True,
            )
            print(f"first tessellate and first relax, {name} cache: {done.stdout.strip()} (20 s, empty)")


PARTS = {
    "ratios": ratios,
    "million": million,
    "growth": growth,
    "lloyd": lloyd,
    "clusters": clusters,
    "sized": sized,
    "compile": compile_time,
    "native": native,
}


def main():
    chosen = sys.argv[1:]
    if chosen:
        for part in chosen:
            PARTS[part]()
        return
    for part in PARTS:
        print(f"\n{part}", flush=True)
        # A process each: the peak of memory of one is not that of the others.
        subprocess.run([sys.executable, __file__, part], check=True)  # noqa: S603  (our own code)


if __name__ == "__main__":
    main()
