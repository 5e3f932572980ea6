"""Which tests run where, and packings that many of them share, each made once."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import HealthCheck, settings
from shaking import MOVING, shaking

from grainsdem.geometry.ahead import STEPS, compiled
from grainsdem.model import Domain, Packing, Polyhedra
from grainsdem.packing import carve, shrink, shuffle
from grainsdem.points import poisson
from grainsdem.tessellation import relax, tessellate

# The clock judges no test: a busy machine is not a failure.
settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("random", settings.get_profile("repeatable"), derandomize=False, print_blob=True)
settings.load_profile("repeatable")

NOT_BROUGHT = {"program", "environment"}
"""Fixtures of what `pip install ".[all,test]"` does not bring; what asks for one of them has the marker `programs`."""

MOST_WORKERS = 4
"""Processes that share the whole suite at most: each takes a gigabyte and compiles kernels of its own."""


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Share the whole suite out among processes, a file to each, unless `-n` says otherwise; a part runs in one."""
    # Processes that tests start from a checkout take the package that is tested, whose kernels are compiled, not the
    # sources in the folder where they start.
    os.environ["PYTHONSAFEPATH"] = "1"
    option = config.option
    is_whole = {Path(argument).resolve() for argument in config.args} == {Path(__file__).parent}
    is_free = config.pluginmanager.hasplugin("xdist") and not hasattr(config, "workerinput")
    if is_whole and is_free and option.numprocesses is None and not option.usepdb:
        workers = config.hook.pytest_xdist_auto_num_workers(config=config)
        option.numprocesses, option.dist = min(workers, MOST_WORKERS), "loadfile"


def pytest_sessionstart(session):
    """Compile all kernels at once before processes share the suite out: each of them would compile its own."""
    if not hasattr(session.config, "workerinput") and session.config.getoption("numprocesses", None):
        compiled(*STEPS)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Mark what needs other programs or environments, so that no test of them can forget to say so."""
    for item in items:
        if NOT_BROUGHT & set(item.fixturenames):
            item.add_marker("programs")
        item.user_properties += [("opens", mark.args) for mark in item.iter_markers("opens")]


def pytest_runtest_logreport(report):
    """Note which program opened which format, where `GRAINSDEM_LEDGER` says a file for it; see `format_table`."""
    ledger = os.environ.get("GRAINSDEM_LEDGER")
    if ledger and report.when == "call" and report.passed and "PYTEST_XDIST_WORKER" not in os.environ:
        with Path(ledger).open("a", encoding="utf-8") as file:
            file.writelines(f"{json.dumps(told)}\n" for name, told in report.user_properties if name == "opens")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport():
    return demanded((yield))


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report():
    return demanded((yield))


def demanded(report):
    """Return the report, as a failure where it skips and CI demands all clients: nothing skips unnoticed there."""
    is_skip = report.skipped and not hasattr(report, "wasxfail")
    if is_skip and os.environ.get("GRAINSDEM_CLIENTS") == "required":
        report.outcome, report.longrepr = "failed", f"GRAINSDEM_CLIENTS=required, but {report.longrepr}"
    return report


def pytest_addoption(parser):
    parser.addoption(
        "--shake",
        type=int,
        default=0,
        metavar="N",
        help="run each test of grains in motion N times more, every start moved by a billionth of a diameter",
    )


def pytest_generate_tests(metafunc):
    n = metafunc.config.getoption("shake")
    if n and metafunc.module.__name__.startswith(MOVING):
        metafunc.parametrize("shake", range(n + 1), indirect=True, scope="module")


@pytest.fixture(scope="module", autouse=True)
def shake(request):
    """The number of the shake under which a test runs, 0 for none; a fixture of wider scope that moves grains asks."""
    number = getattr(request, "param", 0)
    with shaking(number):
        yield number


@pytest.fixture(scope="session")
def program():
    """A function that returns the path of a client program."""

    def find(name, package):
        path = shutil.which(name)
        if path is None:
            pytest.skip(f"{name} is not installed: apt-get install {package}")
        return path

    return find


@pytest.fixture(scope="session")
def environment(request):
    """A function that returns the Python of an environment with packages that ours cannot have; a checkout keeps it."""

    def find(name, *packages):
        mark = hashlib.sha256(" ".join([sys.version, *packages]).encode()).hexdigest()[:12]
        folder = request.config.rootpath / ".environments" / f"{name}-{mark}"
        python, ready = folder / "bin" / "python", folder / "ready"
        commands = [
            [sys.executable, "-m", "venv", "--clear", folder],
            [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *packages],
        ]
        folder.parent.mkdir(exist_ok=True)
        # Of two processes one makes it, and the other waits.
        with FileLock(folder.with_suffix(".lock")):
            if not ready.is_file():
                try:
                    for command in commands:
                        subprocess.run(command, check=True, capture_output=True, text=True, timeout=1800)
                except (OSError, subprocess.SubprocessError) as error:
                    why = getattr(error, "stderr", None) or error
                    pytest.skip(f"an environment with {', '.join(packages)} cannot be made: {why}")
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
def physx(environment):
    """The Python of an environment with PhysX, as Omniverse ships it, for the processor."""
    return environment("physx", "ovphysx>=0.7", "physx-usd-schemas", "newton-usd-schemas>=0.6")


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


@pytest.fixture(params=["opengl", "painter"])
def backend(request, monkeypatch):
    """Draw by what works here, and as on a machine without any OpenGL."""
    if request.param == "painter":
        monkeypatch.setattr("grainsdem.figures.renders.find_window", lambda: None)
    return request.param


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
