"""A bed described in a TOML file, read into a typed model, and the chain that makes it."""

from __future__ import annotations

import json
import math
import tomllib
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Protocol, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

import exporters
from grainsdem import figures, points, storage
from grainsdem.atomic import replacing
from grainsdem.dynamics import Progress, Settled, settle
from grainsdem.errors import FileFormatError, InputError, MissingFileError, UnstableError, WriteError, name_offenders
from grainsdem.measures import diameters, masses, percentiles, summary
from grainsdem.model import QUARTZ_DENSITY, Domain, Packing, Report
from grainsdem.packing import carve, contacts, rescale, shrink, shuffle
from grainsdem.tessellation import relax, tessellate
from grainsdem.validation import validate

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from contextlib import AbstractContextManager

    from numpy.typing import NDArray

    from grainsdem.model import ContactGraph

EXAMPLE = Path(__file__).with_name("ottawa_sand.toml")
"""The demo's recipe: ASTM 20/30 Ottawa sand."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Fraction = Annotated[float, Field(ge=0, lt=1)]
Coefficient = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Table(BaseModel):
    """A table of a recipe: unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class DomainTable(_Table):
    """``[domain]``: the box that grains grow in.

    Parameters
    ----------
    lengths : three numbers
        Edge lengths [m]; only their proportions count where ``grains.median_diameter`` is given.
    """

    lengths: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)


class SeedsTable(_Table):
    """``[seeds]``: where grains grow.

    Parameters
    ----------
    process : {"halton", "poisson", "file"}
        Point process, or a file of your own points.
    count : int
        Number of seeds.
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
        wanted, other = ("path", "count") if self.process == "file" else ("count", "path")
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise ValueError(f"process {self.process!r} needs {wanted}, and no {other}")
        return self


class GrainsTable(_Table):
    """``[grains]``: what the cells become.

    Parameters
    ----------
    keep : {"inside", "all"}
        Whether cells that touch a wall are dropped.
    porosity, scale : float
        Void fraction of the cells' region, or the linear factor that grains shrink by; one of the two.
    median_diameter : float, optional
        Median diameter by mass [m] that the whole bed is scaled to.
    density : float
        Density [kg/m³].
    """

    keep: Literal["inside", "all"] = "inside"
    porosity: Fraction | None = None
    scale: Annotated[float, Field(gt=0, le=1)] | None = None
    median_diameter: Positive | None = None
    density: Positive = QUARTZ_DENSITY

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.porosity is None) == (self.scale is None):
            raise ValueError("give either porosity or scale")
        return self


class SettleTable(_Table):
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


class OutputTable(_Table):
    """``[output]``: what is written.

    Parameters
    ----------
    formats : list of str
        Suffixes of `exporters.FORMATS`, without the dot.
    figures : bool
        Whether renders and plots are made.
    """

    formats: tuple[str, ...] = ("xml", "usda", "stl")
    figures: bool = True

    @model_validator(mode="after")
    def _known_formats(self) -> Self:
        known = [suffix.removeprefix(".") for suffix in exporters.FORMATS]
        unknown = [name for name in self.formats if name.removeprefix(".") not in known]
        if unknown:
            raise ValueError(f"formats must be among {', '.join(known)}; got {name_offenders(unknown)}")
        return self


class Recipe(_Table):
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


_TABLES: dict[str, type[_Table]] = {
    "domain": DomainTable,
    "seeds": SeedsTable,
    "grains": GrainsTable,
    "settle": SettleTable,
    "output": OutputTable,
}


class Monitor(Protocol):
    """Who is told what a chain is doing."""

    def stage(self, title: str) -> AbstractContextManager[Callable[[float, str], None]]:
        """Begin a stage; what is returned is called with the fraction done and a few words."""
        ...


class Silent:
    """A monitor that tells nobody."""

    def stage(self, title: str) -> AbstractContextManager[Callable[[float, str], None]]:  # noqa: ARG002  (the protocol's)
        """Begin a stage that nobody hears of."""
        return nullcontext(lambda _fraction, _words: None)


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """What a recipe made.

    Parameters
    ----------
    fresh : Packing
        The bed as grown.
    settled : Settled, optional
        What became of it under gravity.
    reports : dict of str to Report
        Validation of ``"bed"`` and ``"settled"``.
    summaries : dict of str to dict
        Measures of both.
    files : list of Path
        Everything that was written.
    """

    fresh: Packing
    settled: Settled | None
    reports: dict[str, Report]
    summaries: dict[str, dict[str, Any]]
    files: list[Path]


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


def grow(recipe: Recipe, monitor: Monitor | None = None) -> Packing:
    """Return the bed that a recipe's seeds and grains tables describe."""
    monitor = monitor or Silent()
    domain = Domain.box(recipe.domain.lengths)
    with monitor.stage("Placing seeds"):
        seeds = _seeds(recipe, domain)
    if recipe.seeds.relax:
        with monitor.stage("Relaxing seeds") as tell:
            total = recipe.seeds.relax
            seeds = relax(
                seeds,
                domain,
                iterations=total,
                progress=lambda done: tell(done / total, f"iteration {done} of {total}"),
            )
    with monitor.stage("Growing grains"):
        grains = recipe.grains
        packing = carve(tessellate(seeds, domain), keep=grains.keep, density=grains.density)
        packing = shrink(packing, porosity=grains.porosity, scale=grains.scale)
        if grains.median_diameter is not None:
            (median,) = percentiles(diameters(packing.grains), (50,), weights=masses(packing))
            packing = rescale(packing, grains.median_diameter / float(median))
    # The recipe comes first: it is what the other steps follow from.
    first = json.dumps({"step": "recipe", **recipe.model_dump(mode="json")}, sort_keys=True)
    return replace(packing, provenance=(first, *packing.provenance))


