"""Cells of which each has a form of its own, and lies its own way.

Convex cells of unlike forms do not fill space: where the metric differs from cell to cell the places at one distance of
two seeds are curved. Here each pair is parted by the plane at which their two ellipsoids touch (`cells.between`). Cells
then never overlap, and leave a few hundredths of the space between them, which counts as void.

Cells are not as long as their ellipsoids, and lie as their neighbours let them. So they are grown in rounds, in which
each seed goes to the centroid of its cell, each weight follows the volume that is missing, and each form what the
cell's own second moments are off by. In the last rounds seeds stay, and forms and volumes come nearer.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import ConvergenceError, InputError
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.geometry.forms.boxes import boxes_on_faces
from grainsdem.geometry.integrals import Integrals, integrate
from grainsdem.geometry.integrals import volumes as volumes_of
from grainsdem.geometry.matrices import inverse, product, unit
from grainsdem.points.poisson import poisson
from grainsdem.ragged import owners
from grainsdem.roots import cube_roots, raised
from grainsdem.tessellation.ellipsoids import grown
from grainsdem.tessellation.graded import TOLERANCE, Measured, Wish, graded_cells
from grainsdem.tessellation.lloyd import relax
from grainsdem.tessellation.voronoi import tessellate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain, Grading, Tessellation
    from grainsdem.tessellation.forms import Drawn, Forms
    from grainsdem.tessellation.sized import Law

    Floats = NDArray[np.float64]

LOG = logging.getLogger(__name__)

MOVING, STILL = 24, 40
"""Rounds in which seeds move, and at most in which they stay."""

NEAR = 0.02
"""Largest relative difference of the mean ratios from those asked for."""

SHARE = 0.05
"""Largest relative difference of a class's share from the one asked for, but for one grain."""

_LEAK = 0.4
"""Share of the form asked for in each round's form: without it forms whose neighbours resist grow without bound."""

_FOLLOWING = 0.25
"""How far a form follows what the cell's second moments are off by: half would undo all of a small difference."""

_SLOWLY = 0.3
"""Power by which the form asked for follows the box of the cell, which is not that of its second moments."""

_SWELLING = 0.7
"""How far weights follow what is missing of the volumes: more has neighbours take turns."""

_EXCHANGED = 4
"""Calm rounds after which grains exchange classes, each for the one that the other has."""

_SIEVED = 6
"""Rounds after which holes that cells pass are found anew while seeds move: they take as long as the cells."""

_LACKING = 0.03
"""Share of the cells that may be smaller than their size: of the others what is too much is trimmed off."""

_ON_TOP = 0.1
"""How far the shares that are asked for follow those that are missing."""


class MixedCells(NamedTuple):
    """Cells of forms of their own.

    Parameters
    ----------
    cells : Tessellation
        The cells; `Tessellation.fill` is the share of the domain that they fill.
    ratios : ndarray, shape (n, 2)
        b/a and c/b that were asked of each.
    axes : ndarray, shape (n, 3, 3)
        Directions asked for: long, middle and short axis of each, one a row.
    diameters : ndarray, shape (n,)
        Equal-volume diameter [m] of the grain of each: of its cell where no curve was asked for, and on the curve's
        scale where it is not kept.
    deviation : float
        How far the kept cells are from what was asked for: of means a relative difference over 2 %, of shares of
        classes over 5 % of them, of a curve over its tolerance; the largest. One or less.
    """

    cells: Tessellation
    ratios: Floats
    axes: Floats
    diameters: Floats
    deviation: float


