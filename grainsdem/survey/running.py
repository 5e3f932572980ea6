"""A survey carried out on all cores, into one table that a later run goes on with."""

from __future__ import annotations

import hashlib
import json
import logging
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import grainsdem
from grainsdem import recipe as recipes
from grainsdem.claims import held
from grainsdem.errors import FileFormatError, GrainsDEMError, InputError
from grainsdem.gate import gated
from grainsdem.geometry.forms.sizes import grain_diameters, grain_sphericities
from grainsdem.geometry.integrals import integrate
from grainsdem.measures import summary as summarize
from grainsdem.packing.carve import unwarned
from grainsdem.recipe.views import names_told, told_of
from grainsdem.survey.rows import load, read_rows, text_of, write_rows
from grainsdem.workers import share

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence

    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.model import Packing
    from grainsdem.recipe import Recipe
    from grainsdem.survey.plan import Survey

_LOG = logging.getLogger(__name__)

MEASURES = (
    "n_seeds",
    "n_grains",
    "scale",
    "porosity",
    "void_ratio",
    "mean_diameter",
    "std_diameter",
    "d10",
    "d50",
    "d90",
    "mean_sphericity",
    "std_sphericity",
    "mean_neighbors",
    "std_volume",
)
"""Columns of a survey's table after its parameters: SI units, in a planar bed of circles and outlines; ``scale`` is F,
not a number where faces were moved by a gap; ``std_volume`` is relative to the mean volume."""

OF_THROATS = tuple(
    f"throats_{when}_{what}"
    for when in ("before", "after")
    for what in ("mean", "std", "min", "d10", "d50", "d90", "max")
)
"""Columns of where grains were moved within their cells: the widths [m] of throats."""

PAUSE = 2.0
"""Seconds between two writings of the table: what an interrupted survey may lose."""


