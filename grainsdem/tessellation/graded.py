"""Cells with a grading: a sieve curve, or a law of sizes, that the grains have which are kept.

Sizes are given to the seeds before anybody knows which cells touch a wall and are dropped, and large cells touch walls
more often. So cells are grown, those that stay are counted, and are given the sizes that so many grains have on the
curve, in the order of the sizes that they have: each changes by little, and so hardly any cell comes to touch a wall
or to leave it. A few such rounds, and those that stay have the curve. The same rounds bring sieve diameters to it,
which depend on shapes that are not known before.
"""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import ConvergenceError, InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.boxes import rectangles
from grainsdem.geometry.forms.holes import square_holes
from grainsdem.geometry.integrals import volumes
from grainsdem.memory import allow_cells
from grainsdem.model import Domain, Grading, Tessellation
from grainsdem.roots import cube_roots, raised
from grainsdem.tessellation.sized import Law, resized_cells, sized_cells

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Polyhedra
    from grainsdem.tessellation.metric import Metric

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

TOLERANCE = 5e-3
"""Largest difference, as a share, of the curve of the grains from the one asked for, at any opening."""

ROUNDS = 30
"""Most often that sizes are given anew; three are usual."""

PATIENCE = 3
"""Rounds in a row that come no nearer, after which the nearest is taken where that is allowed."""

SHARPEST = 5e-3
"""Relative error of a cell's volume: a third of that in its diameter is less than `grading.MARGIN`."""


class GradedCells(NamedTuple):
    """Cells, and the sizes that were asked of them.

    Parameters
    ----------
    cells : Tessellation
        The cells; they fill the domain, so that they have the sizes up to one factor.
    diameters : ndarray, shape (n,)
        Equal-volume diameter [m] of the grain of each cell.
    deviation : float
        Largest difference, as a share, of the curve of those that are kept from the one asked for.
    """

    cells: Tessellation
    diameters: Floats
    deviation: float


