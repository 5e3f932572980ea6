"""Powers and roots of arrays that have the same last bit on every processor.

NumPy adds, multiplies, divides and takes square roots as IEEE 754 says, everywhere. Its other functions, cube roots and
powers beyond the square among them, are as wide as the processor's vectors are, and their last bit is the processor's.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

_SPLIT = 2.0**27 + 1
"""Veltkamp's factor: a number times it, less what that exceeds the number by, has half of its digits."""


def cube_roots(values: ArrayLike) -> Floats:
    """Return the cube root of each value, rounded correctly, shape (...).

    Notes
    -----
    NumPy's root y is right to a digit or so. y³ is known to twice the digits by Dekker's products, and one step of
    Newton's method from there is right before it is rounded. Where the values are too large or small for those
    products, the root is NumPy's own.

    References
    ----------
    .. [1] T. J. Dekker, "A floating-point technique for extending the available precision", Numerische Mathematik 18
       (1971) 224-242.

    Examples
    --------
    >>> cube_roots([27.0, -8.0, 0.0]).tolist()
    [3.0, -2.0, 0.0]
    """
    x = np.asarray(values, dtype=np.float64)
    y = np.cbrt(x)
    square, square_rest = _product(y, y)
    cube, cube_rest = _product(square, y)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        beyond = (cube - x) + (cube_rest + square_rest * y)
        better = y - beyond / (3.0 * square)
    return np.where(np.isfinite(better) & (np.abs(x) > 1e-200), better, y)


def raised(values: ArrayLike, power: int) -> Floats:
    """Return each value to a whole power, 1 or more, by multiplication, shape (...)."""
    if power < 1:
        raise InputError(f"power must be 1 or more; got {power}")
    x = np.asarray(values, dtype=np.float64)
    found = x
    for _ in range(power - 1):
        found = found * x
    return np.asarray(found)


def _product(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Return the product of two numbers, rounded, and what rounding took from it."""
    with np.errstate(over="ignore", invalid="ignore"):
        high_a, high_b = _SPLIT * a - (_SPLIT * a - a), _SPLIT * b - (_SPLIT * b - b)
        low_a, low_b = a - high_a, b - high_b
        whole = a * b
        return whole, ((high_a * high_b - whole) + high_a * low_b + low_a * high_b) + low_a * low_b
