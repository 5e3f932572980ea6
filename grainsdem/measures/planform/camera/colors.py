"""Colours of grains: mixtures of minerals and rocks by name, or of one's own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from grainsdem.errors import name_offenders

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


class Stone(NamedTuple):
    """The colour of a mineral or rock.

    Parameters
    ----------
    color : tuple of float
        Mean red, green and blue, in [0, 1].
    spread : float
        Standard deviation of the logarithm of how bright grains are; an eighth of it is that of each colour besides.
    """

    color: tuple[float, float, float]
    spread: float


STONES = {
    "quartz": Stone((0.76, 0.73, 0.69), 0.08),
    "feldspar": Stone((0.80, 0.66, 0.58), 0.10),
    "biotite": Stone((0.24, 0.23, 0.21), 0.15),
    "granite": Stone((0.66, 0.63, 0.61), 0.08),
    "basalt": Stone((0.27, 0.27, 0.28), 0.12),
    "limestone": Stone((0.71, 0.69, 0.63), 0.08),
    "sandstone": Stone((0.71, 0.61, 0.49), 0.12),
    "red_sandstone": Stone((0.59, 0.37, 0.31), 0.12),
    "quartzite": Stone((0.74, 0.67, 0.61), 0.10),
    "gneiss": Stone((0.55, 0.54, 0.53), 0.10),
    "slate": Stone((0.39, 0.40, 0.42), 0.10),
    "serpentinite": Stone((0.37, 0.41, 0.37), 0.15),
    "chert": Stone((0.53, 0.48, 0.42), 0.20),
    "shell": Stone((0.84, 0.80, 0.76), 0.06),
}
"""Colours of dry surfaces, chosen by eye to be typical of hand specimens; they are not measured."""

HUE = 0.125
"""Spread of each colour by itself over that of all three together: stones differ more in how bright they are."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""What red, green and blue add to how bright a colour is (ITU-R BT.709)."""


def mixture(given: Any) -> Any:
    """Return colours as they are given as a mapping of names to shares, or as rows (red, green, blue, share).

    Parameters
    ----------
    given : str, mapping or sequence
        A name of `STONES`; names and their shares, as a mapping or a text such as ``quartz:0.7,basalt:0.3``; or rows
        (red, green, blue), or (red, green, blue, share), of reflectances from 0 to 1. None stays.

    Raises
    ------
    ValueError
        If it is none of these, a stone is unknown, or a number is out of its range.

    Examples
    --------
    >>> mixture("quartz:3,basalt:1"), mixture([[0.5, 0.4, 0.3]])
    ({'quartz': 3.0, 'basalt': 1.0}, ((0.5, 0.4, 0.3, 1.0),))
    """
    if given is None:
        return None
    if isinstance(given, str):
        given = dict(_named(item) for item in given.split(","))
    if isinstance(given, Mapping):
        unknown = [name for name in given if name not in STONES]
        if unknown:
            raise ValueError(f"stones must be among {', '.join(STONES)}; got {name_offenders(unknown)}")
        _check_shares(list(given.values()))
        return {name: float(share) for name, share in given.items()}
    rows = given.tolist() if isinstance(given, np.ndarray) else given
    if not (isinstance(rows, Sequence) and rows and all(_is_row(row) for row in rows)):
        raise ValueError(
            "colours are a name, names and their shares as quartz:0.7,basalt:0.3, or rows (red, green, blue) or (red, "
            "green, blue, share) of reflectances above 0, at most 1"
        )
    full = tuple((*map(float, row[:3]), float(row[3]) if len(row) == 4 else 1.0) for row in rows)
    _check_shares([row[3] for row in full])
    return full


def drawn_colors(colors: Any, n: int, rng: np.random.Generator) -> Floats:
    """Return colours of the floor and of n grains, shape (n + 1, 3), relative to how bright they are in the mean.

    Parameters
    ----------
    colors : mapping or sequence
        What `mixture` returns.
    n : int
        Number of grains.
    rng : Generator
        Source of randomness.

    Notes
    -----
    In the mean over many grains they are the mixture's mean, which the floor has, too, and whose luminance is 1.
    """
    if isinstance(colors, Mapping):
        stones, shares = [STONES[name] for name in colors], list(colors.values())
    else:
        stones, shares = [Stone(tuple(row[:3]), 0.0) for row in colors], [row[3] for row in colors]
    means, spreads = np.array([stone.color for stone in stones]), np.array([stone.spread for stone in stones])
    weights = np.asarray(shares) / np.sum(shares)
    kinds = np.searchsorted(np.cumsum(weights)[:-1], rng.random(n), side="right")
    spread = spreads[kinds][:, None]
    logs = spread * (rng.standard_normal((n, 1)) + HUE * rng.standard_normal((n, 3)))
    own = means[kinds] * np.exp(logs - 0.5 * (1 + HUE**2) * spread**2)  # so that the mean stays
    mean = weights @ means
    return np.asarray(np.vstack([mean, own]) / (mean @ LUMINANCE))


def _named(item: str) -> tuple[str, float]:
    """Return a stone's name and share from a text such as ``quartz:0.7``, or ``quartz``."""
    name, _, share = item.partition(":")
    try:
        return name.strip(), float(share or 1)
    except ValueError:
        raise ValueError(f"a stone's share is a number, as in quartz:0.7; got {item!r}") from None


def _is_row(row: Any) -> bool:
    if not isinstance(row, Sequence) or isinstance(row, str) or len(row) not in {3, 4}:
        return False
    return all(isinstance(value, int | float) for value in row) and all(0 < value <= 1 for value in row[:3])


def _check_shares(shares: list[Any]) -> None:
    numbers = all(isinstance(share, int | float) and not isinstance(share, bool) for share in shares)
    if not (numbers and shares and all(0 <= share < np.inf for share in shares) and sum(shares) > 0):
        raise ValueError(f"shares must be zero or more, finite, and one above zero; got {shares}")