@gated
def graded_cells(
    domain: Domain,
    curve: Grading | Law,
    *,
    n: int | None = None,
    seeds: ArrayLike | None = None,
    keep: Literal["inside", "all"] = "inside",
    tolerance: float = TOLERANCE,
    strict: bool = True,
    relaxations: int = 5,
    metric: Metric | None = None,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> GradedCells:
    """Return Laguerre cells of which those that are kept have a grading.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    curve : Grading, or a frozen distribution of scipy.stats
        Percent passing by mass, or a law of diameters [m] by number.
    n : int, optional
        Number of cells, those that are dropped among them; as many as there are seeds where not given.
    seeds : array_like, shape (n, 3) or (n, 2), optional
        Where to start from; random where not given.
    keep : {"inside", "all"}
        Which cells become grains (see `carve`).
    tolerance : float
        Largest difference, as a share, of the kept grains' curve from the one asked for.
    strict : bool
        Whether to raise where the curve is not had within the tolerance, or to log how near it is.
    relaxations : int
        How many times every seed moves to the centroid of its cell on the way: rounder cells for larger numbers.
    metric : Metric, optional
        How the space is stretched that the domain is in, where holes are those of grains that are mapped back.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called after each round with its number, from 1, and the deviation.

    Raises
    ------
    InputError
        If there are too few grains for the curve, none is kept, or a value is out of range.
    ConvergenceError
        If the curve does not come within the tolerance; neither is raised of that where not ``strict``.
    """
    options = Rounds(keep, tolerance, strict, progress).checked()
    count = n if seeds is None else len(np.asarray(seeds))
    if count is None:
        raise InputError("give n, the number of cells, or seeds")
    allow_cells(count)
    generator = np.random.default_rng(rng)
    wish = Wish(curve, domain, metric)
    diameters = generator.permutation(wish.draw(count, None, tolerance=None))
    start = sized_cells(domain, diameters, seeds=seeds, tolerance=SHARPEST, relaxations=relaxations, rng=generator)
    groups = np.zeros(count, dtype=np.int32)
    return regraded(GradedCells(start, diameters, np.inf), [wish], groups, options)


class Rounds(NamedTuple):
    """How cells are graded: which are kept, how near is near enough, and who is told."""

    keep: Literal["inside", "all"]
    tolerance: float
    strict: bool
    progress: Callable[[int, float], None] | None

    def checked(self) -> Rounds:
        """Return itself, or raise `InputError` before anything is grown where a value is out of range."""
        if self.keep not in ("inside", "all"):
            raise InputError(f"keep must be 'inside' or 'all'; got {self.keep!r}")
        if not 0 < self.tolerance < 1:
            raise InputError(f"tolerance must lie between 0 and 1; got {self.tolerance}")
        return self


def regraded(start: GradedCells, wishes: list[Wish], groups: NDArray[np.int32], options: Rounds) -> GradedCells:
    """Return cells given sizes anew until those of each group that are kept have the group's curve.

    Parameters
    ----------
    start : GradedCells
        Cells, and the diameters [m] that were asked of them.
    wishes : list of Wish
        What is asked for of each group.
    groups : ndarray of int32, shape (n,)
        The group of each cell.
    options : Rounds
        See there. Errors are those of `graded_cells`.
    """
    cells, diameters, _ = start
    best: GradedCells | None = None
    last = 0
    for done in range(1, ROUNDS + 1):
        kept = np.ones(len(cells), dtype=bool) if options.keep == "all" else ~cells.touch_walls()
        members = [kept & (groups == k) for k in range(len(wishes))]
        if not all(rows.any() for rows in members):
            raise InputError(
                f"all {len(cells)} cells{' of a layer' if len(wishes) > 1 else ''} touch a wall; use more seeds, a "
                "periodic domain or keep='all'"
            )
        scale = _scale(cells, diameters)
        holes = next((wish.holes(cells.cells) for wish in wishes if wish.is_sieve), None)
        found = [wish.measure(cells, scale, holes) for wish in wishes]
        deviation = max(wish.deviation(each, rows) for wish, each, rows in zip(wishes, found, members, strict=True))
        LOG.debug("round %d: %d of %d cells stay, curve off by %.3g", done, kept.sum(), len(cells), deviation)
        if options.progress is not None:
            options.progress(done, deviation)
        if best is None or deviation < best.deviation:
            best, last = GradedCells(cells, diameters, deviation), done
        if deviation <= options.tolerance:
            return best
        if not options.strict and done - last > PATIENCE:
            break
        # Those at walls keep their sizes: a cell that shrank there would leave the wall, be kept, and grow back to it.
        diameters = diameters.copy()
        for wish, each, rows in zip(wishes, found, members, strict=True):
            ranked = np.flatnonzero(rows)[np.argsort(each.sizes[rows], kind="stable")]
            ratios = each.ratios[ranked]
            drawn = wish.draw(ranked.size, ratios, tolerance=options.tolerance if options.strict else None)
            diameters[ranked] = drawn / ratios
        cells = resized_cells(cells, diameters, tolerance=SHARPEST)
    if best is None or options.strict:
        raise ConvergenceError(
            f"the curve came within {100 * (best.deviation if best else 1):.3g} % of the one asked for in {ROUNDS} "
            f"rounds, not {100 * options.tolerance:.3g} %: more seeds come nearer"
        )
    LOG.warning(
        "the grains have the curve asked for within %.2g %%, not %.2g %%: more seeds come nearer",
        100 * best.deviation, 100 * options.tolerance,
    )  # fmt: skip
    return best


def _scale(cells: Tessellation, diameters: Floats) -> float:
    """Return how much larger the grains asked for are than the cells, which fill the domain: in length."""
    content = float(volumes(cells.cells).sum())
    if cells.domain.is_planar:
        area = content / float(cells.domain.lengths[2])
        return float(np.sqrt(0.25 * np.pi * (diameters * diameters).sum() / area))
    return float(cube_roots(np.pi / 6 * raised(diameters, 3).sum() / content))


class Measured(NamedTuple):
    """Size [m] of each cell on the scale of what was asked for, that over its equal-volume diameter, and its mass."""

    sizes: Floats
    ratios: Floats
    masses: Floats


class Wish:
    """What is asked for: a grading by mass, or a law by number, in a domain."""

    def __init__(self, curve: Grading | Law, domain: Domain, metric: Metric | None) -> None:
        self._curve, self._metric = curve, metric
        self._is_planar, self._thickness = domain.is_planar, float(domain.lengths[2])
        self._power = 2 if domain.is_planar else 3

    def draw(self, n: int, ratios: Floats | None, *, tolerance: float | None) -> Floats:
        """Return the sizes [m] of n grains, rising, shape (n,)."""
        if isinstance(self._curve, Grading):
            return self._curve.draw(n, power=self._power, ratios=ratios, tolerance=tolerance)
        return np.asarray(self._curve.ppf((np.arange(n) + 0.5) / n), dtype=np.float64)

    def measure(self, cells: Tessellation, scale: float, holes: Floats | None) -> Measured:
        """Return what the cells are once they are as many times larger; ``holes`` [m] are those that they pass."""
        content = volumes(cells.cells)
        if self._is_planar:
            own = np.sqrt(content / (0.25 * np.pi * self._thickness))
        else:
            own = cube_roots(content * (6 / np.pi))
        ratios = np.ones(len(own))
        if self.is_sieve and holes is not None:
            ratios = holes / own
        return Measured(ratios * own * scale, ratios, raised(own, self._power))

    def deviation(self, found: Measured, kept: NDArray[np.bool_]) -> float:
        """Return how far the curve of the kept cells is from the one asked for."""
        sizes, masses = found.sizes[kept], found.masses[kept]
        if isinstance(self._curve, Grading):
            return self._curve.deviation(sizes, masses)
        asked = self.draw(sizes.size, None, tolerance=None)
        # Between each two of the sizes asked for, by number and by mass.
        marks = 0.5 * (asked[1:] + asked[:-1])
        order = np.argsort(sizes, kind="stable")
        place = np.searchsorted(sizes[order], marks)
        by_number = np.abs(place - np.arange(1, sizes.size)) / sizes.size
        running = np.append(0.0, np.cumsum(masses[order])) / masses.sum()
        wanted = np.cumsum(raised(asked, self._power))[:-1] / raised(asked, self._power).sum()
        return float(max(by_number.max(initial=0.0), np.abs(running[place] - wanted).max(initial=0.0)))

    @property
    def is_sieve(self) -> bool:
        """Whether sizes are holes that grains pass."""
        return isinstance(self._curve, Grading) and self._curve.diameter == "sieve"

    def holes(self, shapes: Polyhedra) -> Floats:
        """Return the size [m] of the smallest hole that each cell passes; of the narrowest slit in a plane."""
        if self._metric is not None:
            shapes = self._metric.stretched_shapes(shapes)
        if self._is_planar:
            return rectangles(shapes.vertices[:, :2], shapes.vertex_offsets)[:, 2]
        return square_holes(shapes)
