"""What the files that show or move a bed share: its container, and the colours of its grains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.rotations import from_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain, Packing

GRAIN_COLOURS = {
    "quartz": (0.87, 0.80, 0.66),
    "amber": (0.83, 0.65, 0.40),
    "feldspar": (0.85, 0.62, 0.50),
    "flint": (0.55, 0.50, 0.45),
    "chalk": (0.93, 0.90, 0.83),
    "slate": (0.62, 0.63, 0.62),
}
"""Colours of minerals, linear red, green and blue from 0 to 1."""


def shades(n_grains: int) -> NDArray[np.int64]:
    """Return which of the colours each grain has, shape (n,): all as often, near numbers apart."""
    # Multiples of the golden ratio spread evenly over any number of colours.
    turns = np.arange(n_grains) * 0.6180339887498949 % 1.0
    return (turns * len(GRAIN_COLOURS)).astype(np.int64)


def container_box(packing: Packing, vertices: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners [m] of the container around vertices in the world.

    Along a periodic axis, where cells reach over the boundary, it is as wide as the grains; else it is the
    domain.
    """
    domain = packing.domain
    lower = np.where(domain.periodic, np.minimum(domain.lower, vertices.min(axis=0)), domain.lower)
    upper = np.where(domain.periodic, np.maximum(domain.upper, vertices.max(axis=0)), domain.upper)
    return lower, upper


def plane_frames(domain: Domain) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a point [m] on each of the domain's planes, shape (k, 3), and rotations that turn z inward, shape (k, 4).

    The point is that nearest to the middle of the box; the x axis of each frame is level.
    """
    normals, distances = domain.planes[:, :3], domain.planes[:, 3]
    middle = (domain.lower + domain.upper) / 2
    points = middle + (distances - normals @ middle)[:, None] * normals
    level = np.cross([0.0, 0.0, 1.0], -normals)
    # A plane that is level itself has no level direction of its own.
    level = np.where(np.linalg.norm(level, axis=1, keepdims=True) > 1e-9, level, [1.0, 0.0, 0.0])
    level /= np.linalg.norm(level, axis=1, keepdims=True)
    axes = np.stack([level, np.cross(-normals, level), -normals], axis=2)
    return points, from_matrices(axes)
