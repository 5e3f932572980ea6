"""Halton's sequence: deterministic seeds that fill space evenly.

References
----------
.. [1] J. H. Halton, "On the efficiency of certain quasi-random sequences of points in evaluating
   multi-dimensional integrals", Numerische Mathematik 2 (1960) 84-90.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, shown
from grainsdem.gate import gated
from grainsdem.points.poisson import check_count, place

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from grainsdem.model import Domain


@gated
def halton(
    domain: Domain,
    n: int,
    *,
    bases: Sequence[int] = (2, 3, 5),
    start: int = 1,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    """Return ``n`` points of Halton's sequence in the domain.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie.
    n : int
        Number of seeds, at least 1.
    bases : sequence of int
        One base for each axis, at least 2 and without a common factor; primes as a rule. In a planar domain two will
        do, and a third goes unused.
    start : int
        Index of the first point; 0 is the corner of the domain.
    rng : numpy.random.Generator, int or None
        Where given, shifts the whole sequence by one random vector, wrapping at the walls (Cranley and Patterson
        1976), so that different seeds give different beds of the same evenness. Without it the points are Halton's
        own.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    InputError
        If ``n`` is below 1, ``start`` below 0, or the bases are not a coprime number above 1 for each axis.
    """
    check_count(n)
    if not 0 <= start < 2**62:
        raise InputError(f"start must be 0 or more, below 2^62; got {shown(start)}")
    if (
        len(bases) not in ((2, 3) if domain.is_planar else (3,))
        or not 2 <= min(bases) <= max(bases) < 2**62
        or math.lcm(*bases) != math.prod(bases)
    ):
        allowed = "two or three" if domain.is_planar else "three"
        raise InputError(
            f"bases must be {allowed} whole numbers above 1, below 2^62, without a common factor; "
            f"got {shown(tuple(bases))}"
        )
    shift = None if rng is None else np.random.default_rng(rng).random(len(bases))
    kept: list[NDArray[np.float64]] = []
    # One pass fills a box; where planes cut it, the sequence goes on until enough of it lies inside.
    while sum(map(len, kept)) < n:
        index = np.arange(start, start + n, dtype=np.int64)
        unit = np.stack([_radical_inverse(index, base) for base in bases], axis=1)
        if shift is not None:
            unit = np.mod(unit + shift, 1.0)
        points = place(unit, domain)
        kept.append(points[domain.contains(points)] if len(domain.planes) else points)
        start += n
    return np.concatenate(kept)[:n]


def _radical_inverse(index: NDArray[np.int64], base: int) -> NDArray[np.float64]:
    """Mirror the digits of each index about the point: φ(Σ a_k bᵏ) = Σ a_k b^(−k−1)."""
    result = np.zeros(len(index))
    rest = index.copy()
    weight = 1.0 / base
    while rest.any():
        rest, digit = np.divmod(rest, base)
        result += digit * weight
        weight /= base
    return result
