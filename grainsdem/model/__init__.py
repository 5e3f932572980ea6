"""The nouns: frozen, slotted dataclasses of flat read-only arrays, checked when they are made.

Axis 0 counts items. Geometry is float64 in metres, indices are int32, offsets int64. Indices inside a grain are local
to it, indices between grains are global and count from 0.
"""

from grainsdem.model.contacts import ContactGraph
from grainsdem.model.domain import Domain
from grainsdem.model.grading import Grading
from grainsdem.model.packing import DROPPED, QUARTZ_DENSITY, CellLinks, Packing
from grainsdem.model.report import Check, Report
from grainsdem.model.shapes import Polyhedra
from grainsdem.model.surroundings import Surroundings
from grainsdem.model.tessellation import Tessellation

__all__ = [
    "DROPPED",
    "QUARTZ_DENSITY",
    "CellLinks",
    "Check",
    "ContactGraph",
    "Domain",
    "Grading",
    "Packing",
    "Polyhedra",
    "Report",
    "Surroundings",
    "Tessellation",
]
