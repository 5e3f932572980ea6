"""Shapes whose edges and corners are cut until they are as round as asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError, ShapeError, name_offenders
from grainsdem.gate import gated
from grainsdem.geometry.forms.outlines import outline_roundnesses
from grainsdem.geometry.hulls import convex_hull
from grainsdem.geometry.integrals import face_planes, volumes
from grainsdem.geometry.selection import select
from grainsdem.shapes.sizing import centred, scaled, together

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Polyhedra

    Floats = NDArray[np.float64]

MOST_VERTICES = 64
"""Corners of a rounded shape by default, at most: what PhysX holds."""

ROUNDNESS_TOLERANCE = 0.02
"""How near the roundness of a shape comes to the one asked for: charts tell apart steps of 0.1."""

_STEPS = 24
"""Radii that are tried for a shape; most take six."""

_LARGEST = 0.98
"""Largest radius of an edge, relative to the ball inside: with all of it nothing is left to be rounded."""


@gated
def rounded(shapes: Polyhedra, roundness: ArrayLike, *, n_vertices: int = MOST_VERTICES) -> Polyhedra:
    """Return shapes with bevelled edges and corners, of the same volumes and of a given roundness.

    Parameters
    ----------
    shapes : Polyhedra
        Convex shapes.
    roundness : array_like, shape () or (n,)
        Wadell's, as `grainsdem.roundness` measures it, in [0, 1]: had within 0.02.
    n_vertices : int
        Corners of a shape at most. Where they are too few for all edges, those that stand out most are cut.

    Returns
    -------
    Polyhedra
        Shapes about their centroids.

    Raises
    ------
    InputError
        If a shape is rounder already, or cannot become so round with so few corners.

    Notes
    -----
    Faces moved inward by r leave a core. The shape rounded to radius r is all that is no farther than r from the core,
    and bevels are planes that touch it: one along each edge, halfway between its faces, and one at each corner. The
    radius is searched that gives the roundness, and the shape scaled to its volume.
    """
    wanted = np.asarray(roundness, dtype=np.float64)
    if wanted.shape not in ((), (len(shapes),)):
        raise ShapeError(f"roundness must be one number, or one for each of {len(shapes)} shapes; got {wanted.shape}")
    bad = np.ravel(wanted)[~((np.ravel(wanted) >= 0) & (np.ravel(wanted) <= 1))]
    if bad.size:
        raise InputError(f"roundness must lie in [0, 1]; got {name_offenders(bad.tolist())}")
    wanted = np.broadcast_to(wanted, len(shapes))
    done = []
    for i in range(len(shapes)):
        one, _ = select(shapes, np.array([i]))
        found = searched(one, float(wanted[i]), n_vertices)
        if abs(found.roundness - wanted[i]) > ROUNDNESS_TOLERANCE:
            word = "is rounder already" if found.radius == 0 else f"gets no nearer with {n_vertices} corners"
            raise InputError(f"shape {i} was to have roundness {wanted[i]:g}, and {word}: {found.roundness:.3f}")
        done.append(scaled(centred(found.shape), np.cbrt(volumes(one) / volumes(found.shape))))
    return together(*done)


class Found(NamedTuple):
    """The shape nearest to a roundness.

    Parameters
    ----------
    shape : Polyhedra
        One shape, somewhere.
    roundness : float
        Its own.
    radius : float
        Radius [m] of its edges.
    """

    shape: Polyhedra
    roundness: float
    radius: float


def searched(
    shape: Polyhedra, wanted: float, n_vertices: int, finish: Callable[[Polyhedra], Polyhedra] | None = None
) -> Found:
    """Return a shape rounded until its roundness is the one wanted, or as near as it gets.

    Parameters
    ----------
    shape : Polyhedra
        One convex shape.
    wanted : float
        Roundness.
    n_vertices : int
        Corners at most.
    finish : callable, optional
        What is done to a rounded shape before it is measured.
    """
    frame = _frame(shape)

    def attempt(radius: float) -> Found:
        made = _bevelled(frame, radius, n_vertices) if radius > 0 else shape
        made = made if finish is None else finish(made)
        return Found(made, float(outline_roundnesses(made).mean()), radius)

    low = attempt(0.0)
    if low.roundness >= wanted - 0.1 * ROUNDNESS_TOLERANCE:
        return low
    high = attempt(_LARGEST * frame.inner)
    best = min(low, high, key=lambda found: abs(found.roundness - wanted))
    # Neither end for ever: a box that jumps to another face makes the roundness jump.
    for _ in range(_STEPS):
        if abs(best.roundness - wanted) <= 0.1 * ROUNDNESS_TOLERANCE or high.roundness < wanted:
            break
        share = (wanted - low.roundness) / max(high.roundness - low.roundness, 1e-12)
        middle = attempt(low.radius + min(max(share, 0.2), 0.8) * (high.radius - low.radius))
        best = min(best, middle, key=lambda found: abs(found.roundness - wanted))
        low, high = (middle, high) if middle.roundness < wanted else (low, middle)
    return best


class _Frame(NamedTuple):
    """Planes of a shape about the middle of the largest ball in it, and where it may be cut."""

    normals: Floats
    distances: Floats
    inner: float
    edges: Floats
    corners: Floats
    vertices: Floats


def _frame(shape: Polyhedra) -> _Frame:
    """Return what `_bevelled` needs to know of a shape."""
    from scipy.optimize import linprog  # noqa: PLC0415  (half a second)

    planes = face_planes(shape)
    rows = np.column_stack([planes.normals, np.ones(len(planes.normals))])
    ball = linprog([0, 0, 0, -1], A_ub=rows, b_ub=planes.heights, bounds=[(None, None)] * 3 + [(0, None)])
    if ball.x is None:
        raise InputError("a shape without a ball inside cannot be rounded")
    middle = np.asarray(ball.x[:3])
    beside: dict[tuple[int, int], list[int]] = {}
    at_corner = np.zeros((len(shape.vertices), 3))
    for f, face in enumerate(shape.faces_of(0)):
        at_corner[face] += planes.normals[f]
        for a, b in zip(face, np.roll(face, -1), strict=True):
            beside.setdefault((min(a, b), max(a, b)), []).append(f)
    edges = np.array([planes.normals[pair].sum(axis=0) for pair in beside.values()])
    along, at = (rows / np.sqrt((rows**2).sum(axis=1, keepdims=True)) for rows in (edges, at_corner))
    heights = planes.heights - planes.normals @ middle
    return _Frame(planes.normals, heights, float(ball.x[3]), along, at, shape.vertices - middle)


def _bevelled(frame: _Frame, radius: float, n_vertices: int) -> Polyhedra:
    """Return a shape whose edges, and then corners, are cut along planes that touch what is rounded to a radius."""
    core = _within(frame.normals, frame.distances - radius)
    cuts = []
    for normals in (frame.edges, frame.corners):
        distances = (core @ normals.T).max(axis=0) + radius
        order = np.argsort(distances - (frame.vertices @ normals.T).max(axis=0), kind="stable")
        cuts.append(np.column_stack([normals, distances])[order])
    planes = np.concatenate(cuts)
    # A cut takes away some corners and makes two more than that where three edges meet at each.
    n = min(len(planes), max((n_vertices - len(frame.vertices)) // 2, 0))
    while True:
        normals = np.concatenate([frame.normals, planes[:n, :3]])
        shape = convex_hull(_within(normals, np.concatenate([frame.distances, planes[:n, 3]])))
        excess = len(shape.vertices) - n_vertices
        if excess <= 0 or n == 0:
            return shape
        n = max(n - (excess + 1) // 2, 0)


def _within(normals: Floats, distances: Floats) -> Floats:
    """Return the corners [m] of what lies within planes that go around the origin: the faces of the polar hull."""
    from scipy.spatial import ConvexHull  # noqa: PLC0415  (half a second)

    polar = normals / distances[:, None]
    size = np.abs(polar).max()
    planes = ConvexHull(polar / size).equations
    # Triangles of one face of the polar hull are one corner.
    corners: Floats = np.unique(np.round(planes[:, :3] / -planes[:, 3:], 12), axis=0) / size
    return corners
