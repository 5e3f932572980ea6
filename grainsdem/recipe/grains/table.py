"""``[grains]`` and ``[grains.throats]``: what the cells become."""

from __future__ import annotations

from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from grainsdem.errors import InputError
from grainsdem.model import QUARTZ_DENSITY
from grainsdem.packing import (
    VOID_RELATIONS,
    carve,
    fit_void_ratio,
    infill,
    jitter_throats,
    ratio_to,
    rescale,
    resize,
    shrink,
    size_of,
)
from grainsdem.packing.carve import unwarned
from grainsdem.packing.infill import coarse_solid_fraction
from grainsdem.recipe.base import Fraction, Table
from grainsdem.recipe.grains.axes import AxesTable
from grainsdem.recipe.grains.layers import Layers, LayerTable
from grainsdem.recipe.grains.shapes import ShapesTable
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.recipe.grains.sizes import SizesTable
from grainsdem.values import Coefficient, Positive

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Packing, Tessellation

Corner = tuple[float, float, float]

_OF_CELLS = ("layer", "axes", "infill")
"""Tables that say what cells become."""

VOIDS = ("porosity", "solid_fraction", "void_ratio", "scale", "gap", "relation")
"""Keys that say how much void there is: one of them is given."""

_GROWTHS = 60
"""How often an interval is halved, or a bound doubled, on the way to a size."""


def _is_corner(value: Any) -> bool:
    is_three = isinstance(value, list | tuple) and len(value) == 3
    return is_three and all(isinstance(x, int | float) for x in value)


class ThroatsTable(Table):
    """``[grains.throats]``: grains moved at random within their cells, so that pore throats get many widths.

    Parameters
    ----------
    fraction : float
        Share of the grains that are moved, in [0, 1].
    strength : float
        How much of its slack a grain may use, in [0, 1].
    axes : str
        Coordinates that change: one to three of ``"xyz"``; never z in a slab.
    """

    fraction: Annotated[float, Field(ge=0, le=1)] = 1.0
    strength: Annotated[float, Field(ge=0, le=1)] = 1.0
    axes: str = "xyz"

    @model_validator(mode="after")
    def _known_axes(self) -> Self:
        if not self.axes or set(self.axes) - set("xyz") or len(set(self.axes)) != len(self.axes):
            raise ValueError(f"axes must be one to three of 'xyz', each once; got {self.axes!r}")
        return self


class InfillTable(Table):
    """``[grains.infill]``: fine grains in the voids between the others, which stay as they are.

    The porosity asked for is that of the whole; the coarse grains are shrunk to what is left for them. Coarse grains
    have the class 0, fine ones 1. It takes ``keep = "all"``, or a domain that wraps around.

    Parameters
    ----------
    share : float
        Mass of the fine grains over that of all, had exactly.
    diameter : float
        Diameter [m] of the sphere of their mean volume.
    density : float, optional
        Density [kg/m³] of the fine grains; that of ``[grains]`` where not given.
    relaxations : int
        How many times their seeds move to the centroids of their cells.
    """

    share: Annotated[float, Field(gt=0, lt=1)]
    diameter: Positive
    density: Positive | None = None
    relaxations: Annotated[int, Field(ge=0)] = 8


