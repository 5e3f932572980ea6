"""A laboratory's sieve sheet: openings in any unit, what passes or is retained, and the classes that follow from it.

References
----------
.. [1] ASTM E11, Standard specification for woven wire test sieve cloth and test sieves: openings of numbered sieves.
.. [2] W. C. Krumbein, "Application of logarithmic moments to size frequency distributions of sediments", J. Sedimentary
   Petrology 6 (1936) 35-47: φ = -log₂(d / 1 mm).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Self, get_args

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated_noun
from grainsdem.measures.distributions.statistics import MILLIMETRE
from grainsdem.model import Grading
from grainsdem.model.arrays import Noun
from grainsdem.model.grading import Diameter  # noqa: TC001  (the door reads it)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

Unit = Literal["m", "mm", "um", "phi", "astm"]
"""What openings are given in: metres, millimetres, micrometres, φ, or numbers of ASTM E11."""

ASTM = {
    4: 4.75, 5: 4.0, 6: 3.35, 7: 2.8, 8: 2.36, 10: 2.0, 12: 1.7, 14: 1.4, 16: 1.18, 18: 1.0, 20: 0.85, 25: 0.71,
    30: 0.6, 35: 0.5, 40: 0.425, 45: 0.355, 50: 0.3, 60: 0.25, 70: 0.212, 80: 0.18, 100: 0.15, 120: 0.125, 140: 0.106,
    170: 0.09, 200: 0.075, 230: 0.063, 270: 0.053, 325: 0.045, 400: 0.038, 450: 0.032, 500: 0.025, 635: 0.02,
}  # fmt: skip
"""Opening [mm] of each numbered sieve."""

WIDEST_OPEN = 2.0
"""Ratio of the bounds of an open class that none was given for, at most: one φ."""

WHOLE = 100.5
"""Most per cent that passes, or is retained in all: sheets are rounded."""

_METRES = {"m": 1.0, "mm": 1e-3, "um": 1e-6}
_PAN = {"pan", "bottom", "fines"}
_ZERO = {"0", "0.0"}
_INCHES = re.compile(r"""(?:(\d+)[ -])?(?:(\d+)/)?(\d+(?:\.\d+)?)\s*(?:"|''|in(?:ch(?:es)?)?\.?)""")
_NUMBERED = re.compile(r"(?:no\.?|nr\.?|#|mesh)?\s*(\d+)\s*(?:mesh)?", re.IGNORECASE)
_SIGNED = re.compile(r"(?:no\.?|nr\.?|#|mesh)\s*\d+|\d+\s*mesh", re.IGNORECASE)


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class SieveSheet(Noun):
    """Masses in classes of size, the pan and what stays on the widest sieve among them.

    Parameters
    ----------
    bounds : array_like, shape (k + 1,)
        Bounds [m] of the classes, rising, from 0, the pan, to infinity: what `fit_sieves` and `sieve_statistics` take.
    weights : array_like, shape (k,)
        Mass in each class, in any unit.
    """

    bounds: Floats
    weights: Floats

    def __post_init__(self) -> None:
        bounds = self.freeze("bounds", np.float64, None)
        weights = self.freeze("weights", np.float64, max(len(bounds) - 1, 0))
        if len(bounds) < 4:
            raise ShapeError(f"a sheet has two sieves or more; got {max(len(bounds) - 2, 0)}")
        if not (bounds[0] == 0 and np.isinf(bounds[-1]) and (np.diff(bounds) > 0).all()):
            raise InputError(f"bounds must rise from 0 to infinity; got {bounds.tolist()}")
        if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.any()):
            raise InputError(f"weights must be finite, zero or more, and not all zero; got {weights.tolist()}")

    @classmethod
    def from_passing(cls, openings: Sequence[float], passing: Sequence[float]) -> Self:
        """Return the sheet of percentages by mass that pass openings [m], in either order.

        Raises
        ------
        InputError
            If an opening is not above zero or stands twice, or a percentage is out of range or falls.
        """
        sizes, percent = _paired(openings, passing, "passing")
        if percent.min() < 0 or percent.max() > 100:
            raise InputError(f"per cent passing lie from 0 to 100; got {_shown(percent.min(), percent.max())}")
        falls = np.flatnonzero(np.diff(percent) < 0)
        if falls.size:
            k = int(falls[0])
            raise InputError(
                f"per cent passing must not fall from one opening to a wider one; {percent[k]:g} % pass "
                f"{_millimetres(sizes[k])}, {percent[k + 1]:g} % pass {_millimetres(sizes[k + 1])}"
            )
        return cls(np.concatenate([[0.0], sizes, [np.inf]]), np.diff(np.concatenate([[0.0], percent, [100.0]])))

    @classmethod
    def from_retained(cls, openings: Sequence[float], retained: Sequence[float], *, pan: float = 0.0) -> Self:
        """Return the sheet of masses, in any unit, that stay on sieves with openings [m], in either order.

        Raises
        ------
        InputError
            If an opening is not above zero or stands twice, or a mass is negative.
        """
        sizes, masses = _paired(openings, retained, "retained")
        masses = np.append(pan, masses)
        if masses.min() < 0 or not masses.any():
            raise InputError(f"masses retained must be zero or more, and not all zero; got {masses.tolist()}")
        return cls(np.concatenate([[0.0], sizes, [np.inf]]), masses)

    @property
    def passing(self) -> Floats:
        """Per cent by mass that pass each opening, shape (k - 1,)."""
        return np.asarray(100 * np.cumsum(self.weights)[:-1] / self.weights.sum())

    @property
    def openings(self) -> Floats:
        """Openings [m] of the sieves, rising, shape (k - 1,)."""
        return self.bounds[1:-1]

    def grading(
        self, *, finest: float | None = None, widest: float | None = None, diameter: Diameter = "sieve"
    ) -> Grading:
        """Return the curve, its open ends closed.

        Parameters
        ----------
        finest, widest : float, optional
            Size [m] of the finest grain of the pan, and of the coarsest on the widest sieve. Where such a class holds
            something and no bound is given, it is taken to be as wide in φ as the one beside it, one φ at most;
            `open_ends` tells of it.
        diameter : {"sieve", "equal-volume"}
            What the openings are openings for.

        Raises
        ------
        InputError
            If a bound is on the wrong side of its sieve, or is that of a class that holds nothing.
        """
        bounds, w = self.bounds.copy(), self.weights / self.weights.sum()
        lower, upper = self._ends()
        if finest is not None and not (w[0] and 0 < finest < bounds[1]):
            raise InputError(
                f"finest is a size below the last sieve, {_millimetres(bounds[1])}, that something is finer than; "
                f"got {finest:g} m, and {100 * w[0]:.3g} % are finer"
            )
        if widest is not None and not (w[-1] and bounds[-2] < widest < np.inf):
            raise InputError(
                f"widest is a size above the last sieve, {_millimetres(bounds[-2])}, that something stays on; "
                f"got {widest:g} m, and {100 * w[-1]:.3g} % stay"
            )
        bounds[0], bounds[-1] = finest or lower, widest or upper
        held = np.flatnonzero(w)
        first, last = int(held[0]), int(held[-1])
        passing = np.append(0.0, np.cumsum(w[first : last + 1]))
        passing[-1] = 1.0
        return Grading(bounds[first : last + 2], passing, diameter)

    def open_ends(self) -> list[str]:
        """Return a line on each open class that holds something, and how far it is taken to reach."""
        w, (lower, upper) = self.weights / self.weights.sum(), self._ends()
        ends = (
            (w[0], "finer", self.bounds[1], lower, "finest"),
            (w[-1], "coarser", self.bounds[-2], upper, "widest"),
        )
        return [
            f"{100 * share:.3g} % of the mass is {word} than the last sieve, {_millimetres(sieve)}: taken to reach to "
            f"{_millimetres(end)}; {name} says how far it does"
            for share, word, sieve, end, name in ends
            if share > 0
        ]

    def _ends(self) -> tuple[float, float]:
        """Return bounds [m] for the open classes."""
        low, high = self.bounds[1:3], self.bounds[-3:-1]
        return (
            float(low[0] / min(low[1] / low[0], WIDEST_OPEN)),
            float(high[1] * min(high[1] / high[0], WIDEST_OPEN)),
        )


