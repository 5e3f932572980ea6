"""Cells: Voronoi and Laguerre tessellations of seeds in a domain, Lloyd's relaxation, and cells of given sizes."""

from grainsdem.tessellation.graded import GradedCells, graded_cells
from grainsdem.tessellation.lloyd import Relaxation, relax, relaxation
from grainsdem.tessellation.sized import sized_cells
from grainsdem.tessellation.voronoi import tessellate

__all__ = ["GradedCells", "Relaxation", "graded_cells", "relax", "relaxation", "sized_cells", "tessellate"]
