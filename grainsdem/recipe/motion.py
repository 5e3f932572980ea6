"""Tables of what moves the grains."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from exporters.mjcf.bouncing import LEAST, MOST
from grainsdem.options import ByName
from grainsdem.recipe.base import Coefficient, Positive, Table

Direction = tuple[float, float, float]
Shares = Annotated[dict[Positive, Coefficient], Field(min_length=1)]
Frictions = Annotated[dict[Coefficient, Coefficient], Field(min_length=1)]


class SettleTable(Table):
    """``[settle]``: how the grains come to rest; leave the table out for a bed that is only grown.

    Parameters
    ----------
    start : {"pour", "rain", "place"}
        Whether grains are rotated, reordered and poured, or rained layer by layer; or settle in place, into a jigsaw.
    spheres : bool
        Whether each grain is replaced by the sphere of equal volume.
    friction : float or table, optional
        Coefficient of friction among grains, or coefficients of their own and their shares by number, as in
        ``{"0.3" = 0.5, "0.6" = 0.5}``; by default the grains' own, or 0.5 where there are none.
    wall_friction : float or table, optional
        Coefficient of friction with the walls, or with some of them by name, as in ``{floor = 0.6, wall_x0 = 0}``; by
        default, and of walls that are not named, as among grains.
    mixing : {"max", "min"}
        Whether the rougher or the smoother of two grains with frictions of their own rules their contact.
    rolling_friction : float
        Coefficient of rolling friction.
    restitution : float, optional
        Speed of a grain after a bounce over that before it; by default grains hardly bounce.
    gravity : float
        Acceleration [m/s²].
    direction : list of three floats, optional
        Where gravity points; straight down by default.
    density : float or table, optional
        Density [kg/m³] instead of the grains' own, or densities and their shares by number, as in
        ``{2650 = 0.9, 5200 = 0.1}``.
    drop_height : float, optional
        How far above the bed [m] rain is let go; by default at half the container's height.
    time_step : float
        Time step in units of √(d/g).
    max_time : float
        Time limit in units of √(d/g).
    max_hours : float
        A run that would take longer by estimate is refused before its start.
    overlap : float
        Largest overlap volume that the soft contacts may leave, relative to the smaller grain.
    """

    start: Literal["pour", "rain", "place"] = "pour"
    spheres: bool = False
    friction: Coefficient | Frictions | None = None
    wall_friction: ByName = None
    mixing: Literal["max", "min"] = "max"
    rolling_friction: Coefficient = 0.0
    restitution: Annotated[float, Field(ge=LEAST, le=MOST)] | None = None
    gravity: Positive = 9.81
    direction: Direction | None = None
    density: Positive | Shares | None = None
    drop_height: Positive | None = None
    time_step: Positive = 0.01
    max_time: Positive = 200.0
    max_hours: Positive = 24.0
    overlap: Positive = 1e-3

    @model_validator(mode="after")
    def _start_suits(self) -> Self:
        if self.spheres and self.start == "place":
            raise ValueError("spheres overlap where grains stand in place; start must be 'pour' or 'rain'")
        if self.drop_height is not None and self.start != "rain":
            raise ValueError(f"drop_height needs start = 'rain'; got start = {self.start!r}")
        return self
