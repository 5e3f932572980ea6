"""A set of photographs of beds with one table of truth, taken on all cores, that a later run goes on with."""

from __future__ import annotations

import json
import logging
import re
import time
from typing import TYPE_CHECKING, Any

import grainsdem
from grainsdem.atomic import replacing, working_in
from grainsdem.errors import FileFormatError, InputError
from grainsdem.foreign import json_object
from grainsdem.gate import gated
from grainsdem.measures import write_table
from grainsdem.measures.planform.counting import names_of_percentiles
from grainsdem.recipe import varied
from grainsdem.recipe.base import flat
from grainsdem.recipe.views import ImagesTable
from grainsdem.survey.picturing import Picture, Sitting, columns, files_of, seed_of, take
from grainsdem.survey.plan import MOST_BEDS
from grainsdem.survey.rows import load, read_rows, text_of, write_rows
from grainsdem.survey.running import PAUSE
from grainsdem.workers import share

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from pathlib import Path

    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.recipe import Recipe

_LOG = logging.getLogger(__name__)

FIRST = ("file", "image", "bed", "bed_rng", "rng")
"""Columns that every row has, also that of a photograph that could not be taken."""

_FIXED = ("rng", "name", "images", "output", "voxels", "section", "planform")
"""Keys of a recipe that do not change a bed, or that each bed has of its own."""

TRUTH, ABOUT = "truth.csv", "images.json"
"""The table of a set, and what says of which set a folder's images are."""


