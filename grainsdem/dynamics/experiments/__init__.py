"""Experiments on beds: triaxial compression, ring shear, direct shear, collapse and tilt."""

from grainsdem.dynamics.experiments.collapse import CollapseReport, collapse
from grainsdem.dynamics.experiments.direct_shear import DirectShearReport, direct_shear
from grainsdem.dynamics.experiments.rig import Outcome
from grainsdem.dynamics.experiments.ring import RingReport, ring_shear
from grainsdem.dynamics.experiments.tilt import TiltReport, tilt
from grainsdem.dynamics.experiments.triaxial import TriaxialReport, triaxial

__all__ = [
    "CollapseReport",
    "DirectShearReport",
    "Outcome",
    "RingReport",
    "TiltReport",
    "TriaxialReport",
    "collapse",
    "direct_shear",
    "ring_shear",
    "tilt",
    "triaxial",
]
