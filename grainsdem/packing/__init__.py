"""Grains: carved from cells, shrunk to a porosity, rescaled to a size, shuffled, and who touches whom."""

from grainsdem.packing.carve import carve
from grainsdem.packing.contacts import contacts, neighbor_contacts
from grainsdem.packing.heal import Healed, heal
from grainsdem.packing.shrink import rescale, shrink
from grainsdem.packing.shuffle import shuffle

__all__ = ["Healed", "carve", "contacts", "heal", "neighbor_contacts", "rescale", "shrink", "shuffle"]
