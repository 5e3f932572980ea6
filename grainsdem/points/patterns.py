"""What kind of pattern seeds make: nearest neighbours, Ripley's K, pair correlation.

References
----------
.. [1] B. D. Ripley, "The second-order analysis of stationary point processes", J. Appl. Prob. 13 (1976) 255-266.
.. [2] J. Ohser, "On estimators for the reduced second moment measure of point processes", Math. Operationsforsch.
   Statist. 14 (1983) 63-71.
.. [3] P. J. Clark and F. C. Evans, "Distance to nearest neighbor as a measure of spatial relationships in populations",
   Ecology 35 (1954) 445-453.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.points.check import check_seeds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import ArrayLike, NDArray
    from scipy.spatial import cKDTree

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

_SHORTEST = 1e-12
"""Of the domain's longest edge: below, no place in it is told from another, and volumes vanish."""

PAIRS_AT_ONCE = 1_000_000
"""Pairs that are held at once, but for a single seed with more neighbours: memory does not grow with the pairs."""


@gated
def nearest_distances(seeds: ArrayLike, domain: Domain) -> Floats:
    """Return the distance [m] from each seed to the one nearest to it, shape (n,).

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        At least two positions [m] in the domain.
    domain : Domain
        Across its periodic walls distances are those to the nearest image; at other walls nothing is corrected.

    Raises
    ------
    ShapeError, InputError
        As `check_seeds`, or if there are fewer than two seeds.
    """
    return _nearest(_checked(seeds, domain), domain)


@gated
def clark_evans(seeds: ArrayLike, domain: Domain) -> float:
    r"""Return Clark and Evans's index [3]_: the mean distance to the nearest seed against that of a Poisson process.

    It is 1 for Poisson's, below for clusters and above for seeds that keep away from one another. Parameters and errors
    are those of `nearest_distances`.

    Notes
    -----
    Among seeds of intensity λ in d dimensions the mean is :math:`Γ(1 + 1/d) / (λ b_d)^{1/d}`, where :math:`b_d` is the
    volume of the unit ball.
    """
    return _order(nearest_distances(seeds, domain), domain)


@gated
def ripley_k(seeds: ArrayLike, domain: Domain, radii: ArrayLike) -> Floats:
    r"""Return Ripley's K function [1]_: the mean number of further seeds within r of a seed, over the intensity.

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        At least two positions [m] in the domain.
    domain : Domain
        What they lie in; in a planar domain distances and areas are those in its plane.
    radii : array_like, shape (m,)
        Rising distances r [m], the largest within reach of the edge correction: at most half of each edge that is
        periodic, and less than every other edge; where planes cut the domain, some seed must be as far from all walls.

    Returns
    -------
    ndarray of float64, shape (m,)
        K [m³], in a planar domain [m²]. Poisson's process has 4πr³/3 and πr².

    Raises
    ------
    ShapeError, InputError
        As `check_seeds`; or if there are fewer than two seeds, or the radii do not rise from above zero or reach too
        far.

    Notes
    -----
    Walls hide neighbours. The estimator [2]_ weighs each pair by the part of the domain W that it could lie in,

    .. math:: K(r) = \frac{|W|^2}{n (n - 1)} \sum_{i \ne j} \frac{1(|x_i - x_j| \le r)}{|W \cap (W + x_j - x_i)|},

    which corrects for them by translation; along periodic axes there is nothing to correct. Where planes cut the
    domain, only those seeds count among whose neighbours, up to the outer radius of each shell, no wall stands.
    """
    points = _checked(seeds, domain)
    edges = _edges(radii, domain, lowest=0.0)
    return np.cumsum(_rises(points, domain, edges))


@gated
def pair_correlation(seeds: ArrayLike, domain: Domain, radii: ArrayLike) -> Floats:
    """Return the pair correlation g: how many pairs are so far apart, over how many of a Poisson process would be.

    Parameters
    ----------
    seeds, domain
        As for `ripley_k`, whose edge correction it shares.
    radii : array_like, shape (m + 1,)
        Rising edges [m] of shells, from zero or above.

    Returns
    -------
    ndarray of float64, shape (m,)
        Mean of g over each shell, between one radius and the next.

    Raises
    ------
    ShapeError, InputError
        As `ripley_k`.
    """
    points = _checked(seeds, domain)
    edges = _edges(radii, domain, lowest=-1.0)
    if len(edges) < 2:
        raise InputError(f"a shell lies between two radii; got {edges.tolist()}")
    return _rises(points, domain, edges)[1:] / np.diff(_ball(edges, _dimensions(domain)))


