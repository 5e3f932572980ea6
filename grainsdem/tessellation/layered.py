"""Beds in layers, each with a grading of its own: cells of one tessellation, so that they fill space across interfaces.

Every layer has as many seeds as grains of its sizes fill it, and every cell its own volume: the cells of a layer fill
the layer, and its interface lies where it was asked for, as rough as one grain.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.model import Domain, Grading, Tessellation
from grainsdem.points.poisson import poisson
from grainsdem.roots import raised
from grainsdem.tessellation.graded import SHARPEST, GradedCells, Rounds, Wish, regraded
from grainsdem.tessellation.sized import Law, sized_cells

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from grainsdem.tessellation.metric import Metric

    Floats = NDArray[np.float64]

TOLERANCE = 0.02
"""Largest difference, as a share of a layer's mass, of its curve from the one asked for."""

SAMPLE = 4096
"""Grains that a curve's mean volume is taken of."""

LEAST = 8
"""Grains of a layer: fewer have no curve."""


@dataclass(frozen=True, slots=True)
class Layer:
    """One layer of a bed.

    Parameters
    ----------
    curve : Grading, or a frozen distribution of scipy.stats
        Percent passing by mass, or a law of diameters [m] by number.
    thickness : float
        How thick it is beside the others: its share of the sum of all.

    Raises
    ------
    InputError
        If the thickness is not positive and finite.
    """

    curve: Grading | Law
    thickness: float = 1.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.thickness) and self.thickness > 0):
            raise InputError(f"a layer's thickness must be positive and finite; got {self.thickness}")


class LayeredCells(NamedTuple):
    """Cells in layers.

    Parameters
    ----------
    cells : Tessellation
        The cells, those of the lowest layer first.
    diameters : ndarray, shape (n,)
        Equal-volume diameter [m] of the grain of each.
    classes : ndarray of int32, shape (n,)
        The layer of each, from 0 at the bottom.
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
        From the bottom up, along z; along y in a planar domain.
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
        If there is no layer, one is thinner than its largest grain or has too few grains, or a value is out of range.
    ConvergenceError
        If a curve does not come within the tolerance.
    """
    if not layers:
        raise InputError("a bed has a layer or more; got none")
    options = None if tolerance is None else Rounds(keep, tolerance, strict=True, progress=progress).checked()
    generator = np.random.default_rng(rng)
    wishes = [Wish(layer.curve, domain, metric) for layer in layers]
    counts, scale = shares(domain, layers, n)
    parts = strata(domain, layers)
    for k, (count, part, layer) in enumerate(zip(counts, parts, layers, strict=True)):
        up = 1 if domain.is_planar else 2
        largest = float(_sample(layer.curve, domain).max()) * scale
        if part.lengths[up] < largest:
            raise InputError(
                f"layer {k + 1} is thinner than its largest grain: {part.lengths[up]:.4g} of the bed's "
                f"{domain.lengths[up]:.4g} high, and the grain {largest:.4g} in those units; give more grains, or a "
                "thicker layer"
            )
        if count < LEAST:
            raise InputError(f"layer {k + 1} would have {count} of {n} grains, at least {LEAST} are needed")
    seeds = np.concatenate([poisson(part, count, rng=generator) for part, count in zip(parts, counts, strict=True)])
    drawn = [
        generator.permutation(wish.draw(count, None, tolerance=None))
        for wish, count in zip(wishes, counts, strict=True)
    ]
    classes = np.repeat(np.arange(len(layers), dtype=np.int32), counts)
    diameters = np.concatenate(drawn)
    start = sized_cells(domain, diameters, seeds=seeds, tolerance=SHARPEST, relaxations=relaxations, rng=generator)
    if options is None:
        return LayeredCells(start, diameters, classes, np.inf)
    cells, diameters, deviation = regraded(GradedCells(start, diameters, np.inf), wishes, classes, options)
    return LayeredCells(cells, diameters, classes, deviation)


def shares(domain: Domain, layers: Sequence[Layer], n: int) -> tuple[list[int], float]:
    """Return how many of n cells each layer has, and how many times larger cells are than the grains asked for."""
    volumes = np.array([part.volume for part in strata(domain, layers)])
    power = 2 if domain.is_planar else 3
    means = np.array([float(raised(_sample(layer.curve, domain), power).mean()) for layer in layers])
    numbers = volumes / means
    counts = np.maximum(np.rint(n * numbers / numbers.sum()).astype(int), 0).tolist()
    content = float((np.array(counts) * means).sum())
    full = domain.volume / (domain.lengths[2] * np.pi / 4 if domain.is_planar else np.pi / 6)
    return counts, float((full / content) ** (1 / power))


def strata(domain: Domain, layers: Sequence[Layer]) -> list[Domain]:
    """Return the part of a domain that each layer fills, from the bottom up."""
    up = 1 if domain.is_planar else 2
    heights = np.append(0.0, np.cumsum([layer.thickness for layer in layers]))
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
