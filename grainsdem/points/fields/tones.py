"""What turns grey values into densities: a low-pass filter, contrast, a threshold, a floor.

References
----------
.. [1] S. Butterworth, "On the theory of filter amplifiers", Wireless Engineer 7 (1930) 536-541.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Floats = NDArray[np.float64]


def spread(values: Floats) -> Floats:
    """Return the values stretched so that they run from 0 to 1.

    Raises
    ------
    InputError
        If they are all the same.
    """
    low, high = values.min(), values.max()
    if not high > low:
        raise InputError(f"there is no light and shade to place seeds by: all values are {low:g}")
    return np.asarray((values - low) / (high - low))


def tone(
    values: Floats,
    *,
    gain: float | None = None,
    cutoff: float = 0.5,
    threshold: float | None = None,
    floor: float = 0.0,
) -> Floats:
    """Return values between 0 and 1 with their contrast changed.

    Parameters
    ----------
    values : ndarray
        Between 0 and 1.
    gain : float, optional
        Steepness of the curve 1 / (1 + exp(gain · (cutoff - v))); some 5 to 10 make a difference. Straight without it.
    cutoff : float
        Value about which ``gain`` parts light and dark, in [0, 1].
    threshold : float, optional
        Value in [0, 1] above which all is 1, and below 0; instead of ``gain``.
    floor : float
        What stands for 0 in the result, in [0, 1]: the density of the sparsest places, if that of the densest is 1.

    Raises
    ------
    InputError
        If a number is out of range, or both ``gain`` and ``threshold`` are given.
    """
    if gain is not None and threshold is not None:
        raise InputError(f"give either a gain or a threshold; got gain = {gain}, threshold = {threshold}")
    for name, number in {"cutoff": cutoff, "threshold": threshold, "floor": floor}.items():
        if number is not None and not 0 <= number <= 1:
            raise InputError(f"{name} must be between 0 and 1; got {number}")
    if gain is not None:
        if not (np.isfinite(gain) and gain > 0):
            raise InputError(f"gain must be finite and above 0; got {gain}")
        # The same curve as that of the docstring, stretched: a hyperbolic tangent does not overflow.
        from scipy.special import expit  # noqa: PLC0415  (a tenth of a second)

        # Stretched, the same as tanh, which NumPy rounds otherwise where vectors are wide.
        values = spread(expit(gain * (values - cutoff)))
    if threshold is not None:
        values = np.where(values > threshold, 1.0, 0.0)
    return np.asarray(floor + (1.0 - floor) * values)


LOWEST = 1e-9
"""Lowest frequency [cycles a pixel] of a filter: no image is a billion pixels long."""


def low_passed(values: Floats, cutoff: float, order: int) -> Floats:
    """Return an image without its fine detail: Butterworth's filter [1]_ in the frequency domain.

    Parameters
    ----------
    values : ndarray, shape (p, q)
        Grey values. Beyond its edges the image is taken as mirrored, so that no edge bleeds into the opposite one.
    cutoff : float
        Frequency [cycles a pixel] at which the amplitude is halved, at most 0.5.
    order : int
        Sharpness: the amplitude falls as 1 / (1 + (f / cutoff)^(2·order)).

    Raises
    ------
    InputError
        If a number is out of range.
    """
    from scipy.fft import dctn, idctn  # noqa: PLC0415  (a tenth of a second)

    if not LOWEST <= cutoff <= 0.5:
        raise InputError(f"the low-pass filter's frequency must be {LOWEST:g} to 0.5 cycles a pixel; got {cutoff}")
    if order < 1:
        raise InputError(f"the low-pass filter's order must be 1 or more; got {order}")
    # The cosine transform is Fourier's of the image and its mirror image: row k is k half waves.
    square = sum(
        (np.arange(size) / (2 * size)).reshape([-1 if axis == along else 1 for axis in range(values.ndim)]) ** 2
        for along, size in enumerate(values.shape)
    )
    weights = 1.0 / (1.0 + (square / cutoff**2) ** order)
    return np.asarray(idctn(dctn(values) * weights), dtype=np.float64)
