"""A bed as voxels: the two-phase function I(x) of the paper's equation 1, and what is read from it."""

from grainsdem.measures.voxels.chords import Chords, chord_lengths
from grainsdem.measures.voxels.correlation import Correlation, two_point_correlation
from grainsdem.measures.voxels.files import VoxelFile, write_voxels
from grainsdem.measures.voxels.labels import Voxels, voxelize
from grainsdem.measures.voxels.surfaces import WRONG, exact_specific_surface, specific_surface

__all__ = [
    "WRONG",
    "Chords",
    "Correlation",
    "VoxelFile",
    "Voxels",
    "chord_lengths",
    "exact_specific_surface",
    "specific_surface",
    "two_point_correlation",
    "voxelize",
    "write_voxels",
]
