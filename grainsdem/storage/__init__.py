"""Packings and histories in HDF5, with schema, version and provenance."""

from grainsdem.storage.hdf5 import SCHEMA_VERSION, SUFFIXES, check_suffix
from grainsdem.storage.histories import HistoryWriter, load_history, load_motion, load_moved
from grainsdem.storage.packings import load, save
from grainsdem.storage.surroundings import load_surroundings

__all__ = [
    "SCHEMA_VERSION",
    "SUFFIXES",
    "HistoryWriter",
    "check_suffix",
    "load",
    "load_history",
    "load_motion",
    "load_moved",
    "load_surroundings",
    "save",
]
