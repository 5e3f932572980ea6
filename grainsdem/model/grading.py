"""A grading: the curve of percent passing by mass that a laboratory's sieves give, and grains that have it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol, Self, get_args

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated_noun
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.model.arrays import Noun
from grainsdem.roots import raised

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]
    Counts = NDArray[np.int64]

Diameter = Literal["equal-volume", "sieve"]
"""Which diameter a curve is of: of the sphere of equal volume, or of the square hole that a grain passes."""

MARGIN = 5e-3
"""How far sizes stay from a sieve's opening, relative to it: the cells' volumes are not exact, and a grain that passes
the wrong sieve takes its whole mass along. A tenth of a class at most."""

DIGITS = 9
"""Digits of the sizes that are drawn: the last bits of exp and log differ from one processor to another."""

SMALLEST = 1e-9
"""Size [m] below which nothing is a grain, and its inverse above which nothing is."""

SLACK = 0.3
"""How much larger or smaller, in all, the grains may be than the mean of the curve has them, so that each class holds a
whole number."""

TAIL = 5e-3
"""Share of the mass that is left out at either end of a distribution that has no end."""

CLASSES = 32
"""Classes that a distribution is told by: lines between their bounds are within 0.1 % of the mass of a normal one, and
within 0.3 % of one with long tails."""

STEEPEST = 80.0
"""Exponent of sizes within a class from which all but none of them lie at one of its ends."""


class Distribution(Protocol):
    """A distribution of sizes: any of ours, or a frozen one of `scipy.stats`."""

    def cdf(self, sizes: Floats, /) -> Floats:
        """Return the share that is smaller than sizes [m]."""
        ...


REACH = 0.015
"""Part of a class's width, on a logarithmic scale, that grains do not reach at its ends."""

