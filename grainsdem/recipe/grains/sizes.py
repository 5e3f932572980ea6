"""``[grains.sizes]``: a grain-size distribution that is asked for and had."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.foreign import array_of, refusing
from grainsdem.measures.distributions.fits import FAMILIES
from grainsdem.measures.distributions.hyperbolic import LogHyperbolic
from grainsdem.measures.distributions.normal import LogNormal, Normal
from grainsdem.model import Grading
from grainsdem.points import text
from grainsdem.recipe.base import Table
from grainsdem.recipe.grains.sieves import SievesTable
from grainsdem.tessellation import sized_cells
from grainsdem.tessellation.graded import SHARPEST, TOLERANCE, graded_cells
from grainsdem.values import Positive

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    from grainsdem.model import Domain, Tessellation
    from grainsdem.tessellation.metric import Metric
    from grainsdem.tessellation.sized import Law

    Floats = NDArray[np.float64]

SUFFIXES = (".txt", ".csv", ".npy")


class SizesTable(Table):
    """``[grains.sizes]``: the diameters [m] of the grains, by a law or one by one; cells are made to fit them.

    Only their ratios count where ``[grains]`` has a mean or median diameter of its own. Diameters are those of spheres
    of equal volume, or in a slab of circles of equal area. A law is had by the grains that are kept. Of a list, cells
    that touch a wall are dropped, and their sizes with them, unless ``keep`` is ``"all"``: a warning tells what that
    does to the curve.

    Parameters
    ----------
    law : str
        A family that `grainsdem fit` fits, ``"normal"``, ``"lognormal"`` or ``"log-hyperbolic"``, or the name of a
        continuous distribution of `scipy.stats`, such as ``"lognorm"``. Grains take its quantiles at equal steps of
        probability, in random order.
    parameters : table of numbers
        Its parameters, such as ``{mu = -6.9, sigma = 0.3}``, or by their names in scipy, ``{s = 0.3, scale = 1e-3}``.
    by : {"number", "mass"}
        What the law is a distribution of. One of mass is cut at its half and its 99.5 per cent.
    diameters : list of numbers
        Diameter [m] of each grain; that of seed i is entry i, and there are as many seeds as entries.
    path : str
        File of such a list, relative to the recipe: .txt, .csv or .npy. One of law, diameters and path is given.
    tolerance : float
        Largest relative error of a cell's volume.
    relaxations : int
        How many times seeds move to the centroids of their cells on the way: rounder grains for larger numbers.
    """

    law: str | None = None
    parameters: dict[str, float] = Field(default_factory=dict)
    by: Literal["number", "mass"] = "number"
    diameters: Annotated[tuple[Positive, ...], Field(min_length=1)] | None = None
    path: str | None = None
    tolerance: Annotated[float, Field(gt=0, lt=1)] = 0.01
    relaxations: Annotated[int, Field(ge=0)] = 5

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        given = [name for name in ("law", "diameters", "path") if getattr(self, name) is not None]
        if len(given) != 1:
            raise ValueError(f"give one of law, diameters and path; got {', '.join(given) or 'none'}")
        if self.law is None:
            if self.parameters:
                raise ValueError(f"parameters are those of a law; got {', '.join(self.parameters)} beside {given[0]}")
            if self.by != "number":
                raise ValueError(f"by says what a law is a distribution of; got {self.by!r} beside {given[0]}")
            return self
        self.curve()
        return self

    @property
    def is_list(self) -> bool:
        """Whether the number of grains is known from the diameters alone."""
        return self.law is None

    def draw(self, n: int, rng: np.random.Generator) -> Floats:
        """Return ``n`` diameters [m], shape (n,).

        Raises
        ------
        InputError
            If there is a list of another number.
        MissingFileError, FileFormatError
            If it is in a file that is missing, or holds something else.
        """
        if self.law is not None:
            curve = self.curve()
            if isinstance(curve, Grading):
                return rng.permutation(curve.draw(n, tolerance=None))
            return np.asarray(rng.permutation(curve.ppf((np.arange(n) + 0.5) / n)), dtype=np.float64)
        values = self.listed()
        if len(values) != n:
            raise InputError(f"there must be one diameter for each of the {n} seeds; got {len(values)}")
        return values

    def curve(self) -> Grading | Law:
        """Return what the sizes are to follow, where that is a law."""
        if self.law is None:
            raise InputError("a list of diameters follows no law")
        law = _frozen(self.law, self.parameters)
        return Grading.of(law) if self.by == "mass" else law

    def assumed(self) -> list[str]:
        """Return a line on each thing that had to be assumed: nothing."""
        return []

    def listed(self) -> Floats:
        """Return the diameters [m] of a list, shape (n,); errors as in `draw`."""
        return np.asarray(self.diameters, dtype=np.float64) if self.path is None else _read(Path(self.path))


_OWN: dict[str, type[Normal | LogNormal | LogHyperbolic]] = dict(
    zip(FAMILIES, (Normal, LogNormal, LogHyperbolic), strict=True)
)


def _frozen(law: str, parameters: dict[str, float]) -> Any:
    """Return a family that is fitted, or a distribution of scipy.stats, with its parameters."""
    if law in _OWN:
        names = [field.name for field in fields(_OWN[law])]
        if set(parameters) != set(names):
            raise ValueError(f"{law} takes {', '.join(names)}; got {', '.join(parameters) or 'none'}")
        return _OWN[law](**parameters)
    from scipy import stats  # noqa: PLC0415  (half a second, and only for laws)

    family = getattr(stats, law, None)
    if not isinstance(family, stats.rv_continuous):
        raise ValueError(  # noqa: TRY004  (pydantic turns ValueErrors into lines)
            f"law must be {', '.join(_OWN)}, or a continuous distribution of scipy.stats, such as lognorm or uniform; "
            f"got {law!r}"
        )
    takes = [*filter(None, (family.shapes or "").split(", ")), "loc", "scale"]
    try:
        found = family(**parameters)
    except TypeError as error:
        raise ValueError(f"{law} takes {', '.join(takes)}; got {', '.join(parameters) or 'none'}") from error
    # Outside its parameters' range a distribution of scipy is one of NaNs.
    with np.errstate(all="ignore"):
        median = found.ppf(0.5)
    if not np.isfinite(median):
        shown = ", ".join(f"{name} = {value}" for name, value in parameters.items())
        raise ValueError(f"there is no {law} with {shown}")
    return found


def _read(path: Path) -> Floats:
    """Return the numbers of a file, one diameter [m] each."""
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: sizes are read from {', '.join(SUFFIXES)}; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    with refusing(path, "not a list of numbers"):
        if path.suffix.lower() == ".npy":
            values = np.asarray(array_of(path), dtype=np.float64)
        else:
            values = text.listed(path.read_bytes())
    if values.ndim != 1 or values.size == 0:
        raise FileFormatError(f"{path}: sizes are one list of one number or more; got shape {values.shape}")
    return values


def sized(
    table: SizesTable | SievesTable,
    seeds: Floats,
    domain: Domain,
    rng: np.random.Generator,
    *,
    keep: Literal["inside", "all"] | None,
    metric: Metric | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> tuple[Tessellation, Floats]:
    """Return cells of the sizes of a table about the given seeds, and the diameters [m] asked for, shape (n,).

    Parameters
    ----------
    table : SizesTable or SievesTable
        What is asked for.
    seeds : ndarray, shape (n, 3)
        Where the cells grow [m].
    domain : Domain
        What they fill.
    rng : numpy.random.Generator
        Source of randomness.
    keep : {"inside", "all"}, optional
        Which cells are to have the curve; None where it need not be exact, since only their number is wanted.
    metric : Metric, optional
        How the space is stretched that seeds and domain are in.
    progress : callable, optional
        Called with the number of the round, and how far the curve is off.
    """
    is_curve = isinstance(table, SievesTable) or table.by == "mass"
    if table.is_list or keep is None or not (is_curve or _has_walls(domain, keep)):
        wanted = table.draw(len(seeds), rng)
        tolerance = SHARPEST if isinstance(table, SievesTable) else table.tolerance
        cells = sized_cells(domain, wanted, seeds=seeds, tolerance=tolerance, relaxations=table.relaxations, rng=rng)
        return cells, wanted
    found = graded_cells(
        domain,
        table.curve(),
        seeds=seeds,
        keep=keep,
        tolerance=table.tolerance if isinstance(table, SievesTable) else TOLERANCE,
        strict=isinstance(table, SievesTable) and table.fit is None,
        relaxations=table.relaxations,
        metric=metric,
        rng=rng,
        progress=progress,
    )
    return found.cells, found.diameters


def _has_walls(domain: Domain, keep: str) -> bool:
    """Return whether cells at walls are dropped."""
    sides = domain.periodic[:2] if domain.is_planar else domain.periodic
    return keep == "inside" and bool(not sides.all() or len(domain.planes))
