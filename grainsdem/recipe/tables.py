"""The tables of a recipe: typed models that refuse unknown keys, and say what is allowed."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self, TypeVar, get_args

from pydantic import BaseModel, Field, ValidationError, create_model, model_serializer, model_validator

import exporters
from grainsdem.errors import FileFormatError, InputError, MissingFileError, name_offenders
from grainsdem.foreign import refusing, toml
from grainsdem.gate import gated
from grainsdem.options import explained
from grainsdem.recipe.base import Table
from grainsdem.recipe.domain import DomainTable
from grainsdem.recipe.experiments.tables import experiment_tables
from grainsdem.recipe.grains import GrainsTable, LayerTable
from grainsdem.recipe.motion import SettleTable
from grainsdem.recipe.seeds import SeedsTable
from grainsdem.recipe.views.images import ImagesTable
from grainsdem.recipe.views.tables import PlanformTable, SectionTable, VoxelsTable

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator, Sequence

    from pydantic import SerializerFunctionWrapHandler

    from grainsdem.recipe.experiments.tables import ExperimentTable
    from grainsdem.recipe.views.tables import ViewTable

VIEWS = "voxels", "section", "planform"
"""The tables of what looks into a bed."""

RENAMED = {"shear": "a ring is [ring_shear], a box of two halves [direct_shear]"}
"""Tables of earlier versions, and what took their place."""

EXAMPLE = Path(__file__).parent.parent / "angular_sand.toml"
"""The demo's recipe: an angular quartz sand of ASTM 20/30 grading."""


_Sized = TypeVar("_Sized", GrainsTable, LayerTable)


class OutputTable(Table):
    """``[output]``: what is written.

    Parameters
    ----------
    formats : list of str
        Suffixes of formats (`exporters.known`), without the dot.
    figures : bool
        Whether renders and plots are made.
    replays : list of str
        What the motions of settling and of experiments are written as: ``gif``, ``webp`` or, where ffmpeg is found,
        ``mp4`` for an animation, ``usdc`` or ``usda`` for a stage and a layer over it with time samples, ``pvd`` for
        ParaView.
    forces : list of str
        What the contact forces at the end of each experiment are written as: ``csv``, ``parquet``, ``graphml``, ``vtp``
        for ParaView, or ``png`` for a picture of the force chains.
    options : dict, optional
        Options of the formats; each gets those that it has.
    """

    formats: tuple[str, ...] = ("xml", "usda", "stl")
    figures: bool = True
    replays: tuple[Literal["gif", "webp", "mp4", "usdc", "usda", "pvd"], ...] = ()
    forces: tuple[Literal["csv", "parquet", "graphml", "vtp", "png"], ...] = ()
    options: dict[str, Any] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _known_formats(self) -> Self:
        known = [word.removeprefix(".") for word in exporters.known() if word.startswith(".")]
        unknown = [name for name in self.formats if name.removeprefix(".") not in known]
        if unknown:
            raise ValueError(f"formats must be among {', '.join(known)}; got {name_offenders(unknown)}")
        if self.options:
            exporters.options_for(self.formats, self.options)
        return self


