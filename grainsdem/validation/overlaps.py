"""No two grains overlap: by a separating plane with an error bound, else by the volume that they share."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.bounds import near_images
from grainsdem.geometry.integrals import integrate
from grainsdem.geometry.selection import select
from grainsdem.geometry.separation import bodies, certify, measure_near, offsets_between
from grainsdem.model import Check, Packing
from grainsdem.validation.intersections import intersection_volumes

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.geometry.separation import Bodies

    Floats = NDArray[np.float64]

SOFT = "soft contacts of a settled packing overlap slightly: allow them with a larger overlap, such as 1e-3"

SOFTEST = 0.05
"""Overlaps beyond this, in d or of the smaller volume, are no soft contacts."""

NEGLIGIBLE = 1e-9
"""Bound of a shared volume, relative to the smaller grain's, below which a pair is not measured."""

SEARCH = 0.05
"""How far, relative to d, the smallest gap is searched for."""


def check_overlaps(
    packing: Packing,
    sound: NDArray[np.bool_],
    d: float,
    *,
    overlap: float,
    depth: float,
    method: str,
    progress: Callable[[int, int], None] | None,
) -> list[Check]:
    """Return the checks of pairs: distinct, overlaps, overlap depth, smallest gap.

    Parameters
    ----------
    packing : Packing
        Any packing.
    sound : ndarray of bool, shape (n,)
        Grains that have an inside and an outside; the others are left out.
    d : float
        Length [m] that depths and gaps are relative to.
    overlap, depth : float
        What is allowed (see `grainsdem.validation.validate`).
    method : str
        ``"planes"`` or ``"manifold3d"``.
    progress : callable or None
        Called with the number of pairs that manifold3d has done and of all.
    """
    rows = np.flatnonzero(sound)
    packing = take(packing, rows)
    solids = bodies(packing)
    pairs, shifts = near_images(packing)
    between = offsets_between(packing, pairs, shifts)
    # 1e-9 d: two grains at one place, whatever their shapes.
    is_same = (np.abs(between) <= 1e-9 * d).all(axis=1)
    fractions, note = _share_volumes(
        packing, solids, pairs, between, overlap=overlap, method=method, length=d, progress=progress
    )
    is_over = ~(fractions <= overlap)
    left_out = int((~sound).sum())
    if left_out:
        note = f"{note}; {left_out} unsound grains left out"
    worst = float(np.nanmax(fractions, initial=0.0))
    if overlap < worst < SOFTEST:
        note = f"{note}; {SOFT}"
    return [
        Check(
            "distinct", not is_same.any(), float(is_same.sum()), 0.0, "pairs in one place", _names(rows[pairs[is_same]])
        ),
        Check(
            "overlaps", not is_over.any(), worst, overlap, "of the smaller volume", _names(rows[pairs[is_over]]), note
        ),
        *_check_gaps(packing, solids, rows, d, depth),
    ]


def take(packing: Packing, rows: NDArray[np.int64]) -> Packing:
    """Return the chosen grains of a packing, without their links."""
    if rows.size == len(packing):
        return packing
    return Packing(
        select(packing.grains, rows)[0],
        packing.positions[rows],
        packing.quaternions[rows],
        packing.densities[rows],
        packing.domain,
        frictions=packing.frictions_of(rows),
        classes=packing.classes_of(rows),
    )


def _share_volumes(
    packing: Packing,
    solids: Bodies,
    pairs: NDArray[np.int32],
    between: Floats,
    *,
    overlap: float,
    method: str,
    length: float,
    progress: Callable[[int, int], None] | None,
) -> tuple[Floats, str]:
    """Return the volume that each pair shares, or a bound of it, relative to the smaller grain's; and how it was found.

    Notes
    -----
    Where a plane leaves an overlap no thicker than s, it has no more volume than s times the grain's section, and
    a convex body's section is at most half of its surface.
    """
    if not len(pairs):
        return np.zeros(0), "no boxes of grains meet"
    sizes = integrate(packing.grains)
    smaller = sizes.volumes[pairs].min(axis=1)
    fractions = np.full(len(pairs), np.inf)
    if method == "planes":
        _, margins = certify(solids, pairs, between)
        fractions = np.maximum(-margins, 0.0) * 0.5 * sizes.areas[pairs].min(axis=1) / smaller
    # What is allowed to overlap is measured all the same: the bound of a plane says little of how much.
    rest = np.flatnonzero(~(fractions <= min(overlap, NEGLIGIBLE)))
    found = intersection_volumes(packing.grains, solids, pairs[rest], between[rest], length=length, progress=progress)
    fractions[rest] = found / smaller[rest]
    refused = int(np.isnan(found).sum())
    note = f"{len(pairs)} pairs of boxes meet: {len(pairs) - rest.size} proven by planes, {rest.size} by manifold3d"
    return fractions, f"{note}; {refused} not accepted by manifold3d" if refused else note


def _check_gaps(packing: Packing, solids: Bodies, rows: NDArray[np.int64], d: float, depth: float) -> list[Check]:
    """Return the checks of the deepest overlap and of the smallest gap."""
    pairs, shifts = near_images(packing, SEARCH * d)
    near, measured = measure_near(packing, solids, pairs, shifts, SEARCH * d)
    pairs, gaps = pairs[near], measured.gaps
    is_deep = gaps < -depth * d
    deepest = max(0.0, -float(gaps.min(initial=0.0)))
    smallest = float(gaps.min(initial=np.inf)) / d
    found = np.isfinite(smallest)
    note = (
        "for information; negative is the depth of an overlap" if found else f"no two grains are nearer than {SEARCH} d"
    )
    return [
        Check("overlap depth", not is_deep.any(), deepest / d, depth, "d", _names(rows[pairs[is_deep]]),
              SOFT if depth < deepest / d < SOFTEST else ""),
        Check("smallest gap", True, smallest if found else SEARCH, 0.0, "d", (), note),
    ]  # fmt: skip


def _names(pairs: NDArray[np.int64]) -> tuple[tuple[int, int], ...]:
    """Return pairs of ids, each once."""
    return tuple((i, j) for i, j in np.unique(pairs, axis=0).tolist())
