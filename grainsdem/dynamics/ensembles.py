"""Ensembles: one experiment with several seeds, and the mean and the confidence interval of what it measures."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from exporters.mjcf.log import quiet
from grainsdem.atomic import working_in
from grainsdem.dynamics.engine.lockstep import Lockstep, UnlikeError
from grainsdem.errors import InputError, name_offenders, shown
from grainsdem.gate import gated, gated_noun
from grainsdem.workers import check_workers, n_processors, share

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Sequence

    from numpy.typing import NDArray

    from grainsdem.model import Packing

    Floats = NDArray[np.float64]

Through = Literal["auto", "batch", "processes"]

CONFIDENCE = 0.95
"""Of every interval: Student's, two-sided."""


MOST_SEEDS = 10_000
"""Runs of an ensemble: intervals get no narrower that are worth the time."""

MOST_POINTS = 1_000_000
"""Places of a curve: no run has so many steps."""

_OWN = "rng", "history_path", "resume", "progress"
"""Options of an experiment that the ensemble itself gives."""


@gated_noun
@dataclass(frozen=True, slots=True, eq=False)
class Ensemble:
    """What one experiment with several seeds gave.

    Parameters
    ----------
    seeds : tuple of int
        One for each run.
    outcomes : tuple
        What each run gave back.
    through : {"batch", "processes"}
        How the runs were shared out.
    """

    seeds: tuple[int, ...]
    outcomes: tuple[Any, ...]
    through: str

    def values(self) -> dict[str, Floats]:
        """Return each number of the reports, shape (n_runs,); NaN where a run did not measure it."""
        reports = [outcome.report.to_dict() for outcome in self.outcomes]
        names = [name for name in reports[0] if not any(isinstance(report[name], bool | str) for report in reports)]
        rows = {name: [report[name] for report in reports] for name in names}
        return {name: np.array([np.nan if v is None else v for v in row], dtype=float) for name, row in rows.items()}

    def mean(self) -> dict[str, float]:
        """Return the mean of each number over the runs that measured it; NaN where none did."""
        return {name: _mean(row) for name, row in self.values().items()}

    def half_width(self) -> dict[str, float]:
        """Return half the width of the 95 % confidence interval of each mean; NaN for fewer than two runs."""
        return {name: half_width(row) for name, row in self.values().items()}

    def curve(self, over: str, of: str, *, points: int = 100) -> tuple[Floats, Floats, Floats]:
        """Return the mean of a series of the histories over another one that grows, and its 95 % half width.

        Where an experiment has two stages, the second one is meant, the one after compression or rest.

        Parameters
        ----------
        over, of : str
            Names of the series, such as ``"axial_strain"`` and ``"axial_stress"``.
        points : int
            Where values are interpolated: evenly from zero to where the shortest run ends.

        Returns
        -------
        x, means, half_widths : ndarray, shape (points,)
        """
        if not 1 <= points <= MOST_POINTS:
            raise InputError(f"points must lie from 1 to {MOST_POINTS}; got {points}")
        known = [name for name in self.outcomes[0].history if all(name in one.history for one in self.outcomes)]
        unknown = [name for name in (over, of) if name not in known]
        if unknown:
            raise InputError(f"the histories have {', '.join(known)}; got {', '.join(map(shown, unknown))}")
        pairs = [_second_stage(outcome.history, over, of) for outcome in self.outcomes]
        x = np.linspace(0.0, min(float(a.max()) for a, _ in pairs), points)
        rows = np.array([_on(x, a, b) for a, b in pairs])
        return x, rows.mean(axis=0), np.array([half_width(column) for column in rows.T])

    def to_dict(self) -> dict[str, Any]:
        """Return seeds, means, half widths of the 95 % intervals and of how many runs, as JSON values."""
        numbers = {
            name: {"mean": _json(_mean(row)), "half_width": _json(half_width(row)), "n": int(np.isfinite(row).sum())}
            for name, row in self.values().items()
        }
        return {"seeds": list(self.seeds), "through": self.through, "confidence": CONFIDENCE, **numbers}