Classes = tuple["Floats", "Floats", "Floats"]
"""Lower and upper bounds [m] of the classes that hold something, and their shares of the mass."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Grading(Noun):
    """Percent passing by mass at each opening of a set of sieves.

    Between two openings the curve is a line over the logarithm of the size, as in Folk and Ward's method.

    Parameters
    ----------
    openings : array_like, shape (k,)
        Sizes [m], rising, two or more.
    passing : array_like, shape (k,)
        Share of the mass that is finer than each, from 0 at the first to 1 at the last.
    diameter : {"equal-volume", "sieve"}
        Which diameter the curve is of: that of the sphere of equal volume (planar: the circle of equal area), or the
        smallest square hole that a grain passes, turned as it may be (planar: the narrowest slit).

    Raises
    ------
    InputError
        If openings do not rise, the shares fall or do not go from 0 to 1, or the diameter is unknown.
    """

    openings: Floats
    passing: Floats
    diameter: Diameter = "equal-volume"

    def __post_init__(self) -> None:
        openings = self.freeze("openings", np.float64, None)
        passing = self.freeze("passing", np.float64, len(openings))
        if len(openings) < 2:
            raise ShapeError(f"a grading has two openings or more; got {len(openings)}")
        if not (np.isfinite(openings).all() and openings[0] > 0 and (np.diff(openings) > 0).all()):
            raise InputError(f"openings must be above zero and rise, all unlike; got {openings.tolist()}")
        falls = np.flatnonzero(~(np.diff(passing) >= 0))
        if falls.size:
            raise InputError(f"what passes must not fall from one opening to a wider one; it does at {told(falls)}")
        if passing[0] != 0 or passing[-1] != 1:
            raise InputError(
                f"what passes goes from 0 at the finest opening to 1 at the widest; got {passing[0]:g} and "
                f"{passing[-1]:g}"
            )
        if self.diameter not in get_args(Diameter):
            raise InputError(f"diameter must be 'equal-volume' or 'sieve'; got {self.diameter!r}")

    @classmethod
    def of(cls, distribution: Distribution, *, diameter: Diameter = "equal-volume", tail: float = TAIL) -> Self:
        """Return the curve of a distribution of sizes by mass, its tails cut.

        Parameters
        ----------
        distribution : object with a method ``cdf``
            Share of the mass that is finer than sizes [m]: a fit's ``distribution``, or a frozen one of scipy.stats.
        diameter : {"equal-volume", "sieve"}
            What its sizes are.
        tail : float
            Share of the mass that is left out at either end, above 0: grains without end in size are without number.

        Raises
        ------
        InputError
            If it has no such share of mass above zero, or ``tail`` is out of range.
        """
        if not 0 < tail < 0.5:
            raise InputError(f"tail must lie between 0 and 0.5; got {tail}")
        ends = [_quantile(distribution, share) for share in (tail, 1 - tail)]
        openings = np.geomspace(ends[0], ends[1], CLASSES + 1)
        passing = np.asarray(distribution.cdf(openings), dtype=np.float64)
        passing = (passing - passing[0]) / (passing[-1] - passing[0])
        passing[-1] = 1.0
        return cls(openings, np.maximum.accumulate(passing), diameter)

    def passing_at(self, sizes: ArrayLike) -> Floats:
        """Return the share of the mass that is finer than each size [m], shape (...)."""
        with np.errstate(divide="ignore"):
            logarithms = np.log(np.maximum(np.asarray(sizes, dtype=np.float64), 0.0))
        return np.asarray(np.interp(logarithms, np.log(self.openings), self.passing))

    def percentile(self, percent: ArrayLike) -> Floats:
        """Return the size [m] that a percentage of the mass is finer than, shape (...)."""
        share = 0.01 * np.asarray(percent, dtype=np.float64)
        if not ((share >= 0) & (share <= 1)).all():
            raise InputError(f"percentages lie from 0 to 100; got {np.asarray(percent).tolist()}")
        # Where the curve is level, between the two sides of a gap, the middle of it.
        logarithms = np.log(self.openings)
        low = np.interp(share, self.passing, logarithms)
        high = -np.interp(-share, -self.passing[::-1], -logarithms[::-1])
        return np.asarray(np.exp(0.5 * (low + high)))

    def toward(self, other: Grading, share: float) -> Grading:
        """Return the curve on the way to another: each percentile's logarithm that share of the way, from 0 to 1.

        Raises
        ------
        InputError
            If the share is out of range, or the curves are of unlike diameters.
        """
        if not 0 <= share <= 1:
            raise InputError(f"a share of the way lies from 0 to 1; got {share}")
        if self.diameter != other.diameter:
            raise InputError(f"the curves are of unlike diameters: {self.diameter} and {other.diameter}")
        marks = np.unique(np.concatenate([self.passing, other.passing]))
        own, their = (np.log(curve.percentile(100 * marks)) for curve in (self, other))
        sizes = _rounded(np.exp((1 - share) * own + share * their))
        is_new = np.append(True, np.diff(sizes) > 0)
        return Grading(sizes[is_new], np.append(marks[is_new][:-1], 1.0), self.diameter)

    def deviation(self, sizes: Floats, masses: Floats) -> float:
        """Return the largest difference of the curve of grains from this one at any opening, as a share of the mass.

        Parameters
        ----------
        sizes : ndarray, shape (n,)
            Diameters [m] of the grains, of the kind that the curve is of.
        masses : ndarray, shape (n,)
            Their masses, in any unit.
        """
        if not (np.isfinite(masses).all() and (masses >= 0).all() and masses.any()):
            raise InputError("masses must be finite, zero or more, and not all zero")
        order = np.argsort(sizes, kind="stable")
        running = np.append(0.0, np.cumsum(masses[order]))
        passed = running[np.searchsorted(sizes[order], self.openings, side="left")] / running[-1]
        return float(np.abs(passed - self.passing).max())

    def draw(self, n: int, *, power: int = 3, ratios: Floats | None = None, tolerance: float | None = 0.0) -> Floats:
        """Return the sizes [m] of n grains whose masses have this curve at every opening, rising, shape (n,).

        Parameters
        ----------
        n : int
            How many grains.
        power : int
            How mass goes with size: 3, or 2 in a plane.
        ratios : ndarray, shape (n,), optional
            Size of each grain over its equal-volume diameter, in the order of their sizes; ones where not given.
        tolerance : float, optional
            Largest deviation, as a share of the mass, where the curve cannot be had exactly; None for whatever is
            nearest.

        Raises
        ------
        InputError
            If the curve cannot be had: a class's share of the mass is no whole number of grains.

        Notes
        -----
        A class with the share p of the mass M holds whole grains, and these weigh p M in all: how many there are
        follows from the curve, and within a class sizes lean to either side until the sum is right. Where a class's
        share is less than one grain of it, it is taken together with the class beside it.
        """
        if n < 1:
            raise InputError(f"the number of grains must be 1 or more; got {n}")
        if power not in (2, 3):
            raise InputError(f"power must be 3, or 2 in a plane; got {power}")
        allow_memory(n, A_SEED, "grains")
        if ratios is not None and not (ratios.shape == (n,) and np.isfinite(ratios).all() and (ratios > 0).all()):
            raise InputError(f"ratios must be {n} finite numbers above zero, one a grain; got shape {ratios.shape}")
        shape = np.ones(n) if ratios is None else ratios
        mean = float((1 / raised(shape, power)).mean())
        classes = self._classes()
        found = _counts(n, classes, power, mean)
        while found is None and len(classes[0]) > 1:
            classes = _joined(n, classes, power, mean)
            found = _counts(n, classes, power, mean)
        low, high, shares = classes
        if found is None:
            sizes = np.full(n, np.sqrt(low[0] * high[0]))
        else:
            total, counts = found
            ends = np.cumsum(counts)
            parts = [
                _leaning((a, b), share * total, shape[end - count : end], power)
                for a, b, share, count, end in zip(low, high, shares, counts.tolist(), ends.tolist(), strict=True)
            ]
            sizes = _rounded(np.concatenate(parts))
        if tolerance is not None:
            # 1e-4: masses within a class are as exact as halving makes them, and its bounds let them be.
            off = self.deviation(sizes, raised(sizes / shape, power))
            if off > max(tolerance, 1e-4):
                raise InputError(self._too_few(n, off, power))
        return sizes

    def _too_few(self, n: int, off: float, power: int) -> str:
        """Return why so many grains cannot have the curve, and how many can."""
        low, high, shares = classes = self._classes()
        worst = int(np.argmax(raised(low, power) / shares))
        return (
            f"{n} grains are too few for this grading, and come within {100 * off:.2g} % of it: "
            f"{100 * shares[worst]:.3g} % of their mass between {low[worst]:.4g} and {high[worst]:.4g} m is no whole "
            f"number of grains; {_enough(n, classes, power)} grains can have it"
        )

    def _classes(self) -> Classes:
        """Return bounds and shares of the classes that hold something, the margins taken off the bounds."""
        low, high, shares = self.openings[:-1], self.openings[1:], np.diff(self.passing)
        margin = np.minimum(MARGIN, 0.1 * np.log(high / low))
        held = shares > 0
        return (low * (1 + margin))[held], (high * (1 - margin))[held], shares[held]


def _quantile(distribution: Distribution, share: float) -> float:
    """Return the size [m] that a share of a distribution is finer than."""
    low, high = np.log(SMALLEST), -np.log(SMALLEST)
    for _ in range(100):
        middle = 0.5 * (low + high)
        if float(distribution.cdf(np.array([np.exp(middle)]))[0]) < share:
            low = middle
        else:
            high = middle
    if not np.log(SMALLEST) + 1e-6 < low < -np.log(SMALLEST) - 1e-6:
        raise InputError(f"of sizes above zero the distribution has no {100 * share:.3g} % quantile")
    return float(np.exp(0.5 * (low + high)))


def told(classes: Counts) -> str:
    """Return which openings, counted from 1, are meant."""
    return f"number {name_offenders(classes + 2)}"


def _numbers(classes: Classes, power: int) -> Floats:
    """Return how many grains each class holds in a unit of mass, grains of size one having the mass one."""
    low, high, shares = classes
    return np.asarray(shares * (1 / raised(low, power) - 1 / raised(high, power)) / (power * np.log(high / low)))


def _counts(n: int, classes: Classes, power: int, mean: float) -> tuple[float, Counts] | None:
    """Return a mass of which every class can hold its share in whole grains, n in all, and how many each holds.

    Of those that there are it is the one nearest to the curve's own; ``mean`` is the mass of a grain of size one.
    """
    low, high, shares = classes
    numbers = _numbers(classes, power) / mean
    total = n / numbers.sum()
    # Grains that lean to an end as far as they can are still a hundredth of the class from it.
    reach = (high / low) ** REACH
    low, high = low * reach, high / reach
    for step in range(601):
        # 0, +1, -1, +2, …: the nearest first
        away = 0.5 * (step + step % 2) * (1 if step % 2 else -1)
        mass = total * (1 + SLACK * away / 300)
        least = np.ceil(shares * mass / (mean * raised(high, power))).astype(np.int64)
        most = np.floor(shares * mass / (mean * raised(low, power))).astype(np.int64)
        if (least > most).any() or not least.sum() <= n <= most.sum():
            continue
        counts = np.clip(np.rint(numbers * mass).astype(np.int64), least, most)
        # What is missing goes to the classes of many grains, where it changes least.
        for k in np.argsort(-numbers, kind="stable").tolist():
            counts[k] = np.clip(counts[k] + n - counts.sum(), least[k], most[k])
        return mass, counts
    return None


def _joined(n: int, classes: Classes, power: int, mean: float) -> Classes:
    """Return classes of which the one that holds the smallest part of a grain is joined to the finer one beside it."""
    low, high, shares = classes
    mass = n * mean / _numbers(classes, power).sum()
    held = shares * mass / (mean * raised(0.5 * (low + high), power))
    k = max(int(np.argmin(held)), 1)
    joint = np.delete(shares, k)
    joint[k - 1] += shares[k]
    return np.delete(low, k), np.delete(high, k - 1), joint


def _enough(n: int, classes: Classes, power: int) -> int:
    """Return a number of grains that can have the curve, within 2 % of the least there is."""
    while _counts(n, classes, power, 1.0) is None:
        n = int(np.ceil(1.02 * n))
    return n


def _leaning(bounds: tuple[float, float], mass: float, ratios: Floats, power: int) -> Floats:
    """Return rising sizes between two bounds whose masses sum to one that is asked for, as nearly as bounds allow."""
    low, high = bounds
    at = (np.arange(ratios.size) + 0.5) / ratios.size
    width = np.log(high / low)

    def sizes(lean: float) -> Floats:
        if abs(lean) < 1e-9:
            place = at
        elif lean > 0:
            place = 1 + np.log(at + (1 - at) * np.exp(-lean)) / lean
        else:
            place = np.log1p(-at * -np.expm1(lean)) / lean
        return np.asarray(low * np.exp(width * np.clip(place, 0.0, 1.0)))

    below, above = -STEEPEST, STEEPEST
    for _ in range(60):
        lean = 0.5 * (below + above)
        if raised(sizes(lean) / ratios, power).sum() < mass:
            below = lean
        else:
            above = lean
    return sizes(0.5 * (below + above))


def _rounded(sizes: Floats) -> Floats:
    """Return sizes of so many digits that all processors agree on them."""
    powers = 10.0 ** (DIGITS - 1 - np.floor(np.log10(sizes)))
    return np.asarray(np.rint(sizes * powers) / powers)