@gated
def run(
    survey: Survey,
    path: str | os.PathLike[str],
    *,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> NDArray[np.void]:
    """Grow every bed of a survey that the table does not hold yet, and return the table.

    Parameters
    ----------
    survey : Survey
        What to grow.
    path : str or path-like
        The table (.csv). Rows that it holds already are kept, so that an interrupted survey goes on, and one that
        was extended does only what is new.
    workers : int, optional
        Number of processes; by default one for each processor.
    progress : callable, optional
        Called with the number of beds done and of all.

    Returns
    -------
    structured ndarray, shape (n,)
        One row a bed in the order of the survey: ``version``, ``repeat``, ``rng``, ``recipe``, a mark of all that the
        bed was grown from, the varied keys with ``_`` for the dot, `MEASURES`, `OF_THROATS` where grains are moved,
        what the recipe's section and planform tell (``section_d50`` and so on), and ``error``, empty where the bed
        could be grown.

    Raises
    ------
    InputError
        If a key is unknown, a value out of range, beds would be copies of one (`Survey.jobs`), or the file holds rows
        of another survey or version.
    WriteError
        If the table cannot be written, or another survey that lives is writing it.
    """
    path = Path(path)
    if path.suffix.lower() != ".csv":
        raise FileFormatError(f"{path}: a survey's table is written as .csv; got {path.suffix or 'no suffix'!r}")
    jobs = list(survey.jobs())
    with held(path):
        return _run(survey, jobs, path, workers, progress)


def _run(
    survey: Survey,
    jobs: Sequence[tuple[dict[str, Any], int, Recipe]],
    path: Path,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> NDArray[np.void]:
    """Grow the beds that a table lacks, and return it."""
    varied = [key for key in survey.vary if key != "rng"]
    measures = [*MEASURES, *_more_measures([recipe for _, _, recipe in jobs])]
    header = ["version", "repeat", "rng", "recipe", *map(_column, varied), *measures, "error"]
    marks = [_mark(recipe) for _, _, recipe in jobs]
    known = _kept(path, header, set(marks))
    rows = [known.get(mark) for mark in marks]
    missing = [k for k, row in enumerate(rows) if row is None]
    done, written = len(jobs) - len(missing), time.monotonic()
    if progress is not None:
        progress(done, len(jobs))
    try:
        for number, measured in share(measure, [jobs[k][2] for k in missing], workers=workers):
            case, repeat, recipe = jobs[missing[number]]
            first = [grainsdem.__version__, str(repeat), str(recipe.rng), marks[missing[number]]]
            first += [text_of(case[key]) for key in varied]
            values = (measured.get(name) for name in measures)
            rows[missing[number]] = [
                *first,
                *(text_of(float("nan") if value is None else value) for value in values),
                measured["error"],
            ]
            done += 1
            if progress is not None:
                progress(done, len(jobs))
            if time.monotonic() - written > PAUSE:
                write_rows(path, header, rows)
                written = time.monotonic()
    finally:
        if any(row is not None for row in rows):
            write_rows(path, header, rows)
    _tell_of_lost_sizes([recipe for _, _, recipe in jobs], header, rows)
    return load(path)


def _tell_of_lost_sizes(jobs: list[Recipe], header: list[str], rows: list[list[str] | None]) -> None:
    """Log in how many beds cells of prescribed sizes were dropped at walls."""
    grains, seeds = header.index("n_grains"), header.index("n_seeds")
    listed = [recipe.grains.sizes is not None and recipe.grains.sizes.is_list for recipe in jobs]
    sized = [row for has, row in zip(listed, rows, strict=True) if has and row is not None]
    lost = sum(not row[-1] and int(row[grains]) < int(row[seeds]) for row in sized)
    if lost:
        _LOG.warning(
            "in %d of %d beds cells of prescribed sizes touch a wall and are dropped (n_grains < n_seeds), large ones "
            "more often than small ones: keep = 'all', or a periodic domain, keeps every one; in a larger domain with "
            "more grains fewer of them touch a wall",
            lost, len(rows),
        )  # fmt: skip


def measure(recipe: Recipe) -> dict[str, Any]:
    """Return what is measured of the bed that a recipe grows, and the error that kept it from growing, or nothing."""
    try:
        with unwarned():  # one warning for all beds is enough
            bed = recipes.grow(recipe)
        return {**_measures(bed), **_widths(bed), **told_of(recipe.views(), bed), "error": ""}
    except GrainsDEMError as error:
        return {"error": " ".join(str(error).split())}


def _more_measures(jobs: Sequence[Recipe]) -> list[str]:
    """Return the columns besides `MEASURES`: of throats where any recipe moves grains, and of views that any has."""
    views = {name: table for recipe in jobs for name, table in recipe.views().items() if table is not None}
    throats = OF_THROATS if any(recipe.grains.throats is not None for recipe in jobs) else ()
    return [*throats, *names_told(views)]


def _widths(bed: Packing) -> dict[str, float]:
    """Return `OF_THROATS`, or nothing where no grain was moved."""
    told = recipes.throat_widths_told(bed).get("throats", {})
    return {f"throats_{when}_{what}": value for when, values in told.items() for what, value in values.items()}


def _measures(bed: Packing) -> dict[str, Any]:
    summary = summarize(bed)
    measured = integrate(bed.grains)
    size, volume = grain_diameters(bed, measured), measured.volumes
    scale, n_seeds = 1.0, len(bed)
    for step in map(json.loads, bed.provenance):
        if step["step"] == "carve":
            n_seeds = step["n_cells"]
        if step["step"] == "shrink":
            scale *= step.get("scale", float("nan"))
    found = {
        **summary,
        "n_seeds": n_seeds,
        "scale": scale,
        "void_ratio": summary["porosity"] / (1 - summary["porosity"]),
        "std_diameter": float(size.std()),
        "std_sphericity": float(grain_sphericities(bed, measured).std()),
        "std_volume": float(volume.std() / volume.mean()),
    }
    return {name: found[name] for name in MEASURES}


def _kept(path: Path, header: list[str], wanted: set[str]) -> dict[str, list[str]]:
    """Return the rows that a table holds, by their ``recipe``; those of beds that failed are tried again."""
    if not path.exists():
        return {}
    found, rows = read_rows(path)
    whole = [row for row in rows if len(row) == len(header)]
    foreign = [row for row in whole if row[0] != grainsdem.__version__ or row[3] not in wanted]
    if found != header or foreign:
        what = f"{len(foreign)} rows of other cases or another version" if foreign else "something else"
        raise InputError(f"{path}: holds {what} than this survey's; give another name or remove it")
    return {row[3]: row for row in whole if not row[-1]}


def _mark(recipe: Recipe) -> str:
    """Return a word that stands for all that a bed is grown from, its rng included."""
    text = json.dumps(recipe.model_dump(mode="json", exclude={"name", "images", "output"}), sort_keys=True)
    return (
        f"r{hashlib.sha256(text.encode()).hexdigest()[:12]}"  # a letter first, so that no reader takes it for a number
    )


def _column(key: str) -> str:
    return key.replace(".", "_")
