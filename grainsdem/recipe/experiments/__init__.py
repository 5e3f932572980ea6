"""Experiments in a recipe: their tables, and how they are run on what was grown or settled."""

from grainsdem.recipe.experiments.performing import perform, perform_all
from grainsdem.recipe.experiments.tables import (
    CollapseTable,
    ExperimentTable,
    ShearTable,
    TiltTable,
    TriaxialTable,
)

__all__ = [
    "CollapseTable",
    "ExperimentTable",
    "ShearTable",
    "TiltTable",
    "TriaxialTable",
    "perform",
    "perform_all",
]
