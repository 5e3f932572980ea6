"""Convex cells between ellipsoids: each pair is parted by a plane, and a cell is what its planes leave.

An ellipsoid i at s_i with the form G_i and the weight w_i has the field f_i(x) = (x - s_i)ᵀ G_i (x - s_i) - w_i. The
level sets f_i = t and f_j = t of a pair swell with t until they touch; the plane that both touch there parts them. Of
equal forms these are the planes of Laguerre's cells, which fill space. Of unequal ones the places at which f_i and f_j
are equal are curved [1]_: a plane touches them, cells on either side never overlap, and a little space between
three or more is left empty.

References
----------
.. [1] A. Alpers, A. Brieden, P. Gritzmann, A. Lyckegaard, H. F. Poulsen, "Generalized balanced power diagrams for 3D
   representations of polycrystals", Philosophical Magazine 95 (2015) 1016-1028.
.. [2] J. W. Perram, M. S. Wertheim, "Statistical mechanics of hard ellipsoids. I", J. Computational Physics 58 (1985)
   409-416: where two ellipsoids that swell come to touch.
"""

from __future__ import annotations

from math import sqrt
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.cells.cutting import CUT, EMPTY, HOME, LOST, UNTOUCHED, cut, polish, start_box
from grainsdem.geometry.cells.emitting import BROKEN, emit
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.model import DROPPED, Polyhedra
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]

STEPS = 60
"""Most steps to where two ellipsoids touch: of regula falsi ten are usual."""

NEAREST = 0.02
"""Least share that either has in where the plane lies: one whose centre lies in the other would be parted behind it."""

SIZE = 256
"""Triangles and planes that fit the work arrays of a cell."""

CHUNK = 64
"""Cells that are worth a thread."""

WIDEST = 1e-9
"""Largest relative length that repairs may take for rounding."""


class Between(NamedTuple):
    """Cells between ellipsoids.

    Parameters
    ----------
    shapes : Polyhedra
        One polyhedron an ellipsoid, its vertices relative to the centre; without faces where nothing is left.
    neighbors : ndarray of int32, shape (n_faces,)
        The cell behind each face; negative numbers are walls as `Domain` numbers them.
    codes : ndarray of int8, shape (n_faces,)
        Periodic image of that neighbour, as `cutting` codes it.
    is_sound : ndarray of bool, shape (n,)
        Where the planes are told apart, and enclose the cell along periodic axes.
    """

    shapes: Polyhedra
    neighbors: NDArray[np.int32]
    codes: NDArray[np.int8]
    is_sound: NDArray[np.bool_]


@inner
def _touch(a, b, gain, r, at):  # type: ignore[no-untyped-def]
    """Fill where the level sets of two forms touch, relative to the first centre, and return by which share of each.

    ``gain`` is the weight of the first less that of the second, ``r`` the way from the first centre to the second.
    """
    low, high = 0.0, 1.0
    at_low = at_high = 0.0
    for k in range(3):
        for m in range(3):
            at_low += r[k] * a[k, m] * r[m]
            at_high -= r[k] * b[k, m] * r[m]
    at_low -= gain
    at_high -= gain
    share, side = 0.5, 0
    br0 = b[0, 0] * r[0] + b[0, 1] * r[1] + b[0, 2] * r[2]
    br1 = b[1, 0] * r[0] + b[1, 1] * r[1] + b[1, 2] * r[2]
    br2 = b[2, 0] * r[0] + b[2, 1] * r[1] + b[2, 2] * r[2]
    scale = abs(at_low) + abs(at_high)
    for step in range(STEPS):
        if at_low > 0.0 and at_high < 0.0 and step > 0:
            share = low + (high - low) * at_low / (at_low - at_high)
        share = min(max(share, NEAREST), 1.0 - NEAREST)
        rest = 1.0 - share
        m00, m01, m02 = (
            share * a[0, 0] + rest * b[0, 0],
            share * a[0, 1] + rest * b[0, 1],
            share * a[0, 2] + rest * b[0, 2],
        )
        m11, m12, m22 = (
            share * a[1, 1] + rest * b[1, 1],
            share * a[1, 2] + rest * b[1, 2],
            share * a[2, 2] + rest * b[2, 2],
        )
        c00, c01, c02 = m11 * m22 - m12 * m12, m02 * m12 - m01 * m22, m01 * m12 - m02 * m11
        c11, c12, c22 = m00 * m22 - m02 * m02, m01 * m02 - m00 * m12, m00 * m11 - m01 * m01
        factor = rest / (m00 * c00 + m01 * c01 + m02 * c02)
        x = factor * (c00 * br0 + c01 * br1 + c02 * br2)
        y = factor * (c01 * br0 + c11 * br1 + c12 * br2)
        z = factor * (c02 * br0 + c12 * br1 + c22 * br2)
        at[0], at[1], at[2] = x, y, z
        u, v, w = x - r[0], y - r[1], z - r[2]
        value = -gain
        value += (
            x * (a[0, 0] * x + 2 * a[0, 1] * y + 2 * a[0, 2] * z)
            + y * (a[1, 1] * y + 2 * a[1, 2] * z)
            + a[2, 2] * z * z
        )
        value -= (
            u * (b[0, 0] * u + 2 * b[0, 1] * v + 2 * b[0, 2] * w)
            + v * (b[1, 1] * v + 2 * b[1, 2] * w)
            + b[2, 2] * w * w
        )
        if abs(value) <= 1e-12 * scale or high - low < 1e-13:
            break
        if value > 0.0:
            if share >= 1.0 - NEAREST:
                break
            low, at_low = share, value
            if side == 1:
                at_high *= 0.5
            side = 1
        else:
            if share <= NEAREST:
                break
            high, at_high = share, value
            if side == -1:
                at_low *= 0.5
            side = -1
    return share