def opening(text: str | float, unit: Unit = "mm") -> float:
    """Return the opening [m] of a sieve; 0 of the pan.

    Parameters
    ----------
    text : str or float
        A number in the unit, ``"pan"``, or a name that has its unit with it: ``"No. 40"``, ``"#40"``, ``"3/8 in"``,
        ``"0.5 mm"``, ``"250 µm"``.
    unit : {"mm", "m", "um", "phi", "astm"}
        What bare numbers are in.

    Raises
    ------
    InputError
        If it is none of these.

    Examples
    --------
    >>> [opening(sieve) for sieve in (0.25, "No. 60", "250 µm", "pan")]
    [0.00025, 0.00025, 0.00025, 0.0]
    >>> opening(2, "phi")
    0.00025
    """
    word = str(text).strip()
    if word.lower() in _PAN or (unit != "phi" and word in _ZERO):
        return 0.0
    inches = _INCHES.fullmatch(word.lower())
    if inches is not None:
        whole, over, number = inches.groups()
        size = float(number) if over is None else float(over) / float(number)
        return round((float(whole or 0) + size) * 25.4e-3, 9)
    measured = re.fullmatch(r"([-+]?[\d.]+(?:e[-+]?\d+)?)\s*(mm|µm|μm|um|microns?|phi|φ|m)", word, re.IGNORECASE)
    if measured is not None:
        name = measured[2].lower()
        kind: Unit = "phi" if name in ("phi", "φ") else "um" if name[0] in "µμu" or "micron" in name else _as_unit(name)
        return opening(measured[1], kind)
    if unit == "astm" or _SIGNED.fullmatch(word):
        numbered = _NUMBERED.fullmatch(word.removesuffix(".0"))
        if numbered is None or int(numbered[1]) not in ASTM:
            raise InputError(f"{word!r} is no sieve of ASTM E11; numbers are {', '.join(map(str, ASTM))}")
        return ASTM[int(numbered[1])] * MILLIMETRE
    try:
        value = float(word)
    except ValueError:
        raise InputError(f"{word!r} is no opening; give a number in {unit}, or a name such as 'No. 40'") from None
    return float(2.0**-value * MILLIMETRE) if unit == "phi" else value * _METRES[unit]


