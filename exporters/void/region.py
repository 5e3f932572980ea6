"""Which part of a packing becomes a flow domain, and the grains, images included, that reach into it."""

from __future__ import annotations

from itertools import product
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from grainsdem.errors import InputError
from grainsdem.geometry.bounds import boxes
from grainsdem.geometry.selection import select
from grainsdem.measures import core_box
from grainsdem.model import Domain, Packing

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    Floats = NDArray[np.float64]

REACH = 4.0
"""How far outside the flow domain a grain may lie, in gaps, and still reach in: by its growth, or by a bridge."""

CHOICES = "'core', 'bed', 'periodic' or the two corners of a box"

BEYOND = 0.25
"""How far grains reach over a periodic cell's faces before they are cut, in diameters: the mesh is not to see it."""

PLENUM = 1.0
"""Free length before and behind a whole bed, in diameters: flow enters and leaves it evenly."""


class Region(NamedTuple):
    """A box that fluid flows through.

    Parameters
    ----------
    lower, upper : ndarray, shape (3,)
        Corners [m].
    is_bed : bool
        Whether it holds the whole bed, between its walls, rather than a part of its inside.
    planes : ndarray, shape (k, 4)
        Walls n · x <= d [m] inside the box, those of a cylinder or a hopper.
    cyclic : tuple of bool, shape (3,)
        Along which axes what leaves through a face comes in by the opposite one.
    """

    lower: Floats
    upper: Floats
    is_bed: bool
    planes: Floats
    cyclic: tuple[bool, bool, bool] = (False, False, False)

    def grown(self, margin: float) -> Region:
        """Return the region larger by a margin [m] on both sides of its cyclic axes."""
        beyond = margin * np.array(self.cyclic)
        return self._replace(lower=self.lower - beyond, upper=self.upper + beyond)

    def moved(self, shift: Floats) -> Region:
        """Return the region moved by a vector [m], shape (3,)."""
        planes = self.planes.copy()
        planes[:, 3] += planes[:, :3] @ shift
        return self._replace(lower=self.lower + shift, upper=self.upper + shift, planes=planes)


def choose(packing: Packing, region: str | tuple[ArrayLike, ArrayLike], axis: int, d: float) -> Region:
    """Return the flow domain: the bed's core, the whole bed, or a box of one's own.

    Raises
    ------
    InputError
        If the region is unknown, the box is not one, or it reaches out of the domain or holds no grain.
    """
    domain = packing.domain
    if region == "bed":
        lower, upper = (corner.copy() for corner in (domain.lower, domain.upper))
        first, last = boxes(packing)
        lower[axis], upper[axis] = first[:, axis].min() - PLENUM * d, last[:, axis].max() + PLENUM * d
        if domain.periodic[axis]:
            raise InputError(
                "a bed that is periodic along the flow has no ends; give region='periodic', 'core' or a box"
            )
        return Region(*_mid_plane(domain, lower, upper), is_bed=True, planes=domain.planes)
    if isinstance(region, str) and region == "periodic":
        if not domain.periodic[axis]:
            raise InputError(f"region='periodic' needs a bed that is periodic along the flow, {'xyz'[axis]}")
        found = Region(*_mid_plane(domain, domain.lower, domain.upper), is_bed=True, planes=domain.planes)
        x, y, z = domain.periodic.tolist()
        return found._replace(cyclic=(x, y, z))
    if isinstance(region, str):
        if region != "core":
            raise InputError(f"region must be {CHOICES}; got {region!r}")
        lower, upper = _core(packing)
    else:
        try:
            lower, upper = (np.array(corner, dtype=np.float64).reshape(3) for corner in region)
        except (TypeError, ValueError) as error:
            raise InputError(f"region must be {CHOICES}; got {region!r}") from error
        # A millionth of the domain: corners that came from a file may be rounded.
        slack = 1e-6 * domain.lengths
        inside = (lower >= domain.lower - slack) & (upper <= domain.upper + slack)
        if not (np.isfinite([lower, upper]).all() and (upper > lower).all() and inside.all()):
            raise InputError(
                f"the box must lie in the domain, {domain.lower.tolist()} to {domain.upper.tolist()}, its upper corner "
                f"above its lower; got {lower.tolist()} to {upper.tolist()}"
            )
    return Region(*_mid_plane(domain, lower, upper), is_bed=False, planes=np.empty((0, 4)))


def gather(packing: Packing, region: Region, reach: float) -> tuple[Packing, NDArray[np.int64]]:
    """Return the grains, periodic images included, whose boxes come nearer to the region than ``reach`` [m].

    The result is a plain packing: its domain is a box around the grains, and nothing wraps. With it come their numbers.

    Raises
    ------
    InputError
        If there is none.
    """
    lower, upper = boxes(packing)
    rows, moves = [], []
    for image in product(*((-1, 0, 1) if wraps else (0,) for wraps in packing.domain.periodic)):
        move = np.array(image) * packing.domain.lengths
        near = ((lower + move < region.upper + reach) & (upper + move > region.lower - reach)).all(axis=1)
        rows.append(np.flatnonzero(near))
        moves.append(np.broadcast_to(move, (rows[-1].size, 3)))
    chosen, moved = np.concatenate(rows), np.concatenate(moves)
    if chosen.size == 0:
        raise InputError(f"no grain reaches into {region.lower.tolist()} to {region.upper.tolist()}")
    grains, _ = select(packing.grains, chosen)
    # Wide enough that no wall is near: walls are the case's own.
    around = Domain(
        np.minimum((lower[chosen] + moved).min(axis=0), region.lower) - 10 * reach,
        np.maximum((upper[chosen] + moved).max(axis=0), region.upper) + 10 * reach,
    )
    found = Packing(
        grains,
        packing.positions[chosen] + moved,
        packing.quaternions[chosen],
        packing.densities[chosen],
        around,
        provenance=packing.provenance,
        frictions=packing.frictions_of(chosen),
        classes=packing.classes_of(chosen),
    )
    return found, chosen


WHOLE = "region='bed' takes all of it (--option region=bed)"
"""What an error about a core says besides."""


def _core(packing: Packing) -> tuple[Floats, Floats]:
    """Return the inside of a bed; of grains still in their cells, away from the hull of those that were kept."""
    domain = packing.domain
    if domain.is_planar or packing.links is not None:
        lower, upper = boxes(packing)
        d = (upper - lower).max(axis=1).mean()
        first = np.where(domain.periodic, domain.lower, lower.min(axis=0) + d)
        last = np.where(domain.periodic, domain.upper, upper.max(axis=0) - d)
        if domain.is_planar:
            first[2], last[2] = domain.lower[2], domain.upper[2]
        if (last - first < 0.999 * np.where(domain.is_planar, [d, d, 0], d)).any():
            raise InputError(f"the bed is too small for a core: it must be three grains wide along each axis; {WHOLE}")
        return first, last
    try:
        return core_box(packing)
    except InputError as error:
        raise InputError(f"{error}; {WHOLE}") from error


def _mid_plane(domain: Domain, lower: Floats, upper: Floats) -> tuple[Floats, Floats]:
    """Return the box; of a slab only its middle half, so that the faces of the prisms lie outside it."""
    if domain.is_planar:
        thickness = domain.lengths[2]
        lower, upper = lower.copy(), upper.copy()
        lower[2], upper[2] = domain.lower[2] + 0.25 * thickness, domain.upper[2] - 0.25 * thickness
    return lower, upper
