"""What sections and planforms measure of a bed, for the summary of one bed and for tables of many."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from grainsdem.geometry.bounds import boxes
from grainsdem.measures.planform import planform, planform_bias, planform_table
from grainsdem.measures.planform.truth import BIASES, SAMPLES, STATISTICS
from grainsdem.measures.sections import section, section_summary

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from grainsdem.measures.planform import Planform
    from grainsdem.measures.sections import Section
    from grainsdem.model import Packing
    from grainsdem.recipe.views.tables import PlanformTable, SectionTable, ViewTable

OF_SECTIONS = ("area", "area_fraction", "n_sections", "n_per_area", "mean_area", "mean_diameter", "d10", "d50", "d90")
"""Names of what is told of a section."""

OF_PLANFORMS = (
    "grains_seen",
    "grains_whole",
    *(f"{statistic}_{sample}" for statistic in STATISTICS for sample in (*SAMPLES, *BIASES)),
)
"""Names of what is told of a planform; where no whole grain is seen, the first two only."""


def cut_as_asked(table: SectionTable, packing: Packing) -> tuple[Section, dict[str, Any]]:
    """Return the section that a table asks for, and what is told of it."""
    number = "xyz".index(table.axis)
    lower, upper = boxes(packing)
    domain = packing.domain
    low = max(float(lower[:, number].min()), float(domain.lower[number]))
    high = min(float(upper[:, number].max()), float(domain.upper[number]))
    cut = section(packing, **{table.axis: low + table.at * (high - low)})
    return cut, section_summary(cut)


def seen_as_asked(table: PlanformTable, packing: Packing) -> tuple[Planform, NDArray[np.void], dict[str, Any]]:
    """Return the planform that a table asks for, the whole grains on it, and what is told of it."""
    view = planform(packing, pixel=table.pixel, per_diameter=table.per_diameter)
    rows = planform_table(view, packing)
    whole = rows[~rows["is_cut"] & (rows["n_pixels"] >= table.least_pixels)]
    told: dict[str, Any] = {"grains_seen": int(rows.size), "grains_whole": int(whole.size)}
    if whole.size:
        for row in planform_bias(whole, packing):
            told |= {f"{row['statistic']}_{name}": float(row[name]) for name in (*SAMPLES, *BIASES)}
    return view, whole, told


def names_told(views: Mapping[str, ViewTable | None]) -> list[str]:
    """Return the columns that a recipe's views add to a table of many beds."""
    names = {"section": OF_SECTIONS, "planform": OF_PLANFORMS}
    return [f"{view}_{name}" for view, told in names.items() if views.get(view) is not None for name in told]


def told_of(views: dict[str, Any], packing: Packing) -> dict[str, Any]:
    """Return what a recipe's views measure, by the names of `names_told`."""
    found: dict[str, Any] = {}
    if views.get("section") is not None:
        found |= {f"section_{name}": value for name, value in cut_as_asked(views["section"], packing)[1].items()}
    if views.get("planform") is not None:
        found |= {f"planform_{name}": value for name, value in seen_as_asked(views["planform"], packing)[2].items()}
    return found
