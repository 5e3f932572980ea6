"""Lenses: bodies of other grains that lie in a bed, and replace what is there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from grainsdem.errors import InputError
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import check_within
from grainsdem.tessellation.metric import frame_along

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain

    Floats = NDArray[np.float64]

Form = Literal["ellipsoid", "box"]

_STEPS = 64
"""Places along each edge of a lens at which its volume is looked for: it is known to a hundredth of a per cent."""


@gated_noun
@dataclass(frozen=True, slots=True)
class Lens:
    """Where a lens lies.

    Parameters
    ----------
    center : tuple of float
        Its middle [m].
    half_axes : tuple of float
        Half of its lengths [m] along the trend, across it, and upward.
    form : {"ellipsoid", "box"}
        What it is.
    trend, dip : float
        Direction of its first axis in the plane, counter-clockwise from +x, and how far that end is raised [rad].

    Raises
    ------
    InputError
        If a half axis is not positive and finite, or the form is unknown.
    """

    center: tuple[float, float, float]
    half_axes: tuple[float, float, float]
    form: Form = "ellipsoid"
    trend: float = 0.0
    dip: float = 0.0

    def __post_init__(self) -> None:
        if not all(np.isfinite(value) and value > 0 for value in self.half_axes):
            raise InputError(f"half axes of a lens must be positive and finite; got {list(self.half_axes)}")
        if not np.isfinite([*self.center, self.trend, self.dip]).all():
            raise InputError(f"a lens has its center, trend and dip at finite numbers; got {self}")
        if self.form not in get_args(Form):
            raise InputError(f"a lens is an 'ellipsoid' or a 'box'; got {self.form!r}")

    def contains(self, points: Floats, domain: Domain) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), lie in the lens, or in one of its images where the domain wraps."""
        check_within("points", points)
        away = points - np.array(self.center)
        step = np.where(domain.periodic, domain.lengths, 1.0)
        away = np.where(domain.periodic, away - step * np.rint(away / step), away)
        along = [sum(away[:, k] * axis[k] for k in range(3)) for axis in frame_along(self.trend, self.dip)]
        shares = np.column_stack([part / half for part, half in zip(along, self.half_axes, strict=True)])
        if self.form == "box":
            return np.asarray((np.abs(shares) <= 1).all(axis=1))
        return np.asarray((shares * shares).sum(axis=1) <= 1)

    def places(self, units: Floats, domain: Domain) -> Floats:
        """Return points [m] of the box around the lens of which units, shape (n, 3), are the shares."""
        check_within("units", units)
        arms = (2 * units - 1) * np.array(self.half_axes)
        axes = frame_along(self.trend, self.dip)
        found = np.column_stack([self.center[k] + sum(arms[:, m] * axes[m][k] for m in range(3)) for k in range(3)])
        around = domain.lower + (found - domain.lower) % domain.lengths
        return np.where(domain.periodic, around, found)

    def volume_in(self, domain: Domain, others: tuple[Lens, ...]) -> float:
        """Return the volume [m³] of what lies in the domain, and in none of the lenses that come after."""
        units = (np.indices((_STEPS,) * 3).reshape(3, -1).T + 0.5) / _STEPS
        return float(np.mean(self.is_own(self.places(units, domain), domain, others)) * 8 * np.prod(self.half_axes))

    def is_own(self, points: Floats, domain: Domain, others: tuple[Lens, ...]) -> NDArray[np.bool_]:
        """Return which points [m], shape (n, 3), lie in the lens and the domain, and in no lens that comes after."""
        found = self.contains(points, domain) & domain.contains(points)
        for other in others:
            found &= ~other.contains(points, domain)
        return found
