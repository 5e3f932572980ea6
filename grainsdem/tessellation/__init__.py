"""Cells: Voronoi and Laguerre tessellations of seeds in a domain, Lloyd's relaxation, and cells of given sizes."""

from grainsdem.tessellation.graded import GradedCells, graded_cells
from grainsdem.tessellation.layered import Layer, LayeredCells, layered_cells
from grainsdem.tessellation.lloyd import Relaxation, relax, relaxation
from grainsdem.tessellation.metric import Metric, Shape, shaped_cells
from grainsdem.tessellation.sized import sized_cells
from grainsdem.tessellation.voronoi import tessellate

__all__ = [
    "GradedCells",
    "Layer",
    "LayeredCells",
    "Metric",
    "Relaxation",
    "Shape",
    "graded_cells",
    "layered_cells",
    "relax",
    "relaxation",
    "shaped_cells",
    "sized_cells",
    "tessellate",
]
