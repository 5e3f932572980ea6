"""What sedimentologists and DEM people ask of a packing: sizes, shapes, porosity, contacts, fabric, tables."""

from grainsdem.measures.grains import diameters, masses, percentiles, sphericities, summary, table, write_csv
from grainsdem.measures.graph import (
    anisotropy,
    branch_vectors,
    components,
    coordination_curve,
    degree_distribution,
    fabric_tensor,
    mean_coordination,
    rattlers,
    write_edges,
)
from grainsdem.measures.porosity import core_box, porosity

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
