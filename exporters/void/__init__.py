"""The void between grains in a box, as solids, surfaces and meshes; and how grains that touch are parted first."""
