"""Commands of experiments, each made from what its function says of itself; and ensemble, for several seeds."""

from __future__ import annotations

import functools
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from typer.core import TyperGroup

import grainsdem
from grainsdem.cli.guard import BAD, Written, err, guarded, out, tell_usage
from grainsdem.cli.looking.seeing import planform_command
from grainsdem.cli.made import History, MaxHours, Resume, made_command, running
from grainsdem.cli.moving import settle_command
from grainsdem.cli.options import Bed, Json, Quiet, Rng, app, keyed, load, prepare, print_json
from grainsdem.errors import GrainsDEMError

if TYPE_CHECKING:
    from grainsdem.described import Described
    from grainsdem.dynamics.experiments.registry import Experiment

Output = Annotated[
    Path,
    typer.Argument(help="The packing at the end, to write (.h5).", show_default=False),
    Written("grainsdem.storage:check_suffix"),
]
Start = Annotated[
    Literal["random", "place"],
    typer.Option(help="Turn the grains at random, reorder them and set them apart first, or start where they are."),
]
Figure = Annotated[
    Path | None, typer.Option(help="Draw the curves here (.png)."), Written("grainsdem.figures.frame:check_suffix")
]

Forces = Annotated[
    Path | None,
    typer.Option(
        help="Write the contacts at the end with their forces and force chains: .csv, .parquet, .graphml, .vtp for "
        "ParaView, or a picture (.png)."
    ),
    Written("grainsdem.recipe.experiments:check_forces"),
]

FIRST: dict[str, tuple[Any, Any]] = {"bed": (Bed, ...), "output": (Output, ...)}
"""Parameters of every command before the options of its experiment: annotation, and default or none."""

LAST: dict[str, tuple[Any, Any]] = {
    "start": (Start, "random"), "history": (History, None), "resume": (Resume, False), "figure": (Figure, None),
    "forces": (Forces, None), "max_hours": (MaxHours, 24.0),
    "rng": (Rng, 0), "json_": (Json, False), "quiet": (Quiet, False),
}  # fmt: skip
"""Those behind them."""


UNITS = {
    "pressure": "Pa", "stress": "Pa", "height": "m", "run_out": "m", "time": "s", "force": "N", "pull": "N",
    "depth": "m", "sinkage": "m", "distance": "m", "stiffness": "N/m", "torque": "N m", "work": "J", "dissipated": "J",
    "mass": "kg",
}  # fmt: skip
"""Units of what a report tells, by the words of its name."""


MADE = {"settle": settle_command, "planform": planform_command}
"""Commands that are made of a function's options, as those of experiments are."""


class Commands(TyperGroup):
    """Our commands, and those made of functions when they are asked for: most commands need no engine."""

    def main(self, args: Any = None, *, standalone_mode: bool = True, **extra: Any) -> Any:  # type: ignore[override]  # the rest goes by keyword
        """Run a command; what cannot be read of what was typed is told in one line."""
        try:
            code = super().main(args, standalone_mode=False, **extra)
        except Exception as error:
            if not standalone_mode or not hasattr(error, "format_message"):
                raise
            tell_usage(error)
            sys.exit(BAD)
        if standalone_mode:
            sys.exit(code if isinstance(code, int) else 0)
        return code

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands."""
        from grainsdem.dynamics.experiments import registry

        return [*super().list_commands(ctx), *MADE, *(name.replace("_", "-") for name in registry.names())]

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, or None where there is none of that name."""
        return super().get_command(ctx, cmd_name) or _command(cmd_name)


app.info.cls = Commands


def _command(name: str) -> Any:
    """Return a command that is made of a function, or None where there is no such function."""
    from grainsdem.dynamics.experiments import registry

    if name in MADE:
        return MADE[name]()
    if name.replace("-", "_") not in registry.names():
        return None
    try:
        found = registry.find(name)
    except GrainsDEMError as error:
        raise typer.BadParameter(str(error)) from None
    last = {name: pair for name, pair in LAST.items() if not (found.needs_seed and name == "start")}
    return made_command(found, functools.partial(_perform, found), first=FIRST, last=last)


