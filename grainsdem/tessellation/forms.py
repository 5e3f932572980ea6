"""What forms grains are to have, each its own: Zingg's classes by share, laws of axis ratios, and how grains lie.

References
----------
.. [1] Th. Zingg, "Beitrag zur Schotteranalyse", Schweizerische Mineralogische und Petrographische Mitteilungen 15
   (1935) 39-140.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated_noun
from grainsdem.geometry.rotations import random_quaternions, to_matrices
from grainsdem.memory import allow_memory
from grainsdem.tessellation.metric import frame_along
from grainsdem.tessellation.sized import Law

if TYPE_CHECKING:
    from collections.abc import Mapping

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

Orientation = Literal["uniform", "aligned"]

EQUANT, UNEQUANT = (0.72, 0.88), (0.42, 0.62)
"""Where the ratios of a class lie above and below Zingg's two thirds, evenly: clear of it, and as cells can be."""

ZINGG_BOUND = 2 / 3
"""Ratio of axes that parts Zingg's classes."""

CLASSES = {
    "blade": (UNEQUANT, UNEQUANT),
    "rod": (UNEQUANT, EQUANT),
    "disc": (EQUANT, UNEQUANT),
    "spheroid": (EQUANT, EQUANT),
}
"""Ranges of b/a and c/b of Zingg's classes, by the names that `grainsdem.zingg` has, and in its order."""

LEAST = 0.2
"""Least ratio of two axes: between grains that are flatter and lie any way there is more void than grain."""

_SUM = 1e-6
"""How far from one shares may sum up: rounded to six digits."""

WIDEST = 1.0
"""Largest spread [rad]: grains that are spread wider lie any way."""

_TERMS = 24
"""Terms of the series of sine and cosine: for turns of one and a half times round they are exact."""

_DIGITS = 9
"""Digits of a ratio, so that all processors agree on it."""


A_FORM = 600
"""Bytes that a grain takes while its form is drawn: three axes, two places, and copies."""


class Drawn(NamedTuple):
    """What each of n grains is to be.

    Parameters
    ----------
    kinds : ndarray of int64, shape (n,)
        Its class among those that are asked for.
    places : ndarray, shape (n, 2)
        Probabilities at which its ratios are taken from their laws.
    axes : ndarray, shape (n, 3, 3)
        Unit vectors along its long, middle and short axis, one a row.
    """

    kinds: Ints
    places: Floats
    axes: Floats