@gated
def describe(seeds: ArrayLike, domain: Domain, *, reach: float | None = None, shells: int = 12) -> dict[str, Any]:
    """Return what kind of pattern seeds make, as plain numbers.

    Parameters
    ----------
    seeds, domain
        As for `ripley_k`.
    reach : float, optional
        Largest distance [m] of K and g; by default three mean spacings, or if that is less a quarter of the shortest
        edge, or half of the margin that the innermost seed has.
    shells : int
        Shells of equal width between zero and ``reach``.

    Returns
    -------
    dict
        ``seeds`` (their number), ``intensity`` [1/m³, or 1/m² in a planar domain], ``nearest_mean`` and
        ``nearest_least`` [m], ``clark_evans``, and lists of a value a shell: ``radii`` (outer, [m]), ``ripley_k``,
        ``poisson_k`` [m³ or m²] and ``pair_correlation``.

    Raises
    ------
    ShapeError, InputError
        As `ripley_k`, or if there is no shell.
    """
    if shells < 1:
        raise InputError(f"there must be a shell or more; got {shells}")
    allow_memory(shells, A_SEED, "shells")
    points = _checked(seeds, domain)
    nearest = _nearest(points, domain)
    d, intensity = _dimensions(domain), len(points) / _size(domain)
    if reach is not None and not (np.isfinite(reach) and reach > 0):
        raise InputError(f"reach must be positive and finite; got {reach}")
    if reach is None:
        margin = float(_margins(points, domain).max()) if len(domain.planes) else np.inf
        reach = min(3.0 * intensity ** (-1 / d), 0.25 * float(domain.lengths[:d].min()), 0.5 * margin)
    radii = _edges(np.linspace(0.0, reach, shells + 1)[1:], domain, lowest=0.0)
    rises, balls = _rises(points, domain, radii), _ball(radii, d)
    return {
        "seeds": len(points),
        "intensity": intensity,
        "nearest_mean": float(nearest.mean()),
        "nearest_least": float(nearest.min()),
        "clark_evans": _order(nearest, domain),
        "radii": radii.tolist(),
        "ripley_k": np.cumsum(rises).tolist(),
        "poisson_k": balls.tolist(),
        "pair_correlation": (rises / np.diff(balls, prepend=0.0)).tolist(),
    }


def _nearest(points: Floats, domain: Domain) -> Floats:
    distances, _ = _tree(points, domain).query(points, k=[2])  # the nearest of all is the point itself
    return np.asarray(distances, dtype=np.float64).ravel()


def _order(nearest: Floats, domain: Domain) -> float:
    """Return Clark and Evans's index of nearest distances."""
    d = _dimensions(domain)
    intensity = len(nearest) / _size(domain)
    return float(nearest.mean() * (intensity * _ball(1.0, d)) ** (1 / d) / math.gamma(1 + 1 / d))


def _rises(points: Floats, domain: Domain, edges: Floats) -> Floats:
    """Return the rise of K up to the first radius, and from each to the next, shape (m,)."""
    n, size, d = len(points), _size(domain), points.shape[1]
    lengths, periodic = domain.lengths[:d], domain.periodic[:d]
    margins = _margins(points, domain) if len(domain.planes) else None
    if margins is not None and edges[-1] > margins.max():
        raise InputError(
            f"no seed is farther than {margins.max():g} m from all walls, and radii may be no more; got {edges[-1]:g} m"
        )
    sums = np.zeros(len(edges))
    for first, second, distances in _near(points, _tree(points, domain), float(edges[-1])):
        # Each class is open below and closed above, as K counts pairs at distance r.
        shell = np.minimum(np.searchsorted(edges, distances, side="left"), len(edges) - 1)
        if margins is None:
            apart = np.abs(points[first] - points[second])
            weights = 1.0 / np.prod(np.where(periodic, lengths, lengths - apart), axis=1)
        else:
            weights = np.where(margins[first] >= edges[shell], 1.0, 0.0)
        sums += np.bincount(shell, weights=weights, minlength=len(edges))
    if margins is None:
        return size**2 / (n * (n - 1.0)) * sums
    return np.asarray(size / (n - 1.0) * sums / (margins[:, None] >= edges).sum(axis=0))


