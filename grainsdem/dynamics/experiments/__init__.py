"""Experiments on beds, and what one writes another experiment with (docs/your_own_experiment.md)."""

from grainsdem.dynamics.experiments.collapse import CollapseReport, collapse
from grainsdem.dynamics.experiments.direct_shear import DirectShearReport, direct_shear
from grainsdem.dynamics.experiments.drums.drum import DrumReport, drum
from grainsdem.dynamics.experiments.loading import Staged
from grainsdem.dynamics.experiments.parts.joined.driving import PartState
from grainsdem.dynamics.experiments.parts.joined.own_part import OwnPartReport, own_part
from grainsdem.dynamics.experiments.parts.pushed.penetration import penetration
from grainsdem.dynamics.experiments.parts.pushed.told import PenetrationReport
from grainsdem.dynamics.experiments.registry import Experiment, experiment
from grainsdem.dynamics.experiments.resting import Resting, pour
from grainsdem.dynamics.experiments.rig import JsonReport, Outcome, Trial, assemble
from grainsdem.dynamics.experiments.ring import RingReport, ring_shear
from grainsdem.dynamics.experiments.shared import CompactionFriction, Friction, Gravity, Run, WallFriction
from grainsdem.dynamics.experiments.start import as_asked, in_block, options_of
from grainsdem.dynamics.experiments.streams.discharge import DischargeReport, discharge
from grainsdem.dynamics.experiments.streams.feed import FeedReport, feed
from grainsdem.dynamics.experiments.tilt import TiltReport, tilt
from grainsdem.dynamics.experiments.triaxial import TriaxialReport, triaxial

__all__ = [
    "CollapseReport",
    "CompactionFriction",
    "DirectShearReport",
    "DischargeReport",
    "DrumReport",
    "Experiment",
    "FeedReport",
    "Friction",
    "Gravity",
    "JsonReport",
    "Outcome",
    "OwnPartReport",
    "PartState",
    "PenetrationReport",
    "Resting",
    "RingReport",
    "Run",
    "Staged",
    "TiltReport",
    "Trial",
    "TriaxialReport",
    "WallFriction",
    "as_asked",
    "assemble",
    "collapse",
    "direct_shear",
    "discharge",
    "drum",
    "experiment",
    "feed",
    "in_block",
    "options_of",
    "own_part",
    "penetration",
    "pour",
    "ring_shear",
    "tilt",
    "triaxial",
]