@inner
def _carve(i, frame, sites, weights, forms, partners, codes, further, work, r, at):  # type: ignore[no-untyped-def]
    """Cut the cell of ellipsoid ``i`` in the work arrays; return status and the numbers of triangles and planes."""
    lengths, periodic, walls, slack = frame
    geo, tri, planes, tags = work
    x, y, z = sites[i, 0], sites[i, 1], sites[i, 2]
    # Along a periodic axis the box ends at a whole length: the images of the ellipsoid itself bound it before.
    start_box(
        geo, tri, planes, tags,
        lengths[0] if periodic[0] else x, lengths[1] if periodic[1] else y, lengths[2] if periodic[2] else z,
        np.array([(2.0 if periodic[k] else 1.0) * lengths[k] for k in range(3)]), np.zeros(3, dtype=np.bool_),
        np.int64(0),
    )  # fmt: skip
    n_tri, n_planes = np.int64(8), np.int64(6)  # typed: a literal would have numba compile every callee twice
    for w in range(len(walls)):
        a, b, c = walls[w, 0], walls[w, 1], walls[w, 2]
        half = walls[w, 3] - (a * x + b * y + c * z)
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, a, b, c, half, slack)
        if status == CUT:
            tags[0, n_planes] = -7 - w
            tags[1, n_planes] = HOME
            n_planes += 1
        elif status != UNTOUCHED:
            return status, n_tri, n_planes
    for k in range(len(further)):
        a, b, c = further[k, 0], further[k, 1], further[k, 2]
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, a, b, c, further[k, 3], slack)
        if status == CUT:
            tags[0, n_planes] = DROPPED
            tags[1, n_planes] = HOME
            n_planes += 1
        elif status != UNTOUCHED:
            return status, n_tri, n_planes
    for k in range(len(partners)):
        j, code = partners[k], codes[k]
        r[0] = sites[j, 0] - x + (code // 9 - 1) * lengths[0]
        r[1] = sites[j, 1] - y + (code // 3 % 3 - 1) * lengths[1]
        r[2] = sites[j, 2] - z + (code % 3 - 1) * lengths[2]
        # From the same side for both cells, so that their planes are one.
        is_first = i < j or (i == j and code > HOME)
        if not is_first:
            r[0], r[1], r[2] = -r[0], -r[1], -r[2]
        first, second = (i, j) if is_first else (j, i)
        _touch(forms[first], forms[second], weights[first] - weights[second], r, at)
        form = forms[first]
        nx = form[0, 0] * at[0] + form[0, 1] * at[1] + form[0, 2] * at[2]
        ny = form[1, 0] * at[0] + form[1, 1] * at[1] + form[1, 2] * at[2]
        nz = form[2, 0] * at[0] + form[2, 1] * at[1] + form[2, 2] * at[2]
        norm = sqrt(nx * nx + ny * ny + nz * nz)
        nx, ny, nz = nx / norm, ny / norm, nz / norm
        half = nx * at[0] + ny * at[1] + nz * at[2]
        if not is_first:
            half = nx * (r[0] - at[0]) + ny * (r[1] - at[1]) + nz * (r[2] - at[2])
            nx, ny, nz = -nx, -ny, -nz
        status, n_tri = cut(geo, tri, planes, tags, n_tri, n_planes, nx, ny, nz, half, slack)
        if status == CUT:
            tags[0, n_planes] = j
            tags[1, n_planes] = code
            n_planes += 1
        elif status != UNTOUCHED:
            return status, n_tri, n_planes
    polish(geo, tri, planes, n_tri, 64.0 * slack)
    return CUT, n_tri, n_planes


@njit(cache=True, nogil=True)
def _cells(first, last, frame, ellipsoids, near, further, tolerance, starts, batch, spans, status):  # type: ignore[no-untyped-def]
    """Write the cells from ``first`` to ``last`` into the buffers."""
    sites, weights, forms = ellipsoids
    offsets, partners, codes = near
    out_vertices, counts, ids, out_codes, out_corners = batch
    work = (
        np.empty((8, SIZE)),
        np.zeros((11, SIZE), dtype=np.int32),
        np.empty((4, SIZE)),
        np.zeros((4, SIZE), dtype=np.int32),
    )
    r, at = np.empty(3), np.empty(3)
    periodic = frame[1]
    for i in range(first, last):
        v, f, c = starts[i, 0], starts[i, 1], starts[i, 2]
        v_end, f_end, c_end = starts[i + 1, 0], starts[i + 1, 1], starts[i + 1, 2]
        row = slice(offsets[i], offsets[i + 1])
        own = further[1][further[0][i] : further[0][i + 1]]
        code, n_tri, n_planes = _carve(i, frame, sites, weights, forms, partners[row], codes[row], own, work, r, at)
        n_v = n_f = n_c = np.int64(0)
        if code == CUT:
            wide = tolerance
            code = BROKEN
            while code == BROKEN and wide <= WIDEST:
                code, n_v, n_f, n_c = emit(
                    work[0], work[1], work[3], n_tri, n_planes, wide,
                    out_vertices[v:v_end], counts[f:f_end], ids[f:f_end], out_codes[f:f_end], out_corners[c:c_end],
                )  # fmt: skip
                wide *= 8.0
            for k in range(f, f + n_f):
                if -7 < ids[k] < 0 and periodic[(-1 - ids[k]) // 2]:
                    code = LOST  # nothing bounds the cell along an axis that wraps
        status[i] = code
        if code == CUT:
            spans[i, 0], spans[i, 1], spans[i, 2] = n_v, n_f, n_c


def cells_between(
    frame: tuple[Floats, NDArray[np.bool_], Floats, float],
    ellipsoids: tuple[Floats, Floats, Floats],
    near: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
    further: tuple[NDArray[np.int64], Floats],
    *,
    tolerance: float,
) -> Between:
    """Return the convex cells between ellipsoids.

    Parameters
    ----------
    frame : tuple
        Lengths of the box, periodic axes, walls and slack, as `Frame.kernel` of the tessellation's engine has them.
    ellipsoids : tuple of ndarray
        Centres, shape (n, 3), from the lower corner of the box; weights w in squared lengths, shape (n,); forms G,
        positive definite, shape (n, 3, 3).
    near : tuple
        Offsets, shape (n + 1,), of the rows of numbers of those that may bound each cell, and codes of their images. A
        pair stands in both rows.
    further : tuple of ndarray
        Offsets, shape (n + 1,), of the rows of planes that cut each cell besides, shape (m, 4): unit normals, and
        distances from the centre. What is behind them is `DROPPED`.
    tolerance : float
        Length below which an edge is rounding.
    """
    n = len(ellipsoids[0])
    room = np.minimum(2 * (np.diff(near[0]) + np.diff(further[0]) + 6 + len(frame[2])), SIZE)
    starts = np.stack([offsets_from_counts(room), offsets_from_counts(room), offsets_from_counts(3 * room)], axis=1)
    batch = (
        np.empty((starts[-1, 0], 3)),
        np.empty(starts[-1, 1], dtype=np.int32),
        np.empty(starts[-1, 1], dtype=np.int32),
        np.empty(starts[-1, 1], dtype=np.int8),
        np.empty(starts[-1, 2], dtype=np.int32),
    )
    spans, status = np.zeros((n, 3), dtype=np.int64), np.empty(n, dtype=np.int8)
    in_blocks(_cells, n, frame, ellipsoids, near, further, tolerance, starts, batch, spans, status, least=CHUNK)
    vertices, faces, corners = (_filled(starts[:-1, k], spans[:, k]) for k in range(3))
    counted = offsets_from_counts(batch[1][faces])
    shapes = Polyhedra(
        batch[0][vertices],
        offsets_from_counts(spans[:, 0]),
        offsets_from_counts(spans[:, 1]),
        batch[4][corners],
        counted,
    )
    return Between(shapes, batch[2][faces], batch[3][faces], np.isin(status, (CUT, EMPTY)))


def _filled(starts: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the flat indices of rows that begin at ``starts`` in buffers with room to spare."""
    offsets = offsets_from_counts(counts)
    return np.arange(offsets[-1]) + np.repeat(starts - offsets[:-1], counts)