@gated_noun
@dataclass(frozen=True, slots=True)
class Forms:
    """Forms of grains: what proportions they have, each its own, and how they lie.

    Parameters
    ----------
    classes : mapping of str to float, optional
        Shares by number, of sum one, of Zingg's classes ``"blade"``, ``"rod"``, ``"disc"`` and ``"spheroid"``. Ratios
        are spread evenly over 0.42 to 0.62 below Zingg's two thirds, and over 0.72 to 0.88 above.
    elongation, flatness : float, or a frozen distribution of scipy.stats, optional
        b/a and c/b of the grains instead, the edges of each one's smallest box with a side on a face: one for all, or a
        law, from 0.2 to 1. One that is not given is 0.8, about what cells have.
    orientation : {"uniform", "aligned"}
        Whether grains lie any way, or about one.
    spread : float
        Of aligned grains: standard deviation [rad] of the turns about each of three axes that part them from the way
        that they lie about.
    trend, dip : float
        Of aligned grains: direction of the long axes, and by how much the flat sides are turned up [rad], see
        `Metric.along`.

    Raises
    ------
    InputError
        If neither or both of classes and ratios are given, shares do not sum up to one, or a value is out of range.

    Notes
    -----
    Of turns by vectors with standard deviation σ in each component, the mean square of the cosine between an axis and
    the one that it is spread about is (7 + 4 (1 - σ²) exp(-σ²/2) + 4 (1 - 4 σ²) exp(-2 σ²)) / 15.
    """

    classes: Mapping[str, float] | None = None
    elongation: float | Law | None = None
    flatness: float | Law | None = None
    orientation: Orientation = "uniform"
    spread: float = 0.0
    trend: float = 0.0
    dip: float = 0.0
    names: tuple[str, ...] = field(init=False, repr=False)
    """Classes that have a share, or none."""

    def __post_init__(self) -> None:
        has_ratios = self.elongation is not None or self.flatness is not None
        if (self.classes is None) != has_ratios:
            raise InputError("forms have classes, or an elongation, a flatness or both")
        if self.classes is not None:
            _check_shares(self.classes)
        for name in ("elongation", "flatness"):
            _check_ratio(name, getattr(self, name))
        if self.orientation not in get_args(Orientation):
            raise InputError(f"orientation must be 'uniform' or 'aligned'; got {self.orientation!r}")
        if not 0 <= self.spread <= WIDEST:
            raise InputError(
                f"spread [rad] lies from 0 to {WIDEST:g}, beyond which grains lie any way; got {self.spread}"
            )
        if self.orientation == "uniform" and (self.spread or self.trend or self.dip):
            raise InputError(
                "grains that lie any way have no spread, trend and dip: leave them out, or align the grains"
            )
        object.__setattr__(self, "names", tuple(name for name, share in (self.classes or {}).items() if share > 0))

    @property
    def shares(self) -> Floats:
        """Share of each kind, shape (k,): of one where there are no classes."""
        found = np.array([self.classes[name] for name in self.names]) if self.classes else np.ones(1)
        return np.asarray(found / found.sum())

    def draw(self, n: int, rng: np.random.Generator) -> Drawn:
        """Return what each of n grains is to be, in random order."""
        if n < 0:
            raise InputError(f"the number of grains must be zero or more; got {n}")
        allow_memory(n, A_FORM, "forms")
        kinds = rng.permutation(np.repeat(np.arange(self.shares.size), _counts(self.shares, n)))
        places = np.column_stack([(rng.permutation(n) + 0.5) / n for _ in range(2)])
        return Drawn(kinds, places, self._axes(n, rng))

    def dealt(self, drawn: Drawn, kept: NDArray[np.bool_], shares: Floats) -> Drawn:
        """Return the same with kinds, by shares, and ratios of those that are kept as they should be; few change."""
        self._hold(drawn, kept)
        if not (shares.shape == self.shares.shape and np.isfinite(shares).all() and (shares >= 0).all()):
            raise InputError(f"shares must be {self.shares.size} finite numbers, zero or more; got {shares.tolist()}")
        rows = np.flatnonzero(kept)
        kinds, places = drawn.kinds.copy(), drawn.places.copy()
        wanted = _counts(shares, rows.size)
        have = np.bincount(kinds[rows], minlength=wanted.size)
        lacking = np.repeat(np.arange(wanted.size), np.maximum(wanted - have, 0))
        spare = [rows[kinds[rows] == k][: max(int(have[k] - wanted[k]), 0)] for k in range(wanted.size)]
        kinds[np.concatenate(spare)] = lacking
        for k in range(wanted.size):
            members = rows[kinds[rows] == k]
            for column in range(2):
                order = members[np.argsort(places[members, column], kind="stable")]
                places[order, column] = (np.arange(order.size) + 0.5) / order.size
        return Drawn(kinds, places, drawn.axes)

    def swapped(self, drawn: Drawn, kept: NDArray[np.bool_], found: Ints) -> Drawn:
        """Return the same with kinds exchanged between kept grains of which each has what is asked of the other."""
        self._hold(drawn, kept)
        if found.shape != kept.shape:
            raise ShapeError(f"found must have one value a grain: {kept.size}; got shape {found.shape}")
        kinds = drawn.kinds.copy()
        for one in range(self.shares.size):
            for other in range(one):
                here = np.flatnonzero(kept & (drawn.kinds == one) & (found == other))
                there = np.flatnonzero(kept & (drawn.kinds == other) & (found == one))
                n = min(here.size, there.size)
                kinds[here[:n]], kinds[there[:n]] = other, one
        return Drawn(kinds, drawn.places, drawn.axes)

    def ratios(self, drawn: Drawn) -> Floats:
        """Return b/a and c/b of each, shape (n, 2)."""
        found = np.empty_like(drawn.places)
        if self.classes is None:
            for column, law in enumerate((self.elongation, self.flatness)):
                found[:, column] = _taken(0.5 * sum(EQUANT) if law is None else law, drawn.places[:, column])
            return found
        for k, name in enumerate(self.names):
            rows = drawn.kinds == k
            for column, (low, high) in enumerate(CLASSES[name]):
                found[rows, column] = low + (high - low) * drawn.places[rows, column]
        return found

    def kinds_of(self, ratios: Floats) -> Ints:
        """Return which of the classes asked for ratios, shape (n, 2), are of; -1 where of none of them."""
        code = 2 * (ratios[:, 0] > ZINGG_BOUND) + (ratios[:, 1] > ZINGG_BOUND)
        known = np.array([self.names.index(name) if name in self.names else -1 for name in CLASSES])
        return np.asarray(known[code])

    def _hold(self, drawn: Drawn, kept: NDArray[np.bool_]) -> None:
        """Raise `ShapeError` unless a mask is of as many grains as are drawn."""
        if kept.dtype != bool or kept.shape != drawn.kinds.shape:
            raise ShapeError(
                f"kept must be a mask of {drawn.kinds.size} grains; got {kept.dtype} of shape {kept.shape}"
            )

    def _axes(self, n: int, rng: np.random.Generator) -> Floats:
        if self.orientation == "uniform":
            # Columns of a rotation are as good as rows.
            return to_matrices(random_quaternions(n, rng))
        base = np.broadcast_to(np.array(frame_along(self.trend, self.dip)), (n, 3, 3))
        if self.spread == 0:
            return np.array(base)
        turns = to_matrices(_turns(rng.standard_normal((n, 3)) * self.spread))
        return np.asarray((turns[:, None, :, :] * base[:, :, None, :]).sum(axis=3))


