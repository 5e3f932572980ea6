"""Strauss's process, in which points keep others away: as a rule for points that arrive in turn, and as the process.

References
----------
.. [1] D. J. Strauss, "A model for clustering", Biometrika 62 (1975) 467-475.
.. [2] B. D. Ripley, "Spatial Statistics", Wiley (1981).
.. [3] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001.
.. [4] C. J. Geyer and J. Møller, "Simulation procedures and likelihood inference for spatial point processes",
   Scand. J. Stat. 21 (1994) 359-373.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import InputError, shown
from grainsdem.gate import gated
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.points.poisson import check_count, uniform

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain

BATCH = 65_536
"""Candidates drawn at once, at most: what is drawn depends on nothing but the numbers asked for."""

MOST_STEPS = 10**11
"""Steps of a chain: some million are taken in a second."""

LEAST_BATCH = 1024
"""Candidates drawn at once, at least."""

LEAST_PATIENCE = 100_000
"""Candidates refused in a row, at least, before a domain counts as full; or 100 for each point, where that is more."""

MOST_CANDIDATES = 50_000_000
"""Candidates in all, and 500 more for each point: near a full domain each point takes longer than those before it."""


@gated
def strauss(
    domain: Domain, n: int, *, distance: float, inhibition: float, rng: np.random.Generator | int | None = None
) -> NDArray[np.float64]:
    """Return points that arrived one after another, each accepted with chance c^b among b points nearer than δ.

    This is the rule of [3]_; it is not Strauss's process, in which all points are alike (`strauss_process`).

    Parameters
    ----------
    domain : Domain
        Where the seeds lie.
    n : int
        Number of seeds, at least 1.
    distance : float
        δ [m], within which points keep others away; across walls that wrap, too.
    inhibition : float
        c in [0, 1]: at 0 no two points are nearer than δ, at 1 they do not heed one another.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    InputError
        If a number is out of range, or so many points do not fit: max(100 000, 100 n) candidates in a row were refused,
        or 5·10⁷ and 500 n more were tried. The message says how many fit.
    """
    from grainsdem.geometry.inhibition.grid import make_grid  # noqa: PLC0415  (numba: half a second)
    from grainsdem.geometry.inhibition.sequential import admit  # noqa: PLC0415  (the same)

    check_count(n)
    _check_rule(distance, inhibition)
    generator = np.random.default_rng(rng)
    grid = make_grid(domain, distance, n)
    points, links = np.empty((n, 3)), np.empty(n, dtype=np.int64)
    patience = max(LEAST_PATIENCE, 100 * n)
    placed, refused, tried = 0, 0, 0
    while placed < n:
        # As many as are missing, until refusals ask for more.
        size = min(BATCH, max(LEAST_BATCH, n - placed, refused))
        candidates = uniform(domain, size, generator)
        most = _most_near(generator.random(size), inhibition)
        placed, refused = admit(grid, links, points, placed, candidates, most, refused, patience)
        tried += size
        if placed < n and (refused >= patience or tried >= MOST_CANDIDATES + 500 * n):
            why = f"{refused} candidates in a row were" if refused >= patience else f"{tried - placed} candidates were"
            raise InputError(
                f"only {placed} of {n} points fit at a distance of {distance} m and an inhibition of {inhibition}: "
                f"{why} refused; ask for fewer, or for a smaller distance"
            )
    return points


@gated
def strauss_process(
    domain: Domain,
    n: int | None = None,
    *,
    distance: float,
    inhibition: float,
    intensity: float | None = None,
    sweeps: int = 100,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    r"""Return a pattern of Strauss's process, drawn by a Markov chain of births and deaths.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie.
    n : int, optional
        Number of seeds, exactly: the process given its count. Each death is then followed by a birth.
    distance, inhibition : float
        δ [m] and c as for `strauss`.
    intensity : float, optional
        Points [1/m³], in a planar domain [1/m²], where none keeps any away: β. Instead of ``n``; the count is then
        left to chance, and there may be no point at all.
    sweeps : int
        Steps of the chain for each of the ``n`` points, or of the points that β would give. Where δ is near the mean
        spacing of the points and c is below 0.1, several hundred are needed.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    InputError
        If a number is out of range, both or neither of ``n`` and ``intensity`` are given, or c = 0 and ``n`` points
        do not fit as `strauss` places them.

    Notes
    -----
    The density of a pattern of n points, of which s pairs are nearer than δ, is proportional to

    .. math:: β^n c^s

    against a Poisson process of intensity 1 [1]_. The chain is that of Geyer and Møller [4]_: a birth at a uniform
    place is accepted with chance min(1, β V c^b / (n + 1)), the death of one of n points with chance
    min(1, n / (β V c^b)), where b points are nearer than δ to the one that comes or goes. It starts from points that do
    not heed one another; at c = 0 with ``n`` given from those of `strauss`.
    """
    _check_rule(distance, inhibition)
    if (n is None) == (intensity is None):
        raise InputError(f"Strauss's process takes either n or an intensity; got n = {n}, intensity = {intensity}")
    if sweeps < 1:
        raise InputError(f"sweeps must be 1 or more; got {shown(sweeps)}")
    generator = np.random.default_rng(rng)
    rule = _Rule(float(distance), float(inhibition), int(sweeps))
    if n is None:
        return _with_intensity(domain, intensity or 0.0, rule, generator)
    check_count(n)
    if inhibition == 0:
        start = strauss(domain, n, distance=distance, inhibition=0.0, rng=generator)
    else:
        start = uniform(domain, n, generator)
    return _with_count(domain, start, rule, generator)


class _Rule(NamedTuple):
    """What a chain goes by: δ [m], c, and steps for each point."""

    distance: float
    c: float
    sweeps: int


def _with_count(
    domain: Domain, points: NDArray[np.float64], rule: _Rule, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return the state of the chain of moves after so many sweeps from the given points."""
    from grainsdem.geometry.inhibition.chains import fill, move  # noqa: PLC0415  (numba: half a second)
    from grainsdem.geometry.inhibition.grid import make_grid  # noqa: PLC0415  (the same)

    n = len(points)
    grid, links = make_grid(domain, rule.distance, n), np.empty(n, dtype=np.int64)
    fill(grid, links, points, n)
    for size in _batches(rule.sweeps * n):
        candidates = uniform(domain, size, generator)
        picks, chances = generator.random((2, size))
        move(grid, links, points, candidates, picks, chances, rule.c)
    return points


