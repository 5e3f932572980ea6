"""The surface of a bed seen from above: upward faces drawn into a map of heights, the higher hiding the lower."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.integrals import face_planes
from grainsdem.geometry.raster.copies import copies, spread, turned_normals
from grainsdem.geometry.rotations import to_matrices
from grainsdem.geometry.threads import in_blocks, inner
from grainsdem.ragged import offsets_from_counts

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]
    Labels = NDArray[np.int32]

BAND = 32
"""Rows of pixels that one thread draws at a time."""


class Seen(NamedTuple):
    """What each pixel sees, row 0 at the largest y.

    Parameters
    ----------
    labels : ndarray of int32, shape (ny, nx)
        Grain id + 1; 0 where no grain is.
    heights : ndarray, shape (ny, nx)
        Height z [m] of what is seen; NaN where no grain is.
    faces : ndarray of int32, shape (ny, nx)
        Number of the face that is seen, counted over all grains; -1 where none is.
    """

    labels: Labels
    heights: Floats
    faces: NDArray[np.int32]


def look_down(packing: Packing, corner: Floats, pixel: Floats, counts: tuple[int, int]) -> Seen:
    """Return what is seen from straight above in the middle of each pixel.

    Parameters
    ----------
    packing : Packing
        Convex grains.
    corner : ndarray, shape (2,)
        Smallest x and y [m] of the picture.
    pixel : ndarray, shape (2,)
        Edges [m] of a pixel.
    counts : tuple of int
        Numbers of pixels along x and y.

    Notes
    -----
    Upward faces are scanned row by row; a pixel whose middle lies on an edge belongs to the face on its right, so that
    faces leave neither gaps nor doubles. Grains are drawn from the highest down, and those that lie under what is drawn
    are left out.
    """
    nx, ny = counts
    seen = Seen(np.zeros((ny, nx), dtype=np.int32), np.full((ny, nx), -np.inf), np.full((ny, nx), -1, dtype=np.int32))
    upper = corner + pixel * np.array(counts)
    window = np.append(corner, -np.inf), np.append(upper, np.inf)
    found = copies(packing, *window, wraps=(True, True, False))
    order = np.lexsort((np.arange(found.ids.size), -found.upper[:, 2]))
    ids, centres = found.ids[order], found.centres[order]
    bounds = np.concatenate([found.lower[order], found.upper[order]], axis=1)
    first, last = (
        np.clip(np.floor((upper[1] - bounds[:, k]) / pixel[1]).astype(np.int64), 0, ny - 1) // BAND for k in (4, 1)
    )
    rows, bands = spread(first, last)
    starts = offsets_from_counts(np.bincount(bands, minlength=-(-ny // BAND)))
    entries = rows[np.argsort(bands, kind="stable")]
    grains = packing.grains
    planes = face_planes(grains)
    mesh = grains.vertices, grains.vertex_offsets, grains.face_offsets, grains.face_vertices, grains.face_vertex_offsets
    in_blocks(
        _draw,
        starts.size - 1,
        tuple(seen),
        (np.array([corner[0], upper[1]]), pixel),
        (starts, entries, ids, centres, bounds),
        mesh,
        (turned_normals(packing, planes.normals), planes.heights),
        to_matrices(packing.quaternions),
        least=1,
    )
    seen.heights[seen.labels == 0] = np.nan
    return seen


@inner
def _is_hidden(heights, top, r0, r1, c0, c1):  # type: ignore[no-untyped-def]
    """Whether a rectangle of pixels is all as high as ``top`` or higher."""
    for r in range(r0, r1 + 1):
        for c in range(c0, c1 + 1):
            if heights[r, c] < top:
                return False
    return True


@njit(cache=True, nogil=True)
def _draw(start, stop, image, view, found, mesh, planes, matrices):  # type: ignore[no-untyped-def]
    labels, heights, faces = image
    (left, top), pixel = view[0], view[1]
    starts, entries, ids, centres, bounds = found
    vertices, vertex_offsets, face_offsets, corners, corner_offsets = mesh
    normals, distances = planes
    n_rows, n_columns = labels.shape
    for band in range(start, stop):
        b0, b1 = band * BAND, min((band + 1) * BAND, n_rows) - 1
        turned = np.empty((64, 3))
        for e in range(starts[band], starts[band + 1]):
            copy = entries[e]
            i = ids[copy]
            r0 = max(int(np.floor((top - bounds[copy, 4]) / pixel[1])) - 1, b0)
            r1 = min(int(np.floor((top - bounds[copy, 1]) / pixel[1])) + 1, b1)
            c0 = max(int(np.floor((bounds[copy, 0] - left) / pixel[0])) - 1, 0)
            c1 = min(int(np.floor((bounds[copy, 3] - left) / pixel[0])) + 1, n_columns - 1)
            if r0 > r1 or c0 > c1 or _is_hidden(heights, bounds[copy, 5], r0, r1, c0, c1):
                continue
            v0 = vertex_offsets[i]
            n = vertex_offsets[i + 1] - v0
            if n > turned.shape[0]:
                turned = np.empty((n, 3))
            for k in range(n):
                for c in range(3):
                    turned[k, c] = (
                        matrices[i, c, 0] * vertices[v0 + k, 0]
                        + matrices[i, c, 1] * vertices[v0 + k, 1]
                        + matrices[i, c, 2] * vertices[v0 + k, 2]
                        + centres[copy, c]
                    )
            for f in range(face_offsets[i], face_offsets[i + 1]):
                nz = normals[f, 2]
                if nz <= 0.0:
                    continue
                s, t = corner_offsets[f], corner_offsets[f + 1]
                low = high = turned[corners[s], 2]
                south = north = turned[corners[s], 1]
                for c in range(s + 1, t):
                    z, y = turned[corners[c], 2], turned[corners[c], 1]
                    low, high = min(low, z), max(high, z)
                    south, north = min(south, y), max(north, y)
                f0 = max(int(np.floor((top - north) / pixel[1] - 0.5)), b0)
                f1 = min(int(np.ceil((top - south) / pixel[1] - 0.5)), b1)
                for r in range(f0, f1 + 1):
                    y = top - (r + 0.5) * pixel[1]
                    west, east = np.inf, -np.inf
                    a = corners[t - 1]
                    for c in range(s, t):
                        b = corners[c]
                        # From the lower end always, so that two faces find the same place on their edge.
                        p, q = (a, b) if turned[a, 1] <= turned[b, 1] else (b, a)
                        if turned[p, 1] <= y < turned[q, 1]:
                            share = (y - turned[p, 1]) / (turned[q, 1] - turned[p, 1])
                            x = turned[p, 0] + share * (turned[q, 0] - turned[p, 0])
                            west, east = min(west, x), max(east, x)
                        a = b
                    if west > east:
                        continue
                    g0 = int(max(np.ceil((west - left) / pixel[0] - 0.5), 0.0))
                    g1 = int(min(np.ceil((east - left) / pixel[0] - 0.5), float(n_columns)))
                    level = distances[f] - normals[f, 1] * (y - centres[copy, 1])
                    for c in range(g0, g1):
                        x = left + (c + 0.5) * pixel[0] - centres[copy, 0]
                        z = min(max((level - normals[f, 0] * x) / nz + centres[copy, 2], low), high)
                        if z > heights[r, c] or (z == heights[r, c] and i < labels[r, c] - 1):
                            heights[r, c] = z
                            labels[r, c] = i + 1
                            faces[r, c] = f


def sky(heights: Floats, pixel: float, reach: float, *, wraps: tuple[bool, bool] = (False, False)) -> Floats:
    """Return the share of the sky's light that falls on each pixel of a map of heights, shape (ny, nx).

    Parameters
    ----------
    heights : ndarray, shape (ny, nx)
        Heights [m], finite, row 0 at the largest y.
    pixel : float
        Edge [m] of a pixel.
    reach : float
        How far [m] is looked for what hides the sky.
    wraps : tuple of bool
        Whether the map goes on at its other side along x and y.

    Notes
    -----
    Of an evenly bright sky a level pixel gets the mean of cos² h over all directions, h the height of the horizon
    there; sixteen directions are looked in.
    """
    most = max(int(np.ceil(reach / pixel)), 1)
    steps = np.unique(np.round(np.geomspace(1, most, 24)).astype(np.int64))
    angles = np.arange(16) * (np.pi / 8)
    offsets = np.rint(np.stack([np.outer(np.sin(angles), steps), np.outer(np.cos(angles), steps)], axis=-1)).astype(
        np.int64
    )
    padded = heights
    for axis, wrap in enumerate(wraps[::-1]):
        margin = [(most, most) if axis == k else (0, 0) for k in range(2)]
        padded = np.pad(padded, margin, **({"mode": "wrap"} if wrap else {"constant_values": -np.inf}))
    result = np.empty_like(heights)
    inverses = 1.0 / (pixel * np.hypot(offsets[..., 0], offsets[..., 1]))
    in_blocks(_sky, len(result), padded, most, offsets, inverses, result, least=1)
    return result


@inner
def _at(heights, r, c, wraps):  # type: ignore[no-untyped-def]
    """Return the height of a pixel, that may lie beyond the map; minus infinity where the map has an end."""
    n_rows, n_columns = heights.shape
    if wraps[0]:
        c %= n_columns
    if wraps[1]:
        r %= n_rows
    if r < 0 or c < 0 or r >= n_rows or c >= n_columns:
        return -np.inf
    return heights[r, c]


@njit(cache=True, nogil=True)
def _sky(start, stop, padded, margin, offsets, inverses, result):  # type: ignore[no-untyped-def]
    for r in range(start, stop):
        for c in range(result.shape[1]):
            here = padded[r + margin, c + margin]
            total = 0.0
            for k in range(offsets.shape[0]):
                slope = 0.0
                for s in range(offsets.shape[1]):
                    there = padded[r + margin - offsets[k, s, 0], c + margin + offsets[k, s, 1]]
                    slope = max(slope, (there - here) * inverses[k, s])
                total += 1.0 / (1.0 + slope * slope)
            result[r, c] = total / offsets.shape[0]


def shadows(
    heights: Floats,
    pixel: float,
    towards: Floats,
    *,
    wraps: tuple[bool, bool] = (False, False),
    lamp: tuple[float, float, float] | None = None,
) -> NDArray[np.bool_]:
    """Return which pixels of a map of heights lie in the shadow of others, shape (ny, nx).

    Parameters
    ----------
    heights : ndarray, shape (ny, nx)
        Heights [m], finite, row 0 at the largest y.
    pixel : float
        Edge [m] of a pixel.
    towards : ndarray, shape (3,)
        Unit vector to the light, above the horizon.
    wraps : tuple of bool
        Whether the map goes on at its other side along x and y.
    lamp : tuple of float, optional
        Column and row, not whole ones, and height [m] of a lamp above the map, which takes the place of the direction.
    """
    result = np.zeros(heights.shape, dtype=np.bool_)
    level = float(np.hypot(towards[0], towards[1]))
    if level > 0 or lamp is not None:
        direction = towards[:2] / max(level, 1e-300)
        rise, highest = pixel * towards[2] / max(level, 1e-300), float(heights.max())
        place = np.array((0.0, 0.0, np.inf) if lamp is None else lamp)  # the sun is endlessly high
        in_blocks(_shadows, len(heights), heights, direction, rise, highest, np.array(wraps), place, result, least=1)
    return result


@njit(cache=True, nogil=True)
def _shadows(start, stop, heights, direction, rise, highest, wraps, lamp, result):  # type: ignore[no-untyped-def]
    dx, dy, far = direction[0], direction[1], np.inf
    for r in range(start, stop):
        for c in range(heights.shape[1]):
            if lamp[2] < np.inf:
                dx, dy = lamp[0] - c, r - lamp[1]
                far = max(np.hypot(dx, dy), 1e-9)  # pixels; straight below the lamp nothing is in between
                dx, dy, rise = dx / far, dy / far, (lamp[2] - heights[r, c]) / far
            # The first pixel is left out: a slope must not shade itself by its own steps.
            s = 2
            while s < far and heights[r, c] + s * rise < highest:
                y, x = int(np.rint(s * dy)), int(np.rint(s * dx))
                if _at(heights, r - y, c + x, wraps) > heights[r, c] + s * rise:
                    result[r, c] = True
                    break
                s += 1
