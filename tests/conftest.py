"""Packings that many tests share, each made once."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink, shuffle
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate


@pytest.fixture(scope="session")
def program():
    """A function that returns the path of a client program; where CI demands them all, a missing one is a failure."""

    def find(name, package):
        path = shutil.which(name)
        if path is None:
            message = f"{name} is not installed: apt-get install {package}"
            if os.environ.get("GRAINSDEM_CLIENTS") == "required":
                pytest.fail(message)
            pytest.skip(message)
        return path

    return find


@pytest.fixture(scope="session")
def environment(request):
    """A function that returns the Python of an environment with packages that ours cannot have, made once a checkout.

    Where CI demands all clients, one that cannot be made is a failure.
    """

    def find(name, *packages):
        mark = hashlib.sha256(" ".join(packages).encode()).hexdigest()[:12]
        folder = request.config.cache.mkdir(f"environment-{name}-{mark}")
        python, ready = folder / "bin" / "python", folder / "ready"
        if not ready.is_file():
            commands = [
                [sys.executable, "-m", "venv", "--clear", folder],
                [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages],
            ]
            try:
                for command in commands:
                    subprocess.run(command, check=True, capture_output=True, text=True, timeout=600)
            except (OSError, subprocess.SubprocessError) as error:
                message = f"an environment with {', '.join(packages)} cannot be made: {getattr(error, 'stderr', error)}"
                if os.environ.get("GRAINSDEM_CLIENTS") == "required":
                    pytest.fail(message)
                pytest.skip(message)
            ready.touch()
        return str(python)

    return find


@pytest.fixture(scope="session")
def newton(environment):
    """The Python of an environment with Newton, the MuJoCo 3.17 that it pins, and NVIDIA's asset validator."""
    return environment(
        "newton", "newton[sim]", "newton-usd-schemas>=0.6", "scipy", "usd-core<26.9", "omniverse-asset-validator"
    )


@pytest.fixture(scope="session")
def cells():
    """A relaxed Poisson-Voronoi tessellation of 250 cells in a box of millimetres."""
    domain = Domain.box((6e-3, 6e-3, 7e-3))
    return tessellate(relax(poisson(domain, 250, rng=11), domain, iterations=2), domain)


@pytest.fixture(scope="session")
def fresh(cells):
    """The grains of those cells inside the walls, shrunk to a porosity of 0.4."""
    return shrink(carve(cells), porosity=0.4)


@pytest.fixture(scope="session")
def poured(fresh):
    """The same grains rotated, reordered and lifted apart."""
    return shuffle(fresh, rng=5)


@pytest.fixture(scope="session")
def cube():
    """One cube of edge 2, as a packing in a box of edge 4 whose floor it does not touch."""
    return cube_packing([[2.0, 2.0, 2.0]], domain=Domain.cube(4.0))


def cube_packing(positions, *, half=1.0, domain=None, density=1.0):
    """Return equal cubes at the given positions, with axes along the world's."""
    positions = np.atleast_2d(np.asarray(positions, float))
    n = len(positions)
    corners = half * np.array([[x, y, z] for z in (-1, 1) for y in (-1, 1) for x in (-1, 1)], float)
    faces = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    shapes = Polyhedra(
        np.tile(corners, (n, 1)),
        8 * np.arange(n + 1),
        6 * np.arange(n + 1),
        np.tile(faces.ravel(), n),
        4 * np.arange(6 * n + 1),
    )
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    return Packing(shapes, positions, quaternions, np.full(n, density), domain or Domain.cube(10.0))
