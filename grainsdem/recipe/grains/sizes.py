"""``[grains.sizes]``: a grain-size distribution that is asked for and had."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

import numpy as np
from pydantic import Field, model_validator

from grainsdem.errors import FileFormatError, InputError, MissingFileError
from grainsdem.geometry.integrals import volumes
from grainsdem.points import text
from grainsdem.recipe.base import Positive, Table
from grainsdem.tessellation import sized_cells

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import Domain, Packing, Tessellation

    Floats = NDArray[np.float64]

SUFFIXES = (".txt", ".csv", ".npy")


class SizesTable(Table):
    """``[grains.sizes]``: the diameters [m] of the grains, by a law or one by one; cells are made to fit them.

    Only their ratios count where ``[grains]`` has a mean or median diameter of its own. Diameters are those of spheres
    of equal volume, or in a slab of circles of equal area. Cells that touch a wall are dropped, and their sizes with
    them, unless ``keep`` is ``"all"``: a warning tells what that does to the curve.

    Parameters
    ----------
    law : str
        Name of a continuous distribution of `scipy.stats`, such as ``"lognorm"``. Grains take its quantiles at equal
        steps of probability, in random order.
    parameters : table of numbers
        Its parameters by their names there, such as ``{s = 0.3, scale = 1e-3}``.
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
            return self
        _frozen(self.law, self.parameters)
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
            quantiles = _frozen(self.law, self.parameters).ppf((np.arange(n) + 0.5) / n)
            return np.asarray(rng.permutation(quantiles), dtype=np.float64)
        values = self.listed()
        if len(values) != n:
            raise InputError(f"there must be one diameter for each of the {n} seeds; got {len(values)}")
        return values

    def listed(self) -> Floats:
        """Return the diameters [m] of a list, shape (n,); errors as in `draw`."""
        return np.asarray(self.diameters, dtype=np.float64) if self.path is None else _read(Path(self.path))


def _frozen(law: str, parameters: dict[str, float]) -> Any:
    """Return a distribution of scipy.stats with its parameters."""
    from scipy import stats  # noqa: PLC0415  (half a second, and only for laws)

    family = getattr(stats, law, None)
    if not isinstance(family, stats.rv_continuous):
        raise ValueError(  # noqa: TRY004  (pydantic turns ValueErrors into lines)
            f"law must be a continuous distribution of scipy.stats, such as lognorm or uniform; got {law!r}"
        )
    takes = [*filter(None, (family.shapes or "").split(", ")), "loc", "scale"]
    try:
        found = family(**parameters)
    except TypeError as error:
        raise ValueError(f"{law} takes {', '.join(takes)}; got {', '.join(parameters) or 'none'}") from error
    # Outside its parameters' range a distribution of scipy is one of NaNs.
    if not np.isfinite(found.ppf(0.5)):
        shown = ", ".join(f"{name} = {value}" for name, value in parameters.items())
        raise ValueError(f"there is no {law} with {shown}")
    return found


def _read(path: Path) -> Floats:
    """Return the numbers of a file, one diameter [m] each."""
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(f"{path}: sizes are read from {', '.join(SUFFIXES)}; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    try:
        if path.suffix.lower() == ".npy":
            values = np.asarray(np.load(path, allow_pickle=False), dtype=np.float64)
        else:
            values = text.listed(path.read_bytes())
    except (OSError, ValueError, EOFError) as error:
        raise FileFormatError(f"{path}: not a list of numbers: {error}") from error
    if values.ndim != 1 or values.size == 0:
        raise FileFormatError(f"{path}: sizes are one list of one number or more; got shape {values.shape}")
    return values


def sized(table: SizesTable, seeds: Floats, domain: Domain, rng: np.random.Generator) -> tuple[Tessellation, Floats]:
    """Return cells of the sizes of a table about the given seeds, and the diameters [m] asked for, shape (n,)."""
    wanted = table.draw(len(seeds), rng)
    cells = sized_cells(domain, wanted, seeds=seeds, tolerance=table.tolerance, relaxations=table.relaxations, rng=rng)
    return cells, wanted


def ratio_to(wanted: Floats, packing: Packing) -> float:
    """Return how many times larger grains are than asked for: the same for all, as their cells fill the domain.

    Parameters
    ----------
    wanted : ndarray, shape (n_cells,)
        Diameters [m] of all cells' grains, those included that were dropped.
    packing : Packing
        The grains, scaled in their cells.

    Notes
    -----
    Cells of the total volume V have V d_i³ / Σ d³ each, and grains the same share of their cells.
    """
    if packing.links is None:
        raise InputError("the grains have left the cells that were sized")
    share = volumes(packing.grains).sum() / packing.links.cell_volumes.sum()
    domain = packing.domain
    if domain.is_planar:
        return float(np.sqrt(4 / np.pi * share * domain.volume / domain.lengths[2] / (wanted**2).sum()))
    return float(np.cbrt(6 / np.pi * share * domain.volume / (wanted**3).sum()))