def half_width(values: Floats) -> float:
    """Return half the width of the 95 % confidence interval of the mean of values, those that are NaN left out.

    Examples
    --------
    >>> round(half_width(np.array([1.0, 2.0, 3.0])), 3)
    2.484
    """
    from scipy.stats import t  # noqa: PLC0415  (half a second)

    measured = values[np.isfinite(values)]
    n = measured.size
    if n < 2:
        return float("nan")
    return float(t.ppf(0.5 + CONFIDENCE / 2, n - 1) * measured.std(ddof=1) / np.sqrt(n))


@gated
def ensemble(
    experiment: Callable[..., Any],
    packing: Packing,
    *,
    seeds: int | Sequence[int] = 5,
    through: Through = "auto",
    workers: int | None = None,
    history_folder: str | os.PathLike[str] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Ensemble:
    """Run one experiment with several seeds.

    Parameters
    ----------
    experiment : callable
        A function such as `triaxial` or `settle`, that takes a packing and ``rng``.
    packing : Packing
        The grains of every run; the seed says how they are turned, ordered and set apart.
    seeds : int or sequence of int
        How many runs, with seeds 0, 1, 2 …, or the seeds themselves.
    through : {"auto", "batch", "processes"}
        Whether runs are stepped together by `mujoco.batch`, or each has a process; by default the former, and the
        latter where models are too different for it. Each run has the same bits either way, on one machine.
    workers : int, optional
        Threads or processes; by default one for each processor.
    history_folder : str or path-like, optional
        Folder that each run's history is written to, as its seed and ``.h5``; made where it is not there.
    progress : callable, optional
        Called with how many runs of how many are done.
    **options
        What else the experiment takes.

    Returns
    -------
    Ensemble
        All outcomes, with means and 95 % confidence intervals.

    Raises
    ------
    InputError
        If there is no seed, two are the same, ``through`` is another word, the experiment has no such option, or its
        runs would be copies of one, as of grains that `settle` leaves in place.

    Examples
    --------
    >>> from grainsdem.dynamics import triaxial
    >>> ensemble(triaxial, packing, seeds=5).mean()["peak_friction_angle"]  # doctest: +SKIP
    """
    if isinstance(seeds, int) and seeds > MOST_SEEDS:
        raise InputError(f"an ensemble has at most {MOST_SEEDS} seeds; got {seeds:.4g}")
    chosen = tuple(range(seeds)) if isinstance(seeds, int) else tuple(int(seed) for seed in seeds)
    if not chosen or len(set(chosen)) < len(chosen):
        raise InputError(f"an ensemble needs seeds that differ, one at least; got {list(chosen)}")
    if through not in ("auto", "batch", "processes"):
        raise InputError(f"through must be 'auto', 'batch' or 'processes'; got {through!r}")
    check_workers(workers)
    _check_options(experiment, options)
    if len(chosen) > 1:
        _refuse_copies(experiment, options)
    with nullcontext() if history_folder is None else working_in(history_folder):
        jobs = _jobs(experiment, packing, chosen, history_folder, options)
        return _run(jobs, chosen, through, workers, progress)


def _run(
    jobs: list[tuple[str, str, Packing, dict[str, Any]]],
    chosen: tuple[int, ...],
    through: Through,
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> Ensemble:
    """Run the jobs together where they can be, or each in a process."""
    if through != "processes" and len(chosen) > 1:
        try:
            return Ensemble(chosen, _together(jobs, workers, progress), "batch")
        except UnlikeError:
            if through == "batch":
                raise
    outcomes: list[Any] = [None] * len(jobs)
    for done, (number, outcome) in enumerate(share(_do, jobs, workers=workers), 1):
        outcomes[number] = outcome
        if progress is not None:
            progress(done, len(jobs))
    return Ensemble(chosen, tuple(outcomes), "processes")


def _check_options(experiment: Callable[..., Any], options: dict[str, Any]) -> None:
    """Raise `InputError` where an experiment has no such option, or it is the ensemble's own."""
    names = [p.name for p in signature(experiment).parameters.values() if p.kind is p.KEYWORD_ONLY]
    allowed = [name for name in names if name not in _OWN]
    unknown = [name for name in options if name not in allowed]
    if "rng" not in names or unknown:
        given = f"no such option: {name_offenders(unknown)}" if unknown else "it does not take rng"
        raise InputError(f"{experiment.__name__} takes {', '.join(allowed)}; {given}")


def _refuse_copies(experiment: Callable[..., Any], options: dict[str, Any]) -> None:
    """Raise `InputError` where grains start in place, and seeds do not even draw their densities."""
    start = signature(experiment).parameters.get("start")
    density = options.get("density")
    is_drawn = isinstance(density, Mapping) and len(density) > 1
    if start is not None and options.get("start", start.default) == "place" and not is_drawn:
        raise InputError(
            f"{experiment.__name__} with start = 'place' is the same for every seed: runs would be copies of one; give "
            f"start = 'pour' or 'rain', or one seed"
        )


def _jobs(
    experiment: Callable[..., Any],
    packing: Packing,
    seeds: tuple[int, ...],
    folder: str | os.PathLike[str] | None,
    options: dict[str, Any],
) -> list[tuple[str, str, Packing, dict[str, Any]]]:
    """Return what each run needs; functions go by their names, since processes take them so."""
    jobs = []
    for seed in seeds:
        path = {} if folder is None else {"history_path": str(Path(folder) / f"{seed}.h5")}
        jobs.append((experiment.__module__, experiment.__name__, packing, {**options, **path, "rng": seed}))
    return jobs


def _do(job: tuple[str, str, Packing, dict[str, Any]]) -> Any:
    """Run one job."""
    module, name, packing, options = job
    return getattr(import_module(module), name)(packing, **options)


def _together(
    jobs: list[tuple[str, str, Packing, dict[str, Any]]],
    workers: int | None,
    progress: Callable[[int, int], None] | None,
) -> tuple[Any, ...]:
    """Run jobs as threads that are stepped together."""
    lockstep = Lockstep(len(jobs), workers or n_processors())
    outcomes: list[Any] = [None] * len(jobs)
    failures: list[BaseException] = []

    def work(number: int) -> None:
        with lockstep.running():
            try:
                outcomes[number] = _do(jobs[number])
            except BaseException as error:  # noqa: BLE001  (raised again by the thread that waits)
                failures.append(error)
                lockstep.abandon()
            if progress is not None and not failures:
                progress(sum(outcome is not None for outcome in outcomes), len(jobs))

    with quiet():
        threads = [threading.Thread(target=work, args=(number,), daemon=True) for number in range(len(jobs))]
        for thread in threads:
            thread.start()
        try:
            for thread in threads:
                thread.join()
        except KeyboardInterrupt:
            lockstep.abandon()
            for thread in threads:
                thread.join()
            raise
    if failures:
        raise failures[0]
    return tuple(outcomes)


def _mean(values: Floats) -> float:
    measured = values[np.isfinite(values)]
    return float(measured.mean()) if measured.size else float("nan")


def _json(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _second_stage(history: dict[str, NDArray[Any]], *names: str) -> tuple[Floats, ...]:
    """Return series of a history, without its first stage where it has two."""
    chosen = history["stage"] == 1.0 if "stage" in history else slice(None)
    return tuple(np.asarray(history[name][chosen], dtype=float) for name in names)


def _on(x: Floats, over: Floats, of: Floats) -> Floats:
    """Return a series at given places of another one, where that grows."""
    growing = np.flatnonzero(np.diff(np.maximum.accumulate(over), prepend=-np.inf) > 0)
    return np.asarray(np.interp(x, over[growing], of[growing]))
