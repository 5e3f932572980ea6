"""Random convex rocks whose smallest box has the proportions asked for."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import ConvergenceError, InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.forms.boxes import standing_boxes
from grainsdem.geometry.forms.outlines import outline_roundnesses
from grainsdem.geometry.hulls import convex_hulls
from grainsdem.geometry.selection import select
from grainsdem.memory import A_SEED, allow_memory
from grainsdem.ragged import owners
from grainsdem.shapes.rounding import MOST_VERTICES, ROUNDNESS_TOLERANCE, searched
from grainsdem.shapes.sizing import centred, check_positive, sized, together

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

N_VERTICES = 24
"""Corners of a rock by default, at most: 14 faces. One that is rounded has up to `MOST_VERTICES`."""

FEWEST = 8
"""Corners that a rock may have at most: of fewer than six faces no random ones are left."""

TOLERANCE = 1e-9
"""How near, relative, the proportions of a rock's smallest box come to those asked for: some thousand roundings."""

_ROUNDS = 60
"""Stretches of a rock until another is drawn; most take three."""

_DRAWS = 200
"""Rocks that are drawn for one at most."""

_TURN = np.array([[2.0, -3, 6], [6, -2, -3], [3, 6, 2]]) / 7
"""A rotation about no axis of anyone's."""

_ROUND_FACES = (0.3, 6), (0.5, 7), (np.inf, 8)
"""Roundness below which a rock that is rounded is drawn with so many faces."""

_TRIED = 8
"""Directions that are drawn for each face: the one farthest from the others is taken."""

_UNEVEN = 0.15
"""How far faces lie from the middle, one from another, relative."""


@gated
def rock(
    n: int = 1,
    *,
    elongation: ArrayLike = 0.75,
    flatness: ArrayLike = 0.75,
    roundness: float | None = None,
    n_vertices: int | None = None,
    diameter: float = 1.0,
    rng: np.random.Generator | int | None = None,
) -> Polyhedra:
    """Return random convex rocks: few flat faces and sharp edges, as broken stone has, or rounded as sand is.

    Parameters
    ----------
    n : int
        How many, each another.
    elongation, flatness : array_like, shape () or (n,)
        b/a and c/b of the edges a >= b >= c of the smallest box on a face (`grainsdem.box_axes`), in (0, 1]. They are
        had within a relative 1e-9.
    roundness : float, optional
        Wadell's, as `grainsdem.roundness` measures it, had within 0.02: from about 0.1 to 0.75 can be. By default the
        rocks are as they break, which is 0.47 ± 0.07 with 24 corners and 0.29 ± 0.07 with 12.
    n_vertices : int, optional
        Corners at most, eight or more; there are about half as many faces. By default 24, or 64 of rounded rocks.
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
    allow_memory(float(max(n, 0)) * (n_vertices or N_VERTICES), A_SEED, "corners")
    wanted = _proportions(n, elongation, flatness)
    if roundness is not None and not 0 <= roundness <= 1:
        raise InputError(f"roundness must lie in [0, 1]; got {roundness}")
    if n_vertices is None:
        n_vertices = N_VERTICES if roundness is None else MOST_VERTICES
    if n_vertices < FEWEST:
        raise InputError(f"a rock has {FEWEST} corners or more; got n_vertices = {n_vertices}")
    check_positive(diameter=diameter)
    generator = np.random.default_rng(rng)
    found: dict[int, Polyhedra] = {}
    lacking = np.arange(n)
    for _ in range(_DRAWS):
        clouds = [_draw(_faces(n_vertices, roundness), wanted[i], generator) for i in lacking]
        rocks, is_had = _stretched(convex_hulls(clouds), wanted[lacking])
        if roundness is not None:
            rocks = _rounded(rocks, is_had, wanted[lacking], roundness, n_vertices)
        rocks = sized(centred(rocks), diameter)
        is_had &= _hold(rocks, wanted[lacking], roundness)
        for row in np.flatnonzero(is_had):
            found[int(lacking[row])] = select(rocks, np.array([row]))[0]
        lacking = lacking[~is_had]
        if not lacking.size:
            return together(*(found[i] for i in range(n)))
    b, c = wanted[lacking[0], 1], wanted[lacking[0], 2] / wanted[lacking[0], 1]
    more = "" if roundness is None else f" and roundness {roundness:g}"
    raise ConvergenceError(f"of {_DRAWS} rocks none got elongation {b:g}, flatness {c:g}{more}")


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


def _faces(n_vertices: int, roundness: float | None) -> int:
    """Return how many faces a rock is drawn with: few where edges, and corners to spare, are to be cut."""
    most = n_vertices // 2 + 2
    if roundness is None:
        return most
    return min(most, next(faces for bound, faces in _ROUND_FACES if roundness < bound))


def _proportioned(rock: Polyhedra, wanted: Floats) -> Polyhedra:
    return _stretched(rock, wanted)[0]


def _rounded(
    rocks: Polyhedra, is_had: NDArray[np.bool_], wanted: Floats, roundness: float, n_vertices: int
) -> Polyhedra:
    """Return rocks rounded, as near as each gets, with their proportions kept; those that have none as they are."""
    made = []
    for i in range(len(rocks)):
        one, _ = select(rocks, np.array([i]))
        if is_had[i]:
            one = searched(one, roundness, n_vertices, partial(_proportioned, wanted=wanted[i : i + 1])).shape
        made.append(one)
    return together(*made)


def _hold(rocks: Polyhedra, wanted: Floats, roundness: float | None) -> NDArray[np.bool_]:
    """Return which rocks have the proportions and the roundness asked for, turned one way or another, shape (n,).

    Of two boxes as small as one another the last digit decides which is the smallest.
    """
    result = np.ones(len(rocks), dtype=bool)
    for turn in (np.eye(3), _TURN):
        turned = replace(rocks, vertices=(turn * rocks.vertices[:, None, :]).sum(axis=2))
        edges = -np.sort(-standing_boxes(turned).edges, axis=1)
        result &= (np.abs(edges / edges[:, :1] / wanted - 1) <= 2 * TOLERANCE).all(axis=1)
        if roundness is not None:
            measured = outline_roundnesses(turned).mean(axis=1)
            result &= np.abs(measured - roundness) <= ROUNDNESS_TOLERANCE
    return result


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
