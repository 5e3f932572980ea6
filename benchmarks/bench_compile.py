"""What compiling costs, by kernel and by command, with an empty cache; prints docs/benchmarks.md's table.

    python benchmarks/bench_compile.py             everything
    python benchmarks/bench_compile.py kernels     one part: kernels, commands or demo

Processor time is of all threads and processes together: it hardly feels what else the machine does.
"""

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections import defaultdict

import numpy as np

GRAINS = "60"


class Watch:
    """Processor time that each kernel takes to compile, without that of the kernels it calls."""

    def __init__(self):
        from numba.core import event

        class Listener(event.Listener):
            def on_start(_, __):  # noqa: N805  (the watch is self)
                self.open.append([time.process_time(), 0.0])

            def on_end(_, told):  # noqa: N805
                began, inner = self.open.pop()
                whole = time.process_time() - began
                if self.open:
                    self.open[-1][1] += whole
                self.rows.append((told.data["dispatcher"].py_func, whole - inner))

        self.open, self.rows = [], []
        event.register("numba:compile", Listener())

    def table(self):
        """Return module, name, signatures and seconds of each function, the dearest first."""
        found = defaultdict(list)
        for function, spent in self.rows:
            found[function.__module__.removeprefix("grainsdem."), function.__name__].append(spent)
        return sorted(((*key, len(spent), sum(spent)) for key, spent in found.items()), key=lambda row: -row[3])


def every_kernel():
    """Call whatever has a kernel of its own, on a tiny bed."""
    import grainsdem as gd
    from grainsdem.geometry import ahead
    from grainsdem.geometry.raster.lines import count_pairs, run_lengths
    from grainsdem.geometry.raster.slicing import areas_inside, mean_widths

    for step in ahead.STEPS:
        ahead.take(step)
    domain = gd.Domain.cube()
    for intensity in (None, 40.0):
        gd.points.strauss_process(
            domain, 20 if intensity is None else None, intensity=intensity, distance=0.05, inhibition=0.5, rng=1
        )
    gd.points.strauss(domain, 20, distance=0.05, inhibition=0.5, rng=1)
    bed = gd.shrink(gd.carve(gd.tessellate(gd.points.poisson(domain, 60, rng=1), domain), keep="all"), porosity=0.4)
    gd.table(bed)
    gd.heal(bed, gap=1e-3, by="inset")
    mean_widths(bed)
    labels = gd.voxelize(bed, per_diameter=8).labels
    count_pairs(labels, (1, 0, 0), np.zeros(3, dtype=np.bool_))
    run_lengths((labels[0] > 0).astype(np.int8), wraps=False)
    gd.section(bed, z=0.5)
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    areas_inside(square, np.array([0, 4]), square)
    gd.photograph(gd.planform(bed, per_diameter=8), bed)


def kernels():
    """Compile everything in one process and print what each function took."""
    with tempfile.TemporaryDirectory() as folder:
        ask([sys.executable, __file__, "_kernels"], folder)


def _kernels():
    watch = Watch()
    every_kernel()
    rows = watch.table()
    ours = [row for row in rows if not row[0].startswith("numba")]
    print("| kernel | signatures | processor [s] |")
    print("|---|---|---|")
    for module, name, signatures, spent in rows[:25]:
        print(f"| `{module}.{name}` | {signatures} | {spent:.2f} |")
    count = sum(row[2] for row in ours)
    twice = [f"{module}.{name}" for module, name, signatures, _ in ours if signatures > 1]
    print(f"{len(ours)} functions, {count} signatures; more than one: {', '.join(twice) or 'none'}")
    print(f"all together: {sum(row[3] for row in rows):.1f} s of processor time (60 s)")


def ask(command, cache):
    """Run a command with a cache folder; return the time by the clock and the processor time [s]."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, env={**os.environ, "NUMBA_CACHE_DIR": cache}, check=True)  # noqa: S603  (our own code)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - began, spent


def program(*words):
    """Return the command line that runs grainsdem with some words."""
    return [sys.executable, "-c", "from grainsdem.cli import main; main()", *words, "--quiet"]


def commands():
    """Time the first and the second run of the commands that a newcomer tries, each with an empty cache of its own."""
    code = "import grainsdem as gd; gd.tessellate(gd.points.poisson(gd.Domain.cube(), 60, rng=1), gd.Domain.cube())"
    touch = "import sys, grainsdem as gd; gd.contacts(gd.load(sys.argv[1]))"
    with tempfile.TemporaryDirectory() as folder:
        bed = f"{folder}/bed.h5"
        cases = {
            "grainsdem generate": program("generate", bed, "--count", GRAINS, "--keep", "all"),
            "grainsdem validate": program("validate", bed),
            "grainsdem measure": program("measure", bed),
            "`tessellate` in Python": [sys.executable, "-c", code],
            "`contacts` in Python": [sys.executable, "-c", touch, bed],
        }
        compare(cases, folder)


def demo():
    """Time the first and the second run of the demo."""
    with tempfile.TemporaryDirectory() as folder:
        compare({"grainsdem demo": program("demo", "--folder", f"{folder}/demo")}, folder)


def compare(cases, folder):
    """Print clock and processor time of each command, first and second run."""
    print("| command | first: clock [s] | processor [s] | second: clock [s] | processor [s] |")
    print("|---|---|---|---|---|")
    for number, (name, command) in enumerate(cases.items()):
        first, second = (ask(command, f"{folder}/cache{number}") for _ in range(2))
        print(f"| {name} | {first[0]:.1f} | {first[1]:.1f} | {second[0]:.1f} | {second[1]:.1f} |", flush=True)


PARTS = {"kernels": kernels, "commands": commands, "demo": demo}


def main():
    for part in sys.argv[1:] or PARTS:
        _kernels() if part == "_kernels" else PARTS[part]()


if __name__ == "__main__":
    main()
