"""Cells: the Voronoi tessellation of seeds in a domain, and Lloyd's relaxation of the seeds."""

from grainsdem.tessellation.lloyd import relax
from grainsdem.tessellation.voronoi import tessellate

__all__ = ["relax", "tessellate"]
