"""How a bed at rest gets stiffer contacts: under little of its weight, and between smooth walls.

Stiffer contacts push out what overlaps, and so lift a bed. Its grains slip upward along the walls, whose friction turns
round and pushes the bed down: walls that bore a part of a bed's weight hold down what contacts would push out, and the
floor of a deep bed is pressed with many times its weight. Between smooth walls nothing holds it down. Once they have
their friction again the bed sinks under the weight that is still to come, and they bear a part of it as before.
"""

from __future__ import annotations

import numpy as np

LEAST_WEIGHT = 0.1
"""Share of its weight under which the contacts of a bed get stiffer; under more, what they push out makes it hop."""

ROUGH_WEIGHT = 0.95
"""Share of its weight that is back when walls get their friction again. The last twentieth makes a bed sink so far that
they bear of it what they bear of one that was poured with the finer step; half of it, half as much again."""

UNLOADING = 1.0
"""Time [t] in which weight is taken off."""

LIFTING = 1.0
"""Time [t] that stiffer contacts have to push out what overlaps."""

LOADING = 3.0
"""Time [t] in which weight is put back."""


def weight_share(since: float) -> float:
    """Return the share of its weight that is left on a bed so long [t] after it began to be taken off.

    Examples
    --------
    >>> [round(weight_share(time), 3) for time in (0.0, 0.5, 1.0, 2.0, 3.5, 5.0)]
    [1.0, 0.55, 0.1, 0.1, 0.55, 1.0]
    """
    times = np.cumsum([0.0, UNLOADING, LIFTING, LOADING])
    return float(np.interp(since, times, [1.0, LEAST_WEIGHT, LEAST_WEIGHT, 1.0]))


def are_walls_smooth(since: float) -> bool:
    """Return whether walls are without friction so long [t] after a bed's weight began to be taken off.

    Examples
    --------
    >>> [are_walls_smooth(time) for time in (0.0, 2.0, 3.0, 4.0)]
    [True, True, True, False]
    """
    return since < UNLOADING + LIFTING or weight_share(since) < ROUGH_WEIGHT
