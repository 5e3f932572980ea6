"""Which grains a part carries: those that hang together with it, and not with what they lay on."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from grainsdem.dynamics.mechanics import Snapshot


def carried(now: Snapshot, parts: Sequence[str], beside: Sequence[str] = ()) -> NDArray[np.bool_]:
    """Return which grains, shape (n,), hang together with some parts by contacts that bear, and not with the ground.

    Parameters
    ----------
    now : Snapshot
        The instant.
    parts : sequence of str
        Names of the parts that carry.
    beside : sequence of str
        Names of those that are no ground either, such as walls that grains lean against; all others are.
    """
    from scipy.sparse import coo_array  # noqa: PLC0415  (a third of a second)
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415  (the same)

    n = len(now.packing)
    mine, aside = (
        np.isin(now.pairs, [-1 - number for number, name in enumerate(now.parts) if name in names])
        for names in (parts, beside)
    )
    among = (now.pairs >= 0).all(axis=1)
    ends = now.pairs[among]
    _, piece = connected_components(
        coo_array((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n, n)), directed=False
    )
    is_held, is_bound = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    for side in (0, 1):  # parts are below grains, so they come first; either way is taken
        grains, others = now.pairs[:, side], now.pairs[:, 1 - side]
        touches = (grains >= 0) & (others < 0)
        is_held[piece[grains[touches & mine[:, 1 - side]]]] = True
        is_bound[piece[grains[touches & ~(mine | aside)[:, 1 - side]]]] = True
    result: NDArray[np.bool_] = (is_held & ~is_bound)[piece]
    return result
