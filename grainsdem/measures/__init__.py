"""What sedimentologists and DEM people ask of a packing: sizes, shapes, porosity, tables."""

from grainsdem.measures.porosity import core_box, porosity
from grainsdem.measures.shapes import sphericities
from grainsdem.measures.sizes import diameters, masses, percentiles
from grainsdem.measures.tables import summary, table, write_csv

__all__ = [
    "core_box",
    "diameters",
    "masses",
    "percentiles",
    "porosity",
    "sphericities",
    "summary",
    "table",
    "write_csv",
]
