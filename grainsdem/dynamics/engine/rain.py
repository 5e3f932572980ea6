"""Rain: grains that come down at a steady speed and fall from a height, one by one as they get there."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.dynamics.engine.contract import Engine

    Floats = NDArray[np.float64]

RAIN_SPEED = 1.0
"""Speed [√(g d)] at which rain comes down until it is let go: as after a fall of half a diameter."""

COLUMN = 1.0
"""Width [d] of the columns in which rain looks for the surface of the bed below."""


class Rain:
    """Grains that come down at a steady speed, each without weight until it is let go.

    Parameters
    ----------
    engine : Engine
        What moves; grains get their speed now.
    lower, upper : ndarray, shape (3,)
        Corners of the container [d].
    up : int
        Axis against gravity: those before it are level.
    drop_height : float, optional
        How far [d] above the bed below it a grain is let go. By default all are let go at half the container's height.
    """

    def __init__(
        self, engine: Engine, lower: Floats, upper: Floats, *, up: int, drop_height: float | None = None
    ) -> None:
        self._engine, self._lower, self._up, self._drop_height = engine, lower, up, drop_height
        self._middle = float(0.5 * (lower + upper)[up])
        level = (upper - lower)[:up]
        self._counts = np.maximum(np.floor(level / COLUMN), 1).astype(np.int64)
        self._width = level / self._counts
        self.let_go = np.full(engine.n_grains, np.nan)
        """Height [d] at which each grain was let go, shape (n,); NaN while it waits."""
        engine.set_velocities(np.tile(RAIN_SPEED * engine.gravity, (engine.n_grains, 1)))

    @property
    def is_over(self) -> bool:
        """Whether all grains have been let go."""
        return not np.isnan(self.let_go).any()

    def lasts(self) -> float:
        """Return the time [t] after which the last grain is let go at the latest."""
        lowest = self._middle if self._drop_height is None else float(self._lower[self._up])
        highest = float(self._engine.motion().positions[:, self._up].max())
        return (highest - lowest) / (RAIN_SPEED * -float(self._engine.gravity[self._up]))

    def fall(self) -> None:
        """Let go those grains that are low enough, and take the weight off the others."""
        motion = self._engine.motion()
        heights = motion.positions[:, self._up]
        waits = np.isnan(self.let_go)
        if self._drop_height is None:
            is_low = heights <= self._middle
        else:
            # What has met something and lost its speed is let go wherever it is.
            is_slow = np.linalg.norm(motion.velocities, axis=1) < 0.5 * RAIN_SPEED
            below = self._surface(motion.positions, ~waits & is_slow)
            is_low = is_slow | (heights - 0.5 <= below + self._drop_height)
        now = waits & is_low
        self.let_go[now] = heights[now]
        self._engine.hold_up(waits & ~is_low)

    def _surface(self, positions: Floats, has_landed: NDArray[np.bool_]) -> Floats:
        """Return how high [d] the bed is below each grain, shape (n,): mean top of its column and those beside it."""
        axes, n = self._up, len(positions)
        places = np.floor((positions[:, :axes] - self._lower[:axes]) / self._width).astype(np.int64)
        places = np.clip(places, 0, self._counts - 1)
        tops = np.full(self._counts, self._lower[axes])
        np.maximum.at(tops, tuple(places[has_landed].T), positions[has_landed, axes] + 0.5)
        total, seen = np.zeros(n), np.zeros(n)
        for step in product((-1, 0, 1), repeat=axes):
            beside = places + np.array(step)
            inside = ((beside >= 0) & (beside < self._counts)).all(axis=1)
            total[inside] += tops[tuple(beside[inside].T)]
            seen += inside
        return total / seen
