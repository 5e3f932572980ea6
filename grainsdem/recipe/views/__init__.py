"""Voxels, sections and planforms in a recipe: their tables, and how they are written."""

from grainsdem.recipe.views.looking import look_all
from grainsdem.recipe.views.tables import PlanformTable, SectionTable, ViewTable, VoxelsTable

__all__ = ["PlanformTable", "SectionTable", "ViewTable", "VoxelsTable", "look_all"]
