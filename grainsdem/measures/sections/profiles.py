"""Sections by depth: how many grains each level shows, and how large they seem."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.bounds import boxes
from grainsdem.geometry.raster.copies import copies
from grainsdem.measures.sections.planes import cut, find_plane
from grainsdem.measures.sections.tables import section_summary

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

FIELDS = ("area", "area_fraction", "n_sections", "n_per_area", "mean_area", "mean_diameter", "d10", "d50", "d90")
"""Columns of `section_profile` after the place: those of `section_summary`."""

MOST = 100_000
"""Levels of a profile by their number alone: of more, which take minutes, the places are to be given."""


@gated
def section_profile(
    packing: Packing,
    places: int | ArrayLike = 32,
    *,
    axis: Literal["x", "y", "z"] = "z",
    progress: Callable[[float], None] | None = None,
) -> NDArray[np.void]:
    """Return the number and the sizes of grains in level sections, one row a level.

    Parameters
    ----------
    packing : Packing
        At least one grain.
    places : int or array_like, shape (m,)
        Number of levels, spread evenly over the bed, or their places [m] along the axis.
    axis : {"x", "y", "z"}
        Along which the levels follow one another.
    progress : callable, optional
        Told the share of levels that are done.

    Returns
    -------
    structured ndarray, shape (m,)
        The place as a column named like the axis, then the columns of `section_summary`, NaN for None.

    Raises
    ------
    InputError
        If there is no grain, the axis is another, there is no level, or one misses the domain.
    """
    if axis not in ("x", "y", "z"):
        raise InputError(f"axis must be 'x', 'y' or 'z'; got {axis!r}")
    if len(packing) == 0:
        raise InputError("a profile needs at least one grain; the packing has none")
    levels = _levels(packing, places, "xyz".index(axis))
    integers = ("n_sections",)
    rows = np.zeros(
        levels.size, dtype=[(axis, float), *((name, int if name in integers else float) for name in FIELDS)]
    )
    rows[axis] = levels
    found = copies(packing, packing.domain.lower, packing.domain.upper)
    for k, level in enumerate(levels.tolist()):
        summary = section_summary(cut(packing, found, *find_plane({axis: level}, None)))
        for name in FIELDS:
            rows[name][k] = np.nan if summary[name] is None else summary[name]
        if progress is not None:
            progress((k + 1) / levels.size)
    return rows


def _levels(packing: Packing, places: int | ArrayLike, axis: int) -> NDArray[np.float64]:
    if np.ndim(places) > 0:
        levels: NDArray[np.float64] = np.asarray(places, dtype=np.float64)
        if levels.ndim != 1 or levels.size == 0 or not np.isfinite(levels).all():
            raise InputError(f"places must be finite, in one row, and one at least; got shape {levels.shape}")
        return levels
    n = int(places)  # type: ignore[arg-type]  # no array, so a number
    if not 1 <= n <= MOST:
        raise InputError(f"places must be from one to {MOST} levels; got {n}")
    domain = packing.domain
    if domain.periodic[axis]:
        low, high = float(domain.lower[axis]), float(domain.upper[axis])
    else:
        lower, upper = boxes(packing)
        low = max(float(lower[:, axis].min()), float(domain.lower[axis]))
        high = min(float(upper[:, axis].max()), float(domain.upper[axis]))
    return np.asarray(low + (np.arange(n) + 0.5) * ((high - low) / n), dtype=np.float64)
