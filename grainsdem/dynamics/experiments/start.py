"""Where grains stand before an experiment: turned at random, in random order, apart from each other."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from exporters.mjcf import MjcfOptions
from exporters.rest import frictions
from grainsdem.dynamics.starting import as_spheres
from grainsdem.errors import InputError
from grainsdem.geometry.integrals import volumes
from grainsdem.model import Domain, Packing
from grainsdem.packing.shuffle import random_turns, rearranged

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from numpy.typing import NDArray

    from grainsdem.dynamics.experiments.shared import Run

    Floats = NDArray[np.float64]
    Seed = np.random.Generator | int | None

CLEARANCE = 0.02
"""Gap between neighbouring places, relative to the largest grain's circumscribed diameter."""

NUDGE = 0.005
"""How far grains stand from their places at most along each axis, relative to the same: by less than the gap leaves."""

GUESSED_FRACTION = 0.55, 0.8
"""Solid fraction, in space and in a plane, from which it is guessed how much room grains will take once compressed."""

VACANCIES = 0.5
"""Places that are left empty at random, relative to the grains: without them grains would stand in columns, which bear
a load, and spheres would be pressed into a crystal."""


def as_asked(packing: Packing, run: Run) -> Packing:
    """Return the grains as they are, or the spheres of equal volume."""
    return as_spheres(packing) if run["spheres"] else packing


def options_of(run: Run, **own: Any) -> MjcfOptions:
    """Return what the simulation is like: what every run has, and what an experiment gives besides."""
    return MjcfOptions(
        time_step=run["time_step"],
        rolling_friction=run["rolling_friction"],
        mixing=run["mixing"],
        restitution=run["restitution"],
        **own,
    )


def plate_friction(packing: Packing, friction: float | None) -> float | None:
    """Return the friction of parts that are to grains as these are to each other.

    None, as `grainsdem.dynamics.engine.Apparatus` takes it, where grains have their own.
    """
    found = frictions(replace(packing, provenance=()), friction)
    return found.grains if found.own is None else None


def wall_friction_of(
    packing: Packing, friction: float | None, wall_friction: float | Mapping[str, float] | None
) -> Callable[[str], float | None]:
    """Return what tells the friction of a part that stands for a wall, by the wall's name."""
    found = frictions(replace(packing, provenance=()), friction, wall_friction)
    usual = plate_friction(packing, friction)

    def of_wall(name: str) -> float | None:
        own = found.of_wall(name)
        return usual if own is None else own

    return of_wall


def in_block(packing: Packing, run: Run) -> Packing:
    """Return the grains, or spheres, where they are, or with a seed set apart in a box."""
    grains = as_asked(packing, run)
    return grains if run["rng"] is None else set_apart_in_block(grains, rng=run["rng"])


def pitch(packing: Packing) -> float:
    """Return the distance [m] at which any two of the grains are apart, however they are turned."""
    radii = packing.grains.vertices[:, : 2 if packing.domain.is_planar else 3]
    widest = float(np.sqrt(np.max(np.einsum("ij,ij->i", radii, radii)))) if len(radii) else 0.0
    if not widest > 0:
        raise InputError("an experiment needs at least one grain; got a packing without any")
    return 2 * widest * (1 + CLEARANCE)


def room_taken(packing: Packing) -> float:
    """Return the volume [m³] that grains will take, voids included, once they are compressed: a guess."""
    return float(volumes(packing.grains).sum()) / GUESSED_FRACTION[packing.domain.is_planar]


def n_places(n_grains: int) -> int:
    """Return how many places grains need, those that stay empty among them."""
    return int(np.ceil((1 + VACANCIES) * n_grains))


def set_apart(packing: Packing, places: Floats, domain: Domain, *, rng: Seed, n_fixed: int = 0) -> Packing:
    """Return the grains in random order and at random rotations, at some of the given places, drawn at random.

    Parameters
    ----------
    packing : Packing
        The grains; planar ones are turned in their plane.
    places : ndarray, shape (at least n, 3)
        Where centroids go [m], `pitch` apart from each other.
    domain : Domain
        What is around them.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    n_fixed : int
        The first places, all of which are taken, and exactly.
    """
    generator = np.random.default_rng(rng)
    order = generator.permutation(len(packing))
    turns = random_turns(len(packing), generator, is_planar=packing.domain.is_planar)
    drawn = generator.choice(len(places) - n_fixed, len(packing) - n_fixed, replace=False)
    chosen = np.concatenate([np.arange(n_fixed), n_fixed + np.sort(drawn)])
    nudges = generator.uniform(-NUDGE, NUDGE, (len(packing), 3)) * pitch(packing) / (1 + CLEARANCE)
    nudges[:n_fixed] = 0.0
    placed = rearranged(packing, order, turns=turns, positions=places[chosen] + nudges, domain=domain)
    return placed.with_step("set_apart")


def set_apart_in_block(packing: Packing, *, rng: Seed, lengths: Floats | None = None) -> Packing:
    """Return the grains set apart on a lattice in a box whose sides are as equal as can be.

    Parameters
    ----------
    packing : Packing
        The grains.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    lengths : array_like, shape (3,), optional
        Sides [m] of the box, but for the last one, against gravity, which is as long as the grains need.
    """
    step, n, planar = pitch(packing), len(packing), packing.domain.is_planar
    up = 1 if planar else 2
    if lengths is None:
        columns = np.full(up, int(np.ceil(n_places(n) ** (1 / (up + 1)) - 1e-9)))
        sides = columns * step
    else:
        sides = np.asarray(lengths, dtype=np.float64)[:up]
        columns = np.floor(sides / step + 1e-9).astype(int)
        if columns.min() < 1:
            raise InputError(f"a box of {sides.tolist()} m is narrower than the largest grain, {step:.4g} m")
    layers = -(-n_places(n) // int(columns.prod()))
    counts = np.append(columns, layers)
    index = np.indices(tuple(counts[::-1].tolist())).reshape(up + 1, -1)[::-1].T
    spacing = np.append(sides / columns, step)
    lower = packing.domain.lower.copy()
    places = np.zeros((len(index), 3))
    places[:, : up + 1] = lower[: up + 1] + (index + 0.5) * spacing
    upper = packing.domain.upper.copy()
    upper[: up + 1] = lower[: up + 1] + counts * spacing
    return set_apart(packing, places, Domain(lower, upper, is_planar=planar), rng=rng)
