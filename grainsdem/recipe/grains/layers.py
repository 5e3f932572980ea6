"""``[[grains.layer]]``: beds in layers, each with sizes of its own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Self

import numpy as np
from pydantic import model_validator

from grainsdem.recipe.base import Positive, Table
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.recipe.grains.sizes import SizesTable
from grainsdem.tessellation.layered import TOLERANCE, Layer, layered_cells, shares

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from grainsdem.model import Domain, Tessellation
    from grainsdem.tessellation import Metric

    Floats = NDArray[np.float64]


class LayerTable(Table):
    """``[[grains.layer]]``: one layer of a bed, from the bottom up; its grains have its number, from 0, as their class.

    Parameters
    ----------
    thickness : float
        How thick it is beside the others: its share of the sum of all.
    sizes, sieves : tables
        What sizes its grains have, one of the two: a law of ``[grains.sizes]``, or a sheet of ``[grains.sieves]``.
    density : float, optional
        Density [kg/m³]; that of ``[grains]`` where not given.
    """

    thickness: Positive = 1.0
    sizes: SizesTable | None = None
    sieves: SievesTable | None = None
    density: Positive | None = None

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.sizes is None) == (self.sieves is None):
            raise ValueError("a layer has sizes or sieves, one of the two")
        if self.sizes is not None and self.sizes.is_list:
            raise ValueError("a layer's sizes follow a law: how many grains it has is not known before")
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
        counts, _ = shares(domain, self._layers(), n)
        drawn = [table.source.draw(count, rng) for table, count in zip(self._tables, counts, strict=True) if count]
        return np.concatenate(drawn)

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
        return [Layer(table.source.curve(), table.thickness) for table in self._tables]
