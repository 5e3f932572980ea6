"""What is measured grain by grain: sizes, shapes, and all of it as one table."""

from grainsdem.measures.grains.shapes import sphericities
from grainsdem.measures.grains.sizes import diameters, masses, percentiles
from grainsdem.measures.grains.tables import summary, table, write_csv

__all__ = [
    "diameters",
    "masses",
    "percentiles",
    "sphericities",
    "summary",
    "table",
    "write_csv",
]
