"""Voxels, sections and planforms as a recipe's tables ask for them, written beside the bed."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from grainsdem.figures.seen import planform_figure, section_figure
from grainsdem.measures import write_csv
from grainsdem.measures.planform import photograph, write_planform
from grainsdem.measures.sections import expected_section, section_profile, section_table
from grainsdem.measures.voxels import write_voxels
from grainsdem.recipe.views.measuring import cut_as_asked, seen_as_asked
from grainsdem.recipe.views.tables import PlanformTable, SectionTable, ViewTable, VoxelsTable

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from grainsdem.model import Packing
    from grainsdem.recipe.words import Monitor

    Told = tuple[list[Path], dict[str, Any]]
    Tell = Callable[[float, str], None]


def look_all(
    tables: Mapping[str, ViewTable | None],
    packing: Packing,
    folder: Path,
    monitor: Monitor,
    *,
    rng: int,
    with_figures: bool,
) -> tuple[list[Path], dict[str, dict[str, Any]]]:
    """Write what the tables of views ask for.

    Parameters
    ----------
    tables : mapping of str to ViewTable or None
        Those that the recipe has, by name.
    packing : Packing
        The grains, as grown or as settled.
    folder : pathlib.Path
        Where files go: ``voxels.vti``, ``section.csv`` and ``section_levels.csv``, a folder ``planform``; pictures
        ``section.png`` and ``planform.png``. Files of the same names are replaced.
    monitor : Monitor
        Who is told of the progress.
    rng : int
        Seed of the photograph.
    with_figures : bool
        Whether pictures are drawn.

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
            if isinstance(table, VoxelsTable):
                written, summaries[name] = _voxels(table, packing, folder, tell)
            elif isinstance(table, SectionTable):
                written, summaries[name] = _section(table, packing, folder, with_figures=with_figures)
            elif isinstance(table, PlanformTable):
                written, summaries[name] = _planform(table, packing, folder, rng=rng, with_figures=with_figures)
            files += written
    return files, summaries


def _voxels(table: VoxelsTable, packing: Packing, folder: Path, tell: Tell) -> Told:
    files = [
        write_voxels(
            packing,
            folder / f"voxels.{suffix}",
            size=table.size,
            per_diameter=table.per_diameter,
            phase=table.phase,
            progress=lambda share: tell(share, ""),
        )
        for suffix in table.formats
    ]
    told = {"counts": files[0].counts, "spacing": files[0].spacing, "porosity": files[0].porosity} if files else {}
    return [file.path for file in files], told


def _section(table: SectionTable, packing: Packing, folder: Path, *, with_figures: bool) -> Told:
    cut, told = cut_as_asked(table, packing)
    files = [write_csv(section_table(cut), folder / "section.csv")]
    if table.levels:
        profile = section_profile(packing, table.levels, axis=table.axis)
        files.append(write_csv(profile, folder / "section_levels.csv"))
    if with_figures:
        files.append(section_figure(cut, folder / "section.png", color_by="diameter"))
    expected = expected_section(packing, normal=cut.frame[2])
    return files, {**told, "expected": expected}


def _planform(table: PlanformTable, packing: Packing, folder: Path, *, rng: int, with_figures: bool) -> Told:
    view, whole, told = seen_as_asked(table, packing)
    camera: dict[str, Any] = table.camera()
    files = write_planform(
        view,
        packing,
        folder / "planform",
        formats=table.formats,
        least_pixels=table.least_pixels,
        rng=rng,
        overwrite=True,
        **camera,
    )
    if whole.size and with_figures:
        image = photograph(view, packing, rng=np.random.default_rng(rng), **camera)
        path = folder / "planform.png"
        files.append(planform_figure(view, packing, image, path, least_pixels=table.least_pixels))
    return files, told
