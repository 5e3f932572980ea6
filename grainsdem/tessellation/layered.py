"""Beds in layers and lenses, each with a grading of its own: cells of one tessellation, so that they fill space.

Every part of the bed has as many seeds as grains of its sizes fill it, and every cell its own volume: the cells of a
part fill it, and its interface lies where it was asked for, as rough as one grain.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated, gated_noun
from grainsdem.memory import allow_cells
from grainsdem.model import Domain, Grading, Tessellation
from grainsdem.points.poisson import poisson
from grainsdem.roots import raised
from grainsdem.tessellation.graded import SHARPEST, GradedCells, Rounds, Wish, regraded
from grainsdem.tessellation.lloyd import check_rounds
from grainsdem.tessellation.sized import Law, sized_cells

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from numpy.typing import NDArray

    from grainsdem.tessellation.lenses import Lens
    from grainsdem.tessellation.metric import Metric

    Floats = NDArray[np.float64]

TOLERANCE = 0.02
"""Largest difference, as a share of a layer's mass, of its curve from the one asked for."""

SAMPLE = 4096
"""Grains that a curve's mean volume is taken of."""

LEAST = 8
"""Grains of a layer: fewer have no curve."""


GRADUAL = 6
"""Most steps that a curve takes from the bottom of a layer to its top: each is as thick as its largest grain."""

WHOLE = 3
"""Steps have so many times the fewest grains of a layer: their curves are made of fewer."""