class Recipe(Table):
    """A bed from seeds to rest.

    Parameters
    ----------
    name : str
        What the bed is called.
    rng : int
        Seed of everything that is random; refused, unless it is 0, where nothing is.
    domain, seeds, grains, settle, output : tables
        See each.
    voxels, section, planform : tables, optional
        What looks into the same bed.
    images : table, optional
        What a set of photographs of such beds is drawn from (`grainsdem.images`); it does not change the bed.

    Notes
    -----
    Besides, each experiment has a table of its name (`experiment_tables`): it is done on what has settled, or on what
    was grown where nothing settles.
    """

    name: str = "bed"
    rng: Annotated[int, Field(ge=0)] = 0
    domain: DomainTable = DomainTable()
    seeds: SeedsTable
    grains: GrainsTable
    settle: SettleTable | None = None
    voxels: VoxelsTable | None = None
    section: SectionTable | None = None
    planform: PlanformTable | None = None
    images: ImagesTable | None = None
    output: OutputTable = OutputTable()

    @model_serializer(mode="wrap")
    def _without_what_is_not_done(self, dump: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out what the recipe does not ask of a bed: what it is made of is told, and hashed, without."""
        told: dict[str, Any] = dump(self)
        undone = {*experiment_tables(), *VIEWS, "images"}
        if self.grains.shapes is not None:
            del told["seeds"]
        return {key: value for key, value in told.items() if value is not None or key not in undone}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle without the class, which is made where it is asked for: its tables are those of all experiments."""
        return _again, (dict(self), self.model_fields_set)

    def experiments(self) -> dict[str, ExperimentTable | None]:
        """Return the tables of experiments by their names, in the order in which they are run."""
        return {name: getattr(self, name, None) for name in experiment_tables()}

    def views(self) -> dict[str, ViewTable | None]:
        """Return the tables of voxels, sections and planforms by their names."""
        return {name: getattr(self, name) for name in VIEWS}

    @model_validator(mode="before")
    @classmethod
    def _seeds_or_shapes(cls, tables: Any) -> Any:
        """Grains of shapes grow from no seeds, all others do."""
        grains = tables.get("grains") if isinstance(tables, dict) else None
        if not isinstance(grains, dict) or grains.get("shapes") is None:
            return tables
        if "seeds" in tables:
            raise ValueError("grains of shapes grow from no seeds: leave out seeds, or grains.shapes")
        return {**tables, "seeds": {}}

    @model_validator(mode="after")
    def _two_of_three(self) -> Self:
        """Of the domain in metres, the number of seeds and the grains' size, any two give the third."""
        if self.grains.shapes is not None:
            if self.domain.periodic and not self.domain.is_measured:
                raise ValueError("axes wrap around at the domain's lengths: give its lengths or side")
            return self
        sizes, count = self.grains.prescribed, self.seeds.count
        has_count = count is not None or not self.seeds.wants_count or (sizes is not None and sizes.is_list)
        if self.domain.side is not None and has_count and self.grains.has_size:
            raise ValueError(
                "give two of the domain's side, the number of seeds and the grains' size, and the third follows; got "
                "all three (with lengths instead of side, only their proportions count)"
            )
        if has_count:
            if self.grains.has_size and not isinstance(self.grains.region, str):
                raise ValueError(
                    "a region's corners are in metres, and this bed is scaled to its grains' size: give the "
                    "domain's lengths and no count, or no size, or another region"
                )
            return self
        if not self.grains.has_size:
            raise ValueError(
                f"process {self.seeds.process!r} needs seeds.count, or a size of grains that it follows from"
            )
        if not self.domain.is_measured:
            raise ValueError(
                "the number of seeds follows from the grains' size and the domain's: give the domain's side or "
                "lengths in metres, or seeds.count"
            )
        return self

    @model_validator(mode="after")
    def _layers_have_their_own_seeds(self) -> Self:
        if self.grains.layer and (self.seeds.process != "poisson" or self.seeds.relax):
            given = f"relax = {self.seeds.relax}" if self.seeds.relax else f"process {self.seeds.process!r}"
            raise ValueError(
                "each layer has seeds of its own, as many as its grains: process 'poisson', and relaxations in the "
                f"layers' sizes or sieves; got {given}"
            )
        return self

    @model_validator(mode="after")
    def _sizes_are_said_once(self) -> Self:
        if self.seeds.grade is not None and (self.grains.prescribed is not None or self.grains.shapes is not None):
            raise ValueError("seeds.grade lets sizes follow from place: leave out sizes, sieves, layers and shapes")
        return self

    @model_validator(mode="after")
    def _rng_has_a_use(self) -> Self:
        """Refuse an rng that would change nothing: beds that differ by it alone would be copies of one."""
        later = (self.settle, self.planform, self.images, *self.experiments().values())
        if self.rng and not self.has_chance and all(table is None for table in later):
            raise ValueError(f"rng = {self.rng} changes nothing: {self.told_of_copies()}, or leave out rng")
        return self

    @property
    def has_chance(self) -> bool:
        """Whether the bed as grown differs from one rng to another."""
        sizes, throats = self.grains.prescribed, self.grains.throats
        is_moved = throats is not None and throats.fraction > 0 and throats.strength > 0
        if self.grains.shapes is not None:
            return True
        return self.seeds.has_chance or is_moved or (sizes is not None and not sizes.is_list)

    def told_of_copies(self) -> str:
        """Return why a bed without chance is the same at every rng, and how to let it differ."""
        seeds = "Halton's sequence is" if self.seeds.process == "halton" else "points of a file are"
        shift = "scramble = 'shift' (--seed-parameter scramble=shift) shifts it; or give"
        cure = f": {shift}" if self.seeds.process == "halton" else "; give"
        return f"{seeds} the same at every rng{cure} another process"

    @property
    def is_count_open(self) -> bool:
        """Whether the number of seeds follows from the grains' size and the domain's."""
        sizes = self.grains.prescribed
        if self.grains.shapes is not None:
            return False
        return self.seeds.wants_count and self.seeds.count is None and not (sizes is not None and sizes.is_list)

    @property
    def is_metric(self) -> bool:
        """Whether the domain's lengths are metres; else the bed is scaled to the size of its grains."""
        return self.is_count_open or not self.grains.has_size or self.grains.shapes is not None


@lru_cache(maxsize=1)
def recipe_model() -> type[Recipe]:
    """Return the model of a recipe with a table for each experiment, those of other packages among them."""
    tables: dict[str, Any] = {name: (table | None, None) for name, table in experiment_tables().items()}
    return create_model("Recipe", __base__=Recipe, __doc__=Recipe.__doc__, **tables)


def _again(values: dict[str, Any], given: set[str]) -> Recipe:
    """Return a recipe from what its pickle holds."""
    return recipe_model().model_construct(given, **values)


@gated
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
    with refusing(path, "not TOML"):
        recipe = parse(path.read_text(encoding="utf-8-sig"))
    recipe = recipe.model_copy(update={"seeds": recipe.seeds.beside(path.parent)})
    tables = {name: table.beside(path.parent) for name, table in recipe.experiments().items() if table is not None}
    recipe = recipe.model_copy(update=tables)
    recipe = recipe.model_copy(update={"grains": _found_beside(recipe.grains, path.parent)})
    layers = tuple(_found_beside(layer, path.parent) for layer in recipe.grains.layer)
    recipe = recipe.model_copy(update={"grains": recipe.grains.model_copy(update={"layer": layers})})
    if recipe.grains.shapes is not None:
        shapes = recipe.grains.shapes.beside(path.parent)
        recipe = recipe.model_copy(update={"grains": recipe.grains.model_copy(update={"shapes": shapes})})
    return recipe


def _found_beside(table: _Sized, folder: Path) -> _Sized:
    """Return a table whose files of sizes are those in a folder."""
    for name in ("sizes", "sieves", "top"):
        sizes = getattr(table, name, None)
        if sizes is not None and sizes.path is not None:
            table = table.model_copy(update={name: sizes.model_copy(update={"path": str(folder / sizes.path)})})
    return table


@gated
def parse(text: str) -> Recipe:
    """Return the recipe that a TOML text holds; errors as in `read`."""
    tables = toml(text)
    try:
        return make(**tables)
    except InputError as error:
        raise FileFormatError(str(error)) from error


@gated
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
    for name, cure in RENAMED.items():
        if name in tables:
            raise InputError(f"{name}: no such table; {cure}")
    try:
        return recipe_model().model_validate(tables)
    except ValidationError as error:
        raise InputError(explained(error, _table_at)) from error


def _table_at(path: Sequence[Any]) -> type[BaseModel]:
    """Return the model that keys lead to, such as ``("grains", "throats")``."""
    found: type[BaseModel] = recipe_model()
    for key in path:
        field = found.model_fields.get(str(key))
        found = next(_models(None if field is None else field.annotation), found)
    return found


def _models(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the models that a type is made of, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _models(part)
