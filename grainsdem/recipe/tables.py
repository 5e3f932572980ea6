"""The tables of a recipe: typed models that refuse unknown keys, and say what is allowed."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, ValidationError, model_validator

import exporters
from grainsdem.errors import FileFormatError, InputError, MissingFileError, name_offenders
from grainsdem.recipe.base import Coefficient, Positive, Table
from grainsdem.recipe.domain import DomainTable
from grainsdem.recipe.grains import GrainsTable
from grainsdem.recipe.seeds import SeedsTable

if TYPE_CHECKING:
    import os

EXAMPLE = Path(__file__).parent.parent / "ottawa_sand.toml"
"""The demo's recipe: ASTM 20/30 Ottawa sand."""


class SettleTable(Table):
    """``[settle]``: how the grains come to rest; leave the table out for a bed that is only grown.

    Parameters
    ----------
    shuffle : bool
        Whether grains are rotated, reordered and poured; else they settle in place, into a jigsaw.
    friction : float
        Coefficient of friction among grains.
    wall_friction : float, optional
        Coefficient of friction with the walls; that of the grains by default.
    gravity : float
        Acceleration [m/s²].
    time_step : float
        Time step in units of √(d/g).
    max_time : float
        Time limit in units of √(d/g).
    overlap : float
        Largest overlap volume that the soft contacts may leave, relative to the smaller grain.
    """

    shuffle: bool = True
    friction: Coefficient = 0.5
    wall_friction: Coefficient | None = None
    gravity: Positive = 9.81
    time_step: Positive = 0.01
    max_time: Positive = 200.0
    overlap: Positive = 1e-3


class OutputTable(Table):
    """``[output]``: what is written.

    Parameters
    ----------
    formats : list of str
        Suffixes of formats (`exporters.known`), without the dot.
    figures : bool
        Whether renders and plots are made.
    """

    formats: tuple[str, ...] = ("xml", "usda", "stl")
    figures: bool = True

    @model_validator(mode="after")
    def _known_formats(self) -> Self:
        known = [word.removeprefix(".") for word in exporters.known() if word.startswith(".")]
        unknown = [name for name in self.formats if name.removeprefix(".") not in known]
        if unknown:
            raise ValueError(f"formats must be among {', '.join(known)}; got {name_offenders(unknown)}")
        return self


class Recipe(Table):
    """A bed from seeds to rest.

    Parameters
    ----------
    name : str
        What the bed is called.
    rng : int
        Seed of everything that is random.
    domain, seeds, grains, settle, output : tables
        See each.
    """

    name: str = "bed"
    rng: Annotated[int, Field(ge=0)] = 0
    domain: DomainTable = DomainTable()
    seeds: SeedsTable
    grains: GrainsTable
    settle: SettleTable | None = None
    output: OutputTable = OutputTable()


_TABLES: dict[str, type[Table]] = {
    "domain": DomainTable,
    "seeds": SeedsTable,
    "grains": GrainsTable,
    "settle": SettleTable,
    "output": OutputTable,
}


def read(path: str | os.PathLike[str]) -> Recipe:
    """Read a recipe.

    Raises
    ------
    MissingFileError
        If there is no such file.
    FileFormatError
        If it is not TOML, has unknown keys or values out of range; the message says what is allowed.
    """
    path = Path(path)
    if path.suffix.lower() != ".toml":
        raise FileFormatError(f"{path}: a recipe is a .toml file; got {path.suffix or 'no suffix'!r}")
    if not path.is_file():
        raise MissingFileError(f"{path}: no such file")
    try:
        recipe = parse(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, FileFormatError) as error:
        raise FileFormatError(f"{path}: {error}") from error
    if recipe.seeds.path is not None:
        beside = str(path.parent / recipe.seeds.path)
        recipe = recipe.model_copy(update={"seeds": recipe.seeds.model_copy(update={"path": beside})})
    return recipe


def parse(text: str) -> Recipe:
    """Return the recipe that a TOML text holds; errors as in `read`."""
    try:
        tables = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"not TOML: {error}") from error
    try:
        return make(**tables)
    except InputError as error:
        raise FileFormatError(str(error)) from error


def make(**tables: Any) -> Recipe:
    """Return the recipe of the given tables, each a dictionary.

    Raises
    ------
    InputError
        If a key is unknown or a value out of range; the message says what is allowed.

    Examples
    --------
    >>> make(seeds={"count": 500}, grains={"porosity": 0.4}).seeds.process
    'halton'
    """
    try:
        return Recipe.model_validate(tables)
    except ValidationError as error:
        raise InputError("; ".join(_explain(item) for item in error.errors())) from error


def _explain(item: Any) -> str:
    """Return one of pydantic's errors as a line that says where, what was given and what is allowed."""
    where = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        allowed = (_TABLES[str(item["loc"][0])] if len(item["loc"]) > 1 else Recipe).model_fields
        return f"{where}: unknown key; allowed are {', '.join(allowed)}"
    message = item["msg"].removeprefix("Value error, ")
    if item["type"] == "missing":
        return f"{where}: missing"
    shown = f"; got {item['input']!r}" if not isinstance(item["input"], dict) else ""
    return f"{where}: {message[0].lower()}{message[1:]}{shown}"
