"""Commands that change the grains of a bed: settle, heal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

import grainsdem
from grainsdem.cli.options import (
    Bed,
    Json,
    Quiet,
    Rng,
    app,
    err,
    guarded,
    load,
    out,
    prepare,
    print_json,
    shares,
    telling,
)


@app.command()
@guarded
def settle(
    bed: Bed,
    output: Annotated[Path, typer.Argument(help="The settled packing to write (.h5).", show_default=False)],
    start: Annotated[
        Literal["pour", "rain", "place"],
        typer.Option(
            help="Rotate, reorder and pour the grains, rain them layer by layer, or let them settle in place, into a "
            "jigsaw denser than any random pack."
        ),
    ] = "pour",
    spheres: Annotated[
        bool, typer.Option("--spheres", help="Replace each grain by the sphere of equal volume.")
    ] = False,
    friction: Annotated[
        str | None,
        typer.Option(
            help="Coefficient of friction among grains, or several and their shares: 0.3:0.5,0.6:0.5. By default the "
            "grains' own, or 0.5 where there are none."
        ),
    ] = None,
    wall_friction: Annotated[
        str | None,
        typer.Option(
            help="The same with the walls, or with some of them: floor=0.6,wall_x0=0. By default, and of walls that "
            "are not named, as among grains."
        ),
    ] = None,
    mixing: Annotated[
        Literal["max", "min"],
        typer.Option(help="Whether the rougher or the smoother of two grains rules their contact."),
    ] = "max",
    rolling_friction: Annotated[
        float, typer.Option(help="Coefficient of rolling friction; steps take longer with one.")
    ] = 0.0,
    restitution: Annotated[
        float | None,
        typer.Option(help="Speed of a grain after a bounce over that before it; by default grains hardly bounce."),
    ] = None,
    gravity: Annotated[float, typer.Option(help="Acceleration [m/s²].")] = 9.81,
    direction: Annotated[
        tuple[float, float, float] | None, typer.Option(help="Where gravity points; by default straight down.")
    ] = None,
    density: Annotated[
        str | None,
        typer.Option(
            help="Density [kg/m³] instead of the grains' own, or several and their shares: 2650:0.9,5200:0.1."
        ),
    ] = None,
    drop_height: Annotated[
        float | None,
        typer.Option(help="How far above the bed [m] rain is let go; by default at half the container's height."),
    ] = None,
    time_step: Annotated[float, typer.Option(help="Time step in units of √(d/g).")] = 0.01,
    max_time: Annotated[float, typer.Option(help="Time limit in units of √(d/g).")] = 200.0,
    max_hours: Annotated[float, typer.Option(help="Refuse a run that would take longer by estimate.")] = 24.0,
    history: Annotated[
        Path | None,
        typer.Option(help="Write the history here while the run goes (.h5); an interrupted run keeps it."),
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with the killed run of that history.")] = False,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let grains fall under gravity in their container until they are at rest (MuJoCo)."""
    from exporters.check import checked_coefficients
    from grainsdem import storage
    from grainsdem.recipe import keeping_last_good, settling_words
    from grainsdem.screen import ChainProgress, print_settling

    storage.check_suffix(output)
    prepare("contacts", "shapes", quiet=quiet)
    packing = load(bed)
    with (
        ChainProgress(err, shown=not (quiet or json_)) as progress,
        progress.stage("Settling") as tell,
        telling(shown=not (quiet or json_)),
        keeping_last_good(output),
    ):
        settled = grainsdem.settle(
            packing,
            start=start,
            spheres=spheres,
            friction=shares("friction", friction),
            wall_friction=checked_coefficients("wall_friction", wall_friction),
            mixing=mixing,
            rolling_friction=rolling_friction,
            restitution=restitution,
            gravity=gravity,
            direction=direction,
            density=shares("density", density),
            drop_height=drop_height,
            rng=rng,
            time_step=time_step,
            max_time=max_time,
            max_hours=max_hours,
            history_path=history,
            resume=resume,
            progress=settling_words(tell),
        )
    storage.save(settled.packing, output)
    summary = {**grainsdem.summary(settled.packing, settled.contacts), **settled.report.to_dict()}
    if json_:
        print_json(summary)
    elif not quiet:
        print_settling(out, str(output), summary)


@app.command()
@guarded
def heal(
    bed: Bed,
    output: Annotated[Path, typer.Argument(help="The healed packing to write (.h5).", show_default=False)],
    gap: Annotated[float, typer.Option(help="Gap [m] that is left everywhere.", min=0)] = 0.0,
    by: Annotated[
        Literal["scale", "inset"], typer.Option(help="Scale grains about their centroids, or move their faces inward.")
    ] = "scale",
    each: Annotated[
        Literal["grain", "uniform"], typer.Option(help="Change only the grains that are too near, or all alike.")
    ] = "grain",
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make grains smaller by as little as takes them apart, as CFD needs of a settled bed whose contacts overlap."""
    from grainsdem import storage
    from grainsdem.screen import print_facts

    storage.check_suffix(output)
    prepare("contacts", "shapes", quiet=quiet)
    packing = load(bed)
    healed = grainsdem.heal(packing, gap=gap, by=by, each=each)
    storage.save(healed.packing, output)
    changes = {f"{name}_change": getattr(healed, f"{name}_change") for name in ("volume", "area", "porosity")}
    changed = int(((healed.scales < 1) | (healed.insets > 0)).sum())
    if json_:
        print_json({"grains": len(packing), "grains_changed": changed, **changes})
    elif not quiet:
        facts = {"grains changed": f"{changed} of {len(packing)}"}
        facts |= {" ".join(name.split("_")): f"{value:+.3e}" for name, value in changes.items()}
        print_facts(out, str(output), facts)
