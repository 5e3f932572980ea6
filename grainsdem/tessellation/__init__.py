"""Cells: Voronoi and Laguerre tessellations of seeds in a domain, Lloyd's relaxation, and cells of given sizes."""

from grainsdem.tessellation.forms import Forms
from grainsdem.tessellation.graded import GradedCells, graded_cells
from grainsdem.tessellation.layered import Layer, LayeredCells, layered_cells
from grainsdem.tessellation.lenses import Lens
from grainsdem.tessellation.lloyd import Relaxation, relax, relaxation
from grainsdem.tessellation.metric import Metric, Shape, shaped_cells
from grainsdem.tessellation.mixed import MixedCells, mixed_cells
from grainsdem.tessellation.placed import PlacedCells, placed_cells
from grainsdem.tessellation.sized import sized_cells
from grainsdem.tessellation.voronoi import tessellate

__all__ = [
    "Forms",
    "GradedCells",
    "Layer",
    "LayeredCells",
    "Lens",
    "Metric",
    "MixedCells",
    "PlacedCells",
    "Relaxation",
    "Shape",
    "graded_cells",
    "layered_cells",
    "mixed_cells",
    "placed_cells",
    "relax",
    "relaxation",
    "shaped_cells",
    "sized_cells",
    "tessellate",
]