def _as_unit(name: str) -> Unit:
    return "m" if name == "m" else "mm"


def check_unit(unit: str) -> None:
    """Raise `InputError` unless openings may be given in the unit."""
    if unit not in get_args(Unit):
        raise InputError(f"unit must be one of {', '.join(get_args(Unit))}; got {unit!r}")


def _paired(openings: Sequence[float], values: Sequence[float], name: str) -> tuple[Floats, Floats]:
    """Return openings, rising, and the value of each."""
    sizes, told = np.asarray(openings, dtype=np.float64), np.asarray(values, dtype=np.float64)
    if sizes.ndim != 1 or sizes.shape != told.shape:
        raise ShapeError(f"there must be one number {name} for each opening; got {told.size} for {sizes.size}")
    if sizes.size < 2:
        raise ShapeError(f"a sheet has two sieves or more; got {sizes.size}")
    bad = sizes[~(np.isfinite(sizes) & (sizes > 0))]
    if bad.size:
        raise InputError(f"openings must be above zero; got {_shown(*bad[:5])} m")
    if not np.isfinite(told).all():
        raise InputError(f"what is {name} must be finite; got {told.tolist()}")
    order = np.argsort(sizes, kind="stable")
    sizes, told = sizes[order], told[order]
    alike = sizes[1:][np.diff(sizes) <= 1e-9 * sizes[1:]]
    if alike.size:
        raise InputError(f"no two sieves are alike; got {_millimetres(alike[0])} twice")
    return sizes, told


def _millimetres(size: float) -> str:
    return f"{size * 1e3:.4g} mm"


def _shown(*values: float) -> str:
    return ", ".join(f"{value:g}" for value in dict.fromkeys(values))
