"""What sedimentologists and DEM people ask of a packing: sizes, shapes, porosity, contacts, fabric, tables."""

from grainsdem.measures.connectivity import (
    components,
    coordination_curve,
    degree_distribution,
    mean_coordination,
    rattlers,
)
from grainsdem.measures.edges import write_edges
from grainsdem.measures.fabric import anisotropy, branch_vectors, fabric_tensor
from grainsdem.measures.porosity import core_box, porosity
from grainsdem.measures.shapes import sphericities
from grainsdem.measures.sizes import diameters, masses, percentiles
from grainsdem.measures.tables import summary, table, write_csv

__all__ = [
    "anisotropy",
    "branch_vectors",
    "components",
    "coordination_curve",
    "core_box",
    "degree_distribution",
    "diameters",
    "fabric_tensor",
    "masses",
    "mean_coordination",
    "percentiles",
    "porosity",
    "rattlers",
    "sphericities",
    "summary",
    "table",
    "write_csv",
    "write_edges",
]
