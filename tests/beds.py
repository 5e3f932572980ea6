"""Beds for tests of client programs: one that slow programs can step, and two grains whose numbers are round."""

from functools import cache
from pathlib import Path

import numpy as np
from solids import place, polyhedra

import exporters
from exporters.check import shapes_of
from exporters.mjcf import units
from grainsdem.model import Domain, Packing
from grainsdem.packing import carve, rescale, shrink
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

SIZES = [0.2e-3, 1e-3, 0.1]
"""Median diameters [m] that every program is tried with."""

GOLDEN = Path(__file__).parent / "golden"


@cache
def small_bed(diameter):
    """Return a fresh bed of 15 grains, a few hundredths of a diameter apart, of a given median diameter."""
    domain = Domain.box((3e-3, 3e-3, 3.5e-3))
    bed = shrink(carve(tessellate(relax(poisson(domain, 90, rng=11), domain, iterations=2), domain)), porosity=0.4)
    return rescale(bed, diameter / units(bed).length)


def two_grains():
    """Return a brick of 2 x 4 x 6 mm, and above it a bipyramid that is turned by a right angle about z."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
    tips = np.concatenate([np.diag([2.0, 3.0, 4.0]), -np.diag([2.0, 3.0, 4.0])])
    shapes = polyhedra(signs * [1e-3, 2e-3, 3e-3], tips * 1e-3)
    turns = np.array([[1.0, 0, 0, 0], [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]])
    places = np.array([[4.0, 4.0, 4.0], [4.0, 4.0, 12.0]]) * 1e-3
    return place(shapes, places, quaternions=turns, domain=Domain.box((8e-3, 8e-3, 16e-3)), density=2500.0)


def written(packing, path, **options):
    """Write a packing to a path and return the folder."""
    exporters.write(packing, path, **options)
    return path.parent


def check_golden(packing, format_, *names):
    """Assert that the files of a format are those that are kept, byte by byte."""
    made = exporters.files(packing, format_, name="two")
    for name in names:
        # What is Python for another program is kept as text: nothing here is to read it.
        kept = GOLDEN / name.replace(".py", ".py.txt")
        assert made[name].decode() == kept.read_text(), f"{name} is not what it was"
    return made


def some(packing, n):
    """Return the first grains of a packing."""
    parts = packing.positions[:n], packing.quaternions[:n], packing.densities[:n]
    return Packing(shapes_of(packing.grains, 0, n), *parts, packing.domain)
