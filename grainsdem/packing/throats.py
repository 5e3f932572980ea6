"""Pore throats of many widths: grains moved at random within their own cells, which is proof against overlap."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from grainsdem.errors import InputError, ShapeError
from grainsdem.gate import gated
from grainsdem.packing.contacts import neighbor_contacts
from grainsdem.packing.inset import slacks
from grainsdem.ragged import owners

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

Strength: TypeAlias = "ArrayLike | Callable[[Floats], ArrayLike]"

_KEPT = 1e-9
"""Share of the slack that is never used, so that rounding cannot take a grain out of its cell."""

_LOWER_Z, _UPPER_Z = -5, -6  # walls as `Domain` numbers them


@gated
def jitter_throats(
    packing: Packing,
    *,
    fraction: float = 1.0,
    strength: Strength = 1.0,
    axes: str = "xyz",
    rng: np.random.Generator | int | None = None,
) -> Packing:
    """Return the packing with some of its grains moved at random, each within its own cell.

    Parameters
    ----------
    packing : Packing
        Grains in the cells that they were carved from, shrunk: what lies between a grain and its cell is its slack.
    fraction : float
        Share of the grains that are moved, in [0, 1]: as many as it rounds to, chosen at random.
    strength : float, array_like, shape (n,), or callable
        How much of its slack a grain may use, in [0, 1]; one value a grain, or a function from positions [m], shape
        (n, 3), to them, where throats are to differ from place to place.
    axes : str
        Coordinates that are changed: one to three of ``"xyz"``. In a planar bed z never is.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    Packing
        The same shapes, so the same porosity of the cells; only positions differ. The last step of its provenance tells
        mean, standard deviation and percentiles of the throats' widths, ``throats_before`` and ``throats_after``.

    Raises
    ------
    InputError
        If the packing does not know its cells, or an option is out of range.
    ShapeError
        If the strengths are not one a grain.

    Notes
    -----
    A grain stays in its cell {x : n_f · x <= d_f} as long as its displacement t has n_f · t <= s_f for every face f,
    s_f its distance to the cell's plane. A direction u is drawn uniformly on the sphere of the chosen axes; along it
    the grain may go from -t₋ to t₊, t₊ = min s_f / (n_f · u) over n_f · u > 0, and it goes to a place drawn uniformly
    between the two, times ``strength``. That is one step of the hit-and-run walk, whose limit is the uniform
    distribution over all places that the grain may have in its cell. Cells do not overlap, so grains cannot.

    References
    ----------
    .. [1] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
       material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, section 2.1.
    .. [2] R. L. Smith, "Efficient Monte Carlo procedures for generating points uniformly distributed over bounded
       regions", Operations Research 32 (1984) 1296-1308.
    """
    if packing.links is None or packing.links.sites is None or packing.links.rooms is None:
        raise InputError("the grains' cells are not known: throats can be changed only between carving and settling")
    if not 0 <= fraction <= 1:
        raise InputError(f"fraction must lie in [0, 1]; got {fraction}")
    strengths = _strengths(packing, strength)
    chosen_axes = _axes(packing, axes)
    generator = np.random.default_rng(rng)
    n = len(packing)
    moved = np.zeros(n, dtype=bool)
    moved[generator.permutation(n)[: round(fraction * n)]] = True
    directions = np.zeros((n, 3))
    directions[:, chosen_axes] = generator.standard_normal((n, len(chosen_axes)))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    back, forth = _reach(packing, directions)
    steps = (-back + generator.random(n) * (back + forth)) * strengths * (1 - _KEPT)
    steps[~moved] = 0.0
    links = replace(packing.links, rooms=packing.links.rooms - np.abs(steps))
    before = throat_widths(packing)
    result = replace(packing, positions=packing.positions + steps[:, None] * directions, links=links)
    after = throat_widths(result)
    return result.with_step(
        "jitter_throats",
        fraction=float(fraction),
        axes="".join("xyz"[k] for k in chosen_axes),
        n_moved=int(moved.sum()),
        mean_strength=float(strengths.mean()),
        throats_before=_spread(before),
        throats_after=_spread(after),
    )


@gated
def throat_widths(packing: Packing) -> Floats:
    """Return the width [m] of every throat, the gap between two facing faces of neighbours, shape (m,).

    Raises
    ------
    InputError
        If the packing no longer knows its neighbours.
    """
    return neighbor_contacts(packing).gaps


def _spread(widths: Floats) -> dict[str, float]:
    """Return how throat widths [m] are distributed; nothing where there are none."""
    if not widths.size:
        return {}
    percentiles = np.percentile(widths, [0, 10, 50, 90, 100])
    named = dict(zip(("min", "d10", "d50", "d90", "max"), percentiles.tolist(), strict=True))
    return {"mean": float(widths.mean()), "std": float(widths.std()), **named}


def _strengths(packing: Packing, strength: Strength) -> Floats:
    values = strength(packing.positions) if callable(strength) else strength
    try:
        strengths = np.broadcast_to(np.asarray(values, dtype=np.float64), (len(packing),))
    except ValueError as error:
        raise ShapeError(f"strength must be one number, or one for each of {len(packing)} grains") from error
    bad = strengths[~((strengths >= 0) & (strengths <= 1))]
    if bad.size:
        raise InputError(f"strength must lie in [0, 1]; got {float(bad[0])}")
    return strengths


def _axes(packing: Packing, axes: str) -> list[int]:
    """Return the numbers of the coordinates that may change."""
    if not axes or set(axes) - set("xyz") or len(set(axes)) != len(axes):
        raise InputError(f"axes must be one to three of 'xyz', each once; got {axes!r}")
    chosen = sorted("xyz".index(axis) for axis in axes)
    if packing.domain.is_planar:
        chosen = [axis for axis in chosen if axis != 2]
        if not chosen:
            raise InputError("the grains of a planar bed move in the plane only: axes must name x or y; got 'z'")
    return chosen


def _reach(packing: Packing, directions: Floats) -> tuple[Floats, Floats]:
    """Return how far [m] each grain can go against and along its direction within its cell, shape (n,) each."""
    links, grains = packing.links, packing.grains
    room = slacks(packing)
    owner = owners(grains.face_offsets)
    along = np.einsum("fi,fi->f", room.normals, directions[owner])
    if packing.domain.is_planar and links is not None:
        # Slabs of prisms fill their domain's thickness: the faces along it have no slack, and none is used.
        along[(links.neighbors == _LOWER_Z) | (links.neighbors == _UPPER_Z)] = 0.0
    # Slack that is negative by rounding is none.
    distances = np.maximum(room.distances, 0.0)
    limits = np.full((2, along.size), np.inf)
    for row, cosines in zip(limits, (-along, along), strict=True):
        np.divide(distances, cosines, out=row, where=cosines > 0)
    filled = np.flatnonzero(np.diff(grains.face_offsets))
    reach = np.zeros((2, len(packing)))
    if filled.size:
        reach[:, filled] = np.minimum.reduceat(limits, grains.face_offsets[filled], axis=1)
    # What is certain of planes that the grain has lost its faces along holds in every direction.
    rooms = np.zeros(len(packing)) if links is None or links.rooms is None else links.rooms
    back, forth = np.minimum(reach, rooms)
    return back, forth
