"""The tables of experiments: each has the options of its function, and what a recipe adds to any of them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import ConfigDict, Field, create_model, model_validator

from grainsdem.dynamics.ensembles import MOST_SEEDS
from grainsdem.dynamics.experiments.registry import Experiment, known
from grainsdem.options import paths_of
from grainsdem.recipe.base import Table
from grainsdem.values import STRICT, Positive

if TYPE_CHECKING:
    from pathlib import Path


class ExperimentTable(Table):
    """What the tables of all experiments have besides the options of their functions.

    Parameters
    ----------
    start : {"random", "place"}
        Whether grains are turned at random, reordered and set apart first, or start where they are.
    seeds : int
        How many runs, each with a seed of its own: with two or more, means and 95 % intervals are the result.
    max_hours : float
        A run that would take longer by estimate is refused before its start.
    """

    model_config = ConfigDict(**STRICT)
    experiment: ClassVar[Experiment]

    start: Literal["random", "place"] = "random"
    seeds: Annotated[int, Field(ge=1, le=MOST_SEEDS)] = 1
    max_hours: Positive = 24.0

    @model_validator(mode="after")
    def _place_needs_grains_that_stay(self) -> Self:
        if self.start == "place" and self.seeds > 1:
            raise ValueError("several seeds need start = 'random': grains in place are the same for each")
        if self.start == "place" and self.experiment.needs_seed:
            raise ValueError(f"{self.experiment.name} always sets grains apart; start must be 'random'")
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the experiment's name: the class is made where it is asked for."""
        return _again, (self.experiment.name, dict(self), self.model_fields_set)

    def options(self) -> dict[str, Any]:
        """Return the options of the function."""
        return self.model_dump(exclude={"start", "seeds", "max_hours"})

    def beside(self, folder: Path) -> Self:
        """Return the table with its files found in a folder."""
        files = {name: getattr(self, name) for name in paths_of(self.experiment.options)}
        given = {name: str(folder / file) for name, file in files.items() if file is not None}
        return self.model_copy(update=given)


@lru_cache(maxsize=1)
def experiment_tables() -> dict[str, type[ExperimentTable]]:
    """Return the tables of all experiments by name, in the order in which a recipe runs them."""
    return {name: _table(found) for name, found in known().items()}


def _table(found: Experiment) -> type[ExperimentTable]:
    """Return the table of one experiment."""
    fields: dict[str, Any] = {name: (field.annotation, field) for name, field in found.options.model_fields.items()}
    table = create_model(found.name, __base__=ExperimentTable, __doc__=found.summary, **fields)
    table.experiment = found
    return table


def _again(name: str, values: dict[str, Any], given: set[str]) -> ExperimentTable:
    """Return a table from what its pickle holds."""
    return experiment_tables()[name].model_construct(given, **values)
