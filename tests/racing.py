"""Work in which every kernel that threads share takes part, and ways of sharing it out that make a race show.

What is run in blocks (`grainsdem.geometry.threads.in_blocks`) may hang on neither their number nor their order. `split`
has blocks as small as can be on a number of threads; `alone` leaves nothing to the clock: it runs each block from what
stood there before all of them, so that what one reads of another's, or writes as another does, is seen every time.
"""

from __future__ import annotations

import ast
import importlib
import json
import os
import subprocess
import sys
from collections import Counter
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numba
import numpy as np
from growing_client import DOMAIN, digest, grown

import grainsdem as gd
from grainsdem import points, shapes
from grainsdem.geometry import threads
from grainsdem.geometry.triangles import best_apexes, facets, vector_areas
from grainsdem.tessellation import ellipsoids

PACKAGE = Path(gd.__file__).parent
SMALL = 8
"""Cells that one item of the light and the full pass makes here; elsewhere 256, more than a small bed has."""

MOST = 64
"""Blocks that `alone` runs one by one."""

CALLS = 8
"""Calls of a kernel of which `isolated` looks at each, out of hundreds with like arguments."""

LATTICE = np.array([(x, y, z) for x in range(4) for y in range(4) for z in range(4)]) * 0.005 + 0.0025
"""Seeds of which four and more cells meet in an edge; moved by rounding, some faces are seen from one side only."""


class RaceError(AssertionError):
    """Blocks hang on one another."""


@cache
def places():
    """Return where `in_blocks` is called with which kernel: (module, kernel)."""
    found = set()
    for path in PACKAGE.rglob("*.py"):
        module, text = ".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts), path.read_text("utf-8")
        for node in ast.walk(ast.parse(text)) if "in_blocks(" in text else []:
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "in_blocks":
                found.add((module, node.args[0].id))
    return found


@contextmanager
def shared_by(share, *, small=True):
    """Have every module share its blocks out by another function, and give that small items unless told otherwise."""
    modules = [importlib.import_module(name) for name in sorted({module for module, _ in places()})]
    chunked = [module for module in modules if small and hasattr(module, "CHUNK")]
    kept = [module.CHUNK for module in chunked]
    try:
        for module in modules:
            module.in_blocks = share
        for module in chunked:
            module.CHUNK = min(SMALL, module.CHUNK)
        yield
    finally:
        for module in modules:
            module.in_blocks = threads.in_blocks
        for module, chunk in zip(chunked, kept, strict=True):
            module.CHUNK = chunk


def name_of(kernel):
    """Return (module, kernel)."""
    function = getattr(kernel, "py_func", kernel)
    return function.__module__, function.__name__


@contextmanager
def split(count, seen, *, small=True):
    """Share work out among so many threads, with ``small`` however little it is; ``seen`` gets what was parted."""

    def share(kernel, n, *arguments, least=threads.LEAST):
        least = 1 if small else least
        if n >= 2 * least:
            seen.add(name_of(kernel))
        threads.in_blocks(kernel, n, *arguments, least=least)

    kept, numba.get_num_threads = numba.get_num_threads, lambda: count
    try:
        with shared_by(share, small=small):
            yield
    finally:
        numba.get_num_threads = kept


def arrays_of(arguments):
    """Return the arrays among arguments, in tuples too."""
    found = []
    for argument in arguments:
        if isinstance(argument, np.ndarray):
            found.append(argument)
        elif isinstance(argument, tuple):
            found += arrays_of(argument)
    return found


def in_bytes(array):
    """Return a copy of an array, a row of bytes for each of its values."""
    return np.frombuffer(array.tobytes(), np.uint8).reshape(array.size, array.itemsize)


def alone(kernel, n, *arguments, least=0, rng=None):
    """Run each block as if no other had run, and raise `RaceError` where that gives other values than all in one.

    Raises
    ------
    RaceError
        If two blocks write one value, or all of them together write other values than one block of everything.
    """
    if n < 2:
        kernel(0, n, *arguments)
        return
    name = ".".join(name_of(kernel))
    arrays = [array for array in arrays_of(arguments) if array.size and array.flags.writeable]
    before = [array.copy() for array in arrays]
    plain = [in_bytes(array) for array in arrays]
    kernel(0, n, *arguments)
    whole = [in_bytes(array) for array in arrays]
    after = [array.copy() for array in arrays]
    merged, owner = [row.copy() for row in plain], [np.full(len(row), -1) for row in plain]
    rng = np.random.default_rng(n) if rng is None else rng
    edges = np.unique(np.concatenate([[0, n], rng.permutation(np.arange(1, n))[: MOST - 1]]))
    for b in rng.permutation(len(edges) - 1):
        restore(arrays, before)
        kernel(int(edges[b]), int(edges[b + 1]), *arguments)
        for k, array in enumerate(arrays):
            now = in_bytes(array)
            changed = (now != plain[k]).any(axis=1)
            if (owner[k][changed] >= 0).any():
                raise RaceError(f"{name}: two blocks write the same values of array {k} of {array.shape}")
            owner[k][changed], merged[k][changed] = b, now[changed]
    for k, array in enumerate(arrays):
        if not np.array_equal(merged[k], whole[k]):
            raise RaceError(f"{name}: what stands in array {k} of {array.shape} hangs on the blocks")
    restore(arrays, after)


def restore(arrays, values):
    for array, value in zip(arrays, values, strict=True):
        array[...] = value


@contextmanager
def isolated(seen):
    """Run every block of every kernel as `alone` does."""

    calls = Counter()

    def share(kernel, n, *arguments, least=0):
        if n < 2 or calls[name_of(kernel)] >= CALLS:
            kernel(0, n, *arguments)
            return
        calls[name_of(kernel)] += 1
        seen.add(name_of(kernel))
        alone(kernel, n, *arguments)

    with shared_by(share):
        yield