class GrainsTable(Table):
    """``[grains]``: what the cells become.

    Parameters
    ----------
    keep : {"inside", "all"}
        Whether cells that touch a wall are dropped.
    porosity, solid_fraction, void_ratio : float
        Void of the region, reached exactly: in [0, 1), in (0, 1], or zero or more.
    scale : float
        Linear factor that grains shrink by, in (0, 1].
    gap : float
        Distance [m] between the faces of neighbours, the same everywhere, in the finished bed.
    relation : str
        Name of a relation of void ratio to mean sphericity, or to sorting, that the bed is to lie on: the optimal F.
        One of the six is given.
    about : {"centroid", "seed", "vertex_mean"}
        What grains shrink about.
    region : {"cells", "domain"} or two corners
        What the porosity is of; corners [m] of a box inside.
    mean_diameter, median_diameter : float, optional
        Diameter [m] by number, or by mass, of the grains as they are in the end; one of the two. With a count of seeds
        the whole bed is scaled to it, and only the domain's proportions count; without, the count follows.
    density : float
        Density [kg/m³].
    throats, sizes, sieves, layer, axes, infill, shapes : tables, optional
        See each; one of sizes, sieves and layers. With shapes the other keys have no use, but for the density.
    """

    keep: Literal["inside", "all"] = "inside"
    porosity: Fraction | None = None
    solid_fraction: Annotated[float, Field(gt=0, le=1)] | None = None
    void_ratio: Coefficient | None = None
    scale: Annotated[float, Field(gt=0, le=1)] | None = None
    gap: Coefficient | None = None
    relation: str | None = None
    about: Literal["centroid", "seed", "vertex_mean"] = "centroid"
    region: Literal["cells", "domain"] | tuple[Corner, Corner] = "cells"
    mean_diameter: Positive | None = None
    median_diameter: Positive | None = None
    density: Positive = QUARTZ_DENSITY
    throats: ThroatsTable | None = None
    sizes: SizesTable | None = None
    sieves: SievesTable | None = None
    layer: tuple[LayerTable, ...] = ()
    axes: AxesTable | None = None
    infill: InfillTable | None = None
    shapes: ShapesTable | None = None

    @field_validator("region", mode="before")
    @classmethod
    def _known_region(cls, value: Any) -> Any:
        is_box = isinstance(value, list | tuple) and len(value) == 2
        if value not in ("cells", "domain") and not (is_box and all(map(_is_corner, value))):
            raise ValueError("region must be 'cells', 'domain' or the two corners of a box, three numbers each")
        return value

    @model_validator(mode="after")
    def _one_void(self) -> Self:
        if self.shapes is not None:
            return self._without_cells(self.shapes)
        given = [name for name in VOIDS if getattr(self, name) is not None]
        if len(given) != 1:
            shown = ", ".join(f"{name} = {getattr(self, name)}" for name in given)
            raise ValueError(f"give one of {', '.join(VOIDS)}; got {shown or 'none'}")
        if self.relation is not None and self.relation not in VOID_RELATIONS:
            raise ValueError(f"relation must be one of {', '.join(VOID_RELATIONS)}; got {self.relation!r}")
        if self.mean_diameter is not None and self.median_diameter is not None:
            raise ValueError(
                f"give mean_diameter or median_diameter; got {self.mean_diameter} and {self.median_diameter}"
            )
        return self

    @model_validator(mode="after")
    def _options_have_a_use(self) -> Self:
        if self.gap is not None and self.about != "centroid":
            raise ValueError(f"a gap moves faces, not vertices about a point: leave out about; got {self.about!r}")
        if (self.gap is not None or self.scale is not None) and self.region != "cells":
            raise ValueError(
                "region says what a porosity is of, and neither scale nor gap is one: leave it out, or give porosity, "
                "solid_fraction, void_ratio or relation"
            )
        named = [name for name in ("sizes", "sieves", "layer") if getattr(self, name)]
        if len(named) > 1:
            raise ValueError(f"give one of sizes, sieves and layers; got {', '.join(named)}")
        if self.layer and self.axes is not None and (self.axes.trend or self.axes.dip):
            raise ValueError("layers are level: leave out trend and dip of axes, or the layers")
        if self.layer and self.axes is not None and self.axes.is_mixed:
            raise ValueError("grains in layers have mean proportions: give one elongation and one flatness, no classes")
        if self.gap is not None and self.prescribed is not None:
            given = named[0]
            raise ValueError(f"a gap takes more from small grains than from large ones: give {given} or gap")
        if (self.sieves is not None or self.layer) and self.diameter is not None:
            told = "layers" if self.layer else "sieves"
            raise ValueError(f"{told} say how large grains are: leave out {self.diameter[0]}")
        if self.throats is not None and self._is_full:
            raise ValueError("grains that fill their cells have no room to move: leave out throats, or give more void")
        return self

    @model_validator(mode="after")
    def _infill_has_its_voids(self) -> Self:
        if self.infill is None or self.shapes is not None:
            return self
        if self.void_asked is None or self.region != "cells":
            raise ValueError("an infill takes the porosity, solid_fraction or void_ratio of the whole domain: give one")
        if self.throats is not None or self.layer:
            idle = "throats" if self.throats is not None else "layers"
            raise ValueError(f"grains with an infill between them have no {idle}: leave them out, or infill")
        return self

    @property
    def void_asked(self) -> float | None:
        """The porosity asked for, if it is."""
        if self.porosity is not None:
            return self.porosity
        if self.solid_fraction is not None:
            return 1 - self.solid_fraction
        return None if self.void_ratio is None else self.void_ratio / (1 + self.void_ratio)

    def filled(self, packing: Packing, rng: np.random.Generator, progress: Callable[[int, int], None]) -> Packing:
        """Return the bed with its infill, if it has one."""
        if self.infill is None:
            return packing
        return infill(
            packing,
            share=self.infill.share,
            diameter=self.infill.diameter,
            density=self.infill.density or self.density,
            relaxations=self.infill.relaxations,
            rng=rng,
            progress=progress,
        )

    def _without_cells(self, shapes: ShapesTable) -> Self:
        """Refuse what is done to cells beside grains that come from none."""
        idle = [
            name
            for name in (*VOIDS, "mean_diameter", "median_diameter", "throats", "keep", "about", "region", *_OF_CELLS)
            if getattr(self, name) != type(self).model_fields[name].default
        ]
        if idle:
            raise ValueError(f"grains of shapes come from no cells: leave out {', '.join(idle)}")
        shapes.refuse_without_sizes(self.sizes, self.sieves)
        return self

    @property
    def _is_full(self) -> bool:
        full = self.porosity == 0 or self.void_ratio == 0 or self.gap == 0
        return full or self.scale == 1 or self.solid_fraction == 1

    @property
    def has_size(self) -> bool:
        """Whether the grains' size in metres is asked for."""
        return self.prescribed is not None or self.diameter is not None

    @property
    def prescribed(self) -> SizesTable | SievesTable | Layers | None:
        """What says which sizes the grains have, each its own."""
        if self.layer:
            return Layers(self.layer)
        return self.sizes if self.sieves is None else self.sieves

    @property
    def diameter(self) -> tuple[str, float] | None:
        """The name and value of the diameter asked for."""
        if self.mean_diameter is not None:
            return "mean_diameter", self.mean_diameter
        return None if self.median_diameter is None else ("median_diameter", self.median_diameter)


