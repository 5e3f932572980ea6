"""Grains in motion: MuJoCo simulates the very text that `exporters.mjcf` writes, and gives back a packing.

An experiment is a function that says its options and sets up a run (`experiments.registry.experiment`;
docs/your_own_experiment.md); a run is written in four steps.

1. Text. `exporters.mjcf.text` writes the bed; `engine.Apparatus` adds what moves it: lids and walls on slide and hinge
   joints (`add_body`, `add_shape`), glued grains (`glue`), gravity (`set_gravity`), spheres (`make_spheres`).
2. Scene. `scene.scene_of` loads that text: grain units inside, `Scene.units` are the factors to SI, `Scene.packing` is
   the bed in SI. Forces on joints are `engine.push`, their places and speeds `engine.axle` and `engine.turn`.
3. Loop. A subclass of `loop.Loop` says what a sample is (`measure`, a named tuple; ``columns`` has its units, `in_si`
   converts), when something is wrong (`check`, with `watch.refuse_broken`), when it is over (`is_over`), what is done
   before every step (`drive`, if ``is_driven``), and what it must remember to go on after a kill (`memory`, `recall`).
   `Loop.run` does the rest: history, frames, checkpoints, resuming, the halving of steps, the error at the end.
4. Result. `mechanics.snapshot` is an instant in SI with converged forces; stresses, networks, layers and energies are
   pure functions of it. `report` gives back a frozen dataclass of what was measured.
"""

from grainsdem.dynamics.compaction import CompactReport, TapReport, compact, tap
from grainsdem.dynamics.ensembles import Ensemble, ensemble
from grainsdem.dynamics.experiments import (
    CollapseReport,
    DirectShearReport,
    DischargeReport,
    DrumReport,
    FeedReport,
    Outcome,
    OwnPartReport,
    PartState,
    PenetrationReport,
    RingReport,
    TiltReport,
    TriaxialReport,
    collapse,
    direct_shear,
    discharge,
    drum,
    feed,
    own_part,
    penetration,
    ring_shear,
    tilt,
    triaxial,
)
from grainsdem.dynamics.loop import Progress
from grainsdem.dynamics.settle import settle
from grainsdem.dynamics.settled import Settled, SettleReport
from grainsdem.dynamics.starting import with_densities, with_frictions

__all__ = [
    "CollapseReport",
    "CompactReport",
    "DirectShearReport",
    "DischargeReport",
    "DrumReport",
    "Ensemble",
    "FeedReport",
    "Outcome",
    "OwnPartReport",
    "PartState",
    "PenetrationReport",
    "Progress",
    "RingReport",
    "SettleReport",
    "Settled",
    "TapReport",
    "TiltReport",
    "TriaxialReport",
    "collapse",
    "compact",
    "direct_shear",
    "discharge",
    "drum",
    "ensemble",
    "feed",
    "own_part",
    "penetration",
    "ring_shear",
    "settle",
    "tap",
    "tilt",
    "triaxial",
    "with_densities",
    "with_frictions",
]
