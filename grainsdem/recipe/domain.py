"""``[domain]``: what grains grow in."""

from __future__ import annotations

from typing import Literal, Self

from pydantic import model_validator

from grainsdem.model import Domain
from grainsdem.recipe.base import Table
from grainsdem.values import Positive


class DomainTable(Table):
    """``[domain]``: what grains grow in; only its proportions count where the number and size of grains are given.

    Parameters
    ----------
    shape : {"box", "slab", "cylinder", "hopper"}
        A box, a planar slab of one grain's thickness, an upright cylinder, or a funnel.
    lengths : three numbers
        Edge lengths [m] of a box; of a slab, its two lengths and its thickness.
    side : float
        Edge length [m] of a cube, instead of lengths; never a proportion only.
    periodic : str
        Axes that wrap around, such as ``"xy"``: any of a box, x and y of a slab, z of a cylinder.
    radius, height : float
        Of a cylinder [m]; the height of a hopper.
    top, bottom : two numbers
        Lengths [m] of a hopper's upper and lower opening.
    """

    shape: Literal["box", "slab", "cylinder", "hopper"] = "box"
    lengths: tuple[Positive, Positive, Positive] | None = None
    side: Positive | None = None
    periodic: str = ""
    radius: Positive | None = None
    height: Positive | None = None
    top: tuple[Positive, Positive] | None = None
    bottom: tuple[Positive, Positive] | None = None

    @model_validator(mode="after")
    def _fits_its_shape(self) -> Self:
        needed = _NEEDED[self.shape]
        given = {name for name in ("lengths", "radius", "height", "top", "bottom") if getattr(self, name) is not None}
        if self.side is not None and (self.shape != "box" or self.lengths is not None):
            what = "lengths" if self.shape == "box" else f"a {self.shape}"
            raise ValueError(f"side is that of a cube, without lengths; got side beside {what}")
        if self.shape == "box":
            needed = needed & given  # without lengths it is the unit cube
        if given != needed:
            takes = ", ".join(sorted(_NEEDED[self.shape]))
            raise ValueError(f"a {self.shape} takes {takes}; got {', '.join(sorted(given)) or 'none'}")
        allowed = _PERIODIC[self.shape]
        if not set(self.periodic) <= set(allowed):
            raise ValueError(f"a {self.shape} may be periodic along {allowed or 'no axis'}; got {self.periodic}")
        return self

    @property
    def is_measured(self) -> bool:
        """Whether its lengths are given; else it is the unit cube."""
        return self.shape != "box" or self.lengths is not None or self.side is not None

    def make(self) -> Domain:
        """Return the domain."""
        x, y, z = (axis in self.periodic for axis in "xyz")
        if self.shape == "slab" and self.lengths is not None:
            return Domain.slab(self.lengths[:2], self.lengths[2], periodic=(x, y))
        if self.radius is not None and self.height is not None:
            return Domain.cylinder(self.radius, self.height, periodic=z)
        if self.top is not None and self.bottom is not None and self.height is not None:
            return Domain.hopper(self.top, self.bottom, self.height)
        side = self.side or 1.0
        return Domain.box(self.lengths or (side, side, side), periodic=(x, y, z))


_NEEDED = {
    "box": {"lengths"},
    "slab": {"lengths"},
    "cylinder": {"radius", "height"},
    "hopper": {"top", "bottom", "height"},
}

_PERIODIC = {"box": "xyz", "slab": "xy", "cylinder": "z", "hopper": ""}