def run(recipe: Recipe, folder: str | os.PathLike[str], monitor: Monitor | None = None) -> Result:
    """Make the bed, validate it, write it, settle it, and do the same with what has settled.

    Parameters
    ----------
    recipe : Recipe
        What to make.
    folder : str or path-like
        Where files go; made if it is not there. Files of the same names are replaced.
    monitor : Monitor, optional
        Who is told of the progress.

    Raises
    ------
    ValidationError
        If a bed fails validation; it is not written, and neither is what would follow.
    WriteError
        If the folder cannot be made or written.
    """
    monitor = monitor or Silent()
    folder = _made(folder)
    fresh = grow(recipe, monitor)
    files, reports, summaries = [], {}, {}
    reports["bed"] = _validated(fresh, 1e-9, monitor)
    graph = contacts(fresh)
    summaries["bed"] = summary(fresh, graph)
    files += _write(fresh, graph, folder / "bed", recipe.output, monitor)
    settled = None
    if recipe.settle is not None:
        settled = _settle(fresh, recipe, folder, monitor)
        files.append(folder / "history.h5")
        reports["settled"] = _validated(settled.packing, recipe.settle.overlap, monitor)
        summaries["settled"] = {**summary(settled.packing, settled.contacts), **settled.report.to_dict()}
        files += _write(settled.packing, settled.contacts, folder / "settled", recipe.output, monitor)
        if recipe.output.figures:
            files.append(figures.energy_plot(settled.history, folder / "settling.png"))
    with replacing(folder / "summary.json") as temporary:
        temporary.write_text(json.dumps(summaries, indent=2) + "\n", encoding="utf-8")
    return Result(fresh, settled, reports, summaries, [*files, folder / "summary.json"])


def _seeds(recipe: Recipe, domain: Domain) -> NDArray[np.float64]:
    table = recipe.seeds
    if table.path is not None:
        return points.check_seeds(points.read(table.path), domain)
    count = table.count or 0
    if table.process == "poisson":
        return points.poisson(domain, count, rng=_generator(recipe, 0))
    return points.halton(domain, count, bases=table.bases, rng=_generator(recipe, 0))


def _generator(recipe: Recipe, stage: int) -> np.random.Generator:
    """Return the stage's own stream, so that one stage's draws do not move another's."""
    return np.random.default_rng([recipe.rng, stage])


def _made(folder: str | os.PathLike[str]) -> Path:
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise WriteError(f"{folder}: cannot be made a folder: {error.strerror}") from error
    return Path(folder)


def _validated(packing: Packing, overlap: float, monitor: Monitor) -> Report:
    with monitor.stage("Validating") as tell:
        report = validate(packing, overlap=overlap, progress=counting_words(tell, "pairs"))
    return report.raise_if_failed()


def _write(packing: Packing, graph: ContactGraph, stem: Path, output: OutputTable, monitor: Monitor) -> list[Path]:
    folder, name = stem.parent, stem.name
    with monitor.stage(f"Writing {name}") as tell:
        files = [storage.save(packing, folder / f"{name}.h5")]
        for k, suffix in enumerate(output.formats):
            tell(k / len(output.formats), suffix)
            files += exporters.write(packing, folder / f"{name}.{suffix.removeprefix('.')}")
    if output.figures:
        with monitor.stage(f"Drawing {name}"):
            files.append(figures.render(packing, folder / f"{name}.png"))
            files.append(figures.size_histogram(packing, folder / f"{name}_sizes.png"))
            if len(graph):
                files.append(figures.coordination_histogram(graph, folder / f"{name}_coordination.png"))
    return files


def _settle(fresh: Packing, recipe: Recipe, folder: Path, monitor: Monitor) -> Settled:
    table = recipe.settle or SettleTable()
    start = shuffle(fresh, rng=_generator(recipe, 1)) if table.shuffle else fresh
    options = table.model_dump(exclude={"shuffle", "overlap"})
    with monitor.stage("Settling") as tell, keeping_last_good(folder / "settled.h5"):
        return settle(start, **options, history_path=folder / "history.h5", progress=settling_words(tell))


@contextmanager
def keeping_last_good(path: Path) -> Iterator[None]:
    """Save the last good state of a run that went wrong beside ``path``, and say so in its error."""
    try:
        yield
    except UnstableError as error:
        kept = storage.save(error.last_good, path.with_name(f"{path.stem}_last_good.h5"))
        raise UnstableError(f"{error}; it is kept in {kept}", error.last_good) from error


def counting_words(tell: Callable[[float, str], None], things: str) -> Callable[[int, int], None]:
    """Return a callback that tells how many of how many things are done."""
    return lambda done, total: tell(done / max(total, 1), f"{done} of {total} {things}")


def settling_words(tell: Callable[[float, str], None]) -> Callable[[Progress], None]:
    """Return a callback for `settle` that tells the fraction done and what is being waited for.

    The energy falls by orders of magnitude: the fraction is how many of them are done since its peak, or the share
    of the time limit where that is more.
    """
    peak, best = 0.0, 0.0

    def hear(now: Progress) -> None:
        nonlocal peak, best
        peak = max(peak, now.energy)
        fallen = 0.0
        if peak > now.goal and now.energy > 0:
            fallen = math.log(peak / now.energy) / math.log(peak / now.goal)
        best = min(1.0, max(best, fallen, now.time / now.limit))
        tell(best, f"{now.time:.3f} s, {now.energy:.0e} → {now.goal:.0e} mgd, {now.n_contacts} contacts")

    return hear


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
