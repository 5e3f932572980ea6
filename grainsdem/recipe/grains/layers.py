"""``[[grains.layer]]``: beds in layers, each with sizes of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from grainsdem.recipe.base import Table
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.recipe.grains.sizes import SizesTable
from grainsdem.tessellation.graded import Wish
from grainsdem.tessellation.layered import TOLERANCE, Layer, layered_cells, parts_of, shares
from grainsdem.tessellation.lenses import Form, Lens
from grainsdem.values import Positive

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from grainsdem.model import Domain, Tessellation
    from grainsdem.tessellation import Metric

    Floats = NDArray[np.float64]


class LensTable(Table):
    """``lens`` of a layer: where it lies, in the domain as the recipe has it.

    Parameters
    ----------
    center : three numbers
        Its middle [m].
    half_axes : three numbers
        Half of its lengths [m] along the trend, across it, and upward.
    form : {"ellipsoid", "box"}
        What it is.
    trend, dip : float
        Direction of its first axis in the plane, and how far that end is raised [rad].
    """

    center: tuple[float, float, float]
    half_axes: tuple[Positive, Positive, Positive]
    form: Form = "ellipsoid"
    trend: float = 0.0
    dip: float = 0.0

    def lens(self) -> Lens:
        """Return the lens that is asked for."""
        return Lens(self.center, self.half_axes, self.form, self.trend, self.dip)


class LayerTable(Table):
    """``[[grains.layer]]``: one layer of a bed, from the bottom up; its grains have its number, from 0, as their class.

    Parameters
    ----------
    thickness : float
        How thick it is beside the others: its share of the sum of all.
    sizes, sieves : tables
        What sizes its grains have, one of the two: a law of ``[grains.sizes]``, or a sheet of ``[grains.sieves]``.
    top : table, optional
        A sheet, as ``sieves`` is, that the layer has at its top; its own is that at the bottom, and between them every
        percentile changes with height.
    lens : table, optional
        Where the grains lie instead, if they are no layer but a lens that replaces what is there, see `LensTable`.
    density : float, optional
        Density [kg/m³]; that of ``[grains]`` where not given.
    """

    thickness: Positive = 1.0
    sizes: SizesTable | None = None
    sieves: SievesTable | None = None
    top: SievesTable | None = None
    lens: LensTable | None = None
    density: Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.sizes is None) == (self.sieves is None):
            raise ValueError("a layer has sizes or sieves, one of the two")
        if self.sizes is not None and self.sizes.is_list:
            raise ValueError("a layer's sizes follow a law: how many grains it has is not known before")
        if self.top is not None and (self.sieves is None or self.sieves.diameter != self.top.diameter):
            raise ValueError("a layer with another sheet at its top has sieves, of the same diameter")
        if self.lens is not None and ("thickness" in self.model_fields_set or self.top is not None):
            raise ValueError("a lens is as thick as its half axes say, and has one sheet: leave out thickness and top")
        return self

    @property
    def source(self) -> SizesTable | SievesTable:
        """The table that says what sizes its grains have."""
        return self.sizes or self.sieves  # type: ignore[return-value]


class Layers:
    """All layers of a bed, with what a table of sizes has.

    Parameters
    ----------
    tables : sequence of LayerTable
        From the bottom up.
    """

    is_list = False

    def __init__(self, tables: Sequence[LayerTable]) -> None:
        self._tables = tuple(tables)

    def assumed(self) -> list[str]:
        """Return a line on each thing that had to be assumed of a sheet."""
        return [f"layer {k + 1}: {line}" for k, table in enumerate(self._tables) for line in table.source.assumed()]

    def draw_in(self, domain: Domain, n: int, rng: np.random.Generator) -> Floats:
        """Return the diameters [m] of about ``n`` grains of all layers."""
        parts = parts_of(domain, self._layers(), n)
        counts, _ = shares(domain, parts, n)
        drawn = [
            Wish(part.curve, domain, None).draw(count, None, tolerance=None)
            for part, count in zip(parts, counts, strict=True)
            if count
        ]
        return np.asarray(rng.permutation(np.concatenate(drawn)))

    def densities(self, classes: NDArray[np.int32], other: float) -> Floats:
        """Return the density [kg/m³] of grains of these layers, that of the bed where a layer has none."""
        return np.array([other if table.density is None else table.density for table in self._tables])[classes]

    def cells(
        self,
        domain: Domain,
        n: int,
        rng: np.random.Generator,
        *,
        keep: str | None,
        metric: Metric | None,
        progress: Callable[[int, float], None],
    ) -> tuple[Tessellation, Floats, NDArray[np.int32]]:
        """Return the cells, the diameters [m] asked for, and the layer of each; ``keep`` is None for a pilot."""
        most = max(table.source.relaxations for table in self._tables)
        found = layered_cells(
            domain,
            self._layers(),
            n=n,
            keep="all" if keep == "all" else "inside",
            tolerance=None if keep is None else TOLERANCE,
            relaxations=most,
            metric=metric,
            rng=rng,
            progress=progress,
        )
        return found.cells, found.diameters, found.classes

    def _layers(self) -> list[Layer]:
        return [
            Layer(
                table.source.curve(),
                table.thickness,
                None if table.top is None else table.top.curve(),
                None if table.lens is None else table.lens.lens(),
            )
            for table in self._tables
        ]
