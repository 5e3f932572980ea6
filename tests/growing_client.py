"""Grow beds of every process in whatever processor this Python is told to be, and say as JSON what bytes they have."""

from __future__ import annotations

import hashlib
import json
import sys
from dataclasses import replace

import numpy as np

import exporters
from grainsdem import points
from grainsdem.model import Domain, Grading
from grainsdem.packing import carve, infill, jitter_throats, shrink, shuffle
from grainsdem.tessellation import (
    Forms,
    Layer,
    Lens,
    graded_cells,
    layered_cells,
    mixed_cells,
    placed_cells,
    relax,
    sized_cells,
    tessellate,
)

DOMAIN = Domain.cube(0.02)
CURVE = Grading([0.5e-3, 1e-3, 2e-3], [0.0, 0.4, 1.0])
FORMS = Forms(elongation=0.7, flatness=0.7, orientation="aligned", spread=0.3, dip=0.3)
LAYERS = [Layer(CURVE), Layer(CURVE, lens=Lens((0.01, 0.01, 0.01), (0.007, 0.007, 0.005), dip=0.3))]
OTHERS = {"grains", "lammps", "yade", "sdf"}
"""Tables and formats with principal axes, which LAPACK finds with the processor's own last bit."""

FORMATS = tuple(name for name in exporters.FORMATS if name not in OTHERS)
OPTIONS = {"openfoam": {"region": "bed"}}


def digest(*arrays):
    found = hashlib.sha256()
    for array in arrays:
        found.update(array if isinstance(array, bytes) else np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def seeds(n):
    """Return the seeds of every process."""
    field = points.noise_field((16, 16, 16), 1.0, rng=3)
    image = np.add.outer(np.arange(24.0), np.arange(24.0)) % 7 / 6
    return {
        "poisson": lambda: points.poisson(DOMAIN, n, rng=1),
        "halton": lambda: points.halton(DOMAIN, n),
        "cluster": lambda: points.cluster_poisson(DOMAIN, n, spread=0.002, parents=10, rng=1),
        "strauss": lambda: points.strauss(DOMAIN, n, distance=0.002, inhibition=0.1, rng=1),
        "strauss_process": lambda: points.strauss_process(DOMAIN, n, distance=0.002, inhibition=0.1, sweeps=20, rng=1),
        "noise": lambda: points.pink_noise(DOMAIN, n, beta=1.0, resolution=16, rng=1),
        "noise_field": lambda: field,
        "density": lambda: points.from_density(DOMAIN, n, np.exp(field), rng=1),
        "image": lambda: points.from_image(DOMAIN, n, image, rng=1),
        "toned": lambda: points.pink_noise(DOMAIN, n, beta=1.0, resolution=16, gain=10.0, rng=1),
        "colour": lambda: points.from_image(DOMAIN, n, np.stack([image, image**2, 1 - image], axis=-1), rng=1),
        "smooth_image": lambda: points.from_image(DOMAIN, n, image, low_pass=0.1, rng=1),
    }


def grown(n):
    """Return a digest of everything that is grown from n seeds, by name."""
    found = {name: digest(draw()) for name, draw in seeds(n).items()}
    drawn = points.poisson(DOMAIN, n, rng=1)
    relaxed = tessellate(relax(drawn, DOMAIN, iterations=3), DOMAIN)
    weights, sizes = np.random.default_rng(2).uniform(0, 1e-6, n), np.random.default_rng(2).uniform(0.5, 1.5, n)
    pipe = Domain.cylinder(0.01, 0.02)
    prisms = tessellate(points.cluster_poisson(pipe, n, spread=2e-3, parents=9, walls="reflect", rng=1), pipe)
    bed = shrink(carve(relaxed), porosity=0.4)
    whole = shrink(carve(relaxed, keep="all"), porosity=0.4)
    jittered = jitter_throats(bed, fraction=0.3, rng=1)
    return {
        **found,
        "relaxed": digest(relaxed.cells.vertices, relaxed.neighbors),
        "laguerre": digest(tessellate(drawn, DOMAIN, weights=weights).cells.vertices),
        "sized": digest(sized_cells(DOMAIN, sizes, rng=1).cells.vertices),
        "graded": digest(graded_cells(DOMAIN, CURVE, n=4 * n, rng=1).cells.cells.vertices),
        "sieved": digest(graded_cells(DOMAIN, replace(CURVE, diameter="sieve"), n=4 * n, rng=1).cells.cells.vertices),
        "mixed": digest(mixed_cells(DOMAIN, FORMS, n=4 * n, curve=CURVE, rng=1).cells.cells.vertices),
        "lens": digest(layered_cells(DOMAIN, LAYERS, n=8 * n, keep="all", rng=1).cells.cells.vertices),
        "placed": digest(placed_cells(DOMAIN, lambda _x, _y, z: 1e-3 + z / 20, n=n, rng=1).cells.cells.vertices),
        "infill": digest(infill(whole, share=0.2, diameter=2e-3, rng=1).grains.vertices),
        "planar": digest(sized_cells(Domain.slab((0.02, 0.02), 1e-3), sizes, rng=1).cells.vertices),
        "shuffled": digest(shuffle(bed, rng=1).quaternions, shuffle(bed, rng=1).positions),
        "cylinder": digest(shrink(carve(prisms, keep="all"), porosity=0.5).grains.vertices),
        "shrunk": digest(bed.grains.vertices),
        "jittered": digest(jittered.positions),
        **{name: digest(*exporters.files(jittered, name, **OPTIONS.get(name, {})).values()) for name in FORMATS},
    }


def wide():
    """Return the names of the vectors that NumPy uses beyond what every processor has."""
    return np.show_config(mode="dicts")["SIMD Extensions"].get("found", [])


if __name__ == "__main__":
    json.dump({"wide": wide(), "grown": grown(int(sys.argv[1]))}, sys.stdout)
