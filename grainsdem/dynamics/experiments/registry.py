"""What makes a function an experiment: its options are said once, in its signature, and all else follows from them.

A decorated function sets up a run and returns it. Whoever calls it has its options checked, the run done and recorded,
and gets an `Outcome`; the command line, recipes, ensembles and the docs find it in `known`.
"""

from __future__ import annotations

import functools
import inspect
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import entry_points
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar, cast

from pydantic import create_model

from grainsdem.described import Described, documented
from grainsdem.dynamics.budget import allow
from grainsdem.dynamics.experiments.rig import Outcome, Trial
from grainsdem.dynamics.experiments.shared import DEFAULTS, NOTES, Run
from grainsdem.dynamics.loop import Record
from grainsdem.dynamics.mechanics import snapshot
from grainsdem.errors import InputError, MissingPackageError
from grainsdem.gate import gated
from grainsdem.options import checked, model_of, notes_of
from grainsdem.values import Options

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from numpy.typing import NDArray
    from pydantic import BaseModel

    from grainsdem.panels import Panel

    Panels = Callable[[Mapping[str, NDArray[Any]], Mapping[str, NDArray[Any]]], Sequence[Panel]]

GROUP = "grainsdem.experiments"
"""Entry points under which other packages offer experiments of their own."""

BUILT_IN: dict[str, str] = {
    "compact": "grainsdem.dynamics.compaction.isotropic",
    "tap": "grainsdem.dynamics.compaction.tapping",
    "triaxial": "grainsdem.dynamics.experiments.triaxial",
    "ring_shear": "grainsdem.dynamics.experiments.ring",
    "direct_shear": "grainsdem.dynamics.experiments.direct_shear",
    "collapse": "grainsdem.dynamics.experiments.collapse",
    "tilt": "grainsdem.dynamics.experiments.tilt",
    "discharge": "grainsdem.dynamics.experiments.streams.discharge",
    "feed": "grainsdem.dynamics.experiments.streams.feed",
    "drum": "grainsdem.dynamics.experiments.drums.drum",
    "penetration": "grainsdem.dynamics.experiments.parts.pushed.penetration",
    "own_part": "grainsdem.dynamics.experiments.parts.joined.own_part",
}
"""Experiments of ours, in the order in which a recipe runs them, and the modules that they are in."""

UNSTABLE = "UnstableError", "    If the run goes wrong and three smaller time steps do not help."
"""What the docstring of every experiment says last of what it raises."""

P = ParamSpec("P")
Report = TypeVar("Report")


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment(Described):
    """An experiment: besides what is described of it, how it is drawn and started; its caution is of a single run.

    Parameters
    ----------
    panels : callable
        Given history and profile, the series of both by name, returns the panels of its figure.
    whole : bool
        Whether the whole history is drawn, and not only its second stage.
    needs_seed : bool
        Whether grains are set apart always, so that they cannot start where they are.
    """

    function: Callable[..., Outcome[Any]]
    panels: Panels
    whole: bool
    needs_seed: bool

    def drawn(self, history: Mapping[str, NDArray[Any]], profile: Mapping[str, NDArray[Any]]) -> Sequence[Panel]:
        """Return the panels of its figure; none where the run never came to its second stage."""
        if self.whole:
            return self.panels(history, profile)
        chosen = history["stage"] == 1.0
        return self.panels({name: row[chosen] for name, row in history.items()}, profile) if chosen.any() else ()


_found: dict[str, Experiment] = {}
"""Experiments that were defined, by name."""


def experiment(
    *,
    panels: Panels = lambda _series, _profile: [],
    whole: bool = False,
    needs_seed: bool = False,
    caution: str = "",
) -> Callable[[Callable[P, Trial[Report]]], Callable[P, Outcome[Report]]]:
    """Make a function that sets up a run an experiment.

    Parameters
    ----------
    panels : callable
        Given history and profile, the series of both by name, returns the panels of its figure from the top down.
    whole : bool
        Whether they show the whole history; by default its second stage, after compression or rest.
    needs_seed : bool
        Whether grains are set apart always.
    caution : str
        What is said to a person of the report of a single run, on the command line and on the page; nothing by default.

    Returns
    -------
    callable
        Decorator. The function takes a packing, its options as keywords whose annotations carry an
        `grainsdem.options.option`, and ``**run: Unpack[Run]``. Its docstring describes the packing; the options are
        added to it.
    """

    def decorate(setup: Callable[P, Trial[Report]]) -> Callable[P, Outcome[Report]]:
        name, options = setup.__name__, _options(setup)
        own = notes_of(setup)
        notes = {**{key: (note.kind, note.words) for key, (_, note) in own.items()}, **NOTES}

        @functools.wraps(setup)
        def run(*args: P.args, **kwargs: P.kwargs) -> Outcome[Report]:
            bound = signature.bind(*args, **kwargs)
            packing = bound.arguments.pop("packing")
            apart = {key: bound.arguments.pop(key, signature.parameters[key].default) for key in notes}
            values = checked(options, bound.arguments)
            trial = cast("Callable[..., Trial[Report]]", setup)(packing, **values, **apart)
            return _performed(_found[name], trial, values, apart)

        signature = _signature(setup, options)
        run.__signature__ = signature  # type: ignore[attr-defined]
        run.__doc__ = documented(setup.__doc__ or "", options, notes, raises=UNSTABLE)
        function = gated(run, leave=options.model_fields)
        _found[name] = Experiment(
            name=name, function=function, options=options, notes=notes, caution=caution, panels=panels, whole=whole,
            needs_seed=needs_seed,
        )  # fmt: skip
        return function

    return decorate


