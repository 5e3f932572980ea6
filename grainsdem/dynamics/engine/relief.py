"""How much of its weight is left on a bed at rest while its contacts get stiffer."""

from __future__ import annotations

import numpy as np

LEAST_WEIGHT = 0.25
"""Share s of its weight under which contacts get stiffer, by four with half the step: the overlap that they push out
then, 3/4 s of what there was, is what the bed sinks by when the rest of its weight comes back, (1 − s)/4. Under a tenth
it sinks farther, and walls bear more than of a bed that was poured; from a half on they push it down."""

UNLOADING = 1.0
"""Time [t] in which the rest is taken off: suddenly, the bed would hop."""

LOADING = 3.0
"""Time [t] in which it is put back."""


def weight_share(since: float) -> float:
    """Return the share of its weight that is left on a bed so long [t] after it began to be taken off.

    Notes
    -----
    Stiffer contacts push out what overlaps, and lift a bed that lies under its weight. Its grains slip upward along the
    walls, whose friction turns round: walls that bore a part of the weight push the bed down. Under little weight there
    is little to push out, and the bed sinks again on its stiffer contacts when it is loaded.

    Examples
    --------
    >>> [round(weight_share(time), 3) for time in (0.0, 0.5, 1.0, 2.5, 4.0)]
    [1.0, 0.625, 0.25, 0.625, 1.0]
    """
    return float(np.interp(since, [0.0, UNLOADING, UNLOADING + LOADING], [1.0, LEAST_WEIGHT, 1.0]))