def _with_intensity(
    domain: Domain, intensity: float, rule: _Rule, generator: np.random.Generator
) -> NDArray[np.float64]:
    """Return the state of the chain of births and deaths after so many sweeps from no points."""
    from grainsdem.geometry.inhibition.chains import bear_and_bury  # noqa: PLC0415  (numba: half a second)
    from grainsdem.geometry.inhibition.grid import make_grid  # noqa: PLC0415  (the same)

    if not (np.isfinite(intensity) and intensity > 0):
        raise InputError(f"the intensity must be finite and above 0; got {intensity}")
    activity = intensity * domain.volume / (domain.lengths[2] if domain.is_planar else 1.0)
    allow_memory(activity, A_SEED, "seeds")
    grid = make_grid(domain, rule.distance, int(activity))
    points, links, n = np.empty((0, 3)), np.empty(0, dtype=np.int64), 0
    for size in _batches(rule.sweeps * max(1, int(np.ceil(activity)))):
        candidates = uniform(domain, size, generator)
        kinds, picks, chances = generator.random((3, size))
        points, links = _with_room(points, n + size), _with_room(links, n + size)
        n = bear_and_bury(grid, links, points, n, candidates, kinds, picks, chances, float(activity), rule.c)
    return points[:n].copy()


def _check_rule(distance: float, inhibition: float) -> None:
    if not (np.isfinite(distance) and distance > 0):
        raise InputError(f"distance must be a finite length above 0 m; got {distance}")
    if not 0 <= inhibition <= 1:
        raise InputError(f"inhibition must be between 0, none within the distance, and 1, all; got {inhibition}")


def _most_near(chances: NDArray[np.float64], c: float) -> NDArray[np.int64]:
    """Return the most points b near each candidate with which it is accepted: the largest with chance < c^b."""
    everything = np.iinfo(np.int64).max
    if c in (0, 1):
        return np.full(len(chances), everything if c == 1 else 0)
    # A chance of exactly 0 is below any power; the least above it gives 700 at c = 0.95, so 2⁵³ is as good as all.
    logs = np.log(np.maximum(chances, np.finfo(np.float64).tiny)) / np.log(c)
    return np.asarray(np.clip(np.ceil(logs) - 1, 0.0, 2.0**53), dtype=np.int64)


def _batches(steps: int) -> list[int]:
    """Return how many steps are taken at once, in turn, or raise `InputError` where they would take days."""
    if steps > MOST_STEPS:
        raise InputError(
            f"a chain of at most {MOST_STEPS:.0e} steps, a day of work, is followed; these are {steps:.3g}"
        )
    return [min(BATCH, steps - done) for done in range(0, steps, BATCH)]


def _with_room(array: NDArray[Any], n: int) -> NDArray[Any]:
    """Return the array with at least ``n`` rows, those of its own first."""
    if len(array) >= n:
        return array
    larger = np.empty((2 * n, *array.shape[1:]), dtype=array.dtype)
    larger[: len(array)] = array
    return larger