@gated
def mixed_cells(
    domain: Domain,
    forms: Forms,
    *,
    n: int | None = None,
    seeds: ArrayLike | None = None,
    curve: Grading | Law | None = None,
    keep: Literal["inside", "all"] = "inside",
    relaxations: int = 5,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> MixedCells:
    """Return convex cells of which each has a form of its own, and of which those that are kept have what is asked.

    Parameters
    ----------
    domain : Domain
        What they grow in: a box or one cut by planes, not a slab.
    forms : Forms
        Zingg's classes by share, or laws of ratios, and how the grains lie.
    n : int, optional
        Number of cells, those that are dropped among them; as many as there are seeds where not given.
    seeds : array_like, shape (n, 3), optional
        Where to start from [m]; random where not given.
    curve : Grading, or a frozen distribution of scipy.stats, optional
        Percent passing by mass, or a law of diameters [m] by number. By default cells have the volumes that they have
        before they are given forms.
    keep : {"inside", "all"}
        Which cells become grains (see `carve`).
    relaxations : int
        How many times every seed moves to the centroid of its cell before.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    progress : callable, optional
        Called after each round with its number, from 1, and how far the cells are off, see `MixedCells.deviation`.

    Raises
    ------
    InputError
        If a value is out of range, or the domain is a slab or too short along an axis that wraps.
    ConvergenceError
        If the cells do not come to have what is asked for.
    """
    if domain.is_planar:
        raise InputError("grains of a slab are prisms: cells of forms of their own are grown in space")
    generator = np.random.default_rng(rng)
    if seeds is None and n is None:
        raise InputError("give n, the number of cells, or seeds")
    if curve is not None:
        start = graded_cells(
            domain, curve, n=n, seeds=seeds, keep=keep, strict=False, relaxations=relaxations, rng=generator
        )
        wish = Asked(start.diameters, Wish(curve, domain, None))
        return reshaped(start.cells, forms, keep=keep, asked=wish, rng=generator, progress=progress)
    places = poisson(domain, int(n or 0), rng=generator) if seeds is None else np.asarray(seeds, dtype=np.float64)
    cells = tessellate(relax(places, domain, iterations=relaxations) if relaxations else places, domain)
    return reshaped(cells, forms, keep=keep, rng=generator, progress=progress)


@dataclass(frozen=True, slots=True)
class Asked:
    """Sizes that are asked for: how large each cell's grain is to be [m], by what curve, if any, and how near."""

    diameters: Floats
    wish: Wish | None = None
    tolerance: float = TOLERANCE


def reshaped(
    cells: Tessellation,
    forms: Forms,
    *,
    keep: Literal["inside", "all"] = "inside",
    asked: Asked | None = None,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> MixedCells:
    """Return cells given forms of their own, each of the volume that it has, or of a curve; see `mixed_cells`.

    Parameters
    ----------
    cells : Tessellation
        Cells that fill their domain, none of them empty.
    forms, keep, rng, progress
        See there, and for what is raised.
    asked : Asked, optional
        Sizes asked for, where there is a curve.
    """
    if keep not in ("inside", "all"):
        raise InputError(f"keep must be 'inside' or 'all'; got {keep!r}")
    if cells.domain.is_planar:
        raise InputError("grains of a slab are prisms: cells of forms of their own are grown in space")
    compiled("between")
    growth = _Growth(cells, forms, asked, np.random.default_rng(rng))
    best: MixedCells | None = None
    for done in range(1, MOVING + STILL + 1):
        found = growth.look(keep, calm=done - MOVING)
        LOG.debug("round %d: %.4f filled, off by %.3g", done, found.cells.fill, found.deviation)
        if progress is not None:
            progress(done, found.deviation)
        if done > MOVING and (best is None or found.deviation < best.deviation):
            best = found
            if found.deviation <= 1:
                return found
        growth.follow(moves=done <= MOVING)
    worst = best.deviation if best is not None else np.inf
    raise ConvergenceError(
        f"cells of these forms come within {worst:.3g} times what is allowed (2 % of mean ratios, 5 % of a class's "
        f"share, the curve's tolerance) in {MOVING + STILL} rounds: more grains, or ratios nearer to one, come nearer"
    )


class _Growth:
    """Cells in rounds: seeds, weights and forms, what is asked of them, and the cells that they make."""

    def __init__(self, cells: Tessellation, forms: Forms, asked: Asked | None, rng: np.random.Generator) -> None:
        n = len(cells)
        volumes = integrate(cells.cells).volumes
        if not (volumes > 0).all():
            raise InputError("cells are given forms of their own where none is empty; some are")
        self._domain, self._asked, self._forms = cells.domain, asked, forms
        self._drawn: Drawn = forms.draw(n, rng)
        self._shares = forms.shares
        self._holes: Floats | None = None
        self._sites = np.array(cells.sites)
        self._diameters = cube_roots(volumes * (6 / np.pi)) if asked is None else np.array(asked.diameters)
        self._radii = self._scaled_radii()
        # Between Laguerre's planes and those of ellipsoids that swell in proportion: small grains keep their forms.
        self._stiffness = self._radii.max() / self._radii
        self._weights = self._radii * self._radii * self._stiffness
        self._images = np.broadcast_to(np.eye(3), (n, 3, 3)).copy()
        self._reach = np.repeat(1.3 * self._radii[:, None], 3, axis=1)
        self._goals = forms.ratios(self._drawn)
        self._aims = self._goals.copy()

    def look(self, keep: str, *, calm: int) -> MixedCells:
        """Make the cells, deal what is asked among those that are kept, and return how far off they are.

        ``calm`` is the number of rounds in which seeds have stayed.
        """
        cells, self._reach = grown(
            self._domain,
            self._sites,
            self._weights,
            inverse(self._images) * self._stiffness[:, None, None],
            self._reach,
        )
        self._measured = integrate(cells.cells)
        self._boxes = boxes_on_faces(cells.cells)
        kept = self._measured.volumes > 0
        if keep == "inside":
            kept &= ~cells.touch_walls()
        if not kept.any():
            raise InputError(f"all {len(cells)} cells touch a wall; use more seeds, a periodic domain or keep='all'")
        self._deal(kept, calm=calm)
        goals = self._forms.ratios(self._drawn)
        self._aims = np.where(goals == self._goals, self._aims, self._aims * goals / self._goals)
        self._goals = goals
        # About their centroids: a seed may lie outside of its cell, and cells are trimmed about what is within.
        moves = self._measured.centroids[owners(cells.cells.vertex_offsets)]
        centred = replace(cells.cells, vertices=cells.cells.vertices - moves)
        cells = replace(cells, sites=cells.sites + self._measured.centroids, cells=centred)
        cells, curve_off = self._regrade(cells, kept, calm=calm)
        off = max(curve_off, self._off(kept))
        # Weights say of cells that their sizes were asked for one by one: those at the walls are missed then.
        is_listed = self._asked is not None and self._asked.wish is None
        weights = cells.weights if is_listed else np.zeros(len(cells))
        told = replace(
            cells, weights=weights, fill=min(float(volumes_of(cells.cells).sum()) / self._domain.volume, 1.0)
        )
        return MixedCells(told, goals, self._drawn.axes, self._told, off)

    def _deal(self, kept: NDArray[np.bool_], *, calm: int) -> None:
        """Deal classes and ratios among those that are kept; in calm rounds, so that classes have their shares."""
        if self._forms.classes is not None and calm > 0:
            kinds = self._forms.kinds_of(_ratios(self._boxes))
            if calm % _EXCHANGED == 0:
                self._drawn = self._forms.swapped(self._drawn, kept, kinds)
            has = np.bincount(kinds[kept & (kinds >= 0)], minlength=self._shares.size) / kept.sum()
            # What classes lose to others for good is asked for on top.
            self._shares = np.clip(self._shares + _ON_TOP * (self._forms.shares - has), 0.0, 1.0)
            self._shares /= self._shares.sum()
        self._drawn = self._forms.dealt(self._drawn, kept, self._shares)

    def follow(self, *, moves: bool) -> None:
        """Move seeds, weights and forms to where the cells come nearer to what is asked for."""
        measured, domain = self._measured, self._domain
        is_there = measured.volumes > 0
        if moves:
            sites = self._sites + np.where(is_there[:, None], measured.centroids, 0.0)
            around = domain.lower + (sites - domain.lower) % domain.lengths
            self._sites = np.where(domain.periodic, around, sites)
        self._radii = self._scaled_radii()
        content = raised(self._radii, 3) * (4 * np.pi / 3) * (measured.volumes.sum() / domain.volume)
        missing = np.clip(content / np.maximum(measured.volumes, 1e-9 * content), 0.5, 2.0)
        steps = raised(cube_roots(missing), 2) - 1
        self._weights = self._weights + _SWELLING * self._radii * self._radii * self._stiffness * steps
        found = _ratios(self._boxes)
        ratio = np.clip(self._goals / np.where(found > 0, found, 1.0), 0.7, 1.4)
        self._aims = np.clip(self._aims * (1 + _SLOWLY * (ratio - 1)), 0.05, 1.0)
        wanted = _images(self._drawn.axes, self._aims)
        self._images = _followed(self._images, wanted, _moments(measured), is_there)

    def _regrade(self, cells: Tessellation, kept: NDArray[np.bool_], *, calm: int) -> tuple[Tessellation, float]:
        """Give those that are kept the sizes of the curve; return the cells trimmed to these, and how far they are off.

        A cell that is larger than its size is shrunk to it. The few that lack most of theirs do not count.
        """
        if self._asked is None:
            self._told = self._diameters
            return cells, 0.0
        wish = self._asked.wish
        own = cube_roots(np.maximum(self._measured.volumes, 1e-9 * self._measured.volumes.max()) * (6 / np.pi))
        if self._holes is None or calm > 0 or calm % _SIEVED == 0:
            self._holes = wish.holes(cells.cells) / own if wish is not None and wish.is_sieve else np.ones(len(cells))
        if wish is not None:
            ranked = np.flatnonzero(kept)[np.argsort((self._diameters * self._holes)[kept], kind="stable")]
            ratios = self._holes[ranked]
            self._diameters = self._diameters.copy()
            self._diameters[ranked] = wish.draw(ranked.size, ratios, tolerance=None) / ratios
        excess = own / self._diameters
        scale = np.sort(excess[kept])[int(_LACKING * np.count_nonzero(kept))]
        factors = np.minimum(1.0, scale / excess)
        vertices = cells.cells.vertices * factors[owners(cells.cells.vertex_offsets), None]
        trimmed = replace(cells.cells, vertices=vertices)
        own = own * factors / scale
        self._told = np.where(kept, self._diameters, own)
        found = Measured(self._holes * own, self._holes, raised(own, 3))
        off = 0.0 if wish is None else wish.deviation(found, kept) / self._asked.tolerance
        return replace(cells, cells=trimmed), off

    def _off(self, kept: NDArray[np.bool_]) -> float:
        """Return how far the proportions of those that are kept are off over what is allowed."""
        found, goals = _ratios(self._boxes)[kept], self._goals[kept]
        means = np.abs(found.mean(axis=0) / goals.mean(axis=0) - 1).max() / NEAR
        if self._forms.classes is None:
            return float(means)
        n = int(kept.sum())
        kinds = self._forms.kinds_of(found)
        has, asked = np.bincount(kinds[kinds >= 0], minlength=self._shares.size), self._forms.shares * n
        # A class is had to within a grain, however few it has.
        return float(max(means, (np.abs(has - asked) / np.maximum(SHARE * asked, 1.0)).max()))

    def _scaled_radii(self) -> Floats:
        """Return the radii [m] of the spheres that would fill the domain."""
        cubes = raised(self._diameters, 3)
        return np.asarray(cube_roots(cubes * (3 / (4 * np.pi) * self._domain.volume / cubes.sum())))


def _ratios(boxes: Floats) -> Floats:
    """Return b/a and c/b of boxes, shape (n, 2); zeros where there is none."""
    with np.errstate(invalid="ignore"):
        found = boxes[:, 1:] / boxes[:, :2]
    return np.where(np.isfinite(found), found, 0.0)


def _images(axes: Floats, ratios: Floats) -> Floats:
    """Return the squares of maps that make such ellipsoids of balls of their volume, shape (n, 3, 3)."""
    low, high = ratios.T
    a = 1 / cube_roots(low * low * high)
    squares = np.column_stack([a, a * low, a * low * high])
    squares = squares * squares
    return np.asarray(sum(squares[:, k, None, None] * axes[:, k, :, None] * axes[:, k, None, :] for k in range(3)))


def _moments(measured: Integrals) -> Floats:
    """Return the second moments of each cell about its centroid, scaled to determinant one."""
    inertias = measured.inertias
    half = 0.5 * (inertias[:, 0, 0] + inertias[:, 1, 1] + inertias[:, 2, 2])
    return unit(half[:, None, None] * np.eye(3) - inertias)


def _followed(images: Floats, wanted: Floats, had: Floats, is_there: NDArray[np.bool_]) -> Floats:
    """Return images that were stretched by part of what is missing, and lean to what is wanted."""
    off = product(wanted, inverse(np.where(is_there[:, None, None], had, np.eye(3))))
    step = np.eye(3) + _FOLLOWING * (off - np.eye(3))
    moved = unit(product(product(step, images), step.transpose(0, 2, 1)))
    moved = np.where(is_there[:, None, None], moved, wanted)
    moved = (1 - _LEAK) * moved + _LEAK * wanted
    return unit(0.5 * (moved + moved.transpose(0, 2, 1)))
