"""What settling gives back: grains at rest, and how they came to it."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grainsdem.model import ContactGraph, Packing


@dataclass(frozen=True, slots=True)
class SettleReport:
    """How a settling run went.

    Parameters
    ----------
    at_rest : bool
        Whether the criterion of rest was met before the time limit.
    time : float
        Simulated time [s].
    time_step : float
        Last time step [s].
    n_steps : int
        Steps taken, those of abandoned tries not counted.
    halvings : int
        How often the time step was halved to keep the run stable.
    refinements : int
        How often it was halved at rest to make the overlaps shallower.
    kinetic_energy : float
        Mean kinetic energy of a grain at the end [m g d].
    unbalanced_force : float
        Mean resultant force over mean contact force at the end.
    overlap_mean, overlap_max : float
        Depth of overlapping contacts at the end, relative to the median diameter.
    floor_force, wall_force : float
        What the floor and the side walls bear: force on them along gravity over the weight of the grains, mean of the
        last samples, as a single step's forces are known to a few percent only. Together they are one at rest. In a
        deep bed walls bear a part (Janssen); they push the grains down where it is negative.
    n_contacts : int
        Contact points that carry force at the end.
    drop_height : float
        How far grains fell [m]: from where each was let go to where its centroid is at the end, mean over the grains.
    """

    at_rest: bool
    time: float
    time_step: float
    n_steps: int
    halvings: int
    refinements: int
    kinetic_energy: float
    unbalanced_force: float
    overlap_mean: float
    overlap_max: float
    floor_force: float
    wall_force: float
    n_contacts: int
    drop_height: float

    def to_dict(self) -> dict[str, Any]:
        """Return the report as JSON values."""
        return asdict(self)


@dataclass(frozen=True, slots=True, eq=False)
class Settled:
    """What `settle` returns.

    Parameters
    ----------
    packing : Packing
        The grains where they came to rest.
    history : dict of ndarray
        Series over time: ``time`` [s], ``kinetic_energy`` and ``total_energy`` [m g d a grain],
        ``unbalanced_force``, ``n_contacts``, ``overlap_mean`` and ``overlap_max`` [d], ``floor_force`` and
        ``wall_force`` [weight], ``height`` [m].
    report : SettleReport
        How the run went.
    contacts : ContactGraph
        Pairs that press on each other at the end, as MuJoCo found them.
    """

    packing: Packing
    history: dict[str, NDArray[Any]]
    report: SettleReport
    contacts: ContactGraph
