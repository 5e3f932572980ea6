"""``[grains.sieves]``: a laboratory's sieve sheet that the grains are to have."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, model_validator

from grainsdem.errors import InputError
from grainsdem.measures.distributions.fits import Family
from grainsdem.measures.distributions.sheets.reading import read_sieves
from grainsdem.measures.distributions.sheets.sheet import SieveSheet, Unit, opening
from grainsdem.measures.distributions.sieves import fit_sieves
from grainsdem.model import Grading
from grainsdem.model.grading import Diameter
from grainsdem.recipe.base import Table
from grainsdem.tessellation.graded import TOLERANCE

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Opening = float | str


class SievesTable(Table):
    """``[grains.sieves]``: per cent by mass that pass sieves; the grains that are kept have this curve.

    Parameters
    ----------
    openings : list of numbers or names
        Openings of the sieves in either order: numbers in ``unit``, or names such as ``"No. 40"`` or ``"3/8 in"``.
    unit : {"mm", "m", "um", "phi", "astm"}
        What bare numbers are in.
    passing : list of numbers
        Per cent by mass that pass each.
    retained : list of numbers
        Instead of passing: mass, or per cent of it, that stays on each; ``"pan"`` among the openings is the pan.
    path : str
        Instead of all these: a file of two columns, relative to the recipe (.csv, .txt, .tsv).
    finest, widest : number or name, optional
        Bounds of the pan and of what stays on the widest sieve, where they hold anything; without them such a class is
        as wide in φ as the one beside it, one φ at most.
    diameter : {"sieve", "equal-volume"}
        What the openings are openings for: the smallest square hole that a grain passes, or the diameter of the sphere
        of its volume.
    fit : {"normal", "lognormal", "log-hyperbolic"}, optional
        Have the curve of this family that fits the sheet best, between its half and its 99.5 per cent, and not the
        sheet's own.
    tolerance : float
        Largest difference of the grains' curve from the one asked for at any sieve, as a share of the mass.
    relaxations : int
        How many times seeds move to the centroids of their cells on the way: rounder grains for larger numbers.
    """

    openings: Annotated[tuple[Opening, ...], Field(min_length=2)] | None = None
    unit: Unit = "mm"
    passing: tuple[float, ...] | None = None
    retained: tuple[float, ...] | None = None
    path: str | None = None
    finest: Opening | None = None
    widest: Opening | None = None
    diameter: Diameter = "sieve"
    fit: Family | None = None
    tolerance: Annotated[float, Field(gt=0, lt=1)] = TOLERANCE
    relaxations: Annotated[int, Field(ge=0)] = 5

    @model_validator(mode="after")
    def _one_sheet(self) -> Self:
        given = [name for name in ("passing", "retained", "path") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of passing, retained and path; got {', '.join(given) or 'none'}")
        if (self.path is None) != (self.openings is not None):
            raise ValueError("openings go with passing or retained; a file has its own")
        if self.fit is not None and not (self.finest is None and self.widest is None):
            raise ValueError("a fit has no open classes: leave out finest and widest, or fit")
        if self.path is None:
            self.curve()
        return self

    @property
    def is_list(self) -> bool:
        """Whether the number of grains is known from the table alone: never."""
        return False

    def assumed(self) -> list[str]:
        """Return a line on each thing that had to be assumed of the sheet."""
        named = {"finest": self.finest, "widest": self.widest}
        lines = [] if self.fit is not None else self.sheet().open_ends()
        return [line for line in lines if not any(value is not None and name in line for name, value in named.items())]

    def sheet(self) -> SieveSheet:
        """Return the sheet that is asked for.

        Raises
        ------
        InputError
            If it is none.
        MissingFileError, FileFormatError
            If its file is missing or holds something else.
        """
        if self.path is not None:
            return read_sieves(self.path, unit=self.unit if "unit" in self.model_fields_set else None)
        sizes = [opening(size, self.unit) for size in self.openings or ()]
        values = self.passing if self.passing is not None else self.retained or ()
        if len(values) != len(sizes):
            name = "passing" if self.passing is not None else "retained"
            raise InputError(
                f"there must be one number {name} for each of the {len(sizes)} openings; got {len(values)}"
            )
        rows = [(size, value) for size, value in zip(sizes, values, strict=True) if size != 0]
        pans = [value for size, value in zip(sizes, values, strict=True) if size == 0]
        if len(pans) > 1:
            raise InputError("the pan stands twice among the openings")
        kept = [size for size, _ in rows], [value for _, value in rows]
        if self.passing is not None:
            if pans and pans[0] != 0:
                raise InputError(f"nothing passes the pan; got {pans[0]:g} per cent")
            return SieveSheet.from_passing(*kept)
        return SieveSheet.from_retained(*kept, pan=pans[0] if pans else 0.0)

    def curve(self) -> Grading:
        """Return the curve that the grains are to have; errors as in `sheet`."""
        sheet = self.sheet()
        if self.fit is not None:
            return Grading.of(fit_sieves(sheet.bounds, sheet.weights, self.fit).distribution, diameter=self.diameter)
        bounds = {
            name: None if given is None else opening(given, self.unit)
            for name, given in (("finest", self.finest), ("widest", self.widest))
        }
        return sheet.grading(**bounds, diameter=self.diameter)

    def draw(self, n: int, _rng: np.random.Generator) -> NDArray[np.float64]:
        """Return ``n`` diameters [m] that have the curve as nearly as so many can, shape (n,)."""
        return self.curve().draw(n, tolerance=None)
