"""Cells: Voronoi and Laguerre tessellations of seeds in a domain, Lloyd's relaxation, and cells of given sizes."""

from grainsdem.tessellation.lloyd import relax
from grainsdem.tessellation.sized import sized_cells
from grainsdem.tessellation.voronoi import tessellate

__all__ = ["relax", "sized_cells", "tessellate"]
