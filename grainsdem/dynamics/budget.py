"""What a run will take, told before it starts: memory and time, and a refusal with advice where it is too much."""

from __future__ import annotations

import logging
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from exporters import mjcf
from grainsdem.errors import InputError

if TYPE_CHECKING:
    from grainsdem.model import Packing

_LOG = logging.getLogger(__name__)

_BASE_MEMORY = 250 << 20
"""Memory [bytes] of the interpreter and the libraries."""

_GRAIN_MEMORY = 150 << 10
"""Memory [bytes] a grain while the model is compiled and stepped: 110 kB were seen with 500 to 5000 grains in place."""

_STEP_TIME = 3e-5
"""Time [s] of a step for each grain: 24 µs were seen in beds in place, on one core, with 500 to 5000 grains."""

_COMPILE_TIME = 2e-6
"""Time [s] of compiling, for each pair of grains."""

SETTLING_TIME = 25.0
"""Time [√(d/g)] that a bed needs to come to rest once all grains have landed."""


_ADVICE = (
    "take fewer grains, a smaller box or a larger time step, or let a parallel program have the bed: exporters write "
    "it for exaDEM and others (grainsdem export --help)"
)


@dataclass(frozen=True, slots=True)
class Budget:
    """What a run will take, to a factor of two or so.

    Parameters
    ----------
    n_grains : int
        Number of grains.
    memory : float
        Memory [bytes].
    compile_time : float
        Time [s] until the model is compiled, where it has not been before.
    run_time : float
        Time [s] of the run; 0 where nothing is known of it.
    """

    n_grains: int
    memory: float
    compile_time: float
    run_time: float

    def __str__(self) -> str:
        memory = f"{self.n_grains} grains: about {self.memory / 1e9:.2g} GB"
        return f"{memory} and {_duration(self.compile_time + self.run_time)} on one core" if self.run_time else memory


def estimate(n_grains: int, *, duration: float, time_step: float = 0.01) -> Budget:
    """Return what a run will take.

    Parameters
    ----------
    n_grains : int
        Number of grains.
    duration : float
        Time [√(d/g)] that is simulated.
    time_step : float
        Time step [√(d/g)].

    Examples
    --------
    >>> print(estimate(10_000, duration=40.0))
    10000 grains: about 1.8 GB and 23 minutes on one core
    """
    return Budget(
        n_grains,
        float(_BASE_MEMORY + _GRAIN_MEMORY * n_grains),
        _COMPILE_TIME * n_grains**2,
        _STEP_TIME * n_grains * duration / time_step,
    )


def refuse_memory(budget: Budget, *, memory: float | None = None) -> None:
    """Raise `InputError` where a run takes more memory [bytes] than there is, or than the system says is free."""
    free = _free_memory() if memory is None else memory
    if free is not None and budget.memory > free:
        raise InputError(f"this does not fit: {budget}, and {free / 1e9:.2g} GB are free; {_ADVICE}")


def settling_budget(
    packing: Packing, *, time_step: float = 0.01, max_time: float = 200.0, speed: float | None = None
) -> Budget:
    """Return what settling will take, from where the grains are at its start; rain comes down at a speed [√(g d)]."""
    up = 1 if packing.domain.is_planar else 2
    scale = mjcf.units(packing).length
    if speed is None:
        fall = float(np.ptp(packing.positions[:, up]) / scale)
        duration = min(SETTLING_TIME + float(np.sqrt(2 * fall)), max_time)
    else:
        highest = float(packing.positions[:, up].max(initial=0.0) - packing.domain.lower[up]) / scale
        duration = min(SETTLING_TIME, max_time) + highest / speed
    return estimate(len(packing), duration=duration, time_step=time_step)


def allow(budget: Budget, *, max_hours: float, memory: float | None = None) -> None:
    """Log a budget, or raise `InputError` where it is more than there is.

    Parameters
    ----------
    budget : Budget
        What a run will take.
    max_hours : float
        Most hours that it may take.
    memory : float, optional
        Memory [bytes] that there is; what the system says is free by default.
    """
    if not max_hours > 0:
        raise InputError(f"max_hours must be positive; got {max_hours}")
    refuse_memory(budget, memory=memory)
    if budget.compile_time + budget.run_time > 3600 * max_hours:
        raise InputError(
            f"this takes too long: {budget}, and max_hours is {max_hours:g}; {_ADVICE}, or allow more hours"
        )
    _LOG.info("%s", budget)


def _free_memory() -> float | None:
    """Return the memory [bytes] that programs may still take, where the system tells."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    found = [line.split()[1] for line in lines if line.startswith("MemAvailable:")]
    return 1024.0 * float(found[0]) if found else None


def _duration(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("hours", 3600.0), ("minutes", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} seconds"
