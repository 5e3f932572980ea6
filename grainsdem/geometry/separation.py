"""Exact signed gaps of pairs of convex grains, and planes that certify that two grains do not overlap.

Each pair is solved in the frame of its first grain, so answers do not depend on where in the world a packing lies.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit, prange

from grainsdem.geometry.gjk import FAR, OVERLAPPING, descend
from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.patches import (
    area_and_centre,
    basis,
    clip,
    find_feature,
    nearest_on_segments,
    project,
)
from grainsdem.geometry.penetration import along, search_edges, search_faces
from grainsdem.geometry.rotations import to_matrices
from grainsdem.model import Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

CHUNK = 512
"""Pairs that one thread takes at a time: its scratch arrays are made once for all of them."""

UNIT = 2.0**-53
"""Largest relative error of one rounding."""


class Bodies(NamedTuple):
    """The grains of a packing, turned as they stand, each about its own position.

    Parameters
    ----------
    shapes : Polyhedra
        Turned grains [m].
    normals, heights, areas : ndarray, shapes (n_faces, 3), (n_faces,) and (n_faces,)
        Planes n · x = h [m] and areas [m²] of the faces.
    edges : ndarray of int32, shape (n_edges, 4)
        Two vertices and the two faces beside each edge, local to the grain; the first face runs along the edge.
    edge_offsets : ndarray of int64, shape (n + 1,)
        Edges of grain i are ``edges[edge_offsets[i]:edge_offsets[i + 1]]``.
    """

    shapes: Polyhedra
    normals: Floats
    heights: Floats
    areas: Floats
    edges: NDArray[np.int32]
    edge_offsets: NDArray[np.int64]


class Gaps(NamedTuple):
    """Where two grains of a pair are nearest, one row a pair.

    Parameters
    ----------
    gaps : ndarray, shape (m,)
        Signed gap [m]: distance, or minus the depth of the overlap; infinite beyond the limit.
    normals : ndarray, shape (m, 3)
        Unit normal from the first grain to the second.
    firsts, seconds : ndarray, shape (m, 3)
        Closest points, or the deepest ones, of the two, relative to the first grain's position [m].
    centres : ndarray, shape (m, 3)
        Centre of the shared patch where faces or edges lie flat on one another, else midway between the closest
        points; relative to the first grain's position [m].
    areas : ndarray, shape (m,)
        Area [m²] that facing polygons share.
    features : ndarray of int8, shape (m, 2)
        What each grain touches with: 0 a corner, 1 an edge, 2 a face.
    """

    gaps: Floats
    normals: Floats
    firsts: Floats
    seconds: Floats
    centres: Floats
    areas: Floats
    features: NDArray[np.int8]


def bodies(packing: Packing) -> Bodies:
    """Return the grains of a packing as arrays that the pair kernels read."""
    g = packing.grains
    counts = np.diff(g.vertex_offsets)
    turned = np.empty_like(g.vertices)
    _turn(g.vertices, g.vertex_offsets, to_matrices(packing.quaternions), turned)
    shapes = Polyhedra(turned, g.vertex_offsets, g.face_offsets, g.face_vertices, g.face_vertex_offsets)
    most = int(counts.max(initial=0))
    ends = g.face_vertex_offsets[g.face_offsets]
    raw = np.empty((int(ends[-1]), 4), dtype=np.int32)
    found = np.zeros(len(g), dtype=np.int64)
    _find_edges(g.face_offsets, g.face_vertices, g.face_vertex_offsets, ends, most, raw, found)
    offsets = offsets_from_counts(found)
    rows = np.arange(offsets[-1]) + np.repeat(ends[:-1] - offsets[:-1], found)
    planes = face_planes(shapes)
    return Bodies(shapes, planes.normals, planes.heights, planes.areas, raw[rows], offsets)


def offsets_between(packing: Packing, pairs: NDArray[np.int32], shifts: NDArray[np.int32] | None = None) -> Floats:
    """Return the vector [m] from the first grain's position to the second's image, shape (m, 3)."""
    between = packing.positions[pairs[:, 1]] - packing.positions[pairs[:, 0]]
    if shifts is None or not shifts.any():
        return between
    return between + shifts * packing.domain.lengths


def measure_gaps(solids: Bodies, pairs: NDArray[np.int32], offsets: Floats, limit: float = np.inf) -> Gaps:
    """Return the exact signed gap of each pair.

    Parameters
    ----------
    solids : Bodies
        Convex grains.
    pairs : ndarray of int32, shape (m, 2)
        Grain ids.
    offsets : ndarray, shape (m, 3)
        Vector [m] from the first grain's position to the second's (see `offsets_between`).
    limit : float
        Pairs farther apart than this [m] get an infinite gap and nothing else; saves most of the work.

    Returns
    -------
    Gaps
        One row a pair.

    Notes
    -----
    GJK finds the distance and proves it by a plane. Where it finds none, or cannot prove it, every face normal and
    pair of edges that could be the shortest way out is tried instead.
    """
    m = len(pairs)
    result = Gaps(
        np.full(m, np.inf),
        np.zeros((m, 3)),
        np.zeros((m, 3)),
        np.zeros((m, 3)),
        np.zeros((m, 3)),
        np.zeros(m),
        np.zeros((m, 2), dtype=np.int8),
    )
    s = solids.shapes
    most = int(np.diff(s.face_vertex_offsets).max(initial=2))
    _measure(
        s.vertices, s.vertex_offsets, s.face_offsets, s.face_vertices, s.face_vertex_offsets,
        solids.normals, solids.heights, solids.areas, solids.edges, solids.edge_offsets,
        pairs, np.ascontiguousarray(offsets), limit, 2 * most + 8, *result,
    )  # fmt: skip
    return result


def certify(solids: Bodies, pairs: NDArray[np.int32], offsets: Floats) -> tuple[Floats, Floats]:
    """Return a plane's normal for each pair, and how far apart the two grains surely are along it.

    Parameters
    ----------
    solids : Bodies
        Convex grains.
    pairs : ndarray of int32, shape (m, 2)
        Grain ids.
    offsets : ndarray, shape (m, 3)
        Vector [m] from the first grain's position to the second's.

    Returns
    -------
    normals : ndarray, shape (m, 3)
        Unit normals from the first grain to the second.
    margins : ndarray, shape (m,)
        Lower bound [m] of min n · x over the second minus max n · x over the first. Where it is not negative, the
        plane proves that the two do not overlap; else the overlap is no thicker than its opposite.

    Notes
    -----
    However the normal was found, the margin is taken afresh over all vertices, and lowered by more than all its
    roundings together: 16 u of the vertices' distances from the first grain's position, with u = 2⁻⁵³. That covers
    the turning of the vertices, their dot products and the sum.
    """
    normals = np.zeros((len(pairs), 3))
    margins = np.full(len(pairs), -np.inf)
    s = solids.shapes
    _certify(
        s.vertices, s.vertex_offsets, s.face_offsets, solids.normals, solids.heights,
        pairs, np.ascontiguousarray(offsets), normals, margins,
    )  # fmt: skip
    return normals, margins


@njit(cache=True, parallel=True)
def _turn(vertices, vertex_offsets, matrices, turned):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in prange(vertex_offsets.size - 1):
        r = matrices[i]
        for k in range(vertex_offsets[i], vertex_offsets[i + 1]):
            for c in range(3):
                turned[k, c] = r[c, 0] * vertices[k, 0] + r[c, 1] * vertices[k, 1] + r[c, 2] * vertices[k, 2]


@njit(cache=True, parallel=True)
def _find_edges(face_offsets, corners, corner_offsets, ends, most, edges, found):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """List the edges that two faces share; an edge of an open mesh is left out."""
    n = face_offsets.size - 1
    for block in prange((n + CHUNK - 1) // CHUNK):
        beside = np.full((most, most), -1, dtype=np.int32)
        for i in range(block * CHUNK, min(n, (block + 1) * CHUNK)):
            f0, f1 = face_offsets[i], face_offsets[i + 1]
            count = 0
            for f in range(f0, f1):
                c0, c1 = corner_offsets[f], corner_offsets[f + 1]
                for c in range(c0, c1):
                    p, q = corners[c], corners[c0 if c + 1 == c1 else c + 1]
                    other = beside[q, p]
                    if other < 0:
                        beside[p, q] = f - f0
                        continue
                    row = ends[i] + count
                    edges[row, 0], edges[row, 1], edges[row, 2], edges[row, 3] = q, p, other, f - f0
                    count += 1
            found[i] = count
            for f in range(f0, f1):
                c0, c1 = corner_offsets[f], corner_offsets[f + 1]
                for c in range(c0, c1):
                    beside[corners[c], corners[c0 if c + 1 == c1 else c + 1]] = -1


@njit(cache=True, parallel=True)
def _measure(
    x,
    vertex_offsets,
    face_offsets,
    corners,
    corner_offsets,
    normals,
    heights,
    face_areas,
    edges,
    edge_offsets,
    pairs,
    offsets,
    limit,
    room,
    gaps,
    axes,
    firsts,
    seconds,
    centres,
    areas,
    features,
):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, E501
    m = len(pairs)
    for block in prange((m + CHUNK - 1) // CHUNK):
        simplex, made, weights = np.empty((4, 3)), np.empty((4, 2), dtype=np.int64), np.empty(4)
        n, u, w, centre = np.empty(3), np.empty(3), np.empty(3), np.empty(2)
        pa, pb, sa, sb = np.empty(3), np.empty(3), np.empty((2, 3)), np.empty((2, 3))
        picked = np.empty(2, dtype=np.int64)
        poly_a, poly_b = np.empty(room, dtype=np.int64), np.empty(room, dtype=np.int64)
        flat_a, flat_b, spare = np.empty((room, 2)), np.empty((room, 2)), np.empty((room, 2))
        for row in range(block * CHUNK, min(m, (block + 1) * CHUNK)):
            a, b = pairs[row, 0], pairs[row, 1]
            t = offsets[row]
            a0, a1, b0, b1 = vertex_offsets[a], vertex_offsets[a + 1], vertex_offsets[b], vertex_offsets[b + 1]
            fa0, fa1, fb0, fb1 = face_offsets[a], face_offsets[a + 1], face_offsets[b], face_offsets[b + 1]
            if a0 == a1 or b0 == b1:
                continue
            weights[:] = 0.0
            state, rows, lower = descend(x, a0, a1, b0, b1, t, limit, simplex, made, weights, n)
            if state == FAR:
                continue
            size = 0.0
            for k in range(a0, a1):
                size = max(size, abs(x[k, 0]), abs(x[k, 1]), abs(x[k, 2]))
            pa[:] = 0.0
            pb[:] = 0.0
            total = weights[:rows].sum()
            for r in range(rows):
                p, q, share = made[r, 0], made[r, 1], weights[r] / total
                for k in range(3):
                    pa[k] += share * x[p, k]
                    pb[k] += share * (x[q, k] + t[k])
            gap = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            # Below 1e-9 of a grain the direction of v is rounding; above, the bound must meet the distance.
            proven = state != OVERLAPPING and gap > 1e-9 * size and gap - lower <= 1e-12 * (size + gap)
            if proven:
                n /= gap
            else:
                gap = _solve_near(
                    x, vertex_offsets, face_offsets, normals, heights, edges, edge_offsets,
                    a, b, t, pa, pb, size, n, picked, sa, sb,
                )  # fmt: skip
            if gap > limit:
                continue
            gaps[row] = gap
            axes[row] = n
            firsts[row] = pa
            seconds[row] = pb
            count_a = find_feature(
                x, a0, a1, normals, face_areas, fa0, fa1, corners, corner_offsets, edges, edge_offsets[a],
                edge_offsets[a + 1], n[0], n[1], n[2], poly_a,
            )  # fmt: skip
            count_b = find_feature(
                x, b0, b1, normals, face_areas, fb0, fb1, corners, corner_offsets, edges, edge_offsets[b],
                edge_offsets[b + 1], -n[0], -n[1], -n[2], poly_b,
            )  # fmt: skip
            features[row, 0] = min(count_a, 3) - 1
            features[row, 1] = min(count_b, 3) - 1
            for k in range(3):
                centres[row, k] = 0.5 * (pa[k] + pb[k])
            if max(count_a, count_b) < 3 or min(count_a, count_b) < 2:
                continue
            basis(n, u, w)
            project(x, poly_a, count_a, 0.0, 0.0, 0.0, u, w, flat_a)
            project(x, poly_b, count_b, t[0], t[1], t[2], u, w, flat_b)
            # Seen from the tip of n, faces of a run counter-clockwise and those of b clockwise.
            if count_a >= 3:
                shared = clip(flat_b, count_b, flat_a, count_a, 1.0, spare)
                area = area_and_centre(flat_b, shared, centre) if shared > 0 else 0.0
            else:
                shared = clip(flat_a, count_a, flat_b, count_b, -1.0, spare)
                area = area_and_centre(flat_a, shared, centre) if shared > 0 else 0.0
            if shared == 0:
                continue
            areas[row] = area if min(count_a, count_b) >= 3 else 0.0
            height = 0.0
            for k in range(3):
                height += n[k] * 0.5 * (pa[k] + pb[k])
            for k in range(3):
                centres[row, k] = centre[0] * u[k] + centre[1] * w[k] + height * n[k]


@njit(cache=True)
def _solve_near(
    x, vertex_offsets, face_offsets, normals, heights, edges, edge_offsets, a, b, t, pa, pb, size, n, picked, sa, sb
):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202, E501
    """Return the signed gap of bodies that touch, overlap or nearly do; fill its normal and the deepest points."""
    a0, a1, b0, b1 = vertex_offsets[a], vertex_offsets[a + 1], vertex_offsets[b], vertex_offsets[b + 1]
    fa0, fa1, fb0, fb1 = face_offsets[a], face_offsets[a + 1], face_offsets[b], face_offsets[b + 1]
    norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    best = -np.inf
    picked[0] = picked[1] = -1
    if norm > 0.0:
        n /= norm
        best = along(x, a0, a1, b0, b1, t, n[0], n[1], n[2])
    apart = 0.0
    for k in range(3):
        apart += (pb[k] - pa[k]) ** 2
    apart = np.sqrt(apart)
    if best < apart - 1e-12 * size:
        # A small head start lets equal directions lose to a face normal, which is the exact one.
        best = search_faces(x, a0, a1, b0, b1, t, normals, heights, fa0, fa1, fb0, fb1, pa, pb, best - 1e-13 * size, n)
    if best < -1e-13 * size:
        best = search_edges(
            x, t, normals, heights, edges, a, b, edge_offsets, vertex_offsets, face_offsets, pa, pb, best, n, picked
        )
    if best >= 0.0 and apart > best:
        # Apart, and the closest points are known: the plane only bounds their distance from below.
        return best if apart - best > 1e-9 * size else apart
    if picked[0] >= 0:
        for k in range(3):
            sa[0, k] = x[a0 + edges[picked[0], 0], k]
            sa[1, k] = x[a0 + edges[picked[0], 1], k]
            sb[0, k] = x[b0 + edges[picked[1], 0], k] + t[k]
            sb[1, k] = x[b0 + edges[picked[1], 1], k] + t[k]
        nearest_on_segments(sa[0], sa[1], sb[0], sb[1], pa, pb)
    elif best < 0.0:
        _deepest(x, a0, a1, b0, b1, fa0, fa1, normals, t, best, n, pa, pb)
    return best


@njit(cache=True)
def _deepest(x, a0, a1, b0, b1, fa0, fa1, normals, t, gap, n, pa, pb):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the deepest points of bodies whose shortest way out is along a face normal of one of them."""
    of_a = False
    for f in range(fa0, fa1):
        of_a = of_a or (normals[f, 0] == n[0] and normals[f, 1] == n[1] and normals[f, 2] == n[2])
    sign, first, last = (-1.0, b0, b1) if of_a else (1.0, a0, a1)
    high = -np.inf
    for k in range(first, last):
        s = sign * (n[0] * x[k, 0] + n[1] * x[k, 1] + n[2] * x[k, 2])
        if s > high:
            high = s
            for c in range(3):
                if of_a:
                    pb[c] = x[k, c] + t[c]
                    pa[c] = pb[c] - gap * n[c]
                else:
                    pa[c] = x[k, c]
                    pb[c] = pa[c] + gap * n[c]


