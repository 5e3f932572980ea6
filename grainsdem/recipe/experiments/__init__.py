"""Experiments in a recipe: their tables, and how they are run on what was grown or settled."""

from grainsdem.recipe.experiments.performing import perform, perform_all, write_replays
from grainsdem.recipe.experiments.tables import (
    CollapseTable,
    CompactTable,
    ExperimentTable,
    ShearTable,
    TapTable,
    TiltTable,
    TriaxialTable,
)

__all__ = [
    "CollapseTable",
    "CompactTable",
    "ExperimentTable",
    "ShearTable",
    "TapTable",
    "TiltTable",
    "TriaxialTable",
    "perform",
    "perform_all",
    "write_replays",
]
