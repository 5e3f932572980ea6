"""The chain that a recipe describes: grow, validate, write, settle, validate, write."""

from __future__ import annotations

import json
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import exporters
from grainsdem import figures, storage
from grainsdem.atomic import replacing, working_in
from grainsdem.dynamics import Settled, settle
from grainsdem.errors import RefusedError, UnstableError
from grainsdem.gate import gated
from grainsdem.measures import summary
from grainsdem.packing import contacts
from grainsdem.recipe.experiments import perform_all, write_replays
from grainsdem.recipe.growing import grow, stream
from grainsdem.recipe.motion import SettleTable
from grainsdem.recipe.views import look_all
from grainsdem.recipe.words import Monitor, Silent, counting_words, noting, settling_words, throat_widths_told
from grainsdem.validation import validate

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator
    from pathlib import Path

    from grainsdem.model import ContactGraph, Packing, Report
    from grainsdem.recipe.tables import OutputTable, Recipe


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
        Measures of both, and of each experiment and view by its name; of the bed also ``throats``, the widths [m]
        before and after they were changed, if they were.
    files : list of Path
        Everything that was written.
    """

    fresh: Packing
    settled: Settled | None
    reports: dict[str, Report]
    summaries: dict[str, dict[str, Any]]
    files: list[Path]


@gated
def run(recipe: Recipe, folder: str | os.PathLike[str], monitor: Monitor | None = None) -> Result:
    """Make the bed, validate it, write it, settle it, and do the same with what has settled.

    Parameters
    ----------
    recipe : Recipe
        What to make.
    folder : str or path-like
        Where files go; made if it is not there. Files of the same names are replaced, or removed where a format
        refuses the bed.
    monitor : Monitor, optional
        Who is told of the progress.

    Raises
    ------
    ValidationError
        If a bed fails validation; it is not written, and neither is what would follow.
    RefusedError
        If a format, or a replay, could not take a bed. All else is done and written first: the error has the result.
    WriteError
        If the folder cannot be made or written, or another run that lives is writing it.
    """
    with working_in(folder) as place:
        return _run(recipe, place, monitor or Silent())


def _run(recipe: Recipe, folder: Path, monitor: Monitor) -> Result:
    """Do what `run` says in a folder that is there."""
    fresh = grow(recipe, monitor)
    files, reports, summaries = [], {}, {}
    refused: dict[str, str] = {}
    reports["bed"] = _validated(fresh, 1e-9, monitor)
    graph = contacts(fresh)
    summaries["bed"] = {**summary(fresh, graph), **throat_widths_told(fresh)}
    files += _write(fresh, graph, folder / "bed", recipe.output, monitor, refused=refused)
    settled = None
    if recipe.settle is not None:
        settled = _settle(fresh, recipe, folder, monitor)
        files.append(folder / "history.h5")
        reports["settled"] = _validated(settled.packing, recipe.settle.overlap, monitor)
        summaries["settled"] = {**summary(settled.packing, settled.contacts), **settled.report.to_dict()}
        files += _write(settled.packing, settled.contacts, folder / "settled", recipe.output, monitor, refused=refused)
        if recipe.output.figures:
            files.append(figures.energy_plot(settled.history, folder / "settling.png"))
        stem = folder / "settling"
        files += write_replays(
            settled.packing, folder / "history.h5", stem, recipe.output.replays, monitor, refused=refused
        )
    bed = fresh if settled is None else settled.packing
    written, measured = perform_all(
        recipe.experiments(),
        bed,
        folder,
        monitor,
        rng=recipe.rng,
        with_figures=recipe.output.figures,
        replays=recipe.output.replays,
        forces=recipe.output.forces,
        refused=refused,
    )
    files += written
    summaries |= measured
    written, measured = look_all(
        recipe.views(), bed, folder, monitor, rng=recipe.rng, with_figures=recipe.output.figures
    )
    files += written
    summaries |= measured
    with replacing(folder / "summary.json") as temporary:
        temporary.write_text(json.dumps(summaries, indent=2) + "\n", encoding="utf-8")
    result = Result(fresh, settled, reports, summaries, [*files, folder / "summary.json"])
    if refused:
        raise RefusedError(refused, result)
    return result


def _validated(packing: Packing, overlap: float, monitor: Monitor) -> Report:
    with monitor.stage("Validating") as tell:
        report = validate(packing, overlap=overlap, progress=counting_words(tell, "pairs"))
    return report.raise_if_failed()


def _write(
    packing: Packing,
    graph: ContactGraph,
    stem: Path,
    output: OutputTable,
    monitor: Monitor,
    *,
    refused: dict[str, str],
) -> list[Path]:
    """Write and draw a bed; formats that cannot take it are noted with their reasons."""
    folder, name = stem.parent, stem.name
    with monitor.stage(f"Writing {name}") as tell:
        files = [storage.save(packing, folder / f"{name}.h5")]
        options = exporters.options_for(output.formats, output.options)
        for k, suffix in enumerate(output.formats):
            tell(k / len(output.formats), suffix)
            path = folder / f"{name}.{suffix.removeprefix('.')}"
            with noting(refused, path.name):
                files += exporters.write(packing, path, **options[k])
            if path.name in refused:
                path.unlink(missing_ok=True)  # one of an earlier run would pass for this bed's
    if output.figures:
        with monitor.stage(f"Drawing {name}"):
            files.append(figures.render(packing, folder / f"{name}.png"))
            files.append(figures.size_histogram(packing, folder / f"{name}_sizes.png"))
            if len(graph):
                files.append(figures.coordination_histogram(graph, folder / f"{name}_coordination.png"))
    return files


def _settle(fresh: Packing, recipe: Recipe, folder: Path, monitor: Monitor) -> Settled:
    with monitor.stage("Settling") as tell, keeping_last_good(folder / "settled.h5"):
        return come_to_rest(fresh, recipe, history_path=folder / "history.h5", progress=settling_words(tell))


@gated
def come_to_rest(fresh: Packing, recipe: Recipe, **run: Any) -> Settled:
    """Return what becomes of a bed as grown as a recipe's table of settling says; errors as of `settle`.

    Parameters
    ----------
    fresh : Packing
        The bed as grown.
    recipe : Recipe
        Whose table, or the table's defaults, and whose rng are used.
    **run
        Of `settle`: ``history_path``, ``progress``.
    """
    table = recipe.settle or SettleTable()
    return settle(fresh, **table.model_dump(exclude={"overlap"}), rng=stream(recipe, 1), **run)


@gated
@contextmanager
def keeping_last_good(path: Path) -> Iterator[None]:
    """Save the last good state of a run that went wrong beside ``path``, and say so in its error."""
    try:
        yield
    except UnstableError as error:
        kept = storage.save(error.last_good, path.with_name(f"{path.stem}_last_good.h5"))
        raise UnstableError(f"{error}; it is kept in {kept}", error.last_good) from error
