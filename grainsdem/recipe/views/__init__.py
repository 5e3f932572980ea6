"""Voxels, sections, planforms and sets of images in a recipe: their tables, and how the first three are written."""

from grainsdem.recipe.views.images import Draw, ImagesTable
from grainsdem.recipe.views.looking import look_all
from grainsdem.recipe.views.measuring import names_told, told_of
from grainsdem.recipe.views.tables import PlanformTable, SectionTable, ViewTable, VoxelsTable

__all__ = [
    "Draw",
    "ImagesTable",
    "PlanformTable",
    "SectionTable",
    "ViewTable",
    "VoxelsTable",
    "look_all",
    "names_told",
    "told_of",
]
