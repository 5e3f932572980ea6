"""Cluster processes: children scattered about parents, of which only the children are seeds.

References
----------
.. [1] M. Thomas, "A generalization of Poisson's binomial limit for use in ecology", Biometrika 36 (1949) 18-25.
.. [2] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.points.poisson import check_count, uniform

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

Walls = Literal["clip", "reflect", "periodic"]

MOST_BOUNCES = 1000
"""Reflections at planes that a child may take: in a wedge they end after π/angle, so only absurd spreads reach it."""

LEAST_ROUND = 1024
"""Children drawn at once, at least, so that few that are missing do not take many rounds."""

MOST_TRIES = 1_000_000
"""Children in a row that fall outside the domain, after which none is expected to fall inside."""


@gated
def cluster_poisson(
    domain: Domain,
    n: int | None = None,
    *,
    spread: float,
    parents: int | ArrayLike | None = None,
    children: float | None = None,
    walls: Walls = "clip",
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    r"""Return the children of parents that are uniform in the domain, or where you put them.

    Of ``n``, ``parents`` and ``children`` give two: parents and children leave the count to chance, with a mean of
    parents times children where no wall takes any; ``n`` is reached exactly.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie.
    n : int, optional
        Number of seeds, exactly.
    spread : float
        Standard deviation [m] of a child's distance from its parent along each axis: σ, where the paper gives σ².
    parents : int or array_like, shape (m, 3) or (m, 2)
        Number of parents, or their positions [m], also outside the domain; shape (m, 2) where the domain is planar.
    children : float, optional
        Mean number of children of a parent, λ; each parent's is a Poisson number.
    walls : {"clip", "reflect", "periodic"}
        Whether children beyond a wall are lost, thrown back, or enter on the other side. Periodic axes always wrap.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar. There may be none where the count is left to
        chance.

    Raises
    ------
    InputError
        If the three numbers are not two, one is out of range, ``walls`` is periodic in a domain with planes, or the
        children do not reach the domain.
    ShapeError
        If the parents' positions are of another shape.

    Notes
    -----
    Given their sum, Poisson numbers of children are as if every child had chosen its parent with equal chance; that is
    how ``n`` is reached. With parents of Poisson number κ a volume, all of it periodic, this is Thomas's process [1]_,

    .. math:: g(r) = 1 + \exp(-r^2 / 4σ^2) / (κ (4πσ^2)^{d/2})

    in d dimensions; with m parents exactly, 1 - 1/m stands for 1.

    Examples
    --------
    >>> from grainsdem.model import Domain
    >>> len(cluster_poisson(Domain.cube(), 500, parents=20, spread=0.05, rng=1))
    500
    """
    generator = np.random.default_rng(rng)
    _check_numbers(n, parents, children)
    _check_scatter(domain, spread, walls)
    if parents is None:
        parents = max(1, round((n or 0) / (children or 1.0)))
    if isinstance(parents, int | np.integer):
        where = uniform(domain, int(parents), generator)
    else:
        where = _placed(parents, domain)
    if n is None:
        counts = generator.poisson(children or 0.0, len(where))
        points = _scatter(np.repeat(where, counts, axis=0), domain, spread, generator)
        return _kept(points, domain, walls)
    found: list[NDArray[np.float64]] = []
    missing, tries = n, 0
    while missing > 0:
        chosen = where[generator.integers(len(where), size=max(missing, LEAST_ROUND))]
        found.append(_kept(_scatter(chosen, domain, spread, generator), domain, walls)[:missing])
        missing -= len(found[-1])
        tries = 0 if len(found[-1]) else tries + len(chosen)
        if tries >= MOST_TRIES:
            raise InputError(
                f"children at a spread of {spread} m do not reach the domain: none of the last {tries} did; "
                f"put parents nearer to it, or let walls reflect"
            )
    return np.concatenate(found)


def _check_numbers(n: int | None, parents: int | ArrayLike | None, children: float | None) -> None:
    if sum(value is not None for value in (n, parents, children)) != 2:
        raise InputError(
            f"a cluster process takes two of n, parents and children; got n = {n}, "
            f"parents {'not given' if parents is None else 'given'}, children = {children}"
        )
    if n is not None:
        check_count(n)
    if isinstance(parents, int | np.integer) and parents < 1:
        raise InputError(f"the number of parents must be 1 or more; got {parents}")
    if children is not None and not (np.isfinite(children) and children > 0):
        raise InputError(f"the mean number of children must be finite and above 0; got {children}")


def _check_scatter(domain: Domain, spread: float, walls: str) -> None:
    if not (np.isfinite(spread) and spread > 0):
        raise InputError(f"spread must be a finite length above 0 m; got {spread}")
    if walls not in ("clip", "reflect", "periodic"):
        raise InputError(f"walls must be 'clip', 'reflect' or 'periodic'; got {walls!r}")
    if walls == "periodic" and len(domain.planes):
        raise InputError(f"walls cannot be periodic in a domain cut by {len(domain.planes)} planes; clip or reflect")


def _placed(parents: ArrayLike, domain: Domain) -> NDArray[np.float64]:
    """Return given parents as an array, shape (m, 3)."""
    where = np.array(parents, dtype=np.float64)
    if where.ndim != 2 or where.shape[1] not in ((2, 3) if domain.is_planar else (3,)) or not len(where):
        allowed = "(m, 2) or (m, 3)" if domain.is_planar else "(m, 3)"
        raise ShapeError(f"parents must be a number, or positions of shape {allowed}; got {where.shape}")
    bad = np.flatnonzero(~np.isfinite(where).all(axis=1))
    if bad.size:
        raise InputError(f"parents must be finite; {bad.size} of {len(where)} are not: {name_offenders(bad)}")
    if domain.is_planar:
        return _flattened(where, domain)
    return where


def _flattened(points: NDArray[np.float64], domain: Domain) -> NDArray[np.float64]:
    middle = domain.lower[2] + 0.5 * domain.lengths[2]
    return np.column_stack([points[:, :2], np.full(len(points), middle)])


def _scatter(
    about: NDArray[np.float64], domain: Domain, spread: float, generator: np.random.Generator
) -> NDArray[np.float64]:
    points = about + generator.normal(scale=spread, size=about.shape)
    return _flattened(points, domain) if domain.is_planar else points


def _kept(points: NDArray[np.float64], domain: Domain, walls: Walls) -> NDArray[np.float64]:
    """Return the points that stay in the domain, after what its walls do to them."""
    wraps = np.ones(3, dtype=bool) if walls == "periodic" else domain.periodic
    unit = (points - domain.lower) / domain.lengths
    unit[:, wraps] = np.mod(unit[:, wraps], 1.0)
    points = domain.lower + unit * domain.lengths
    if walls == "reflect":
        points = _reflected(points, domain, ~wraps)
    return points[domain.contains(points)]


def _reflected(points: NDArray[np.float64], domain: Domain, axes: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return points mirrored at the walls that they lie beyond, until they lie beyond none."""
    for _ in range(MOST_BOUNCES):
        # A box needs one fold, however far away the points are; planes may throw them back across its walls.
        unit = np.mod((points - domain.lower) / domain.lengths, 2.0)
        folded = domain.lower + np.minimum(unit, 2.0 - unit) * domain.lengths
        points = np.where(axes, folded, points)
        outside = np.flatnonzero(~domain.contains(points))
        if not outside.size or not len(domain.planes):
            return points
        # Not a matrix product: BLAS rounds as the processor's vectors are wide.
        beyond = (points[outside, None] * domain.planes[:, :3]).sum(axis=2) - domain.planes[:, 3]
        worst = beyond.argmax(axis=1)
        step = 2.0 * beyond[np.arange(outside.size), worst]
        points[outside] -= step[:, None] * domain.planes[worst, :3]
    return points
