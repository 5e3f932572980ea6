"""Light on what is seen: parallel or from a lamp, uneven, and with the shadow of what stands outside the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.raster.above import shadows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.planform.views import Planform

    Floats = NDArray[np.float64]


class Beam(NamedTuple):
    """Light from a sun or a lamp, as it arrives at each pixel.

    Parameters
    ----------
    towards : ndarray, shape (3,) or (ny, nx, 3)
        Unit vectors to where it comes from: one, or of each pixel.
    strength : ndarray, shape (ny, nx)
        Light on the face there; 1 on a level face in the middle of the picture; 0 in the shadow of other grains.
    """

    towards: Floats
    strength: Floats


LOWEST = 0.01
"""Height [rad] of the light above the horizon, at least."""


def beam(view: Planform, heights: Floats, normals: Floats, towards: Floats, lamp: float | None) -> Beam:
    """Return the light on each pixel.

    Parameters
    ----------
    view : Planform
        What is seen.
    heights : ndarray, shape (ny, nx)
        Height z [m] of what is seen, the floor's where no grain is.
    normals : ndarray, shape (n_faces + 1, 3)
        Of the faces of all grains; the last is the floor's.
    towards : ndarray, shape (3,)
        Unit vector to the light, from the middle of the picture at the mean height.
    lamp : float or None
        Distance [m] of the lamp from there; None for the sun.

    Raises
    ------
    InputError
        If the light stands too low, or the lamp is not above the grains.

    Notes
    -----
    A lamp's light falls with the square of its distance.
    """
    pixel, wraps = float(view.pixel.mean()), (bool(view.periodic[0]), bool(view.periodic[1]))
    if towards[2] < LOWEST:
        raise InputError(
            f"the light must stand {LOWEST:g} rad or more above the horizon: lower, shadows have no end; got "
            f"{towards[2]:.2g} rad"
        )
    if lamp is None:
        direct = np.maximum(normals @ towards, 0.0)[view.faces] / towards[2]
        direct[shadows(heights, pixel, towards, wraps=wraps)] = 0.0
        return Beam(towards, direct)
    x, y = view.places()
    place = np.array([0.5 * (x[0] + x[-1]), 0.5 * (y[0] + y[-1]), float(heights.mean())]) + lamp * towards
    if place[2] <= heights.max():
        raise InputError(
            f"the lamp must hang above the grains, whose highest is at z = {heights.max():.4g} m; at a distance of "
            f"{lamp:g} m it is at z = {place[2]:.4g} m"
        )
    ways = np.stack([*np.broadcast_arrays(place[0] - x, (place[1] - y)[:, None]), place[2] - heights], axis=-1)
    far = np.sqrt(np.einsum("ijk,ijk->ij", ways, ways))
    ways /= far[..., None]
    direct = np.maximum(np.einsum("ijk,ijk->ij", normals[view.faces], ways), 0.0) * (lamp / far) ** 2 / towards[2]
    seen_from = (place[0] - x[0]) / view.pixel[0], (y[0] - place[1]) / view.pixel[1], place[2]
    direct[shadows(heights, pixel, towards, wraps=wraps, lamp=seen_from)] = 0.0
    return Beam(ways, direct)


def unevenness(view: Planform, gradient: tuple[float, float]) -> Floats:
    """Return the light on each pixel over that in the middle, where it changes by a share of it across the picture."""
    ny, nx = view.labels.shape
    across = (np.arange(nx) + 0.5) / nx - 0.5
    up = 0.5 - (np.arange(ny) + 0.5) / ny
    return np.asarray(1 + gradient[0] * across + gradient[1] * up[:, None])


class CastShadow(NamedTuple):
    """The shadow of something that stands outside the picture: of whoever takes it, or of a bar.

    Parameters
    ----------
    reach : float
        How far it reaches into the picture, from 0, not at all, to 1, all across.
    side : float
        Direction [rad] of the side that it comes from, counter-clockwise from +x.
    width : float or None
        Breadth of the shadow, as a share of the way across; without end where None.
    edge : float
        Breadth of the half-shadow along its edges, as such a share.
    """

    reach: float
    side: float
    width: float | None
    edge: float


def passed(view: Planform, heights: Floats, towards: Floats, shadow: CastShadow) -> Floats:
    """Return the share of the beam that passes what casts a shadow, shape (ny, nx).

    Parameters
    ----------
    view : Planform
        What is seen.
    heights : ndarray, shape (ny, nx)
        Height z [m] of what is seen.
    towards : ndarray, shape (3,) or (ny, nx, 3)
        Unit vectors to the light: the shadow falls along it, so that its edge bends on what is high.
    shadow : CastShadow
        What is cast.

    Notes
    -----
    Half-shadow is what a straight edge lets pass of an evenly bright disc, ½ + (t √(1 - t²) + asin t) / π, t from -1 to
    1 across it.
    """
    x, y = view.places()
    rise = (heights - heights.mean()) / towards[..., 2]
    dx = x - 0.5 * (x[0] + x[-1]) - rise * towards[..., 0]
    dy = (y - 0.5 * (y[0] + y[-1]))[:, None] - rise * towards[..., 1]
    toward = np.array([np.cos(shadow.side), np.sin(shadow.side)])
    half = 0.5 * float(np.abs(toward) @ (view.pixel * view.labels.shape[::-1]))
    across = 0.5 - 0.5 * (dx * toward[0] + dy * toward[1]) / half
    light = _beyond(across - shadow.reach, shadow.edge)
    if shadow.width is not None:
        light += 1 - _beyond(across - shadow.reach + shadow.width, shadow.edge)
    return light


def _beyond(distance: Floats, edge: float) -> Floats:
    """Return the share of a disc that is seen at a distance beyond the middle of an edge's half-shadow."""
    if edge == 0:
        return np.asarray(distance >= 0, dtype=np.float64)
    t = np.clip(2 * distance / edge, -1.0, 1.0)
    return np.asarray(0.5 + (t * np.sqrt(1 - t * t) + np.arcsin(t)) / np.pi)
