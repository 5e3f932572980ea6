"""Lloyd's relaxation: every seed moves to the centroid of its cell, again and again.

References
----------
.. [1] Q. Du, V. Faber, M. Gunzburger, "Centroidal Voronoi tessellations: applications and algorithms",
   SIAM Review 41 (1999) 637-676.
.. [2] D. D. Buscombe, D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError, shown
from grainsdem.gate import gated
from grainsdem.geometry.ahead import compiled
from grainsdem.points.check import check_seeds
from grainsdem.tessellation.density import (
    Density,
    sampler,
    weighted_centroids,
)
from grainsdem.tessellation.engine.frame import Frame
from grainsdem.tessellation.engine.light import moments
from grainsdem.tessellation.engine.tree import build
from grainsdem.tessellation.voronoi import tessellate

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

MOST_ITERATIONS = 100_000
"""Iterations: a lattice is nearer after some hundred than any tolerance of use."""


class Relaxation(NamedTuple):
    """Relaxed seeds, and how they came there.

    Parameters
    ----------
    seeds : ndarray, shape (n, 3)
        Positions [m].
    energies : ndarray, shape (iterations,)
        Second moment of the cells about their seeds before each iteration, per dimension and normalised by the mean
        volume: (1/3) Σ ∫ |x - s|² dV / (n (V/n)^(5/3)). A lattice of cubes has 1/12 = 0.0833, BCC 0.0785, the least
        that is known. With a density, ∫ ν |x - s|² dV [density · m⁵] as it is.
    moves : ndarray, shape (iterations,)
        Farthest that a seed moved in each iteration, relative to (V/n)^(1/3).
    """

    seeds: Floats
    energies: Floats
    moves: Floats


def check_rounds(name: str, n: int) -> None:
    """Raise `InputError` unless a number of rounds in which seeds move is one that ends."""
    if not 0 <= n <= MOST_ITERATIONS:
        raise InputError(f"{name} must be zero or more, at most {MOST_ITERATIONS}; got {shown(n)}")


@gated
def relax(
    seeds: ArrayLike,
    domain: Domain,
    *,
    iterations: int = 10,
    over_relaxation: float = 1.0,
    tolerance: float | None = None,
    density: Density | None = None,
    progress: Callable[[int], None] | None = None,
) -> Floats:
    """Return the seeds after Lloyd iterations towards a centroidal Voronoi tessellation (CVT).

    A few iterations over Poisson seeds make the paper's "CVT-Uniform".

    Parameters
    ----------
    seeds : array_like, shape (n, 3) or (n, 2)
        Positions [m].
    domain : Domain
        What the cells fill; seeds wrap around its periodic axes.
    iterations : int
        How many times every seed moves towards the centroid of its cell, at most.
    over_relaxation : float
        Part of the way to the centroid that a seed goes, in (0, 2): 1 is Lloyd's own, 1.5 or so needs fewer iterations.
    tolerance : float, optional
        Stop when no seed moves farther than this, relative to (V/n)^(1/3).
    density : callable or array_like, shape (nx, ny, nz), optional
        Density ν of the paper's equation 3, at points [m] of shape (m, 3), or in voxels that fill the domain's box:
        cells become smaller where it is high. In the limit there are ν^(3/5) seeds a volume, ν^(1/2) in a planar
        domain.
    progress : callable, optional
        Called with the number of each finished iteration, from 1.

    Returns
    -------
    ndarray, shape (n, 3)
        Relaxed positions [m].

    Raises
    ------
    InputError
        If an option is out of range, a density is negative or not finite, or the seeds cannot be tessellated.
    ShapeError
        If the seeds or the density have the wrong shape.

    See Also
    --------
    relaxation : the same with the history of the energy.
    """
    return relaxation(
        seeds,
        domain,
        iterations=iterations,
        over_relaxation=over_relaxation,
        tolerance=tolerance,
        density=density,
        progress=progress,
    ).seeds


@gated
def relaxation(
    seeds: ArrayLike,
    domain: Domain,
    *,
    iterations: int = 10,
    over_relaxation: float = 1.0,
    tolerance: float | None = None,
    density: Density | None = None,
    progress: Callable[[int], None] | None = None,
) -> Relaxation:
    """Return relaxed seeds and the history of their energy; for the parameters and errors see `relax`."""
    check_rounds("iterations", iterations)
    if not 0 < over_relaxation < 2:
        raise InputError(f"over_relaxation must lie between 0 and 2; got {over_relaxation}")
    if tolerance is not None and not tolerance >= 0:
        raise InputError(f"tolerance must be zero or more; got {tolerance}")
    sites = check_seeds(seeds, domain)
    sample = None if density is None else sampler(density, domain)
    mean = domain.volume / len(sites)
    frame = Frame.of(domain)
    weights = np.zeros(len(sites))
    energies, moves = [], []
    compiled("lloyd" if sample is None else "cells")
    for iteration in range(iterations):
        if sample is None:
            _, steps, energy = moments(build(frame.inward(sites), weights), frame)
            energies.append(float(energy.sum()) / (3 * len(sites) * mean ** (5 / 3)))
        else:
            steps, energy = weighted_centroids(tessellate(sites, domain), sample)
            energies.append(float(energy.sum()))
        sites = _moved(sites, steps, over_relaxation, domain)
        moves.append(over_relaxation * float(np.sqrt(np.max(np.sum(steps**2, axis=1)))) / mean ** (1 / 3))
        if progress is not None:
            progress(iteration + 1)
        if tolerance is not None and moves[-1] <= tolerance:
            break
    return Relaxation(sites, np.array(energies), np.array(moves))


def _moved(sites: Floats, steps: Floats, factor: float, domain: Domain) -> Floats:
    """Return the sites moved by ``factor`` steps; those that would leave the domain go to their centroids."""
    wanted = sites + factor * steps
    moved = inside(wanted, domain)
    # Along a periodic axis nothing can be left.
    lost = ~domain.contains(np.where(domain.periodic, moved, wanted))
    moved[lost] = inside(sites + steps, domain)[lost]
    return moved


def inside(sites: Floats, domain: Domain) -> Floats:
    """Return the sites wrapped around the periodic axes; a centroid is inside but for rounding."""
    wrapped = domain.lower + np.mod(sites - domain.lower, domain.lengths)
    return np.clip(np.where(domain.periodic, wrapped, sites), domain.lower, domain.upper)
