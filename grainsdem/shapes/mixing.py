"""Which shape each grain has, and which size: mixtures by shares of number or of mass."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.geometry.defects import find_defects
from grainsdem.geometry.forms.holes import square_holes
from grainsdem.geometry.hulls import FLAT, convex_hull
from grainsdem.geometry.selection import select
from grainsdem.model import Polyhedra
from grainsdem.roots import cube_roots, raised
from grainsdem.shapes.scans import Scans
from grainsdem.shapes.sizing import centred, sized, together

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Grading

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]


_DENT = 1e-6
"""How far from convex a shape may be, relative to its diameter: single precision of a file leaves a tenth of it."""


SIEVED = 5e-3
"""Largest difference of the grains' curve from a grading at any opening, as a share of the mass."""


class Law(Protocol):
    """A distribution of scipy.stats with its parameters, or whatever else has quantiles."""

    def ppf(self, q: Any, /) -> Any:
        """Return the quantiles of probabilities."""


class Kinds(NamedTuple):
    """Shapes of unit diameter about their centroids, and what kind each is of.

    Parameters
    ----------
    shapes : Polyhedra
        All of them.
    offsets : ndarray of int64, shape (n_kinds + 1,)
        Shapes of kind k are those from ``offsets[k]`` to before ``offsets[k + 1]``.
    """

    shapes: Polyhedra
    offsets: Ints

    def __len__(self) -> int:
        return self.offsets.size - 1


def kinds_of(given: Polyhedra | Scans | Sequence[Polyhedra | Scans]) -> Kinds:
    """Return the kinds that shapes are: of a sequence each entry is one, of a set of shapes each shape.

    Raises
    ------
    InputError
        If there is none, one is no shape, or one is not convex or has no volume.
    """
    entries = [given] if isinstance(given, Polyhedra | Scans) else list(given)
    sets = [entry.shapes if isinstance(entry, Scans) else entry for entry in entries]
    sizes = [len(one) for one in sets]
    if not sizes or 0 in sizes:
        raise InputError("shapes must be one or more; got none")
    shapes = together(*sets)
    if isinstance(given, Polyhedra | Scans):
        sizes = [1] * len(shapes)
    shapes = sized(centred(shapes), 1.0)
    return Kinds(_convex(shapes), np.concatenate([[0], np.cumsum(sizes)]))


def _convex(shapes: Polyhedra) -> Polyhedra:
    """Return shapes of unit diameter, those that are convex but for rounding as their hulls, or raise `InputError`."""
    found = find_defects(shapes)
    bad = np.flatnonzero((found.open_edges != 0) | (found.inward_faces > 0) | (found.dents > _DENT))
    if bad.size:
        raise InputError(
            "shapes must be closed and convex, faces counter-clockwise seen from outside; not so: "
            f"{name_offenders(bad)}"
        )
    bent = found.dents > FLAT
    if not bent.any():
        return shapes
    each = (select(shapes, np.array([i]))[0] for i in range(len(shapes)))
    hulls = together(*(convex_hull(one.vertices) if is_bent else one for one, is_bent in zip(each, bent, strict=True)))
    return sized(centred(hulls), 1.0)


def diameters_of(sizes: ArrayLike | Law, n: int | None, rng: np.random.Generator) -> Floats:
    """Return the diameter [m] of each grain, shape (n,): a list as it is, a law's quantiles in random order.

    Raises
    ------
    InputError
        If a law comes without a number, a list with another, or a diameter is not positive and finite.
    """
    if n is not None and n < 1:
        raise InputError(f"grains are one or more; got n = {n}")
    if hasattr(sizes, "ppf"):
        if n is None:
            raise InputError("a law of sizes needs the number of grains, n")
        values = rng.permutation(np.asarray(sizes.ppf((np.arange(n) + 0.5) / n), dtype=np.float64))
    else:
        values = np.asarray(sizes, dtype=np.float64)
        if values.ndim == 0 and n is not None:
            values = np.full(n, values)
        if values.ndim != 1 or not values.size:
            raise ShapeError(f"sizes are a list of diameters, or one diameter or law and n; got shape {values.shape}")
        if n is not None and values.size != n:
            raise InputError(f"there must be one size for each of n = {n} grains; got {values.size}")
    bad = np.flatnonzero(~(np.isfinite(values) & (values > 0)))
    if bad.size:
        raise InputError(f"sizes must be positive and finite; those of grains {name_offenders(bad)} are not")
    return values


