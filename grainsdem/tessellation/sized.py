"""Laguerre cells of prescribed volumes: a grain-size distribution that is asked for and had.

The weights that give every cell its volume solve a semi-discrete optimal transport problem; a damped Newton method
finds them, since the derivative of the volumes is known from the faces.

References
----------
.. [1] J. Kitagawa, Q. Mérigot, B. Thibert, "Convergence of a Newton algorithm for semi-discrete optimal transport",
   J. Eur. Math. Soc. 21 (2019) 2603-2651.
.. [2] D. P. Bourne, P. J. J. Kok, S. M. Roper, W. D. T. Spanjer, "Laguerre tessellations and polycrystalline
   microstructures: a fast algorithm for generating grains of given volumes", Phil. Mag. 100 (2020) 2677-2707.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from grainsdem.errors import ConvergenceError, InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.integrals import face_planes, integrate
from grainsdem.model import Domain, Polyhedra, Tessellation
from grainsdem.points.check import check_seeds
from grainsdem.points.poisson import poisson
from grainsdem.ragged import owners
from grainsdem.roots import raised
from grainsdem.tessellation.engine.frame import Frame
from grainsdem.tessellation.engine.full import full_cells
from grainsdem.tessellation.engine.tree import Tree, build, reweighted
from grainsdem.tessellation.lloyd import check_rounds, inside

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

NEWTON_STEPS = 60
"""Steps of Newton's method before giving up; some ten are usual."""

SOLVED = 1e-4
"""Residual, relative to the right side, at which a step's system counts as solved."""

MOST_GRADIENTS = 2000
"""Most iterations of its solver."""

ROUGH = 0.2
"""Relative error of the volumes that is enough before the seeds move again."""

STRENGTHS = (1.0, 0.9, 0.75, 0.5, 0.25, 0.0)
"""What parts of the weights that the cells had are tried once the seeds have moved."""


@runtime_checkable
class Law(Protocol):
    """A continuous distribution: any frozen one of `scipy.stats`."""

    def ppf(self, q: Floats) -> Floats:
        """Return the quantiles."""
        ...


class _State(NamedTuple):
    """Laguerre cells of some seeds and weights, and what Newton's method needs of them."""

    shapes: Polyhedra
    neighbors: NDArray[np.int32]
    shifts: NDArray[np.int8]
    volumes: Floats
    centroids: Floats