def shape(
    table: GrainsTable,
    cells: Tessellation,
    rng: np.random.Generator,
    *,
    wanted: NDArray[np.float64] | None = None,
    classes: NDArray[np.int32] | None = None,
    is_scaled: bool = True,
) -> Packing:
    """Return the packing that a table makes of the cells.

    Parameters
    ----------
    table : GrainsTable
        What to make.
    cells : Tessellation
        Cells, of the ratios of ``wanted`` where that is given.
    rng : numpy.random.Generator
        Source of randomness for throats.
    wanted : ndarray, shape (n_cells,), optional
        Diameters [m] that the grains are to have.
    classes : ndarray of int32, shape (n_cells,), optional
        The layer of each cell.
    is_scaled : bool
        Whether the whole bed is scaled to the size asked for, if any.
    """
    # Grains that are kept have the curve of a law or of sieves: nothing is lost with those at the walls.
    is_listed = table.prescribed is None or table.prescribed.is_list
    with nullcontext() if is_listed else unwarned():
        density = table.density if classes is None else Layers(table.layer).densities(classes, table.density)
        packing = carve(cells, keep=table.keep, density=density, classes=classes)
    if is_scaled and table.gap is not None:
        packing = _apart(packing, table)
    else:
        packing = _shrunk(packing, table)
        if is_scaled and table.has_size:
            packing = _resized(packing, table, wanted)
    if table.throats is None:
        return packing
    throats = table.throats
    # After all else, so that the widths it tells are those of the finished bed.
    return jitter_throats(packing, fraction=throats.fraction, strength=throats.strength, axes=throats.axes, rng=rng)


def size_ratio(table: GrainsTable, packing: Packing, wanted: NDArray[np.float64] | None) -> float:
    """Return how many times larger the grains of a packing are than a table asks for."""
    if table.diameter is not None:
        name, diameter = table.diameter
        return size_of(packing, name) / diameter
    if wanted is None:
        raise InputError("the table asks for no size")
    return ratio_to(wanted, packing)


def _shrunk(packing: Packing, table: GrainsTable) -> Packing:
    if table.relation is not None:
        return fit_void_ratio(packing, relation=table.relation, about=table.about, region=table.region)
    if table.infill is not None and table.void_asked is not None:
        own, share = table.infill.density or table.density, table.infill.share
        solid = coarse_solid_fraction(table.void_asked, share, table.density, own)
        return shrink(packing, solid_fraction=solid, about=table.about)
    voids = {name: getattr(table, name) for name in VOIDS if name != "relation"}
    return shrink(packing, **voids, about=table.about, region=table.region)


def _resized(packing: Packing, table: GrainsTable, wanted: NDArray[np.float64] | None) -> Packing:
    if table.diameter is not None:
        name, diameter = table.diameter
        return resize(packing, **{name: diameter})
    return rescale(packing, 1 / size_ratio(table, packing, wanted))


def _apart(packing: Packing, table: GrainsTable) -> Packing:
    """Return grains a gap [m] apart that have the diameter asked for: their cells are scaled until they do."""
    from scipy.optimize import brentq  # noqa: PLC0415  (a tenth of a second, and only for gaps)

    if table.diameter is None:
        return _shrunk(packing, table)
    name, diameter = table.diameter
    low = diameter / size_of(packing, name)

    def excess(factor: float) -> float:
        try:
            return size_of(_shrunk(rescale(packing, factor), table), name) - diameter
        except InputError:  # grains vanish: the cells are too small by far
            return -diameter

    high = low
    for _ in range(_GROWTHS):
        if excess(high) >= 0:
            break
        high *= 1.25
    factor = (
        low
        if high == low
        else brentq(excess, low, high, xtol=1e-15 * low, rtol=4 * np.finfo(float).eps, maxiter=_GROWTHS)
    )
    return _shrunk(rescale(packing, factor), table)
