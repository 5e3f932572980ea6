"""What the graph of contacts tells: how a bed hangs together, how its contacts are oriented, and its edges as files."""

from grainsdem.measures.graph.connectivity import (
    components,
    coordination_curve,
    degree_distribution,
    mean_coordination,
    rattlers,
)
from grainsdem.measures.graph.edges import write_edges
from grainsdem.measures.graph.fabric import anisotropy, branch_vectors, fabric_tensor

__all__ = [
    "anisotropy",
    "branch_vectors",
    "components",
    "coordination_curve",
    "degree_distribution",
    "fabric_tensor",
    "mean_coordination",
    "rattlers",
    "write_edges",
]