@gated
def sized_cells(
    domain: Domain,
    diameters: ArrayLike | Law,
    *,
    n: int | None = None,
    seeds: ArrayLike | None = None,
    tolerance: float = 0.01,
    relaxations: int = 5,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Tessellation:
    """Return Laguerre cells whose volumes follow the diameters asked for.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    diameters : array_like, shape (n,), or a frozen distribution of scipy.stats
        Diameter [m] of the sphere of each cell's volume; in a planar domain, of the circle of its area. Cells fill the
        domain, so only the ratios are kept: all are scaled by one factor. From a distribution, ``n`` diameters are
        taken at equal steps of probability, in random order.
    n : int, optional
        Number of cells for a distribution; as many as fill the domain at the diameters asked for, where not given.
    seeds : array_like, shape (n, 3) or (n, 2), optional
        Where to start from; random where not given. Diameter i goes to seed i.
    tolerance : float
        Largest relative error of a cell's volume.
    relaxations : int
        How many times every seed moves to the centroid of its cell on the way: rounder cells for larger numbers.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called after each step of Newton's method with its number, from 1, and the largest relative error.

    Returns
    -------
    Tessellation
        Cells with weights, none of them empty.

    Raises
    ------
    InputError
        If a diameter is not positive and finite, or another value is out of range.
    ShapeError
        If there are not as many seeds as diameters.
    ConvergenceError
        If the volumes do not come within the tolerance.

    Notes
    -----
    With faces of area A_ij between seeds at the distance d_ij, ∂V_i/∂w_j = -A_ij / (2 d_ij). Each step solves this for
    the change of the weights and is halved until no cell is smaller than half the smallest volume and the error falls.
    """
    if not 0 < tolerance < 1:
        raise InputError(f"tolerance must lie between 0 and 1; got {tolerance}")
    check_rounds("relaxations", relaxations)
    generator = np.random.default_rng(rng)
    targets = _targets(domain, diameters, n, generator)
    sites = check_seeds(poisson(domain, len(targets), rng=generator) if seeds is None else seeds, domain)
    if len(sites) != len(targets):
        raise ShapeError(f"there must be one seed for each of the {len(targets)} diameters; got {len(sites)}")
    weights = np.zeros(len(sites))
    steps = 0
    compiled("cells", "lloyd")
    for _ in range(relaxations):
        weights, state, steps = solve(domain, sites, weights, targets, max(ROUGH, tolerance), steps, progress)
        sites = check_seeds(inside(sites + state.centroids, domain), domain)
    weights, state, _ = solve(domain, sites, weights, targets, tolerance, steps, progress)
    return Tessellation(domain, sites, weights, state.shapes, state.neighbors, state.shifts)


def resized_cells(cells: Tessellation, diameters: Floats, *, tolerance: float) -> Tessellation:
    """Return the cells of the same seeds with other sizes [m], shape (n,); from weights that are near, so soon."""
    targets = _targets(cells.domain, diameters, None, np.random.default_rng(0))
    weights, state, _ = solve(cells.domain, cells.sites, cells.weights, targets, tolerance, 0, None)
    return Tessellation(cells.domain, cells.sites, weights, state.shapes, state.neighbors, state.shifts)


def _targets(domain: Domain, diameters: ArrayLike | Law, n: int | None, rng: np.random.Generator) -> Floats:
    """Return the volumes asked for, scaled to fill the domain."""
    power = 2 if domain.is_planar else 3
    if isinstance(diameters, Law):
        if n is None:
            unit = raised(_quantiles(diameters, 4096), power)
            mean = float(unit.mean()) * (np.pi / 4 * domain.lengths[2] if domain.is_planar else np.pi / 6)
            n = max(1, round(domain.volume / mean)) if np.isfinite(mean) and mean > 0 else 1
        if n < 1:
            raise InputError(f"the number of cells must be 1 or more; got {n}")
        values = rng.permutation(_quantiles(diameters, n))
    else:
        values = np.atleast_1d(np.array(diameters, dtype=np.float64))
        if n is not None and values.shape != (n,):
            raise ShapeError(f"n is {n}, but the diameters have shape {values.shape}")
    if values.ndim != 1 or values.size == 0:
        raise ShapeError(f"diameters must have shape (n,), one or more; got {values.shape}")
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if bad.size:
        raise InputError(f"diameters must be positive and finite; {bad.size} are not: {name_offenders(bad)}")
    # The largest first: the cubes of micrometres are small enough to lose digits.
    volumes = raised(values / values.max(), power)
    return np.asarray(volumes * (domain.volume / volumes.sum()))


def _quantiles(law: Law, n: int) -> Floats:
    """Return ``n`` quantiles at the middles of equal steps of probability."""
    return np.asarray(law.ppf((np.arange(n) + 0.5) / n), dtype=np.float64)


def _state(tree: Tree, frame: Frame, weights: Floats) -> _State:
    cells = full_cells(reweighted(tree, (weights - weights.mean()) / frame.scale**2), frame)
    shapes = Polyhedra(cells.vertices, cells.vertex_offsets, cells.face_offsets, cells.corners, cells.corner_offsets)
    measured = integrate(shapes)
    return _State(shapes, cells.neighbors, cells.shifts, measured.volumes, measured.centroids)


def solve(
    domain: Domain,
    sites: Floats,
    weights: Floats,
    targets: Floats,
    tolerance: float,
    steps: int,
    progress: Callable[[int, float], None] | None,
) -> tuple[Floats, _State, int]:
    """Return weights that give the volumes asked for, their cells, and the number of steps taken so far."""
    frame = Frame.of(domain)
    tree = build(frame.inward(sites), weights)
    # The old weights may leave a moved seed without a cell, or with one so small that no step leads away from it; they
    # are weakened until one does, as without weights all have a cell of some size.
    failure = ConvergenceError("some of the seeds have no cell, even without weights")
    for strength in STRENGTHS:
        state = _state(tree, frame, strength * weights)
        if state.volumes.min() > 0:
            start = _Start(domain, frame, tree, sites, strength * weights, state)
            try:
                return _descend(start, targets, tolerance, steps, progress)
            except ConvergenceError as error:
                failure = error
                LOG.debug("with %g of the weights before: %s", strength, error)
    raise failure


class _Start(NamedTuple):
    """Where Newton's method begins."""

    domain: Domain
    frame: Frame
    tree: Tree
    sites: Floats
    weights: Floats
    state: _State


def _descend(
    start: _Start, targets: Floats, tolerance: float, steps: int, progress: Callable[[int, float], None] | None
) -> tuple[Floats, _State, int]:
    """Return what `solve` does, from weights that leave no cell empty."""
    domain, frame, tree, sites, weights, state = start
    smallest = 0.5 * min(state.volumes.min(), targets.min())
    worst = float(np.max(np.abs(state.volumes / targets - 1)))
    for _ in range(NEWTON_STEPS):
        if worst <= tolerance:
            return weights, state, steps
        direction = _newton_direction(domain, sites, state, targets)
        error = _length(state.volumes - targets)
        length = 1.0
        while True:
            trial = _state(tree, frame, weights + length * direction)
            fallen = _length(trial.volumes - targets) <= (1 - 0.5 * length) * error
            if fallen and trial.volumes.min() >= smallest:
                break
            length *= 0.5
            if length < 2.0**-20:
                raise ConvergenceError(
                    f"the cells' volumes came within {worst:.3g} of those asked for, not {tolerance:.3g}; "
                    f"smallest and largest volumes asked for differ by a factor {targets.max() / targets.min():.3g}"
                )
        weights, state = weights + length * direction, trial
        worst = float(np.max(np.abs(state.volumes / targets - 1)))
        steps += 1
        LOG.debug("step %d: length %.3g, largest error of a volume %.3g", steps, length, worst)
        if progress is not None:
            progress(steps, worst)
    if worst <= tolerance:
        return weights, state, steps
    raise ConvergenceError(
        f"the cells' volumes came within {worst:.3g} of those asked for after {NEWTON_STEPS} steps, not {tolerance:.3g}"
    )


def _length(vector: Floats) -> float:
    """Return the length of a vector, summed in one order on every processor."""
    return float(np.sqrt((vector * vector).sum()))


def _newton_direction(domain: Domain, sites: Floats, state: _State, targets: Floats) -> Floats:
    """Return the change of the weights that would give the volumes asked for, were the faces' areas constant."""
    from scipy.sparse import coo_array  # noqa: PLC0415  (scipy.sparse costs a tenth of a second)

    n = len(sites)
    i = owners(state.shapes.face_offsets)
    j = state.neighbors.astype(np.int64)
    kept = (j >= 0) & (i != j)
    i, j = i[kept], j[kept]
    distances = np.linalg.norm(sites[j] + state.shifts[kept] * domain.lengths - sites[i], axis=1)
    couplings = face_planes(state.shapes).areas[kept] / (2 * distances)
    diagonal = np.bincount(i, couplings, minlength=n)
    matrix: Any = coo_array(
        (np.append(-couplings, diagonal), (np.append(i, np.arange(n)), np.append(j, np.arange(n)))), shape=(n, n)
    ).tocsr()
    # Constants are in the kernel of the matrix, and the right side sums to zero: the gradients stay clear of them.
    wanted = targets - state.volumes
    solution = _conjugate_gradients(matrix, wanted - wanted.mean(), np.where(diagonal > 0, diagonal, 1.0))
    return np.asarray(solution - solution.mean())


def _conjugate_gradients(matrix: Any, right: Floats, diagonal: Floats) -> Floats:
    """Solve a symmetric system to `SOLVED` of its right side, preconditioned by the diagonal.

    Products are summed by NumPy, in one order on every processor: BLAS, which SciPy's solver asks, sums as wide as the
    processor's vectors are, and the last bits of the cells would be the machine's.
    """
    solution, residual = np.zeros_like(right), right.copy()
    goal = SOLVED**2 * float((right * right).sum())
    direction, old = np.zeros_like(right), 1.0
    for _ in range(MOST_GRADIENTS):
        if float((residual * residual).sum()) <= goal:
            break
        guess = residual / diagonal
        new = float((residual * guess).sum())
        direction = guess + new / old * direction
        old = new
        image = matrix @ direction
        length = new / float((direction * image).sum())
        solution += length * direction
        residual -= length * image
    return solution
