"""What a state says: pure functions of a `Snapshot`, in SI, and the `Sample` that a running bed is watched by."""

from grainsdem.dynamics.mechanics.energies import (
    Energies,
    displacements,
    energies,
    inertial_number,
    rotations,
    unbalanced_force,
)
from grainsdem.dynamics.mechanics.forces import contact_forces, write_forces
from grainsdem.dynamics.mechanics.layers import porosity_profile, velocity_profile
from grainsdem.dynamics.mechanics.networks import (
    contact_graph,
    coordination,
    fabric,
    force_chains,
    merge_points,
    normalized_forces,
    sliding_fraction,
)
from grainsdem.dynamics.mechanics.sampling import SAMPLE_UNITS, Sample, sample
from grainsdem.dynamics.mechanics.snapshots import Snapshot, snapshot
from grainsdem.dynamics.mechanics.stresses import force_on, friction_angle, stress, torque_on, torque_through, traction

__all__ = [
    "SAMPLE_UNITS",
    "Energies",
    "Sample",
    "Snapshot",
    "contact_forces",
    "contact_graph",
    "coordination",
    "displacements",
    "energies",
    "fabric",
    "force_chains",
    "force_on",
    "friction_angle",
    "inertial_number",
    "merge_points",
    "normalized_forces",
    "porosity_profile",
    "rotations",
    "sample",
    "sliding_fraction",
    "snapshot",
    "stress",
    "torque_on",
    "torque_through",
    "traction",
    "unbalanced_force",
    "velocity_profile",
    "write_forces",
]
