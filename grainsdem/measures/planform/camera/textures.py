"""Texture within grains: speckles and bands that are fixed to the grain, as those of minerals and bedding are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.geometry.rotations import to_matrices

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.measures.planform.views import Planform
    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

WAVES = 16
"""Waves that a texture is the sum of: with as many its values are nearly normal."""


def texture(view: Planform, packing: Packing, *, size: float, bands: float, seed: int) -> Floats:
    """Return the texture of the grains that are seen, of mean 0 and variance 1; 0 on the floor, shape (ny, nx).

    Parameters
    ----------
    view : Planform
        What is seen of the packing.
    packing : Packing
        The same packing.
    size : float
        Mean wavelength [m] of what varies.
    bands : float
        Share of the grains with bands instead of speckles.
    seed : int
        With a grain's number it says what the grain looks like.

    Notes
    -----
    √(2 / K) Σ cos(k · q + φ) over K waves, q from the grain's centroid in its frame; wavelengths in an octave about the
    size, phases and directions by a hash. The waves of speckles go in all directions, those of bands in one.
    """
    row, column = np.nonzero(view.labels)
    ids, which = np.unique(view.labels[row, column] - 1, return_inverse=True)
    is_banded = _hashed(seed, ids, 4 * WAVES) < bands
    x, y = view.places()
    arms = np.stack([x[column], y[row], view.heights[row, column]], axis=1) - packing.positions[ids][which]
    # To the grain's nearest image: a grain looks alike on both sides of a periodic picture.
    periods = np.where(packing.domain.periodic[:2], packing.domain.lengths[:2], np.inf)
    arms[:, :2] -= np.where(np.isfinite(periods), periods, 0.0) * np.rint(arms[:, :2] / periods)
    turns = to_matrices(packing.quaternions[ids])
    total = np.zeros(row.size)
    for k in range(WAVES):
        first = np.where(is_banded, 0, k)
        length = size * 2 ** (_hashed(seed, ids, 4 * k) - 0.5)
        rise, around = 2 * _hashed(seed, ids, 4 * first + 1) - 1, 2 * np.pi * _hashed(seed, ids, 4 * first + 2)
        flat = np.sqrt(1 - rise**2)
        own = np.stack([flat * np.cos(around), flat * np.sin(around), rise], axis=1)
        waves = np.einsum("nij,nj->ni", turns, own) * (2 * np.pi / length)[:, None]
        phases = 2 * np.pi * _hashed(seed, ids, 4 * k + 3)
        total += np.cos(np.einsum("nk,nk->n", waves[which], arms) + phases[which])
    result = np.zeros(view.labels.shape)
    result[row, column] = np.sqrt(2 / WAVES) * total
    return result


def _hashed(seed: int, ids: NDArray[np.integer], which: int | NDArray[np.integer]) -> Floats:
    """Return numbers in [0, 1) that look random and follow from a seed, a grain and what they are for.

    The finish of SplitMix64 (Steele, Lea and Flood 2014, OOPSLA).
    """
    with np.errstate(over="ignore"):  # arithmetic modulo 2^64 is meant
        x = np.uint64(seed) + np.asarray(ids).astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15)
        for word in (np.asarray(which).astype(np.uint64) * np.uint64(0xD1B54A32D192ED03), np.uint64(0)):
            x = x + word
            x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
            x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
            x = x ^ (x >> np.uint64(31))
    return np.asarray((x >> np.uint64(11)) * 2.0**-53)
