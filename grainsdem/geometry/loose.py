"""Convex bodies that arrive one after another at random places and rotations, and are pushed away where others are.

The large come first, so that the small find their place between them, and each size has cells of its own: what is near
a place is found in constant time however unlike the sizes are.

References
----------
.. [1] B. Widom, "Random sequential addition of hard spheres to a volume", J. Chemical Physics 44 (1966) 3888-3894.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numba import njit

from grainsdem.geometry.pairs.bodies import Bodies
from grainsdem.geometry.pairs.gjk import FAR, descend, make_simplex
from grainsdem.geometry.threads import inner

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int64]

_MOST_NEAR = 4096
"""Grains that may reach as far as a place: of grains twenty times smaller as many lie about a large one, and those come
after it."""

_PUSHES = 12
"""Times that a body is pushed away from what is in its way before another place is tried."""

_STEP = 0.3
"""How far, as a share of what the spheres around two bodies overlap by."""


class Arrivals(NamedTuple):
    """Bodies, where they are so far, and what they are in.

    Parameters
    ----------
    vertices, turned : ndarray, shape (n_vertices, 3)
        Vertices [m] of all bodies, each about its centroid, as they are and as they are turned.
    ranges : ndarray of int64, shape (n, 2)
        Vertices of body i are ``vertices[ranges[i, 0]:ranges[i, 1]]``.
    outer, inner : ndarray, shape (n,)
        Radii [m] about the centroid of the sphere around each body, and of the sphere in it.
    order : ndarray of int64, shape (n,)
        Bodies in the order in which they arrive, the largest first.
    positions, quaternions : ndarray, shapes (n, 3) and (n, 4)
        Centroids [m] and rotations of those that are there.
    levels : ndarray of int64, shape (n,)
        Size of each body: its sphere fits into cells of that size.
    cells : ndarray, shape (n_levels, 3)
        Edges [m] of the cells of each size, along an axis that wraps a whole part of its length.
    counts : ndarray of int64, shape (n_levels, 3)
        Cells along axes that wrap, 0 along others.
    heads, links : ndarray of int64, shapes (2 ** k,) and (n,)
        First body in the bucket of each cell, and the next one after each body; -1 where there is none.
    lower, upper : ndarray, shape (3,)
        Corners [m] of the box.
    planes : ndarray, shape (p, 4)
        What else it is cut by: n · x <= d.
    gap : float
        Smallest distance [m] of two bodies, and to the walls.
    """

    vertices: Floats
    turned: Floats
    ranges: Ints
    outer: Floats
    inner: Floats
    order: Ints
    positions: Floats
    quaternions: Floats
    levels: Ints
    cells: Floats
    counts: Ints
    heads: Ints
    links: Ints
    lower: Floats
    upper: Floats
    planes: Floats
    gap: float


@inner
def _bucket(x, y, z, level, size):  # type: ignore[no-untyped-def]
    """Scatter a cell over a table whose size is a power of two: no grid need be stored, however high the box gets."""
    x, y, z = np.int64(x), np.int64(y), np.int64(z)  # not compiled, only these wrap below zero
    key = (np.uint64(x) * np.uint64(0x9E3779B97F4A7C15)) ^ np.uint64(level)
    key = (key ^ (key >> np.uint64(29)) ^ np.uint64(y)) * np.uint64(0xBF58476D1CE4E5B9)
    key = (key ^ (key >> np.uint64(32)) ^ np.uint64(z)) * np.uint64(0x94D049BB133111EB)
    return np.int64((key ^ (key >> np.uint64(31))) & np.uint64(size - 1))


@inner
def _cell(all_, place, level, axis):  # type: ignore[no-untyped-def]
    k = np.int64(np.floor((place[axis] - all_.lower[axis]) / all_.cells[level, axis]))
    count = all_.counts[level, axis]
    return min(max(k, 0), count - 1) if count > 0 else k


@inner
def _span(all_, place, reach, level, axis):  # type: ignore[no-untyped-def]
    """Return the first and last cell that a distance reaches; beyond the ends of an axis that wraps."""
    from_lower = place[axis] - all_.lower[axis]
    low = np.int64(np.floor((from_lower - reach) / all_.cells[level, axis]))
    high = np.int64(np.floor((from_lower + reach) / all_.cells[level, axis]))
    count = all_.counts[level, axis]
    if count > 0 and high - low + 1 > count:
        return np.int64(0), count - 1
    return low, high


@inner
def _between(all_, j, place, between):  # type: ignore[no-untyped-def]
    """Fill the vector from a place to body j, or to its nearest image; return its square."""
    square = 0.0
    for axis in range(3):
        step = all_.positions[j, axis] - place[axis]
        if all_.counts[0, axis] > 0:
            length = all_.upper[axis] - all_.lower[axis]
            step -= length * np.round(step / length)
        between[axis] = step
        square += step * step
    return square


@inner
def _find_near(all_, i, place, near, between):  # type: ignore[no-untyped-def]
    """Fill the bodies whose spheres meet that of body i at a place, and return how many there are."""
    size, found = all_.heads.size, 0
    most, spans = all_.outer[all_.order[0]], np.empty((3, 2), dtype=np.int64)
    for level in range(all_.levels[i] + 1):
        reach = all_.outer[i] + most * 0.5**level + all_.gap
        for axis in range(3):  # not by constants: each would be compiled by itself
            spans[axis, 0], spans[axis, 1] = _span(all_, place, reach, level, axis)
        x0, x1, y0, y1, z0, z1 = spans[0, 0], spans[0, 1], spans[1, 0], spans[1, 1], spans[2, 0], spans[2, 1]
        nx, ny, nz = all_.counts[level, 0], all_.counts[level, 1], all_.counts[level, 2]
        for a in range(x0, x1 + 1):
            x = a % nx if nx > 0 else a
            for b in range(y0, y1 + 1):
                y = b % ny if ny > 0 else b
                for c in range(z0, z1 + 1):
                    z = c % nz if nz > 0 else c
                    j = all_.heads[_bucket(x, y, z, level, size)]
                    while j >= 0:
                        square = _between(all_, j, place, between)
                        if square < (all_.outer[i] + all_.outer[j] + all_.gap) ** 2 and found < near.size:
                            near[found] = j
                            found += 1
                        j = all_.links[j]
    return found


@inner
def _blocked(all_, solids, simplex, i, place, near, found, between, push):  # type: ignore[no-untyped-def]
    """Return whether bodies are in the way of body i, and fill the way out: away from their centres."""
    is_blocked = False
    # Where the spheres within meet, nothing else need be asked.
    for k in range(found):
        j = near[k]
        square, least = _between(all_, j, place, between), all_.inner[i] + all_.inner[j] + all_.gap
        if square < least * least:
            is_blocked = True
            distance = max(np.sqrt(square), 1e-9 * least)
            for axis in range(3):
                push[axis] -= between[axis] / distance * (least - distance)
    if is_blocked:
        return True
    for k in range(found):
        j = near[k]
        distance = np.sqrt(_between(all_, j, place, between))
        # A plane between the two proves that they are farther apart than the gap; all else counts as overlap.
        # Pairs of contacts have these indices, too: with others it would be compiled again.
        first, second = np.int32(i), np.int32(j)
        status, _, _ = descend(solids, first, second, between, all_.gap, simplex)  # type: ignore[arg-type]
        if status != FAR:
            is_blocked = True
            step = _STEP * (all_.outer[i] + all_.outer[j] - distance) + 2.0 * all_.gap
            for axis in range(3):
                push[axis] -= between[axis] / distance * step
    return is_blocked


@inner
def _turn(all_, i, q):  # type: ignore[no-untyped-def]
    w, x, y, z = q[0], q[1], q[2], q[3]
    for k in range(all_.ranges[i, 0], all_.ranges[i, 1]):
        a, b, c = all_.vertices[k, 0], all_.vertices[k, 1], all_.vertices[k, 2]
        all_.turned[k, 0] = (1 - 2 * (y * y + z * z)) * a + 2 * (x * y - w * z) * b + 2 * (x * z + w * y) * c
        all_.turned[k, 1] = 2 * (x * y + w * z) * a + (1 - 2 * (x * x + z * z)) * b + 2 * (y * z - w * x) * c
        all_.turned[k, 2] = 2 * (x * z - w * y) * a + 2 * (y * z + w * x) * b + (1 - 2 * (x * x + y * y)) * c


@inner
def _bring_inside(all_, i, place):  # type: ignore[no-untyped-def]
    """Move the place of a turned body away from walls that it is too near to; return whether it was."""
    is_out = False
    for axis in range(3):
        if all_.counts[0, axis] > 0:
            continue
        low, high = np.inf, -np.inf
        for k in range(all_.ranges[i, 0], all_.ranges[i, 1]):
            low, high = min(low, all_.turned[k, axis]), max(high, all_.turned[k, axis])
        least, most = all_.lower[axis] + all_.gap - low, all_.upper[axis] - all_.gap - high
        if place[axis] > most:
            place[axis], is_out = most, True
        if place[axis] < least:
            place[axis], is_out = least, True
    for plane in all_.planes:
        most = -np.inf
        for k in range(all_.ranges[i, 0], all_.ranges[i, 1]):
            v = all_.turned[k]
            most = max(most, plane[0] * v[0] + plane[1] * v[1] + plane[2] * v[2])
        beyond = plane[0] * place[0] + plane[1] * place[1] + plane[2] * place[2] + most + all_.gap - plane[3]
        if beyond > 0.0:
            is_out = True
            for axis in range(3):
                # A little farther: rounding must not leave it outside for ever.
                place[axis] -= plane[axis] * (beyond + 1e-3 * all_.gap)
    return is_out


@inner
def _settle(all_, i, place, turn):  # type: ignore[no-untyped-def]
    """Give a body its place, and enter it into the cell there."""
    for axis in range(3):
        all_.positions[i, axis] = place[axis]
    for axis in range(4):
        all_.quaternions[i, axis] = turn[axis]
    level = all_.levels[i]
    cell = np.empty(3, dtype=np.int64)
    for axis in range(3):
        cell[axis] = _cell(all_, place, level, axis)
    bucket = _bucket(cell[0], cell[1], cell[2], level, all_.heads.size)
    all_.links[i] = all_.heads[bucket]
    all_.heads[bucket] = i


@njit(cache=True, nogil=True)
def admit(all_, solids, done, tries, patience, units, turns):  # type: ignore[no-untyped-def]
    """Offer places, as shares of the box, and rotations to the bodies in turn, until all are in or patience ends.

    Parameters
    ----------
    all_ : Arrivals
        The first ``done`` of the order are in their places.
    solids : Bodies
        The same turned vertices.
    done, tries, patience : int
        Bodies in place; offers that the next one has refused so far, and at most.
    units, turns : ndarray, shapes (m, 3) and (m, 4)
        Offers.

    Returns
    -------
    done, tries : int
        The same after the offers.
    """
    simplex, near = make_simplex(), np.empty(_MOST_NEAR, dtype=np.int64)
    place, between, push = np.empty(3), np.empty(3), np.empty(3)
    for row in range(len(units)):
        if done == all_.order.size or tries >= patience:
            break
        i = all_.order[done]
        tries += 1
        for axis in range(3):
            place[axis] = all_.lower[axis] + (all_.upper[axis] - all_.lower[axis]) * units[row, axis]
        _turn(all_, i, turns[row])
        is_free = False
        for _ in range(_PUSHES):
            # Out of one wall may be into another: what is out after a push is looked at once more.
            if _bring_inside(all_, i, place) and _bring_inside(all_, i, place):
                continue
            push[:] = 0.0
            found = _find_near(all_, i, place, near, between)
            if found < near.size and not _blocked(all_, solids, simplex, i, place, near, found, between, push):
                is_free = True
                break
            for axis in range(3):
                place[axis] += push[axis]
                if all_.counts[0, axis] > 0:
                    length = all_.upper[axis] - all_.lower[axis]
                    place[axis] -= length * np.floor((place[axis] - all_.lower[axis]) / length)
        if is_free:
            _settle(all_, i, place, turns[row])
            done += 1
            tries = 0
    return done, tries


def as_bodies(arrivals: Arrivals) -> Bodies:
    """Return the turned vertices as the kernels of pairs take them: those that part bodies need no faces and edges."""
    none, pairs = np.empty(0), np.empty((0, 2), dtype=np.int64)
    return Bodies(
        arrivals.turned, arrivals.ranges, pairs, pairs, np.empty(0, np.int32), np.empty(0, np.int64),
        np.empty((0, 3)), none, none, np.empty((0, 4), np.int32), arrivals.outer,
    )  # fmt: skip
