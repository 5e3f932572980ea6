"""Random convex rocks whose smallest box has the proportions asked for."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import ConvergenceError, InputError, ShapeError, name_offenders
from grainsdem.geometry.forms.boxes import standing_boxes
from grainsdem.geometry.hulls import convex_hulls
from grainsdem.geometry.selection import select
from grainsdem.ragged import owners
from grainsdem.shapes.sizing import centred, check_positive, sized, together

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

N_VERTICES = 24
"""Corners of a rock by default, at most: 14 faces."""

FEWEST = 8
"""Corners that a rock may have at most: of fewer than six faces no random ones are left."""

TOLERANCE = 1e-9
"""How near, relative, the proportions of a rock's smallest box come to those asked for: some thousand roundings."""

_ROUNDS = 60
"""Stretches of a rock until another is drawn; most take three."""

_DRAWS = 200
"""Rocks that are drawn for one at most."""

_TRIED = 8
"""Directions that are drawn for each face: the one farthest from the others is taken."""

_UNEVEN = 0.15
"""How far faces lie from the middle, one from another, relative."""


def rock(
    n: int = 1,
    *,
    elongation: ArrayLike = 0.75,
    flatness: ArrayLike = 0.75,
    n_vertices: int = N_VERTICES,
    diameter: float = 1.0,
    rng: np.random.Generator | int | None = None,
) -> Polyhedra:
    """Return random convex rocks, as broken stone is: few flat faces, sharp edges.

    Parameters
    ----------
    n : int
        How many, each another.
    elongation, flatness : array_like, shape () or (n,)
        b/a and c/b of the edges a >= b >= c of the smallest box on a face (`grainsdem.box_axes`), in (0, 1]. They are
        had within a relative 1e-9.
    n_vertices : int
        Corners at most, eight or more; there are about half as many faces.
    diameter : float
        Of the sphere of equal volume [m].
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    Polyhedra
        ``n`` shapes, each about its centroid, longest along x and flattest along z or nearly so.

    Raises
    ------
    InputError
        If a number is out of range.
    ConvergenceError
        If no rock of those proportions was found.

    Notes
    -----
    The planes of the faces have directions that keep apart and unlike distances from the middle. The rock is then
    stretched along the edges of its smallest box. Of that box faces and edges stay where they are, so that it has the
    proportions at once; where another box has become smaller by the stretch, the same is done with that one.
    """
    wanted = _proportions(n, elongation, flatness)
    if n_vertices < FEWEST:
        raise InputError(f"a rock has {FEWEST} corners or more; got n_vertices = {n_vertices}")
    check_positive(diameter=diameter)
    generator = np.random.default_rng(rng)
    found: dict[int, Polyhedra] = {}
    lacking = np.arange(n)
    for _ in range(_DRAWS):
        clouds = [_draw(n_vertices // 2 + 2, wanted[i], generator) for i in lacking]
        rocks, is_had = _stretched(convex_hulls(clouds), wanted[lacking])
        for row in np.flatnonzero(is_had):
            found[int(lacking[row])] = select(rocks, np.array([row]))[0]
        lacking = lacking[~is_had]
        if not lacking.size:
            return sized(centred(together(*(found[i] for i in range(n)))), diameter)
    b, c = wanted[lacking[0], 1], wanted[lacking[0], 2] / wanted[lacking[0], 1]
    raise ConvergenceError(f"of {_DRAWS} rocks none got elongation {b:g} and flatness {c:g}: others have them")


def _proportions(n: int, elongation: ArrayLike, flatness: ArrayLike) -> Floats:
    """Return the edges of boxes, the longest one, shape (n, 3)."""
    if n < 1:
        raise InputError(f"rocks are one or more; got n = {n}")
    columns = []
    for name, given in (("elongation", elongation), ("flatness", flatness)):
        values = np.asarray(given, dtype=np.float64)
        if values.shape not in ((), (n,)):
            raise ShapeError(f"{name} must be one number, or one for each of {n} rocks; got shape {values.shape}")
        bad = np.ravel(values)[~(np.ravel(values) > 0) | (np.ravel(values) > 1)]
        if bad.size:
            raise InputError(f"{name} must lie in (0, 1]; got {name_offenders(bad.tolist())}")
        columns.append(np.broadcast_to(values, n))
    b, c = columns
    return np.column_stack([np.ones(n), b, b * c])


def _draw(n_faces: int, proportions: Floats, generator: np.random.Generator) -> Floats:
    """Return the corners of a random rock, about as long, wide and high as asked for."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415  (half a second)

    while True:
        normals = _apart(n_faces, generator)
        distances = 1 + _UNEVEN * generator.uniform(-1.0, 1.0, n_faces)
        # A face of the hull of what is polar to the planes, n / d, is polar to a corner.
        planes = ConvexHull(normals / distances[:, None]).equations
        if planes[:, 3].max() < -0.2:  # no corner farther than five times the faces
            return np.asarray(planes[:, :3] / -planes[:, 3:]) * proportions


def _apart(n: int, generator: np.random.Generator) -> Floats:
    """Return random directions, shape (n, 3), each of several the farthest from those before."""
    drawn = generator.standard_normal((n, _TRIED, 3))
    drawn /= np.sqrt((drawn**2).sum(axis=2, keepdims=True))
    chosen = drawn[:, 0].copy()
    for k in range(1, n):
        nearest = np.array([(chosen[:k] * trial).sum(axis=1).max() for trial in drawn[k]])
        chosen[k] = drawn[k, np.argmin(nearest)]
    return chosen


def _stretched(rocks: Polyhedra, wanted: Floats) -> tuple[Polyhedra, NDArray[np.bool_]]:
    """Return rocks stretched along their smallest boxes, and which have the proportions of their boxes, shape (n,)."""
    owner, is_had = owners(rocks.vertex_offsets), np.zeros(len(rocks), dtype=bool)
    for _ in range(_ROUNDS):
        boxes = standing_boxes(rocks)
        order = np.argsort(-boxes.edges, axis=1, kind="stable")
        edges = np.take_along_axis(boxes.edges, order, axis=1)
        axes = np.take_along_axis(boxes.axes, order[:, :, None], axis=1)
        factors = wanted / (edges / edges[:, :1])
        is_had = np.asarray((np.abs(factors - 1) <= TOLERANCE).all(axis=1))
        if is_had.all():
            break
        # Without a change of volume: boxes that were no smaller before are compared with what they were.
        factors /= np.cbrt(factors.prod(axis=1, keepdims=True))
        factors[is_had] = 1.0
        along = (axes[owner] * rocks.vertices[:, None, :]).sum(axis=2) * factors[owner]
        rocks = replace(rocks, vertices=(axes[owner] * along[:, :, None]).sum(axis=1))
    return rocks, is_had
