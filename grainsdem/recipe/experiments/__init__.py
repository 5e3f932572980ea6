"""Experiments in a recipe: their tables, and how they are run on what was grown or settled."""

from grainsdem.recipe.experiments.performing import (
    check_forces,
    draw_or_write_forces,
    perform,
    perform_all,
    write_replays,
)
from grainsdem.recipe.experiments.tables import ExperimentTable, experiment_tables

__all__ = [
    "ExperimentTable",
    "check_forces",
    "draw_or_write_forces",
    "experiment_tables",
    "perform",
    "perform_all",
    "write_replays",
]