def _margins(points: Floats, domain: Domain) -> Floats:
    """Return how far each seed is from the nearest wall that neighbours hide behind [m], shape (n,)."""
    d = points.shape[1]
    margins = np.minimum(points, domain.lengths[:d] - points)[:, ~domain.periodic[:d]].min(axis=1, initial=np.inf)
    for plane in domain.planes:
        across = float(np.linalg.norm(plane[:d]))
        if across > 0:
            height = plane[3] - plane[:3] @ domain.lower
            height -= 0.5 * plane[2] * domain.lengths[2] if d == 2 else 0.0  # in the mid-plane
            margins = np.minimum(margins, (height - points @ plane[:d]) / across)
    return np.asarray(margins)


def _near(
    points: Floats, tree: cKDTree, within: float
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64], Floats]]:
    """Yield the ordered pairs of two seeds no farther apart than a distance, and theirs, some at a time."""
    from scipy.spatial import cKDTree  # noqa: PLC0415  (a third of a second)

    counts = tree.query_ball_point(points, within, return_length=True)
    running = np.cumsum(counts)
    start = 0
    while start < len(points):
        before = running[start - 1] if start else 0
        stop = max(start + 1, int(np.searchsorted(running, before + PAIRS_AT_ONCE, side="right")))
        some = cKDTree(points[start:stop], boxsize=tree.boxsize)
        found = some.sparse_distance_matrix(tree, within, output_type="ndarray")
        other = found["i"] + start != found["j"]
        yield found["i"][other] + start, found["j"][other], found["v"][other]
        start = stop


def _checked(seeds: ArrayLike, domain: Domain) -> Floats:
    """Return the seeds seen from the lower corner, those on an upper periodic wall on the lower one, shape (n, d)."""
    points = check_seeds(seeds, domain)
    if len(points) < 2:
        raise InputError(f"a pattern needs two seeds or more; got {len(points)}")
    points = points - domain.lower
    wrapped = np.where(domain.periodic, np.mod(points, domain.lengths), points)
    return np.ascontiguousarray(wrapped[:, : _dimensions(domain)])


def _tree(points: Floats, domain: Domain) -> cKDTree:
    from scipy.spatial import cKDTree  # noqa: PLC0415  (a third of a second)

    d = points.shape[1]
    # Length 0 is the tree's word for an axis that does not wrap.
    return cKDTree(points, boxsize=np.where(domain.periodic[:d], domain.lengths[:d], 0.0))


def _edges(radii: ArrayLike, domain: Domain, *, lowest: float) -> Floats:
    """Return the radii, or raise `InputError`; they must exceed ``lowest``."""
    edges = np.atleast_1d(np.asarray(radii, dtype=np.float64))
    if edges.ndim != 1 or not edges.size or not np.isfinite(edges).all():
        raise InputError(f"radii must be one row of finite numbers; got shape {edges.shape}")
    if edges[0] <= lowest or edges[0] < 0 or (np.diff(edges) <= 0).any():
        raise InputError(f"radii must rise from {'0 m' if lowest < 0 else 'above 0 m'}; got {edges.tolist()}")
    least = _SHORTEST * float(domain.lengths.max())
    if edges[edges > 0].min(initial=least) < least:
        raise InputError(f"radii must be at least {least:g} m in this domain; got {edges[edges > 0].min():g} m")
    for axis in range(_dimensions(domain)):
        length = domain.lengths[axis]
        reach = 0.5 * length if domain.periodic[axis] else length
        if edges[-1] > reach or (edges[-1] == length):
            word = "half of it, as it is periodic" if domain.periodic[axis] else "less than it"
            raise InputError(
                f"along {'xyz'[axis]} the domain is {length:g} m long, and radii may be {word}; got {edges[-1]:g} m"
            )
    return edges


def _dimensions(domain: Domain) -> int:
    return 2 if domain.is_planar else 3


def _size(domain: Domain) -> float:
    """Return the volume [m³] of a domain, or the area [m²] of a planar one."""
    return domain.volume / float(domain.lengths[2]) if domain.is_planar else domain.volume


def _ball(radius: Floats | float, d: int) -> Floats:
    """Return the volume of balls in ``d`` dimensions."""
    unit = math.pi if d == 2 else 4.0 * math.pi / 3.0
    return np.asarray(unit * np.asarray(radius) ** d)
