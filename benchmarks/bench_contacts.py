"""Contacts and validation against their bars: ``python benchmarks/bench_contacts.py [grains]`` prints one table.

The bars are those of 100 000 grains on two threads. Times are the best of a few, so that a busy machine counts less;
the peers run in the same process, on the same pairs.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.separation import bodies, certify, measure_gaps, offsets_between
from grainsdem.geometry.triangles import triangles
from grainsdem.model import Domain
from grainsdem.packing import carve, contacts, heal, inset, shrink
from grainsdem.packing.contacts import mean_diameter
from grainsdem.points import halton
from grainsdem.tessellation import tessellate
from grainsdem.validation import validate  # noqa: F401  (for bench_validate)
from grainsdem.validation.intersections import intersection_volumes

NEAR = 0.25
"""Gap in d up to which pairs are near: about seven a grain at a porosity of 0.4."""


def bed(n):
    domain = Domain.cube(0.01)
    return shrink(carve(tessellate(halton(domain, int(1.15 * n) + 60), domain)), porosity=0.4)


def scaled(packing, factor):
    """Return the grains grown back."""
    g = packing.grains
    return replace(g, vertices=g.vertices * factor)


def best(work, times=3):
    """Return the shortest time of a few runs, and the last result."""
    shortest = np.inf
    for _ in range(times):
        start = time.perf_counter()
        result = work()
        shortest = min(shortest, time.perf_counter() - start)
    return shortest, result


def row(work, figure, bar, note=""):
    print(f"{work:<58} {figure:>12}   bar {bar:<10} {note}", flush=True)


def bench_fcl(packing, d):
    import fcl

    within = NEAR * d
    contacts(packing, within=within)  # compiled before it is timed
    everything, graph = best(lambda: contacts(packing, within=within))
    solids, offsets = bodies(packing), offsets_between(packing, graph.pairs)
    busy = time.process_time()
    ours, measured = best(lambda: measure_gaps(solids, graph.pairs, offsets, within), 1)
    busy = time.process_time() - busy
    ours = min(ours, best(lambda: measure_gaps(solids, graph.pairs, offsets, within))[0])
    start = time.perf_counter()
    convexes = []
    for i in range(len(packing)):
        faces = packing.grains.faces_of(i)
        rings = np.concatenate([np.append(len(face), face) for face in faces])
        shape = fcl.Convex(packing.grains.vertices_of(i) / d, len(faces), rings)
        convexes.append(fcl.CollisionObject(shape, fcl.Transform(np.eye(3), packing.positions[i] / d)))
    building = time.perf_counter() - start
    request, result, pairs = fcl.DistanceRequest(), fcl.DistanceResult(), graph.pairs.tolist()
    fcl_busy = time.process_time()
    theirs, distances = best(lambda: [fcl.distance(convexes[i], convexes[j], request, result) for i, j in pairs], 1)
    fcl_busy = time.process_time() - fcl_busy
    error = np.array(distances) - measured.gaps / d
    # The planes prove our gaps from below, and the points from above; where fcl differs, it stopped early.
    x, y = measured.firsts, measured.seconds
    proven = np.abs(np.linalg.norm(y - x, axis=1) - measured.gaps) / d
    row(f"gaps of {len(pairs)} near pairs against fcl's distance", f"{theirs / ours:.1f}×", "≥ 5×",
        f"{ours:.2f} s against {theirs:.2f} s, and {building:.1f} s for its shapes")  # fmt: skip
    row(
        "the same in processor time, on one thread",
        f"{fcl_busy / busy:.1f}×",
        "—",
        f"{busy:.2f} s against {fcl_busy:.2f} s",
    )
    row("contacts() from nothing, against fcl's distance alone", f"{theirs / everything:.1f}×", "—",
        f"{everything:.2f} s with boxes, grid, edges and areas")  # fmt: skip
    row("largest difference from fcl, in d", f"{np.quantile(np.abs(error), 0.999):.1e}", "1e-9",
        f"but for {int((np.abs(error) > 1e-9).sum())} pairs, where fcl is up to {error.max():.2g} above")  # fmt: skip
    row("gap against the distance of its own closest points, in d", f"{proven.max():.1e}", "1e-9", "all pairs")


def bench_certificate(packing, d):
    pairs, _ = near_images(packing, NEAR * d)
    pairs = np.resize(pairs, (1_000_000, 2))
    solids, offsets = bodies(packing), offsets_between(packing, pairs)
    certify(solids, pairs[:10], offsets[:10])
    seconds, (_, margins) = best(lambda: certify(solids, pairs, offsets))
    row("certificate of 1 000 000 pairs", f"{seconds:.2f} s", "≤ 3 s", f"{int((margins >= 0).sum())} proven apart")


def bench_manifold(packing, d, kind):
    import manifold3d

    pairs, _ = near_images(packing)
    solids, offsets = bodies(packing), offsets_between(packing, pairs)
    mesh = triangles(packing.grains)
    listed = pairs.tolist()

    def build():
        built = {}
        for i in np.unique(pairs).tolist():
            corners = mesh.indices[mesh.offsets[i] : mesh.offsets[i + 1]].astype(np.uint64)
            vertices = (packing.grains.vertices_of(i) + packing.positions[i]) / d
            built[i] = manifold3d.Manifold(manifold3d.Mesh64(np.ascontiguousarray(vertices), corners))
            built[i].status()
        return built

    building, built = best(build, 2)
    bare, _ = best(lambda: [(built[i] ^ built[j]).volume() for i, j in listed])
    one, _ = best(lambda: intersection_volumes(packing.grains, solids, pairs, offsets, length=d, processes=1))
    two, _ = best(lambda: intersection_volumes(packing.grains, solids, pairs, offsets, length=d, processes=2), 2)
    row(f"manifold3d, {len(pairs)} {kind} pairs, against a bare loop", f"{100 * (bare + building) / one:.0f} %",
        "≥ 85 %", f"both building; {100 * bare / one:.0f} % of the loop alone, {len(pairs) / bare:.0f}/s")  # fmt: skip
    row("the same in two processes, against one", f"{one / two:.2f}×", "near 2×",
        f"starting them included: {one:.2f} s and {two:.2f} s")  # fmt: skip


def bench_inset(packing, d):
    depth = 0.01 * d
    inset(packing, depth)  # compiled before it is timed
    seconds, smaller = best(lambda: inset(packing, depth))
    lost = 100 * (1 - smaller.grains.n_faces / packing.grains.n_faces)
    row(f"inset of {len(packing)} grains by 0.01 d", f"{seconds:.2f} s", "—", f"{lost:.1f} % of the faces vanish")
    steps = 0.03 * d * np.random.default_rng(0).standard_normal((len(packing), 3))
    pressed = replace(packing, positions=packing.positions + steps, links=None)
    for by in ("scale", "inset"):
        seconds, healed = best(lambda by=by: heal(pressed, gap=1e-3 * d, by=by), 1)
        row(f"heal the same thrown about by 0.03 d, by {by}", f"{seconds:.2f} s", "—",
            f"porosity {healed.porosity_change:+.4f}")  # fmt: skip


def bench_validate(n):
    """Validate in a process of its own, whose peak memory is then the work's."""
    code = (
        "import sys, time, resource; sys.path.insert(0, 'benchmarks')\n"
        "from bench_contacts import bed, validate\n"
        f"validate(bed(300)); packing = bed({n}); start = time.perf_counter(); report = validate(packing)\n"
        "peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6\n"
        "print(len(packing), report.ok, time.perf_counter() - start, peak)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603  (a constant)
    grains, ok, seconds, peak = done.stdout.split()
    row(f"validate {grains} grains", f"{float(seconds):.1f} s", "≤ 20 s", f"ok: {ok}")
    row("its peak memory, packing included", f"{float(peak):.2f} GB", "≤ 3 GB")


def main():
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    packing = bed(n)
    d = mean_diameter(packing)
    print(f"{len(packing)} grains; peak so far {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")
    bench_fcl(packing, d)
    bench_certificate(packing, d)
    bench_inset(packing, d)
    small = bed(6000)
    bench_manifold(small, mean_diameter(small), "disjoint")
    larger = bed(40_000)
    bench_manifold(larger, mean_diameter(larger), "disjoint")
    # At a porosity of zero all neighbours touch.
    bench_manifold(replace(small, grains=scaled(small, 1 / 0.6 ** (1 / 3))), mean_diameter(small), "touching")
    bench_validate(n)


if __name__ == "__main__":
    main()
