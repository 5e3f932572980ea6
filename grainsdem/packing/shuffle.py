"""Rotated and reordered grains, lifted apart: what is poured to get a random pack.

Cells left in place remember the tessellation like a jigsaw: they settle denser than any random pack and even
reassemble under pressure.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated
from grainsdem.geometry.rotations import multiply, random_quaternions
from grainsdem.geometry.selection import select
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.model import Domain, Packing

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DOUBLINGS = 8
"""How often the number of layers is doubled where a domain's planes leave little of each."""


@gated
def shuffle(
    packing: Packing,
    *,
    rng: np.random.Generator | int | None = None,
    clearance: float = 0.02,
    vacancies: float = 0.0,
) -> Packing:
    """Return the grains in random order and at random rotations, spaced on a lattice that fills the domain upward.

    Parameters
    ----------
    packing : Packing
        Grains to pour.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    clearance : float
        Smallest gap between grains, and to the walls, relative to the largest grain's circumscribed diameter.
    vacancies : float
        Places of the lattice that stay empty, drawn at random, relative to the grains.

    Returns
    -------
    Packing
        The same shapes in a new order, free of overlap whatever their rotation, in a domain of the same floor and
        walls that is as high as they need; without links and without periodic axes. Grain ids are new.

    Raises
    ------
    InputError
        If the domain's floor is narrower than the largest grain, or ``clearance`` or ``vacancies`` is negative.

    Notes
    -----
    Planar grains are turned in their plane and lifted along y.
    """
    for name, value in {"clearance": clearance, "vacancies": vacancies}.items():
        if not 0 <= value < np.inf:
            raise InputError(f"{name} must be zero or more and finite; got {value}")
    allow_memory((1 + vacancies) * len(packing), A_SEED, "places of the lattice")
    domain = packing.domain
    up = 1 if domain.is_planar else 2
    generator = np.random.default_rng(rng)
    order = generator.permutation(len(packing))
    grains, _ = select(packing.grains, order)
    reach = grains.vertices[:, : up + 1]
    radius = float(np.sqrt(np.max(np.einsum("ij,ij->i", reach, reach))))
    pitch = 2 * radius * (1 + clearance)
    columns = np.floor(domain.lengths[:up] / pitch + 1e-9).astype(int)
    if columns.min() < 1:
        raise InputError(
            f"the floor {domain.lengths[:up].tolist()} m must be wider than the largest grain, {pitch:.4g} m with "
            f"clearance"
        )
    n = len(packing)
    positions = _lattice(int(np.ceil((1 + vacancies) * n)), columns, domain, pitch)
    if len(positions) > n:
        positions = positions[np.sort(generator.choice(len(positions), n, replace=False))]
    turns = random_turns(n, generator, is_planar=domain.is_planar)
    upper = domain.upper.copy()
    upper[up] = positions[-1, up] + 0.5 * pitch
    room = Domain(domain.lower, upper, is_planar=domain.is_planar, planes=domain.planes)
    placed = rearranged(packing, order, turns=turns, positions=positions, domain=room)
    return placed.with_step("shuffle", clearance=clearance, vacancies=vacancies)


def rearranged(
    packing: Packing,
    order: NDArray[np.int64],
    *,
    turns: NDArray[np.float64],
    positions: NDArray[np.float64],
    domain: Domain,
) -> Packing:
    """Return grains in another order, each turned and somewhere else; planar ones keep to their plane.

    Parameters
    ----------
    packing : Packing
        The grains.
    order : ndarray of int64, shape (n,)
        Which grain comes where in the new order.
    turns : ndarray, shape (n, 4)
        Rotations in the new order, that are added to those which the grains have.
    positions : ndarray, shape (n, 3)
        Where the centroids go [m], in the new order.
    domain : Domain
        What is around them.
    """
    turned = multiply(turns, packing.quaternions[order])
    places = positions.copy()
    if packing.domain.is_planar:
        places[:, 2] = packing.positions[order, 2]
    return replace(
        packing,
        grains=select(packing.grains, order)[0],
        positions=places,
        quaternions=turned / np.linalg.norm(turned, axis=1, keepdims=True),
        densities=packing.densities[order],
        frictions=packing.frictions_of(order),
        classes=packing.classes_of(order),
        domain=domain,
        links=None,
    )


def _lattice(n: int, columns: NDArray[np.int64], domain: Domain, pitch: float) -> NDArray[np.float64]:
    """Return ``n`` places in the domain, layer by layer from the floor; its planes reach upward past its lid."""
    up, per_layer = columns.size, int(columns.prod())
    # Spread evenly between four walls; close together where planes cut the corners off.
    spacing = np.append(np.full(up, pitch) if len(domain.planes) else domain.lengths[:up] / columns, pitch)
    margin = np.append((domain.lengths[:up] - columns * spacing[:up]) / 2, 0.0)
    n_layers = -(-n // per_layer)
    for _ in range(_DOUBLINGS):
        index = np.arange(n_layers * per_layer)
        across = [index % columns[0], index // columns[0] % columns[1]] if up == 2 else [index % columns[0]]
        places = np.zeros((index.size, 3))
        places[:, up + 1 :] = (0.5 * (domain.lower + domain.upper))[up + 1 :]
        steps = np.stack([*across, index // per_layer], axis=1)
        places[:, : up + 1] = domain.lower[: up + 1] + margin + (steps + 0.5) * spacing
        is_inside = np.ones(len(places), dtype=bool)
        for plane in domain.planes:
            is_inside &= (places * plane[:3]).sum(axis=1) <= plane[3] - 0.5 * pitch
        if np.count_nonzero(is_inside) >= n:
            chosen: NDArray[np.float64] = places[is_inside][:n]
            return chosen
        n_layers *= 2
    raise InputError(f"the domain's planes leave no room to lift {n} grains of {pitch:.4g} m apart")


def random_turns(n: int, rng: np.random.Generator, *, is_planar: bool) -> NDArray[np.float64]:
    """Return random rotations, shape (n, 4); in planar work about z alone."""
    if not is_planar:
        return random_quaternions(n, rng)
    # Not NumPy's sines: their last bit is the processor's.
    return np.array([(math.cos(half), 0.0, 0.0, math.sin(half)) for half in rng.uniform(0.0, np.pi, n)]).reshape(n, 4)