def in_disorder(kernel, n, *arguments, least=0):
    """Take one item after another, the last one anywhere."""
    for item in np.random.default_rng(n).permutation(n).tolist():
        kernel(item, item + 1, *arguments)


def columns(table):
    """Return the columns of a table of grains that are made without the arctangents of a processor's own."""
    return [table[name] for name in table.dtype.names if name != "roundness"]


def plain(value):
    """Return the arrays and numbers that a noun is made of, for a digest."""
    if isinstance(value, np.ndarray):
        return [value]
    if isinstance(value, (bool, int, float, np.number)):
        return [np.asarray(value)]
    if isinstance(value, (tuple, list)):
        return [part for item in value for part in plain(item)]
    if isinstance(value, str):
        return [value.encode()]
    if isinstance(value, dict):
        return plain(list(value.items()))
    return [part for name in getattr(value, "__dataclass_fields__", ()) for part in plain(getattr(value, name))]


def measured(n):
    """Return a digest of what is packed, touched, cut, drawn and measured in beds of n seeds, by name."""
    wrapped = gd.Domain.box([0.02] * 3, periodic=(True, True, False))
    drawn = points.poisson(DOMAIN, n, rng=1)
    bed = gd.shrink(gd.carve(gd.tessellate(drawn, DOMAIN), keep="all"), porosity=0.4)
    tight = gd.carve(gd.tessellate(drawn, wrapped), keep="all")
    graph = gd.contacts(tight, walls=True)
    kinds = [shapes.rock(12, rng=1), shapes.box(1.0, 2.0, 3.0)]
    loose = gd.pack(kinds, np.full(n // 2, 2e-3), DOMAIN, rng=1)
    voxels = gd.voxelize(tight, per_diameter=5)
    pipe = gd.Domain.cylinder(0.01, 0.02)
    round_bed = gd.carve(gd.tessellate(points.poisson(pipe, n, rng=1), pipe), keep="all")
    view = gd.planform(bed, per_diameter=24)  # drawn in bands of 32 rows
    flat = gd.Domain.slab((0.02, 0.02), 1e-3)
    coins = gd.carve(gd.sized_cells(flat, np.linspace(0.5, 1.5, n), rng=1), keep="all")

    forms = np.diag([1.2, 1.0, 0.9])[None]
    standing = facets(bed.grains, best_apexes(bed.grains))
    found = {
        "strauss": points.strauss(DOMAIN, n, distance=0.007 * n ** (-1 / 3), inhibition=0.1, rng=1),
        "strauss_process": points.strauss_process(
            DOMAIN, n, distance=0.007 * n ** (-1 / 3), inhibition=0.1, sweeps=5, rng=1
        ),
        "between": ellipsoids.grown(DOMAIN, drawn, np.zeros(n), np.repeat(forms, n, axis=0), np.full((n, 3), 2e-3)),
        "graph": graph,
        "loose": loose,
        "loose_graph": gd.contacts(loose, within=1e-3),
        "lattice": gd.tessellate(LATTICE + 1e-15 * np.random.default_rng(0).normal(size=LATTICE.shape), DOMAIN).cells,
        "periodic": gd.tessellate(gd.relax(drawn, wrapped, iterations=2), wrapped).cells,
        "inset": gd.inset(bed, 1e-5),
        "healed": gd.heal(tight, gap=1e-5),
        "report": gd.validate(bed),
        "table": columns(gd.table(bed)),
        "coins": columns(gd.table(coins)),
        "porosity": gd.porosity(bed, region=([0.004] * 3, [0.015] * 3)),
        "voxels": voxels.labels,
        "round": gd.voxelize(round_bed, per_diameter=5).labels,
        "chords": gd.chord_lengths(voxels),
        "correlation": gd.two_point_correlation(voxels),
        "crofton": gd.specific_surface(voxels, method="crofton"),
        "section": gd.section(bed, z=0.01),
        "profile": gd.section_profile(bed, 5),
        "expected": gd.expected_section(bed),
        "view": view,
        "seen": gd.planform_table(view, bed),
        "photograph": gd.photograph(view, bed, lamp=0.05, texture=0.2, wet=True, noise=0.01, rng=1),
        "sunlit": gd.photograph(view, bed, light=(1.0, 0.0, 0.4), blur=1e-4, rng=1),
        "facets": standing,
        "areas": vector_areas(standing.corners),
    }
    return {name: digest(*plain(value)) for name, value in found.items()}


def everything(n):
    """Return a digest of all that is grown and measured from n seeds, by name."""
    return {**grown(n), **measured(n)}


def told(n):
    """Return what is measured of n seeds; apart from it two measures that are made of arctangents, as numbers."""
    bed = gd.carve(gd.tessellate(points.poisson(DOMAIN, n, rng=1), DOMAIN), keep="all")
    numbers = {"roundness": gd.roundness(bed).tolist(), "width": gd.mean_widths(bed).tolist()}
    return {"measured": {name: told for name, told in measured(n).items() if name != "expected"}, **numbers}


def interpreted(n):
    """Return what another process tells of n seeds that compiles no kernel, and takes items in disorder."""
    settings = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONSAFEPATH": ""}
    command = [sys.executable, __file__, str(n)]
    return json.loads(subprocess.run(command, env=settings, capture_output=True, text=True, check=True).stdout)


if __name__ == "__main__":
    with np.errstate(over="ignore"), shared_by(in_disorder):  # hashes overflow
        json.dump(told(int(sys.argv[1])), sys.stdout)
