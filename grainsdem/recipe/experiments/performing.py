"""Experiments run as their tables say, and written: packing, history, figure, and what they measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from grainsdem import dynamics, storage
from grainsdem.errors import UnstableError
from grainsdem.figures.curves import curve_figure
from grainsdem.figures.motion import replay
from grainsdem.figures.networks import force_figure
from grainsdem.measures.graph.edges import check_edges
from grainsdem.recipe.words import noting

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Mapping, Sequence

    from grainsdem.dynamics import Ensemble, Outcome
    from grainsdem.dynamics.mechanics import Snapshot
    from grainsdem.model import Packing
    from grainsdem.recipe.experiments.tables import ExperimentTable
    from grainsdem.recipe.words import Monitor


def perform(
    table: ExperimentTable,
    packing: Packing,
    *,
    rng: int,
    history_path: Path | None = None,
    resume: bool = False,
    progress: Callable[[float, str], None] | None = None,
) -> Outcome[Any]:
    """Run the one experiment that a table describes.

    Parameters
    ----------
    table : ExperimentTable
        Which, and how.
    packing : Packing
        The grains.
    rng : int
        Seed, where grains start at random.
    history_path, resume, progress
        As for `grainsdem.dynamics.triaxial`.
    """
    seed = rng if table.start == "random" else None
    return table.experiment.function(
        packing,
        **table.options(),
        rng=seed,
        history_path=history_path,
        resume=resume,
        max_hours=table.max_hours,
        progress=progress,
    )


def perform_all(
    tables: Mapping[str, ExperimentTable | None],
    packing: Packing,
    folder: Path,
    monitor: Monitor,
    *,
    rng: int,
    with_figures: bool,
    refused: dict[str, str],
    replays: Sequence[str] = (),
    forces: Sequence[str] = (),
) -> tuple[list[Path], dict[str, dict[str, Any]]]:
    """Run the experiments of a recipe, each on the same grains, and write them.

    Parameters
    ----------
    tables : mapping of str to ExperimentTable or None
        Those that the recipe has, by name.
    packing : Packing
        The grains, as grown or as settled.
    folder : pathlib.Path
        Where files go: of each experiment ``NAME.h5``, ``NAME_history.h5`` and ``NAME.png``; of an ensemble a folder
        ``NAME`` of histories.
    monitor : Monitor
        Who is told of the progress.
    rng : int
        Seed; an ensemble has it and those that follow.
    with_figures : bool
        Whether curves are drawn.
    refused : dict of str to str
        Where replays that cannot be written are noted, with their reasons.
    replays : sequence of str
        What motions are written as; see `write_replays`.
    forces : sequence of str
        What the contact forces at the end are written as, to ``NAME_forces``: suffixes without the dot.

    Returns
    -------
    files : list of pathlib.Path
        What was written.
    summaries : dict of str to dict
        What each measured, as JSON values.
    """
    files: list[Path] = []
    summaries: dict[str, dict[str, Any]] = {}
    for name, table in tables.items():
        if table is None:
            continue
        with monitor.stage(name.capitalize()) as tell:
            if table.seeds > 1:
                runs = _repeat(table, packing, folder / name, tell, rng=rng)
                files += [folder / name / f"{seed}.h5" for seed in runs.seeds]
                summaries[name] = runs.to_dict()
                continue
            path = folder / f"{name}_history.h5"
            outcome = _keeping(table, packing, folder / f"{name}.h5", rng=rng, history_path=path, progress=tell)
        files += [storage.save(outcome.packing, folder / f"{name}.h5"), path]
        summaries[name] = outcome.report.to_dict()
        if with_figures and outcome.panels:
            files.append(curve_figure(outcome.panels, folder / f"{name}.png"))
        for suffix in forces:
            path_of_forces = folder / f"{name}_forces.{suffix}"
            with noting(refused, path_of_forces.name):
                files.append(draw_or_write_forces(outcome.snapshot, path_of_forces))
        files += write_replays(outcome.packing, path, folder / f"{name}_replay", replays, monitor, refused=refused)
    return files, summaries


def check_forces(path: str | os.PathLike[str]) -> None:
    """Raise `FileFormatError` unless contact forces can be written to a path, by its suffix."""
    if Path(path).suffix.lower() != ".png":
        check_edges(path)


def draw_or_write_forces(now: Snapshot, path: str | os.PathLike[str]) -> Path:
    """Write the contacts of an instant with their forces, or draw them, by the path's suffix."""
    if Path(path).suffix.lower() != ".png":
        return dynamics.mechanics.write_forces(now, path)
    return force_figure(now.packing, *dynamics.mechanics.contact_forces(now), path)


def write_replays(
    packing: Packing, history: Path, stem: Path, suffixes: Sequence[str], monitor: Monitor, *, refused: dict[str, str]
) -> list[Path]:
    """Write the motion that a history holds, and return the files.

    Parameters
    ----------
    packing : Packing
        The grains that were moved, as they were at the end.
    history : pathlib.Path
        The run's history.
    stem : pathlib.Path
        Where files go, without their suffix.
    suffixes : sequence of str
        ``gif``, ``webp`` or ``mp4``: an animation. ``usdc`` or ``usda``: a stage, and a layer over it with time
        samples. ``pvd``: a time series for ParaView.
    monitor : Monitor
        Who is told of the progress.
    refused : dict of str to str
        Where files that cannot be made of this bed are noted, with their reasons.
    """
    files: list[Path] = []
    for suffix in suffixes:
        path = stem.with_name(f"{stem.name}.{suffix}")
        with monitor.stage(f"Replay {suffix}"), noting(refused, path.name):
            files += replay(history, packing, path)
    return files


def _repeat(
    table: ExperimentTable, packing: Packing, folder: Path, tell: Callable[[float, str], None], *, rng: int
) -> Ensemble:
    """Run an experiment with several seeds."""
    return dynamics.ensemble(
        table.experiment.function,
        packing,
        seeds=range(rng, rng + table.seeds),
        history_folder=folder,
        progress=lambda done, total: tell(done / total, f"{done} of {total} runs"),
        max_hours=table.max_hours,
        **table.options(),
    )


def _keeping(table: ExperimentTable, packing: Packing, path: Path, **options: Any) -> Outcome[Any]:
    """Run an experiment; where it goes wrong its last good state is kept."""
    try:
        return perform(table, packing, **options)
    except UnstableError as error:
        kept = storage.save(error.last_good, path.with_name(f"{path.stem}_last_good.h5"))
        raise UnstableError(f"{error}; it is kept in {kept}", error.last_good) from error
