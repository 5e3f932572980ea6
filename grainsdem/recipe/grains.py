"""``[grains]``: what the cells become."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from grainsdem.measures import diameters, masses, percentiles
from grainsdem.model import QUARTZ_DENSITY
from grainsdem.packing import carve, rescale, shrink
from grainsdem.recipe.base import Fraction, Positive, Table

if TYPE_CHECKING:
    from grainsdem.model import Packing, Tessellation


class GrainsTable(Table):
    """``[grains]``: what the cells become.

    Parameters
    ----------
    keep : {"inside", "all"}
        Whether cells that touch a wall are dropped.
    porosity, scale : float
        Void fraction of the cells' region, or the linear factor that grains shrink by; one of the two.
    median_diameter : float, optional
        Median diameter by mass [m] that the whole bed is scaled to.
    density : float
        Density [kg/m³].
    """

    keep: Literal["inside", "all"] = "inside"
    porosity: Fraction | None = None
    scale: Annotated[float, Field(gt=0, le=1)] | None = None
    median_diameter: Positive | None = None
    density: Positive = QUARTZ_DENSITY

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.porosity is None) == (self.scale is None):
            raise ValueError("give either porosity or scale")
        return self


def shape(table: GrainsTable, cells: Tessellation) -> Packing:
    """Return the packing that a table makes of the cells."""
    packing = carve(cells, keep=table.keep, density=table.density)
    packing = shrink(packing, porosity=table.porosity, scale=table.scale)
    if table.median_diameter is None:
        return packing
    (median,) = percentiles(diameters(packing.grains), (50,), weights=masses(packing))
    return rescale(packing, table.median_diameter / float(median))
