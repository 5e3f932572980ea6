"""How far chance alone may move what grains in motion end up as: the tolerances of tests that judge it.

Where a chaotic run ends is a draw. m runs that were made once, with other seeds, told its spread s (their sample
standard deviation) and, where no law gives it, its mean. The mean of n new runs then differs from theirs by a draw of
Student's distribution with m − 1 degrees of freedom times s √(1/n + 1/m), where single runs are normal: their interval
of prediction. A tolerance is that distribution's quantile at the rate of false alarms that one can live with. For one
run it is 4.3 spreads where m is large, 5.8 for m = 20 and 8.5 for m = 10: a spread that is known badly does no harm.

Where a test asks only which of two means is larger, its comment tells the means, their spreads, and by how many spreads
of the mean of so many runs they differ: seven are as good as never, five by a normal distribution once in 3e6.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t

FALSE_ALARMS = 2e-5
"""How often a test fails although its law holds, of all processors and versions that it may ever run on."""


def margin(spread, *, measured, runs=1, rate=FALSE_ALARMS):
    """Return how far the mean of ``runs`` may lie from that of ``measured`` others, to either side."""
    return spread * float(t.ppf(1 - rate / 2, measured - 1) * np.sqrt(1 / runs + 1 / measured))