@app.command()
@guarded
def experiments(
    name: Annotated[str | None, typer.Argument(help="Tell the options of this one.", show_default=False)] = None,
    markdown: Annotated[bool, typer.Option("--markdown", help="Print a page in Markdown.")] = False,
    json_: Annotated[bool, typer.Option("--json", help="Print JSON schemas of the options.")] = False,
) -> None:
    """List the experiments, those of other packages among them, or the options of one, or of settle."""
    from grainsdem.described import description
    from grainsdem.dynamics.experiments import registry
    from grainsdem.screen import print_facts

    settling = description(grainsdem.settle)
    if name is not None:
        chosen: dict[str, Described] = {name: settling if name == "settle" else registry.find(name)}
    else:  # settling is told with them, and comes before
        chosen = {**({"settle": settling} if markdown or json_ else {}), **registry.known()}
    if json_:
        print_json({found.name: found.schema() for found in chosen.values()})
    elif markdown:
        out.print("\n".join(found.page() for found in chosen.values()), markup=False, highlight=False, end="")
    elif name is None:
        print_facts(out, "experiments", {found.name: found.summary for found in chosen.values()})
    else:
        found = chosen[name]
        print_facts(out, f"{found.name}: {found.summary}", {told.name: told.line() for told in found.told()})


@app.command()
@guarded
def ensemble(
    experiment: Annotated[
        str, typer.Argument(help="What to run: the name of a command that is an experiment.", show_default=False)
    ],
    bed: Bed,
    options: Annotated[
        list[str] | None, typer.Argument(help="Its options, such as strain=0.3 spheres=true.", show_default=False)
    ] = None,
    seeds: Annotated[int, typer.Option(help="How many runs, each with a seed of its own.", min=1, max=10_000)] = 5,
    through: Annotated[
        Literal["auto", "batch", "processes"],
        typer.Option(help="Step runs together (mujoco.batch), or give each a process."),
    ] = "auto",
    workers: Annotated[int | None, typer.Option(help="Threads or processes.", min=1)] = None,
    histories: Annotated[
        Path | None, typer.Option(help="A folder for the histories of the runs."), Written(is_folder=True)
    ] = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Run one experiment with several seeds: means and intervals of 95 % confidence (MuJoCo)."""
    from grainsdem.dynamics.experiments import registry
    from grainsdem.screen import ChainProgress, print_facts

    found = registry.find(experiment)
    packing = load(bed)
    with ChainProgress(err, shown=not (quiet or json_)) as bars, bars.stage(found.title) as tell:
        runs = grainsdem.dynamics.ensemble(
            found.function,
            packing,
            seeds=range(rng, rng + seeds),
            through=through,
            workers=workers,
            history_folder=histories,
            progress=lambda done, total: tell(done / total, f"{done} of {total} runs"),
            **keyed(options or []),
        )
    if json_:
        print_json(runs.to_dict())
    elif not quiet:
        widths = runs.half_width()
        facts = {_title(k): f"{_shown(k, v)} ± {_shown(k, widths[k])}" for k, v in runs.mean().items()}
        print_facts(out, f"{experiment}: {seeds} seeds, 95 % intervals", facts)


def _perform(
    found: Experiment,
    *,
    bed: Path,
    output: Path,
    history: Path | None,
    resume: bool,
    figure: Path | None,
    forces: Path | None,
    max_hours: float,
    rng: int,
    json_: bool,
    quiet: bool,
    start: str = "random",
    **options: Any,
) -> None:
    """Run an experiment on a bed, write what comes of it, and print what it measured."""
    from grainsdem import storage
    from grainsdem.figures.curves import curve_figure
    from grainsdem.recipe.experiments import draw_or_write_forces
    from grainsdem.screen import print_facts

    prepare("contacts", "shapes", quiet=quiet)
    packing = load(bed)
    with running(found.title, output, shown=not (quiet or json_)) as tell:
        outcome = found.function(
            packing,
            history_path=history,
            resume=resume,
            max_hours=max_hours,
            progress=tell,
            rng=rng if start == "random" else None,
            **options,
        )
    storage.save(outcome.packing, output)
    if figure is not None:
        curve_figure(outcome.panels, figure)
    if forces is not None:
        draw_or_write_forces(outcome.snapshot, forces)
    report = outcome.report.to_dict()
    if json_:
        print_json(report)
    elif not quiet:
        print_facts(out, str(output), {_title(name): _shown(name, value) for name, value in report.items()})
        if found.caution:
            out.print(found.caution, highlight=False, markup=False)


def _title(name: str) -> str:
    """Return the name of a number with its unit."""
    words = name.replace("_", " ")
    if "angle" in name:
        return f"{words}, °"
    unit = next((u for word, u in UNITS.items() if f"_{word}_" in f"_{name}_" and "half" not in name), "")
    return f"{words}, {unit}" if unit and not name.startswith("relative") else words


def _shown(name: str, value: Any) -> str:
    """Return a number as it is shown: angles in degrees."""
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, str):
        return value or "–"
    return f"{math.degrees(value):.1f}" if "angle" in name else f"{value:.4g}"
