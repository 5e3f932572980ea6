"""Grains on lattices and planes: voxels, polygons of sections, and the surface seen from above."""