def _performed(
    kind: Experiment, trial: Trial[Report], values: Mapping[str, Any], apart: Mapping[str, Any]
) -> Outcome[Report]:
    """Do a run that was set up, and return what comes of it."""
    trial.experiment = kind.name
    trial.record = Record(apart["history_path"], apart["resume"], values)
    if apart["progress"] is not None:
        trial.tell = apart["progress"]
    allow(trial.budget(), max_hours=apart["max_hours"])
    trial.run()
    history, profile = trial.history(), trial.profile()
    return Outcome(
        trial.packing().with_step(kind.name, **{**values, **trial.remarks()}),
        history,
        trial.report(),
        snapshot(trial.scene),
        profile,
        tuple(kind.drawn(history, profile)),
    )


def names() -> list[str]:
    """Return the names of all experiments: ours, then those of other packages."""
    return [*BUILT_IN, *(point.name for point in entry_points(group=GROUP) if point.name not in BUILT_IN)]


def known() -> dict[str, Experiment]:
    """Return all experiments by name."""
    return {name: find(name) for name in names()}


def find(name: str) -> Experiment:
    """Return an experiment by its name; dashes count as underscores.

    Raises
    ------
    InputError
        If there is none of that name.
    MissingPackageError
        If the package that offers it cannot be imported.
    """
    name = name.replace("-", "_")
    if name in BUILT_IN:
        import_module(BUILT_IN[name])
        return _found[name]
    for point in entry_points(group=GROUP):
        if point.name == name:
            try:
                function = point.load()
            except (ImportError, AttributeError) as error:
                raise MissingPackageError(f"experiment {name!r}, {point.value}, cannot be loaded: {error}") from error
            return of(function)
    raise InputError(f"there is no experiment {name!r}; there are {', '.join(names())}")


def of(function: Callable[..., Any]) -> Experiment:
    """Return the experiment that a function is.

    Raises
    ------
    InputError
        If it is none.
    """
    found = _found.get(getattr(function, "__name__", ""))
    if found is None or found.function is not function:
        raise InputError(
            f"{getattr(function, '__name__', function)!r} is no experiment: decorate it with @experiment()"
        )
    return found


def _options(setup: Callable[..., Any]) -> type[BaseModel]:
    """Return the model of a function's own options and of those that every run has."""
    own = model_of(setup, setup.__name__)
    fields = {name: (field.annotation, field) for name, field in own.model_fields.items()}
    for name, kind in inspect.get_annotations(Run, eval_str=False).items():
        del kind
        if name not in NOTES:
            fields[name] = (_run_annotation(name), DEFAULTS[name])
    return create_model(setup.__name__, __base__=Options, **fields)  # type: ignore[call-overload,no-any-return]


def _run_annotation(name: str) -> Any:
    """Return the annotation of an option that every run has."""
    text = Run.__annotations__[name].__forward_arg__
    return eval(text, vars(import_module(Run.__module__)))  # noqa: S307  (as `typing` does)


def _signature(setup: Callable[..., Any], options: type[BaseModel]) -> inspect.Signature:
    """Return the signature with all options and what a run takes, for `help` and who reads it."""
    first = [p for p in inspect.signature(setup).parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    keyword = inspect.Parameter.KEYWORD_ONLY
    own = [
        inspect.Parameter(
            name, keyword, default=field.default if not field.is_required() else inspect.Parameter.empty,
            annotation=field.annotation,
        )
        for name, field in options.model_fields.items()
    ]  # fmt: skip
    given = inspect.signature(setup).parameters
    noted = [given[name].replace(annotation=kind) for name, (kind, _) in notes_of(setup).items()]
    rest = [inspect.Parameter(name, keyword, default=DEFAULTS[name], annotation=NOTES[name][0]) for name in NOTES]
    return inspect.Signature([*first, *own, *noted, *rest], return_annotation=Outcome)
