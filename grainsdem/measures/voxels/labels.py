"""Which grain each voxel of a box lies in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated, gated_noun
from grainsdem.geometry.clipping import box_planes
from grainsdem.geometry.forms.sizes import grain_diameters
from grainsdem.geometry.raster.lattice import OUTSIDE, VOID, Lattice, label_blocks
from grainsdem.model.arrays import Noun, check_length

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

PER_DIAMETER = 20.0
"""Voxels along a mean diameter where nothing else is asked for."""

MOST_VOXELS = 1 << 32
"""Voxels that are held in memory: 16 GiB."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Voxels(Noun):
    """Voxels of a box, each with the grain that its middle lies in.

    Parameters
    ----------
    labels : array_like of int32, shape (nz, ny, nx)
        Grain id + 1; 0 in the void, -1 outside the domain.
    lower : array_like, shape (3,)
        Lower corner [m] of the box.
    spacing : array_like, shape (3,)
        Edges [m] of a voxel along x, y and z.
    periodic : array_like of bool, shape (3,)
        Along which of x, y and z the voxels go on at the other side.
    """

    labels: NDArray[np.int32]
    lower: Floats
    spacing: Floats
    periodic: NDArray[np.bool_]

    def __post_init__(self) -> None:
        self.freeze("labels", np.int32, None, None, None)
        self.freeze("lower", np.float64, 3)
        spacing = self.freeze("spacing", np.float64, 3)
        self.freeze("periodic", np.bool_, 3)
        if self.labels.size == 0 or not (np.isfinite(spacing).all() and (spacing > 0).all()):
            raise InputError(
                f"voxels must be one at least, with edges above zero; "
                f"got shape {self.labels.shape} and {spacing.tolist()}"
            )

    @property
    def is_layer(self) -> bool:
        """Whether there is one layer: the voxels of a planar bed, pixels in fact."""
        return bool(self.labels.shape[0] == 1)

    def phase(self) -> NDArray[np.uint8]:
        """Return the two-phase function I(x) of the paper's equation 1: 1 in grains, 0 in the void and outside."""
        return (self.labels > VOID).astype(np.uint8)

    def porosity(self) -> float:
        """Return the share of void among the voxels of the domain."""
        inside = int(np.count_nonzero(self.labels != OUTSIDE))
        if inside == 0:
            raise InputError("no voxel lies in the domain: there is no porosity")
        return 1 - int(np.count_nonzero(self.labels > VOID)) / inside


@gated
def voxelize(
    packing: Packing,
    *,
    size: float | None = None,
    per_diameter: float | None = None,
    region: tuple[ArrayLike, ArrayLike] | None = None,
) -> Voxels:
    """Return which grain the middle of each voxel of a box lies in.

    Parameters
    ----------
    packing : Packing
        Convex grains; where two overlap, a voxel is of the lower id.
    size : float, optional
        Edge [m] of a voxel.
    per_diameter : float, optional
        Voxels along a mean diameter, 20 by default; instead of ``size``.
    region : tuple of two array_like, shape (3,), optional
        Lower and upper corner [m] of a box; the domain by default.

    Returns
    -------
    Voxels
        They fill the box: their number along each axis is the nearest whole one, so that edges differ a little from
        what was asked where the box is no multiple of it. A planar bed has one layer, in its mid-plane.

    Raises
    ------
    InputError
        If both sizes are given, one is not positive and finite, the box is none, or there would be more voxels than
        memory is meant for; `write_voxels` has no such limit.

    Notes
    -----
    A voxel lies in a grain where its middle is on the inner side of all planes of the faces, or within rounding of
    them. Counting points of a lattice of edge h gives a volume with variance 0.0667 h⁴ A, A the surface area, and in a
    plane an area with variance 0.0728 h³ B, B the perimeter: the error of the porosity falls as h² and as h^1.5. The
    factors are the sums over the reciprocal lattice of Porod's law, 1 / 8π³k⁴ and 1 / 4π³k³. Faces that lie along the
    lattice, as those at flat walls do, are rounded alike: where a bed has them its porosity is off by a part of a voxel
    times their area, which falls as h only. A region off the walls, `core_box` for one, has none.
    """
    lattice = fit_lattice(packing, size=size, per_diameter=per_diameter, region=region)
    if np.prod(lattice.shape, dtype=float) > MOST_VOXELS:
        n = " × ".join(map(str, lattice.counts))
        raise InputError(
            f"at most {MOST_VOXELS} voxels are held in memory; got {n}: take larger ones, or stream them to a file"
        )
    labels = np.empty(lattice.shape, dtype=np.int32)
    filled = 0
    for block in label_blocks(packing, lattice):
        labels[filled : filled + len(block)] = block
        filled += len(block)
    return Voxels(labels, lattice.lower, lattice.spacing, spans(packing, lattice))


def fit_lattice(
    packing: Packing,
    *,
    size: float | None,
    per_diameter: float | None,
    region: tuple[ArrayLike, ArrayLike] | None,
) -> Lattice:
    """Return the voxels that fill a box; see `voxelize`."""
    if size is not None and per_diameter is not None:
        raise InputError(f"give size or per_diameter, not both; got {size} and {per_diameter}")
    domain = packing.domain
    lower, upper = (domain.lower, domain.upper) if region is None else _corners(region)
    if size is None:
        if len(packing) == 0:
            raise InputError("a packing without grains has no diameter; give the size of a voxel")
        ratio = _positive("per_diameter", PER_DIAMETER if per_diameter is None else per_diameter)
        size = float(grain_diameters(packing).mean()) / ratio
    check_length("size", size)
    counts = np.maximum(np.rint((upper - lower) / size), 1)
    if domain.is_planar:
        counts[2] = 1
    if counts.max() > np.iinfo(np.int32).max:
        raise InputError(f"there are at most {np.iinfo(np.int32).max} voxels along an axis; got {counts.max():.3g}")
    nx, ny, nz = counts.astype(int).tolist()
    return Lattice(lower, (upper - lower) / counts, (nx, ny, nz))


def spans(packing: Packing, lattice: Lattice) -> NDArray[np.bool_]:
    """Return along which axes voxels take a whole period of the domain, shape (3,)."""
    lengths = lattice.upper - lattice.lower
    # A millionth: a corner that came from a file may be rounded.
    whole = np.abs(lengths - packing.domain.lengths) <= 1e-6 * packing.domain.lengths
    return np.asarray(packing.domain.periodic & whole, dtype=bool)


def _corners(region: tuple[ArrayLike, ArrayLike]) -> tuple[Floats, Floats]:
    try:
        lower, upper = (np.asarray(corner, dtype=np.float64) for corner in region)
    except (TypeError, ValueError) as error:
        raise InputError(f"region must be the two corners of a box; got {region!r}") from error
    box_planes(lower, upper)  # says what is wrong with the corners
    return lower, upper


def _positive(name: str, value: float) -> float:
    if not (np.isfinite(value) and value > 0):
        raise InputError(f"{name} must be positive and finite; got {value}")
    return float(value)