@gated_noun
@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a bed, or a lens in it.

    Parameters
    ----------
    curve : Grading, or a frozen distribution of scipy.stats
        Percent passing by mass, or a law of diameters [m] by number.
    thickness : float
        How thick it is beside the others: its share of the sum of all. Of a lens it says nothing.
    top : Grading, optional
        The curve at the layer's top, where ``curve`` is that at its bottom: every percentile goes from one to the
        other, as its logarithm, in steps as thick as a grain, six at most.
    lens : Lens, optional
        Where it lies, if it is no layer but replaces what is there; a later one replaces an earlier one.

    Raises
    ------
    InputError
        If the thickness is not positive and finite, or a lens has a ``top``, or curves are not of one diameter.
    """

    curve: Grading | Law
    thickness: float = 1.0
    top: Grading | None = None
    lens: Lens | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise InputError(f"a layer's thickness must be positive and finite; got {self.thickness}")
        if self.top is None:
            return
        if self.lens is not None:
            raise InputError("a lens has one curve: leave out top")
        if not isinstance(self.curve, Grading) or self.curve.diameter != self.top.diameter:
            raise InputError("a layer whose curve changes has two gradings of one diameter")


class Part(NamedTuple):
    """A part of a bed that has one curve.

    Parameters
    ----------
    layer : int
        The layer or lens that it belongs to.
    curve : Grading or Law
        Its curve.
    volume : float
        What it fills [m³].
    height : float
        How thick it is [m].
    box : Domain, optional
        The stratum that it fills, but for what lies in ``above``.
    lens : Lens, optional
        The lens that it is instead.
    above : tuple of Lens
        Lenses that replace what is in it.
    """

    layer: int
    curve: Grading | Law
    volume: float
    height: float
    box: Domain | None
    lens: Lens | None
    above: tuple[Lens, ...]

    def seeds(self, domain: Domain, n: int, rng: np.random.Generator) -> Floats:
        """Return n seeds [m] at random in the part, shape (n, 3)."""
        if self.box is not None and not self.above:
            return poisson(self.box, n, rng=rng)
        found = [np.empty((0, 3))]
        while sum(map(len, found)) < n:
            if self.box is not None:
                points = poisson(self.box, n, rng=rng)
                is_own = ~np.any([other.contains(points, domain) for other in self.above], axis=0)
            else:
                assert self.lens is not None  # noqa: S101  (a part is a stratum or a lens)
                points = self.lens.places(rng.random((n, 3)), domain)
                is_own = self.lens.is_own(points, domain, self.above)
            found.append(points[is_own])
        return np.concatenate(found)[:n]


class LayeredCells(NamedTuple):
    """Cells in layers.

    Parameters
    ----------
    cells : Tessellation
        The cells, those of the lowest layer first.
    diameters : ndarray, shape (n,)
        Equal-volume diameter [m] of the grain of each.
    classes : ndarray of int32, shape (n,)
        The layer or lens of each, from 0 at the bottom, as they were given.
    deviation : float
        Largest difference, as a share, of a layer's curve from the one asked for.
    """

    cells: Tessellation
    diameters: Floats
    classes: NDArray[np.int32]
    deviation: float


@gated
def layered_cells(
    domain: Domain,
    layers: Sequence[Layer],
    *,
    n: int,
    keep: Literal["inside", "all"] = "inside",
    tolerance: float | None = TOLERANCE,
    relaxations: int = 5,
    metric: Metric | None = None,
    rng: np.random.Generator | int | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> LayeredCells:
    """Return Laguerre cells in level layers, of which those that are kept have each layer's grading.

    Parameters
    ----------
    domain : Domain
        What the cells fill.
    layers : sequence of Layer
        From the bottom up, along z; along y in a planar domain. Lenses may stand anywhere among them.
    n : int
        Number of cells in all. How many each layer has follows from its thickness and its grains.
    tolerance : float, optional
        Largest difference, as a share of a layer's mass, of its curve from the one asked for; None for whatever the
        first round gives.
    keep, relaxations, metric, rng, progress
        See `graded_cells`.

    Raises
    ------
    InputError
        If there is no layer, one is thinner than its largest grain or has too few grains, a lens lies outside of the
        domain, or a value is out of range.
    ConvergenceError
        If a curve does not come within the tolerance.
    """
    if not layers:
        raise InputError("a bed has a layer or more; got none")
    allow_cells(n)
    check_rounds("relaxations", relaxations)
    options = None if tolerance is None else Rounds(keep, tolerance, strict=True, progress=progress).checked()
    generator = np.random.default_rng(rng)
    parts = parts_of(domain, layers, n)
    counts, scale = shares(domain, parts, n)
    _refuse_thin(domain, parts, counts, scale, n)
    if metric is not None and any(layer.lens is not None for layer in layers):
        raise InputError("a lens lies in space that is not stretched: leave out the axes, or the lens")
    wishes = [Wish(part.curve, domain, metric) for part in parts]
    seeds = np.concatenate([part.seeds(domain, count, generator) for part, count in zip(parts, counts, strict=True)])
    drawn = [
        generator.permutation(wish.draw(count, None, tolerance=None))
        for wish, count in zip(wishes, counts, strict=True)
    ]
    groups = np.repeat(np.arange(len(parts), dtype=np.int32), counts)
    classes = np.array([part.layer for part in parts], dtype=np.int32)[groups]
    diameters = np.concatenate(drawn)
    start = sized_cells(domain, diameters, seeds=seeds, tolerance=SHARPEST, relaxations=relaxations, rng=generator)
    if options is None:
        return LayeredCells(start, diameters, classes, np.inf)
    cells, diameters, deviation = regraded(GradedCells(start, diameters, np.inf), wishes, groups, options)
    return LayeredCells(cells, diameters, classes, deviation)


def _refuse_thin(domain: Domain, parts: Sequence[Part], counts: list[int], scale: float, n: int) -> None:
    """Raise `InputError` where a part is thinner than a grain, or has too few."""
    up = 1 if domain.is_planar else 2
    for part, count in zip(parts, counts, strict=True):
        name = f"{'layer' if part.lens is None else 'lens'} {part.layer + 1}"
        largest = float(_sample(part.curve, domain).max()) * scale
        if part.height < largest:
            raise InputError(
                f"{name} is thinner than its largest grain: {part.height:.4g} of the bed's "
                f"{domain.lengths[up]:.4g} high, and the grain {largest:.4g} in those units; give more grains, or a "
                f"thicker {name.split(maxsplit=1)[0]}"
            )
        if count < LEAST:
            raise InputError(f"{name} would have {count} of {n} grains, at least {LEAST} are needed")


def parts_of(domain: Domain, layers: Sequence[Layer], n: int) -> list[Part]:
    """Return the parts of a bed of about n grains that have a curve each, in the order of the layers."""
    level = [layer for layer in layers if layer.lens is None]
    if not level:
        raise InputError("a bed has a layer or more besides its lenses; got none")
    lenses = tuple(layer.lens for layer in layers if layer.lens is not None)
    if lenses and domain.is_planar:
        raise InputError("a slab is one grain thick: it has layers, and no lenses")
    boxes = iter(strata(domain, [layer.thickness for layer in level]))
    whole = _strata_parts(domain, layers, lenses, boxes)
    if all(layer.top is None for layer in layers):
        return whole
    for steps in range(GRADUAL, 0, -1):
        found = [step for part in whole for step in _steps(part, layers[part.layer].top, steps, domain, lenses)]
        counts, scale = shares(domain, found, n)
        if all(
            count >= WHOLE * LEAST and part.height >= scale * float(_sample(part.curve, domain).max())
            for part, count in zip(found, counts, strict=True)
            if layers[part.layer].top is not None
        ):
            break
    return found


def _steps(part: Part, top: Grading | None, steps: int, domain: Domain, lenses: tuple[Lens, ...]) -> list[Part]:
    """Return a layer in steps from its curve to the one at its top, or as it is where it has none."""
    if top is None or part.box is None or not isinstance(part.curve, Grading):
        return [part]
    found = []
    for k, box in enumerate(strata(part.box, [1.0] * steps)):
        curve = part.curve.toward(top, (k + 0.5) / steps)
        found.append(Part(part.layer, curve, _left(box, domain, lenses), part.height / steps, box, None, lenses))
    return found


def _strata_parts(
    domain: Domain, layers: Sequence[Layer], lenses: tuple[Lens, ...], boxes: Iterator[Domain]
) -> list[Part]:
    """Return the layers as one part each, and the lenses."""
    up, found, seen = 1 if domain.is_planar else 2, [], 0
    for k, layer in enumerate(layers):
        if layer.lens is None:
            box = next(boxes)
            volume = _left(box, domain, lenses)
            found.append(Part(k, layer.curve, volume, float(box.lengths[up]), box, None, lenses))
            continue
        seen += 1
        volume = layer.lens.volume_in(domain, lenses[seen:])
        if not volume > 0:
            raise InputError(
                f"lens {k + 1} lies outside of the bed, or under a later one: its center is {list(layer.lens.center)}, "
                f"and the bed goes from {domain.lower.tolist()} to {domain.upper.tolist()}"
            )
        found.append(Part(k, layer.curve, volume, 2 * min(layer.lens.half_axes), None, layer.lens, lenses[seen:]))
    return found


def _left(box: Domain, domain: Domain, lenses: tuple[Lens, ...]) -> float:
    """Return the volume [m³] of a stratum that lies in no lens."""
    if not lenses:
        return box.volume
    steps = 64
    units = (np.indices((steps,) * 3).reshape(3, -1).T + 0.5) / steps
    points = box.lower + units * box.lengths
    points = points[box.contains(points)]
    return box.volume * float(np.mean(~np.any([lens.contains(points, domain) for lens in lenses], axis=0)))


def shares(domain: Domain, parts: Sequence[Part], n: int) -> tuple[list[int], float]:
    """Return how many of n cells each part has, and how many times larger cells are than the grains asked for."""
    volumes = np.array([part.volume for part in parts])
    power = 2 if domain.is_planar else 3
    means = np.array([float(raised(_sample(part.curve, domain), power).mean()) for part in parts])
    numbers = volumes / means
    counts = np.maximum(np.rint(n * numbers / numbers.sum()).astype(int), 0).tolist()
    content = float((np.array(counts) * means).sum())
    full = domain.volume / (domain.lengths[2] * np.pi / 4 if domain.is_planar else np.pi / 6)
    return counts, float((full / content) ** (1 / power))


def strata(domain: Domain, thicknesses: Sequence[float]) -> list[Domain]:
    """Return the parts of a domain that layers of such shares of the height fill, from the bottom up."""
    up = 1 if domain.is_planar else 2
    heights = np.append(0.0, np.cumsum(thicknesses))
    bounds = domain.lower[up] + domain.lengths[up] * heights / heights[-1]
    found = []
    for low, high in pairwise(bounds):
        lower, upper = domain.lower.copy(), domain.upper.copy()
        lower[up], upper[up] = low, high
        found.append(Domain(lower, upper, domain.periodic, domain.is_planar, domain.planes))
    return found


def _sample(curve: Grading | Law, domain: Domain) -> Floats:
    """Return sizes [m] of many grains of a curve."""
    if isinstance(curve, Grading):
        return curve.draw(SAMPLE, power=2 if domain.is_planar else 3, tolerance=None)
    return np.asarray(curve.ppf((np.arange(SAMPLE) + 0.5) / SAMPLE), dtype=np.float64)