@njit(cache=True, parallel=True)
def _certify(x, vertex_offsets, face_offsets, normals, heights, pairs, offsets, axes, margins):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    m = len(pairs)
    for block in prange((m + CHUNK - 1) // CHUNK):
        simplex, made, weights, n = np.empty((4, 3)), np.empty((4, 2), dtype=np.int64), np.empty(4), np.empty(3)
        pa, pb = np.empty(3), np.empty(3)
        for row in range(block * CHUNK, min(m, (block + 1) * CHUNK)):
            a, b = pairs[row, 0], pairs[row, 1]
            t = offsets[row]
            a0, a1, b0, b1 = vertex_offsets[a], vertex_offsets[a + 1], vertex_offsets[b], vertex_offsets[b + 1]
            far = max(abs(t[0]), abs(t[1]), abs(t[2]))
            size = far
            for k in range(a0, a1):
                size = max(size, abs(x[k, 0]), abs(x[k, 1]), abs(x[k, 2]))
            for k in range(b0, b1):
                size = max(size, far + abs(x[k, 0]), far + abs(x[k, 1]), far + abs(x[k, 2]))
            error = 16.0 * np.sqrt(3.0) * UNIT * size
            weights[:] = 0.0
            state, rows, lower = descend(x, a0, a1, b0, b1, t, error, simplex, made, weights, n)
            norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
            margin = -np.inf
            if norm > 0.0:
                n /= norm
                margin = along(x, a0, a1, b0, b1, t, n[0], n[1], n[2])
            if margin < error:
                pa[:] = 0.0
                pb[:] = 0.0
                total = weights[:rows].sum()
                for r in range(rows):
                    for k in range(3):
                        pa[k] += weights[r] / total * x[made[r, 0], k]
                        pb[k] += weights[r] / total * (x[made[r, 1], k] + t[k])
                margin = search_faces(
                    x, a0, a1, b0, b1, t, normals, heights, face_offsets[a], face_offsets[a + 1], face_offsets[b],
                    face_offsets[b + 1], pa, pb, margin, n,
                )  # fmt: skip
            axes[row] = n
            margins[row] = margin - error
