"""What is measured grain by grain: sizes, shapes, and all of it as one table."""

from grainsdem.measures.grains.directions import orientation_tensor, principal_axes, trend_and_plunge
from grainsdem.measures.grains.files import to_pandas, write_csv, write_table
from grainsdem.measures.grains.shapes import box_axes, ellipsoid_axes, krumbein, roundness, sphericities, zingg
from grainsdem.measures.grains.sizes import diameters, masses, percentiles, sieve_diameters
from grainsdem.measures.grains.tables import neighbor_table, summary, table

__all__ = [
    "box_axes",
    "diameters",
    "ellipsoid_axes",
    "krumbein",
    "masses",
    "neighbor_table",
    "orientation_tensor",
    "percentiles",
    "principal_axes",
    "roundness",
    "sieve_diameters",
    "sphericities",
    "summary",
    "table",
    "to_pandas",
    "trend_and_plunge",
    "write_csv",
    "write_table",
    "zingg",
]