def mean_square(spread: float) -> float:
    """Return the mean square of the cosine between an axis and the one that it is spread about; see `Forms`."""
    s = spread * spread
    return (7 + 4 * (1 - s) * math.exp(-s / 2) + 4 * (1 - 4 * s) * math.exp(-2 * s)) / 15


def _check_shares(classes: Mapping[str, float]) -> None:
    unknown = [name for name in classes if name not in CLASSES]
    if unknown:
        raise InputError(f"Zingg's classes are {', '.join(CLASSES)}; got {', '.join(map(str, unknown))}")
    values = list(classes.values())
    if not all(math.isfinite(share) and share >= 0 for share in values):
        raise InputError(f"shares of classes must be zero or more and finite; got {values}")
    if not abs(sum(values) - 1) <= _SUM:
        raise InputError(f"shares of classes must sum up to 1; those of {', '.join(classes)} sum up to {sum(values):g}")


def _check_ratio(name: str, value: float | Law | None) -> None:
    ends = np.array([0.5]) if value is None else _taken(value, np.array([1e-3, 0.5, 1 - 1e-3]))
    if not ((ends >= LEAST) & (ends <= 1)).all():
        got = f"a law from {ends[0]:.3g} to {ends[-1]:.3g}" if isinstance(value, Law) else value
        raise InputError(f"{name} of grains that differ lies from {LEAST:g} to 1; got {got}")


def _taken(value: float | Law, places: Floats) -> Floats:
    if isinstance(value, Law):
        return np.asarray(np.round(value.ppf(places), _DIGITS), dtype=np.float64)
    return np.full(places.size, float(value))


def _counts(shares: Floats, n: int) -> Ints:
    """Return the nearest whole numbers to shares of n, of sum n."""
    counts = np.floor(shares * n).astype(np.int64)
    counts[np.argsort(-(shares * n - counts), kind="stable")[: n - int(counts.sum())]] += 1
    return counts


def _turns(vectors: Floats) -> Floats:
    """Return the quaternions of turns about vectors by their lengths [rad], shape (n, 4)."""
    # By their series, for squared half angles: the last bit of sines is the processor's.
    square = 0.25 * (vectors * vectors).sum(axis=1)
    cosine, ratio = np.ones(len(vectors)), np.ones(len(vectors))
    even, odd = np.ones(len(vectors)), np.ones(len(vectors))
    for k in range(1, _TERMS):
        even = -even * square / (2 * k * (2 * k - 1))
        odd = -odd * square / (2 * k * (2 * k + 1))
        cosine, ratio = cosine + even, ratio + odd
    found = np.column_stack([cosine, 0.5 * vectors * ratio[:, None]])
    return np.asarray(found / np.sqrt((found * found).sum(axis=1))[:, None])
