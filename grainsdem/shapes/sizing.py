"""Shapes moved to their centroids, scaled to sizes, and put together."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders, shown
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import above_zero, sphere_diameters
from grainsdem.geometry.integrals import integrate, volumes
from grainsdem.model import Polyhedra
from grainsdem.model.arrays import LONGEST, SHORTEST
from grainsdem.ragged import offsets_from_counts, owners

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


@gated
def sized(shapes: Polyhedra, diameters: ArrayLike) -> Polyhedra:
    """Return shapes scaled, each about its own origin, to diameters [m] of the spheres of equal volume.

    Parameters
    ----------
    shapes : Polyhedra
        Closed polyhedra.
    diameters : array_like, shape () or (n,)
        One for all, or one for each.

    Raises
    ------
    InputError
        If a diameter is not positive and finite, or a shape has no volume.
    """
    wanted = np.asarray(diameters, dtype=np.float64)
    if wanted.shape not in ((), (len(shapes),)):
        raise ShapeError(f"diameters must be one number, or one for each of {len(shapes)} shapes; got {wanted.shape}")
    bad = np.flatnonzero(~((wanted >= SHORTEST) & (wanted <= LONGEST)))
    if bad.size:
        raise InputError(f"diameters must be positive and finite; {name_offenders(np.ravel(wanted)[bad])} are not")
    return scaled(shapes, np.broadcast_to(wanted, len(shapes)) / sphere_diameters(volumes(shapes)))


def scaled(shapes: Polyhedra, factors: NDArray[np.float64]) -> Polyhedra:
    """Return each shape scaled about its own origin by a factor, shape (n,)."""
    return replace(shapes, vertices=shapes.vertices * factors[owners(shapes.vertex_offsets), None])


def centred(shapes: Polyhedra) -> Polyhedra:
    """Return each shape about its centroid; `InputError` where one has no volume."""
    measured = integrate(shapes)
    above_zero(measured.volumes)
    return replace(shapes, vertices=shapes.vertices - measured.centroids[owners(shapes.vertex_offsets)])


@gated
def together(*shapes: Polyhedra) -> Polyhedra:
    """Return several polyhedra, or sets of them, as one set, in their order.

    Examples
    --------
    >>> len(together(platonic("cube"), platonic("octahedron")))  # doctest: +SKIP
    2
    """
    counts = [
        np.concatenate([np.diff(getattr(s, name)) for s in shapes]) if shapes else np.empty(0, np.int64)
        for name in ("vertex_offsets", "face_offsets", "face_vertex_offsets")
    ]
    return Polyhedra(
        np.concatenate([s.vertices for s in shapes]) if shapes else np.empty((0, 3)),
        offsets_from_counts(counts[0]),
        offsets_from_counts(counts[1]),
        np.concatenate([s.face_vertices for s in shapes]) if shapes else np.empty(0, np.int32),
        offsets_from_counts(counts[2]),
    )


def check_positive(**values: float) -> None:
    """Raise `InputError` unless all values are lengths [m] that something can have."""
    for name, value in values.items():
        if not SHORTEST <= value <= LONGEST:
            raise InputError(f"{name} must be positive and finite, {SHORTEST:g} to {LONGEST:g} m; got {shown(value)}")