@gated
def images(
    recipe: Recipe,
    folder: str | os.PathLike[str],
    *,
    count: int,
    workers: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> NDArray[np.void]:
    """Grow beds, photograph them, and write images and one table of truth into a folder.

    Parameters
    ----------
    recipe : Recipe
        Of the beds. Its table of images says what differs from photograph to photograph; without it the light comes
        from all around and images are a little blurred and noisy. Beds settle where the recipe has that table.
    folder : str or path-like
        Where files go; made if need be. Images that it holds already are kept, so that an interrupted set goes on, and
        a larger count adds to it.
    count : int
        Number of photographs.
    workers : int, optional
        Number of processes; by default one for each processor.
    progress : callable, optional
        Called with the number of photographs done and of all.

    Returns
    -------
    structured ndarray, shape (n,)
        What ``truth.csv`` holds, one row a photograph: ``file``; ``bed`` and the seeds that both follow from;
        ``width`` and ``height`` [pixels], ``scale`` [m], the edge of a pixel (in the middle, where the lens bends), and
        the lower corner [m] of the picture in the bed; every option of the photograph; ``porosity`` as `summary` has
        it; numbers of grains of the bed, seen, seen whole, and of stones counted; `size_percentiles` [m]; and
        ``error``, empty where it could be taken. How many could not is logged as a warning.

    Raises
    ------
    InputError
        If the count is none, the folder holds another set or something else, beds would be copies of one, or grains lie
        loose since shapes are laid out and do not settle.
    WriteError
        If a file cannot be written, or another run that lives is writing the set.

    Notes
    -----
    A bed follows from the recipe and its number, a photograph from its own number besides: they are the same in
    whatever order and on however many processors of one kind they are made, and whatever else is in the set.
    """
    if isinstance(count, bool) or not isinstance(count, int) or count < 1:
        raise InputError(f"count must be a whole number, 1 or more; got {count!r}")
    if count > MOST_BEDS:
        raise InputError(f"a set has at most {MOST_BEDS} photographs; got {count:.4g}")
    table, bare = recipe.images or ImagesTable(), recipe.model_copy(update={"images": None})
    _refuse_copies(bare, count, table)
    with working_in(folder) as place:
        _begin(place, bare, table)
        try:
            return _taken(bare, table, place, count, workers=workers, progress=progress)
        except BaseException:
            if not (place / TRUTH).exists():  # it has come to nothing
                (place / ABOUT).unlink(missing_ok=True)
            raise


def _taken(
    bare: Recipe,
    table: ImagesTable,
    place: Path,
    count: int,
    *,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> NDArray[np.void]:
    """Take the photographs that a folder lacks, and return its table."""
    header = [*FIRST, *columns(table, names_of_percentiles()), "error"]
    rows = _kept(place, header, table)
    sittings = list(_sittings(bare, table, place, [k for k in range(1, count + 1) if str(k) not in rows]))
    total, done, written = max(count, len(rows)), len(rows), time.monotonic()
    if progress is not None:
        progress(done, total)
    try:
        for _, taken in share(take, sittings, workers=workers):
            for row in taken:
                rows[str(row["image"])] = [text_of(row.get(name, float("nan"))) for name in header]
            done += len(taken)
            if progress is not None:
                progress(done, total)
            if time.monotonic() - written > PAUSE:
                _write(place, header, rows)
                written = time.monotonic()
    finally:
        if rows:
            _write(place, header, rows)
    found = load(place / TRUTH)
    failed = found[found["error"] != ""]
    if failed.size:
        _LOG.warning(
            "%d of %d photographs could not be taken; the first, %s: %s",
            failed.size, found.size, failed["file"][0], failed["error"][0],
        )  # fmt: skip
    for suffix in table.tables:
        write_table(found, place / f"truth.{suffix}")
    return found


def _refuse_copies(recipe: Recipe, count: int, table: ImagesTable) -> None:
    """Raise `InputError` where several beds would be the same, grains hang in the air, or what is varied cannot be."""
    for key, values in table.vary.items():
        if key in _FIXED or key.split(".")[0] in _FIXED:
            raise InputError(f"images.vary: {key} is no part of a bed; leave it out")
        varied(recipe.model_copy(update={"rng": 0}), {key: values[0]})
    if recipe.grains.shapes is not None and recipe.settle is None:
        raise InputError("grains of shapes are laid out loose, and no bed to photograph: add a settle table")
    if count > table.per_bed and not table.vary and not recipe.has_chance and recipe.settle is None:
        raise InputError(
            f"the beds of {count} photographs, {table.per_bed} of each, would be copies of one: "
            f"{recipe.told_of_copies()}, or take all of one bed, per_bed = {count}"
        )


def _sittings(recipe: Recipe, table: ImagesTable, folder: Path, missing: list[int]) -> Iterator[Sitting]:
    """Yield each bed with those of its photographs that are missing."""
    text = _text(recipe)
    pictures: dict[int, list[Picture]] = {}
    for number in missing:
        bed = (number - 1) // table.per_bed + 1
        pictures.setdefault(bed, []).append(Picture(number, seed_of(text, "image", str(number))))
    for bed, those in pictures.items():
        yield Sitting(recipe, table, bed, seed_of(text, "bed", str(bed)), tuple(those), folder)


def _begin(folder: Path, recipe: Recipe, table: ImagesTable) -> None:
    """Mark the folder of a set if it is new, or raise `InputError` where it holds something else."""
    told = {"recipe": json.loads(_text(recipe)), "images": table.model_dump(mode="json")}
    about = {"version": grainsdem.__version__, **told}
    if (folder / ABOUT).is_file():
        try:
            found = json_object((folder / ABOUT).read_text(encoding="utf-8"))
        except (FileFormatError, UnicodeDecodeError):
            found = None
        if found != about:
            raise InputError(f"{folder}: holds another set of images; {_differing(found, about)}")
        return
    # A hidden one is a lock, or what a killed run has left.
    strangers = sorted(path.name for path in folder.iterdir() if not path.name.startswith("."))
    if strangers:
        raise InputError(
            f"{folder}: holds {strangers[0]}, and no set of images to go on with; give a folder of its own"
        )
    with replacing(folder / ABOUT) as temporary:
        temporary.write_text(json.dumps(about, indent=2) + "\n", encoding="utf-8")


def _differing(found: Any, about: dict[str, Any]) -> str:
    """Return which keys of two descriptions differ, in words."""
    if not isinstance(found, dict):
        return f"its {ABOUT} cannot be read"
    before, now = flat(found), flat(about)
    key = next(key for key in {**before, **now} if before.get(key) != now.get(key))
    return f"{key} was {before.get(key)!r} and is {now.get(key)!r}: give another folder"


def _kept(folder: Path, header: list[str], table: ImagesTable) -> dict[str, list[str]]:
    """Return the rows of photographs whose files are there, by number; those that failed are tried again."""
    if not (folder / TRUTH).exists():
        return {}
    found, rows = read_rows(folder / TRUTH)
    if found != header:
        raise InputError(f"{folder / TRUTH}: has other columns than this set's; give another folder or remove it")
    whole = [row for row in rows if len(row) == len(header) and not row[-1] and re.fullmatch(r"\d{1,9}", row[1])]
    numbers = {row[1]: files_of(Picture(int(row[1]), 0), table) for row in whole}
    return {row[1]: row for row in whole if all((folder / name).is_file() for name in numbers[row[1]])}


def _write(folder: Path, header: list[str], rows: dict[str, list[str]]) -> None:
    write_rows(folder / TRUTH, header, [rows[number] for number in sorted(rows, key=int)])


def _text(recipe: Recipe) -> str:
    """Return all that beds are grown from, as text."""
    unused = {"name", "images", "output", "voxels", "section", "planform"}
    return json.dumps(recipe.model_dump(mode="json", exclude=unused), sort_keys=True)
