"""Commands that move grains with MuJoCo: settle."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

import grainsdem
from grainsdem.cli.options import Bed, Json, Quiet, Rng, app, err, guarded, load, out, print_json


@app.command()
@guarded
def settle(
    bed: Bed,
    output: Annotated[Path, typer.Argument(help="The settled packing to write (.h5).", show_default=False)],
    pour: Annotated[
        bool,
        typer.Option("--pour/--in-place", help="Rotate, reorder and pour the grains, or let them settle in place."),
    ] = True,
    friction: Annotated[float, typer.Option(help="Coefficient of friction among grains.")] = 0.5,
    wall_friction: Annotated[
        float | None, typer.Option(help="The same with the walls; by default as among grains.")
    ] = None,
    time_step: Annotated[float, typer.Option(help="Time step in units of √(d/g).")] = 0.01,
    max_time: Annotated[float, typer.Option(help="Time limit in units of √(d/g).")] = 200.0,
    history: Annotated[
        Path | None,
        typer.Option(help="Write the history here while the run goes (.h5); an interrupted run keeps it."),
    ] = None,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Let grains fall under gravity in their container until they are at rest (MuJoCo)."""
    from grainsdem import storage
    from grainsdem.recipe import keeping_last_good, settling_words
    from grainsdem.screen import ChainProgress, print_settling

    storage.check_suffix(output)
    packing = load(bed)
    start = grainsdem.shuffle(packing, rng=rng) if pour else packing
    with (
        ChainProgress(err, shown=not (quiet or json_)) as progress,
        progress.stage("Settling") as tell,
        keeping_last_good(output),
    ):
        settled = grainsdem.settle(
            start,
            friction=friction,
            wall_friction=wall_friction,
            time_step=time_step,
            max_time=max_time,
            history_path=history,
            progress=settling_words(tell),
        )
    storage.save(settled.packing, output)
    summary = {**grainsdem.summary(settled.packing, settled.contacts), **settled.report.to_dict()}
    if json_:
        print_json(summary)
    elif not quiet:
        print_settling(out, str(output), summary)
