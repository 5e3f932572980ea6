"""``[seeds]``: where grains grow."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal, Self

from pydantic import Field, model_validator

from grainsdem import points
from grainsdem.recipe.base import Table

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.model import Domain


class SeedsTable(Table):
    """``[seeds]``: where grains grow.

    Parameters
    ----------
    process : {"halton", "poisson", "file"}
        Point process, or a file of your own points.
    count : int
        Number of seeds; without it, and with a size of grains, it follows from the domain's.
    bases : three ints
        Bases of Halton's sequence.
    path : str
        File of seeds [m], relative to the recipe, where the process is ``"file"``.
    relax : int
        Lloyd iterations: more make grains rounder and more alike.
    """

    process: Literal["halton", "poisson", "file"] = "halton"
    count: Annotated[int, Field(ge=1)] | None = None
    bases: tuple[int, int, int] = (2, 3, 5)
    path: str | None = None
    relax: Annotated[int, Field(ge=0)] = 0

    @model_validator(mode="after")
    def _needs_its_source(self) -> Self:
        if self.process == "file" and (self.path is None or self.count is not None):
            raise ValueError("process 'file' needs path, and no count")
        if self.process != "file" and self.path is not None:
            raise ValueError(f"process {self.process!r} needs count, and no path")
        return self

    @property
    def wants_count(self) -> bool:
        """Whether the process takes a number of seeds; it is given, or follows from the grains' size."""
        return self.process != "file"


def place(table: SeedsTable, domain: Domain, rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the seeds [m], shape (n, 3), that a table describes, before relaxation."""
    if table.path is not None:
        return points.check_seeds(points.read(table.path), domain)
    count = table.count or 0
    if table.process == "poisson":
        return points.poisson(domain, count, rng=rng)
    return points.halton(domain, count, bases=table.bases, rng=rng)
