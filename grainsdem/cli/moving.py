"""Commands that change the grains of a bed: settle, heal."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import grainsdem
from grainsdem.cli.guard import Written, guarded, out
from grainsdem.cli.made import History, MaxHours, Resume, made_command, running
from grainsdem.cli.options import Bed, Json, Quiet, Rng, app, load, prepare, print_json

FIRST: dict[str, tuple[Any, Any]] = {
    "bed": (Bed, ...),
    "output": (
        Annotated[
            Path,
            typer.Argument(help="The settled packing to write (.h5).", show_default=False),
            Written("grainsdem.storage:check_suffix"),
        ],
        ...,
    ),
}  # fmt: skip
"""What the command that settles takes before the options."""

LAST: dict[str, tuple[Any, Any]] = {
    "max_hours": (MaxHours, 24.0), "history": (History, None), "resume": (Resume, False), "rng": (Rng, 0),
    "json_": (Json, False), "quiet": (Quiet, False),
}  # fmt: skip
"""What it takes behind them."""


def settle_command() -> Any:
    """Return the command that settles a bed, with the options that `grainsdem.settle` says."""
    from grainsdem.described import description

    return made_command(description(grainsdem.settle), _settle, first=FIRST, last=LAST)


def _settle(
    *,
    bed: Path,
    output: Path,
    max_hours: float,
    history: Path | None,
    resume: bool,
    rng: int,
    json_: bool,
    quiet: bool,
    **options: Any,
) -> None:
    """Settle a bed, write it, and print how it went."""
    from grainsdem import storage
    from grainsdem.recipe import settling_words
    from grainsdem.screen import print_settling

    prepare("contacts", "shapes", quiet=quiet)
    packing = load(bed)
    with running("Settling", output, shown=not (quiet or json_)) as tell:
        settled = grainsdem.settle(
            packing,
            **options,
            rng=rng,
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
    output: Annotated[
        Path,
        typer.Argument(help="The healed packing to write (.h5).", show_default=False),
        Written("grainsdem.storage:check_suffix"),
    ],
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
