"""Noise whose amplitude falls as a power of frequency, and seeds as dense as it is strong.

References
----------
.. [1] D. Buscombe and D. M. Rubin, "Advances in the simulation and automated measurement of well-sorted granular
   material: 1. Simulation", J. Geophys. Res. 117 (2012) F02001, figure 10.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError, ShapeError, shown
from grainsdem.gate import gated
from grainsdem.memory import A_VOXEL, allow_memory
from grainsdem.points.fields.density import from_density
from grainsdem.points.fields.tones import spread, tone
from grainsdem.points.poisson import check_count

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Domain


@gated
def noise_field(
    shape: Sequence[int],
    beta: float,
    *,
    lengths: ArrayLike | None = None,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    r"""Return a random field whose amplitude spectrum is exactly :math:`1/f^β`, the same in every direction.

    Parameters
    ----------
    shape : sequence of int
        Voxels along each axis, of which there may be one, two or three.
    beta : float
        Exponent β: 0 is white noise, more makes larger blobs.
    lengths : array_like, shape (len(shape),), optional
        Edges of the field [m], where its voxels are not cubes.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray of float64, shape ``shape``
        Mean 0 and standard deviation 1; it goes on across opposite faces.

    Raises
    ------
    ShapeError
        If there are other than one to three axes, fewer than two voxels, or not a length for each axis.
    InputError
        If β is not finite, or a length not positive.

    Notes
    -----
    The phases are those of white noise; each amplitude is set to :math:`|k|^{-β}`, where k is the wave's vector, and
    that of the mean to zero.
    """
    from scipy.fft import irfftn, rfftn  # noqa: PLC0415  (a tenth of a second)

    shape = tuple(shape)
    allow_memory(math.prod(map(float, shape)), A_VOXEL, "voxels of a field")
    edges = np.asarray(shape if lengths is None else lengths, dtype=np.float64)
    if not 1 <= len(shape) <= 3 or min(shape) < 1 or np.prod(shape) < 2 or edges.shape != (len(shape),):
        raise ShapeError(
            f"a field has one to three axes, a voxel or more along each, two in all, and a length for each axis; "
            f"got shape {shape} and lengths {edges.tolist()}"
        )
    if not np.isfinite(beta):
        raise InputError(f"beta must be finite; got {beta}")
    if not (np.isfinite(edges) & (edges > 0)).all():
        raise InputError(f"lengths must be finite and above 0 m; got {edges.tolist()}")
    spectrum = rfftn(np.random.default_rng(rng).standard_normal(shape))
    frequencies = _frequencies(shape, edges)
    frequencies.flat[0] = frequencies.max()  # the mean, which is set apart
    gains = _amplitudes(frequencies, beta) / np.hypot(spectrum.real, spectrum.imag)
    # One part at a time: a product of complex numbers is rounded once or twice, as the processor has it.
    spectrum.real *= gains
    spectrum.imag *= gains
    spectrum.flat[0] = 0.0
    field = irfftn(spectrum, s=shape)
    return np.asarray(field / field.std(), dtype=np.float64)


@gated
def pink_noise(
    domain: Domain,
    n: int,
    *,
    beta: float = 1.0,
    resolution: int = 128,
    gain: float | None = None,
    cutoff: float = 0.5,
    threshold: float | None = None,
    floor: float = 0.0,
    rng: np.random.Generator | int | None = None,
) -> NDArray[np.float64]:
    """Return independent seeds whose density is noise of amplitude 1/f^β.

    Parameters
    ----------
    domain : Domain
        Where the seeds lie; the noise fills its box, and goes on across opposite faces.
    n : int
        Number of seeds, at least 1.
    beta : float
        Exponent β: 0 is white noise, more makes larger blobs.
    resolution : int
        Voxels along the longest edge, 2 or more; the others have as many as makes them nearly cubes.
    gain, cutoff, threshold, floor : float
        What is done to the noise, first stretched to run from 0 to 1: a steeper contrast about ``cutoff``, or all 1
        above a threshold and 0 below; the floor is the density that stands for 0.
    rng : numpy.random.Generator, int or None
        Source of randomness, or a seed for one.

    Returns
    -------
    ndarray, shape (n, 3)
        Positions [m]; in the mid-plane where the domain is planar.

    Raises
    ------
    InputError
        If a number is out of range.
    """
    check_count(n)
    if resolution < 2:
        raise InputError(f"resolution must be 2 voxels or more; got {shown(resolution)}")
    allow_memory(float(min(resolution, 2**62)) ** (2 if domain.is_planar else 1), A_VOXEL, "voxels of a field")
    edges = domain.lengths[: 2 if domain.is_planar else 3]
    shape = np.maximum(1, np.rint(resolution * edges / edges.max())).astype(int)
    generator = np.random.default_rng(rng)
    field = noise_field(shape.tolist(), beta, lengths=edges, rng=generator)
    density = tone(spread(field), gain=gain, cutoff=cutoff, threshold=threshold, floor=floor)
    return from_density(domain, n, density, rng=generator)


def _amplitudes(frequencies: NDArray[np.float64], beta: float) -> NDArray[np.float64]:
    """Return the amplitude of every wave, relative to the strongest, so that no exponent is too large."""
    from scipy.special import inv_boxcox, xlogy  # noqa: PLC0415  (a tenth of a second)

    # The C library's log and exp, by other names: NumPy's own are others where vectors are wide.
    falls = -xlogy(beta, frequencies)
    return np.asarray(inv_boxcox(falls - falls.max(), 0.0), dtype=np.float64)


def _frequencies(shape: tuple[int, ...], edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the frequency of every wave of a real transform, in waves along the longest edge."""
    square = np.zeros((*shape[:-1], shape[-1] // 2 + 1))
    for axis, (size, edge) in enumerate(zip(shape, edges, strict=True)):
        waves = np.arange(size // 2 + 1) if axis == len(shape) - 1 else np.fft.fftfreq(size, 1 / size)
        square += ((waves * edges.max() / edge) ** 2).reshape([-1 if k == axis else 1 for k in range(len(shape))])
    return np.asarray(np.sqrt(square))
