"""Starts moved by a billionth of a diameter, with `pytest --shake N`: what still holds hangs on no last bit.

Grains in motion are chaotic. On another processor the last bit of a sum differs, and a hundred collisions later every
grain lies elsewhere; a test that holds on one machine only says nothing of the material. `--shake N` runs each test of
grains in motion N times more, each time with every grain's start moved. The move goes into the text that an engine
loads, the one gate through which grains come to it: the program knows nothing of it.
"""

from __future__ import annotations

import subprocess
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from exporters import mjcf
from grainsdem import workers
from grainsdem.dynamics import scene

MOVE = 1e-9
"""How far each coordinate of a start is moved, up or down [d]: the last digit that the text of a model has."""

MOVING = (
    "test_dynamics",
    "test_figures_surroundings",
    "test_chain",
    "test_cli_experiments",
    "test_recipe_experiments",
    "test_recipe_replays",
)
"""How the names of those modules begin that are shaken."""


def shaken(packing, number):
    """Return the packing with every coordinate that can change moved up or down; the same number moves it the same."""
    signs = np.random.default_rng([number, len(packing)]).choice([-1.0, 1.0], packing.positions.shape)
    if packing.domain.is_planar:
        signs[:, 2] = 0.0
    return replace(packing, positions=packing.positions + MOVE * mjcf.units(packing).length * signs)


@contextmanager
def shaking(number):
    """Move every start while the block lasts, in this process and in those that `grainsdem.workers` begins."""
    if not number:
        yield
        return
    before = scene.mjcf, workers.subprocess
    begin(number)
    try:
        yield
    finally:
        scene.mjcf, workers.subprocess = before


def begin(number):
    """Move every start from now on; what a child process is told to do first (`child_code`)."""

    def text(packing, *args, **options):
        return mjcf.text(shaken(packing, number), *args, **options)

    def start(args, **options):
        code = child_code(number) + "from grainsdem.workers import serve; serve()"
        return subprocess.Popen([args[0], "-P", "-c", code], **options)

    scene.mjcf = SimpleNamespace(**{**vars(mjcf), "text": text})
    workers.subprocess = SimpleNamespace(**{**vars(subprocess), "Popen": start})


def child_code(number):
    """Return the Python with which a child process begins, so that it moves starts as its parent does."""
    if not number:
        return ""
    return f"import sys; sys.path.append({str(Path(__file__).parent)!r}); import shaking; shaking.begin({number}); "
