"""Experiments on beds: triaxial compression."""

from grainsdem.dynamics.experiments.rig import Outcome
from grainsdem.dynamics.experiments.triaxial import TriaxialReport, triaxial

__all__ = ["Outcome", "TriaxialReport", "triaxial"]