def of_grading(
    curve: Grading, kinds: Kinds, n: int, *, shares: Floats, densities: Floats, by: str, rng: np.random.Generator
) -> tuple[Floats, Ints, Ints]:
    """Return equal-volume diameter [m], kind and shape of n grains that together have a curve, shape (n,) each.

    Raises
    ------
    InputError
        If so few grains cannot have the curve within `SIEVED`.

    Notes
    -----
    Each shape passes a hole of its own share of its diameter, and has its own density: which grain is of which shape is
    drawn first, and its size then from the curve, with the mass that it has at that size.
    """
    ratios = square_holes(kinds.shapes) if curve.diameter == "sieve" else np.ones(len(kinds.shapes))
    counts = np.diff(kinds.offsets)
    mean_cubes = np.add.reduceat(1 / raised(ratios, 3), kinds.offsets[:-1]) / counts
    kind_of = dealt(curve.draw(n, tolerance=None), shares, densities * mean_cubes, by, rng)
    shape_of = kinds.offsets[kind_of] + (rng.random(n) * counts[kind_of]).astype(np.int64)
    # A heavy grain weighs as much as a larger one.
    weights = cube_roots(densities[kind_of] / densities.max())
    sizes = curve.draw(n, ratios=ratios[shape_of] / weights, tolerance=SIEVED)
    order = rng.permutation(n)
    return (sizes / ratios[shape_of])[order], kind_of[order], shape_of[order]


def shares_of(shares: ArrayLike | None, n_kinds: int) -> Floats:
    """Return the share of each kind, shape (n_kinds,), of sum one: equal ones by default."""
    if shares is None:
        return np.full(n_kinds, 1 / n_kinds)
    values = np.asarray(shares, dtype=np.float64)
    if values.shape != (n_kinds,):
        raise ShapeError(f"shares must be one for each of {n_kinds} kinds of shapes; got shape {values.shape}")
    if not (np.isfinite(values).all() and (values >= 0).all() and values.sum() > 0):
        raise InputError(f"shares must be zero or more, and one above it; got {values.tolist()}")
    return np.asarray(values / values.sum())


def dealt(diameters: Floats, shares: Floats, densities: Floats, by: str, rng: np.random.Generator) -> Ints:
    """Return the kind of each grain, shape (n,), such that kinds have their shares by number or by mass.

    Notes
    -----
    By number the counts are the nearest whole ones, in random order. By mass grains are dealt from the largest to the
    smallest, each to the kind that it leaves farthest below its share: kinds have their shares within about the mass of
    a small grain, and all of them the same sizes.
    """
    n, taking = diameters.size, np.flatnonzero(shares > 0)
    if by == "number":
        counts = np.floor(shares * n).astype(np.int64)
        rest = np.argsort(-(shares * n - counts), kind="stable")[: n - counts.sum()]
        counts[rest] += 1
        return rng.permutation(np.repeat(np.arange(shares.size), counts))
    if by != "mass":
        raise InputError(f"shares are by 'number' or by 'mass'; got by = {by!r}")
    taking = rng.permutation(taking)
    kinds, had = np.empty(n, dtype=np.int64), np.zeros(taking.size)
    steps = diameters[:, None] ** 3 * (densities[taking] / shares[taking])
    for i in np.argsort(-diameters, kind="stable"):
        best = int(np.argmin(had + steps[i]))
        had[best] += steps[i, best]
        kinds[i] = taking[best]
    return kinds
