"""Poisson point process: seeds at random, independent of one another."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, shown
from grainsdem.gate import gated
from grainsdem.memory import A_SEED, allow_memory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain


@gated
def poisson(
    domain: Domain, n: int, *, exact: bool = True, rng: np.random.Generator | int | None = None
) -> NDArray[np.float64]:
    """Return seeds that are independent and uniform in the domain.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie.
    n : int
        Number of seeds, at least 1.
    exact : bool
        Whether there are exactly ``n`` (the binomial process), or ``n`` on the average, as in Poisson's own process.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    InputError
        If ``n`` is below 1.
    """
    check_count(n)
    generator = np.random.default_rng(rng)
    if not exact:
        n = int(generator.poisson(n))
    return uniform(domain, n, generator)


def uniform(domain: Domain, n: int, generator: np.random.Generator) -> NDArray[np.float64]:
    """Return ``n`` points [m], shape (n, 3), independent and uniform in the domain; none is allowed."""
    points = place(generator.random((n, 3)), domain)
    if not len(domain.planes):
        return points
    # In the box first, then those that the planes keep: uniform in what is left of it.
    kept = [points[domain.contains(points)]]
    while sum(map(len, kept)) < n:
        points = place(generator.random((n, 3)), domain)
        kept.append(points[domain.contains(points)])
    return np.concatenate(kept)[:n]


def check_count(n: int) -> None:
    """Raise `InputError` unless ``n`` is a count of at least one, and of no more seeds than there is memory for."""
    if n < 1:
        raise InputError(f"the number of seeds must be 1 or more; got {shown(n)}")
    allow_memory(n, A_SEED, "seeds")


def place(unit: NDArray[np.float64], domain: Domain) -> NDArray[np.float64]:
    """Return points of the unit cube, shape (n, 3), stretched to the domain; to its mid-plane where it is planar."""
    if domain.is_planar:
        unit = np.column_stack([unit[:, :2], np.full(len(unit), 0.5)])
    return domain.lower + unit * domain.lengths
