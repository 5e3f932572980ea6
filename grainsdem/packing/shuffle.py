"""Rotated and reordered grains, lifted apart: what is poured to get a random pack.

Cells left in place remember the tessellation like a jigsaw: they settle denser than any random pack and even
reassemble under pressure.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.rotations import multiply, random_quaternions
from grainsdem.model import Domain, Packing
from grainsdem.packing.carve import select

if TYPE_CHECKING:
    from numpy.typing import NDArray

_DOUBLINGS = 8
"""How often the number of layers is doubled where a domain's planes leave little of each."""


def shuffle(packing: Packing, *, rng: np.random.Generator | int | None = None, clearance: float = 0.02) -> Packing:
    """Return the grains in random order and at random rotations, spaced on a lattice that fills the domain upward.

    Parameters
    ----------
    packing : Packing
        Grains to pour.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.
    clearance : float
        Smallest gap between grains, and to the walls, relative to the largest grain's circumscribed diameter.

    Returns
    -------
    Packing
        The same shapes in a new order, free of overlap whatever their rotation, in a domain of the same floor and
        walls that is as high as they need; without links and without periodic axes. Grain ids are new.

    Raises
    ------
    InputError
        If the domain's floor is narrower than the largest grain, the domain is planar, or ``clearance`` is negative.
    """
    if clearance < 0:
        raise InputError(f"clearance must be zero or more; got {clearance}")
    domain = packing.domain
    if domain.is_planar:
        raise InputError("a planar packing cannot be shuffled: its grains turn in the plane only")
    generator = np.random.default_rng(rng)
    order = generator.permutation(len(packing))
    grains, _ = select(packing.grains, order)
    radius = float(np.sqrt(np.max(np.einsum("ij,ij->i", grains.vertices, grains.vertices))))
    pitch = 2 * radius * (1 + clearance)
    columns = np.floor(domain.lengths[:2] / pitch + 1e-9).astype(int)
    if columns.min() < 1:
        raise InputError(
            f"the floor {domain.lengths[:2].tolist()} m must be wider than the largest grain, {pitch:.4g} m with "
            f"clearance"
        )
    positions = _lattice(len(packing), columns, domain, pitch)
    turned = multiply(random_quaternions(len(packing), generator), packing.quaternions[order])
    upper = np.array([*domain.upper[:2], positions[-1, 2] + 0.5 * pitch])
    return replace(
        packing,
        grains=grains,
        positions=positions,
        quaternions=turned / np.linalg.norm(turned, axis=1, keepdims=True),
        densities=packing.densities[order],
        domain=Domain(domain.lower, upper, planes=domain.planes),
        links=None,
    ).with_step("shuffle", clearance=clearance)


def _lattice(n: int, columns: NDArray[np.int64], domain: Domain, pitch: float) -> NDArray[np.float64]:
    """Return ``n`` places in the domain, layer by layer from the floor; its planes reach upward past its lid."""
    per_layer = int(columns.prod())
    # Spread evenly between four walls; close together where planes cut the corners off.
    spacing = np.append(np.full(2, pitch) if len(domain.planes) else domain.lengths[:2] / columns, pitch)
    margin = np.append((domain.lengths[:2] - columns * spacing[:2]) / 2, 0.0)
    n_layers = -(-n // per_layer)
    for _ in range(_DOUBLINGS):
        index = np.arange(n_layers * per_layer)
        ijk = np.stack([index % columns[0], index // columns[0] % columns[1], index // per_layer], axis=1)
        places = domain.lower + margin + (ijk + 0.5) * spacing
        is_inside = np.ones(len(places), dtype=bool)
        for plane in domain.planes:
            is_inside &= places @ plane[:3] <= plane[3] - 0.5 * pitch
        if np.count_nonzero(is_inside) >= n:
            chosen: NDArray[np.float64] = places[is_inside][:n]
            return chosen
        n_layers *= 2
    raise InputError(f"the domain's planes leave no room to lift {n} grains of {pitch:.4g} m apart")
