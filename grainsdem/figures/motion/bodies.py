"""What is around the grains in the pictures of an animation: its bodies where they were, and gravity downward."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.figures.scene import Scene
    from grainsdem.model import Surroundings

    Floats = NDArray[np.float64]

BEYOND = 0.15
"""How far bodies are followed away from the grains, relative to the longest side of what is drawn: walls may be wider
than need be."""

STRAIGHT = 1e-6
"""Difference of two directions below which gravity has not turned."""


def surrounded(scenes: list[Scene], around: Surroundings, chosen: NDArray[np.int64]) -> list[Scene]:
    """Return the scenes of pictures with what was around the grains in their frames.

    Parameters
    ----------
    scenes : list of Scene
        All with room for the same box, which is enlarged for the bodies.
    around : Surroundings
        What was recorded.
    chosen : ndarray of int, shape (n,)
        Which frame of it each scene shows.
    """
    first = scenes[0]
    bodies = {k: _bodies(around, k) for k in np.unique(chosen).tolist()}
    lower, upper = _room(first, [body for shown in bodies.values() for body in shown])
    ups = {k: _up(first, around.gravity[k]) for k in bodies}
    is_turning = any(np.abs(up - first.up).max() > STRAIGHT for up in ups.values())
    return [
        scene._replace(
            lower=lower,
            upper=upper,
            bodies=tuple((body.corners, body.triangles) for body in bodies[k]),
            up=ups[k],
            is_turning=is_turning,
        )
        for scene, k in zip(scenes, chosen.tolist(), strict=True)
    ]


class _Body(NamedTuple):
    """A body in one frame: its number, corners [m] and triangles."""

    number: int
    corners: Floats
    triangles: NDArray[np.int32]


def _bodies(around: Surroundings, frame: int) -> list[_Body]:
    """Return the bodies that are there in a frame."""
    found = []
    for number in np.flatnonzero(np.isfinite(around.positions[frame, :, 0])).tolist():
        mine = np.flatnonzero(around.vertex_bodies == number)
        turn = to_matrices(around.quaternions[frame, number][None])[0]
        triangles = around.triangles[around.vertex_bodies[around.triangles[:, 0]] == number]
        corners = around.vertices[mine] @ turn.T + around.positions[frame, number]
        found.append(_Body(number, corners, np.searchsorted(mine, triangles).astype(np.int32)))
    return found


def _room(scene: Scene, bodies: list[_Body]) -> tuple[Floats, Floats]:
    """Return the corners of what a picture has room for: bodies that go all around are whole, of others a part."""
    margin = BEYOND * float((scene.upper - scene.lower).max())
    lower, upper = scene.lower.copy(), scene.upper.copy()
    for number in {body.number for body in bodies}:
        corners = np.concatenate([body.corners for body in bodies if body.number == number])
        low, high = corners.min(axis=0), corners.max(axis=0)
        if not ((low <= scene.lower).all() and (high >= scene.upper).all()):
            low, high = (np.clip(edge, scene.lower - margin, scene.upper + margin) for edge in (low, high))
        lower, upper = np.minimum(lower, low), np.maximum(upper, high)
    return lower, upper


def _up(scene: Scene, gravity: Floats) -> Floats:
    """Return what is up in a picture: against gravity, where there is any."""
    return -gravity if gravity.any() else scene.up
