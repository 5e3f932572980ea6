"""Grains: carved from cells, shrunk to a porosity, moved, rescaled to a size, shuffled, and who touches whom."""

from grainsdem.packing.blunting import Merged, merge_edges
from grainsdem.packing.carve import carve, subset
from grainsdem.packing.contacts import contacts, neighbor_contacts
from grainsdem.packing.heal import Healed, heal
from grainsdem.packing.infill import infill
from grainsdem.packing.inset import inset
from grainsdem.packing.optimal import VOID_RELATIONS, SortingRelation, VoidRelation, fit_void_ratio
from grainsdem.packing.shrink import ratio_to, rescale, resize, shrink, size_of
from grainsdem.packing.shuffle import shuffle
from grainsdem.packing.throats import jitter_throats, throat_widths

__all__ = [
    "VOID_RELATIONS",
    "Healed",
    "Merged",
    "SortingRelation",
    "VoidRelation",
    "carve",
    "contacts",
    "fit_void_ratio",
    "heal",
    "infill",
    "inset",
    "jitter_throats",
    "merge_edges",
    "neighbor_contacts",
    "ratio_to",
    "rescale",
    "resize",
    "shrink",
    "shuffle",
    "size_of",
    "subset",
    "throat_widths",
]
