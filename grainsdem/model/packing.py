"""Grains in a domain, and what they still know of their cells."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.errors import ArgumentError, InputError, ShapeError, name_offenders
from grainsdem.gate import gated_noun
from grainsdem.model.arrays import LONGEST, Noun, check_factor, check_rows

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model.domain import Domain
    from grainsdem.model.shapes import Polyhedra

    Floats = NDArray[np.float64]
    Ints = NDArray[np.int32]

DROPPED = np.iinfo(np.int32).min
"""Neighbour of a face whose other cell was dropped when the packing was carved."""

QUARTZ_DENSITY = 2650.0
"""Density of quartz [kg/m³], the default of every packing."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class CellLinks(Noun):
    """What grains in place still know of the tessellation that they were carved from.

    Parameters
    ----------
    neighbors : array_like of int32, shape (n_faces,)
        The grain across each face; negative for a wall (see `Domain`), `DROPPED` where that cell was dropped.
    shifts : array_like of int8, shape (n_faces, 3)
        Periodic image of that neighbour, in whole domain lengths.
    cell_volumes : array_like, shape (n,)
        Volume [m³] of the cell that each grain was shrunk from, with its part of the void between cells that do not
        fill space.
    sites : array_like, shape (n, 3), optional
        Seed [m] that each cell grew from.
    heights : array_like, shape (n_faces,), optional
        Distance [m] of each face's cell plane from the seed, outward; with ``sites`` or not at all.
    rooms : array_like, shape (n,), optional
        Distance [m] that each grain is certain to keep from planes of its cell that it has no face along any more;
        infinite where there is none, as by default.
    """

    neighbors: Ints
    shifts: NDArray[np.int8]
    cell_volumes: Floats
    sites: Floats | None = None
    heights: Floats | None = None
    rooms: Floats | None = None

    def __post_init__(self) -> None:
        neighbors = self.freeze("neighbors", np.int32, None)
        self.freeze("shifts", np.int8, neighbors.size, 3)
        n = self.freeze("cell_volumes", np.float64, None).size
        self._hold_finite("cell_volumes")
        if (self.sites is None) != (self.heights is None):
            raise ShapeError("links must have both sites and heights, or neither")
        if self.sites is None:
            return
        self.freeze("sites", np.float64, n, 3)
        self.freeze("heights", np.float64, neighbors.size)
        if self.rooms is None:
            object.__setattr__(self, "rooms", np.full(n, np.inf))
        rooms = self.freeze("rooms", np.float64, n)
        self._hold_finite("sites", "heights")
        if np.isnan(rooms).any():
            raise InputError("rooms of links must be numbers; some are not")

    def _hold_finite(self, *names: str) -> None:
        """Raise `InputError` where one of these arrays is not finite."""
        for name in names:
            values = getattr(self, name)
            bad = np.flatnonzero(~np.isfinite(values).all(axis=tuple(range(1, values.ndim))))
            if bad.size:
                raise InputError(f"{name} of links must be finite; not so: {name_offenders(bad)}")

    def scaled(self, factor: float) -> CellLinks:
        """Return the links of the same cells scaled about the origin."""
        check_factor(factor)
        return replace(
            self,
            cell_volumes=self.cell_volumes * factor**3,
            sites=None if self.sites is None else self.sites * factor,
            heights=None if self.heights is None else self.heights * factor,
            rooms=None if self.rooms is None else self.rooms * factor,
        )


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Packing(Noun):
    """Grains in a domain, each with a pose and a density.

    Parameters
    ----------
    grains : Polyhedra
        Shapes, each about its own centroid.
    positions : array_like, shape (n, 3)
        Centroid [m] of each grain.
    quaternions : array_like, shape (n, 4)
        Rotation (w, x, y, z) from each grain's frame to the world, of unit length.
    densities : array_like, shape (n,)
        Density [kg/m³] of each grain.
    domain : Domain
        The container.
    links : CellLinks, optional
        Neighbours in the tessellation, while they are still meaningful.
    provenance : tuple of str
        What made it: one JSON object a step, oldest first.
    frictions : array_like, shape (n,), optional
        Coefficient of friction [1] of each grain, zero or more; without it all have that of the run that they are in.
    classes : array_like of int32, shape (n,), optional
        Number of the kind, shape or layer that each grain is of, zero or more: it goes wherever its grain goes.
    """

    grains: Polyhedra
    positions: Floats
    quaternions: Floats
    densities: Floats
    domain: Domain
    links: CellLinks | None = None
    provenance: tuple[str, ...] = ()
    frictions: Floats | None = None
    classes: Ints | None = None

    def __post_init__(self) -> None:
        n = len(self.grains)
        for name, width in (("positions", 3), ("quaternions", 4)):
            self._hold_range(self.freeze(name, np.float64, n, width), name, -LONGEST, LONGEST)
        self._hold_range(self.freeze("densities", np.float64, n)[:, None], "densities", 0.0, LONGEST)
        if self.frictions is not None:
            own = self.freeze("frictions", np.float64, n)
            bad = np.flatnonzero(~(np.isfinite(own) & (own >= 0)))
            if bad.size:
                raise ShapeError(f"frictions must be finite and zero or more; not so: {name_offenders(bad)}")
        if self.classes is not None:
            numbers = np.asarray(self.classes)
            if numbers.dtype.kind not in "iu" or (numbers < 0).any():
                raise ShapeError("classes must be whole numbers, zero or more")
            self.freeze("classes", np.int32, n)
        object.__setattr__(self, "provenance", tuple(self.provenance))
        if self.links is not None:
            if self.links.neighbors.size != self.grains.n_faces:
                raise ShapeError(
                    f"links must have one neighbour a face: {self.grains.n_faces}; got {self.links.neighbors.size}"
                )
            if self.links.neighbors.max(initial=-1) >= n:
                raise ShapeError(f"links must be to grains 0 to {n - 1}; got one to {self.links.neighbors.max()}")
            if self.links.cell_volumes.size != n:
                raise ShapeError(f"links must have one cell volume a grain: {n}; got {self.links.cell_volumes.size}")

    def __len__(self) -> int:
        return len(self.grains)

    def _hold_range(self, values: Floats, name: str, least: float, most: float) -> None:
        """Raise `InputError` where a number is out of range; what is not finite is left to validation."""
        if values.size and least <= values.min() and values.max() <= most:
            return
        bad = np.flatnonzero((np.isfinite(values) & ((values < least) | (values > most))).any(axis=1))
        if bad.size:
            raise InputError(f"{name} must be {least:g} to {most:g}; not so: {name_offenders(bad)}")

    def frictions_of(self, rows: NDArray[np.integer[Any]] | slice) -> Floats | None:
        """Return the coefficients of friction of some grains, or None where grains have none of their own."""
        return None if self.frictions is None else self.frictions[check_rows("rows", rows, len(self))]

    def classes_of(self, rows: NDArray[np.integer[Any]] | slice) -> Ints | None:
        """Return the classes of some grains, or None where grains have none."""
        return None if self.classes is None else self.classes[check_rows("rows", rows, len(self))]

    def with_step(self, step: str, **options: Any) -> Packing:
        """Return the same packing with one more step in its provenance; options must be JSON values."""
        try:
            line = json.dumps({"step": step, **options}, sort_keys=True)
        except (TypeError, ValueError, RecursionError) as error:
            raise ArgumentError(f"options of a step must be JSON values; {error}") from None
        return replace(self, provenance=(*self.provenance, line))
