"""Exporters against their bars: ``python benchmarks/bench_exporters.py [grains]`` prints one table.

Times are the best of three, of the clock and of the processor: on a busy machine only the latter says much. Memory is
the most that was held at once while it wrote, in terms of the packing's own arrays.
"""

from __future__ import annotations

import sys
import tempfile
import time
import tracemalloc
from dataclasses import fields
from pathlib import Path

import numpy as np

import exporters
from grainsdem.geometry.rotations import world_vertices
from grainsdem.geometry.triangles import triangles
from grainsdem.model import Domain
from grainsdem.packing import carve, shrink
from grainsdem.points import halton
from grainsdem.tessellation import tessellate

BARS = {".stl": "4 s", ".usdc": "15 s", ".vtp": "8 s"}
"""Of 128 000 grains."""


def bed(n):
    domain = Domain.cube(0.05)  # the cells at its walls are dropped
    grown = shrink(carve(tessellate(halton(domain, round((n ** (1 / 3) + 1.9) ** 3), rng=1), domain)), porosity=0.4)
    return type(grown)(grown.grains, grown.positions, grown.quaternions, grown.densities, grown.domain)


def own_memory(packing):
    arrays = [getattr(noun, field.name) for noun in (packing, packing.grains) for field in fields(noun)]
    return sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))


def most_memory(work):
    """Return the most memory that was held at once while it worked."""
    tracemalloc.start()
    work()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return most


def best(work, times=3):
    """Return the shortest times of a few runs, of the clock and of the processor."""
    found = []
    for _ in range(times):
        clock, processor = time.perf_counter(), time.process_time()
        work()
        found.append((time.perf_counter() - clock, time.process_time() - processor))
    return np.min(found, axis=0)


def row(work, seconds, bar="", note=""):
    print(f"{work:<44} clock {seconds[0]:7.2f} s  processor {seconds[1]:7.2f} s   bar {bar:<6} {note}", flush=True)


def bench_format(packing, suffix, folder, bar, **options):
    def work():
        exporters.write(packing, folder / f"bed{suffix}", **options)

    memory = most_memory(work) / own_memory(packing)
    written = sum(path.stat().st_size for path in folder.iterdir())
    row(f"{suffix}, {len(packing)} grains", best(work), bar, f"memory {memory:.2f}, {written / 1e6:.0f} MB")
    for path in folder.iterdir():
        path.unlink()


def bench_trimesh(packing, n=2000):
    """Export a loop of grains by trimesh, as one would who has nothing else."""
    import trimesh

    world, offsets, cut = world_vertices(packing), packing.grains.vertex_offsets, triangles(packing.grains)

    def work():
        for i in range(n):
            faces = cut.indices[cut.offsets[i] : cut.offsets[i + 1]]
            trimesh.Trimesh(world[offsets[i] : offsets[i + 1]], faces, process=False).export(file_type="stl")

    def ours():
        for content in exporters.find(".stl").module.files(packing).values():
            for _ in content:
                pass

    row("binary STL made, not stored", best(ours))
    row("a loop of trimesh exports, not stored", best(work) * len(packing) / n)


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 128_000
    small, many = bed(10_000), bed(n)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        for suffix in (".xml", ".stl", ".obj", ".usdc", ".vtp"):  # kernels are compiled before the clock starts
            bench_format(bed(200), suffix, folder, "")
        bench_format(small, ".xml", folder, "1.5 s")
        bench_format(small, ".usdc", folder, "")
        for suffix in (".stl", ".obj", ".usdc", ".xml", ".vtp"):
            bench_format(many, suffix, folder, BARS.get(suffix, ""))
        bench_trimesh(many)


if __name__ == "__main__":
    main()
