"""Commands that make a bed: demo, run, generate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from grainsdem.cli.options import Json, Quiet, Rng, app, err, guarded, out, print_json, show_summary


@app.command()
@guarded
def demo(
    folder: Annotated[Path, typer.Option(help="Where the files go.")] = Path("grainsdem_demo"),
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the main example: a bed of ASTM 20/30 Ottawa sand, from seeds to grains at rest."""
    from grainsdem.recipe import EXAMPLE

    _run(EXAMPLE, folder, json_=json_, quiet=quiet)


@app.command()
@guarded
def run(
    recipe: Annotated[Path, typer.Argument(help="A recipe (.toml).", show_default=False)],
    folder: Annotated[
        Path | None, typer.Option(help="Where the files go; by default a folder named like the recipe.")
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Make the bed that a recipe describes: grow, validate, write, settle, validate, write."""
    _run(recipe, folder or Path(recipe.stem), json_=json_, quiet=quiet)


def _run(recipe: Path, folder: Path, *, json_: bool, quiet: bool) -> None:
    from grainsdem import recipe as recipes
    from grainsdem.screen import ChainProgress, print_result

    wanted = recipes.read(recipe)
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        result = recipes.run(wanted, folder, progress)
    if json_:
        print_json({**result.summaries, "files": [str(path) for path in result.files]})
    elif not quiet:
        print_result(out, wanted.name, result)


@app.command()
@guarded
def generate(
    output: Annotated[Path, typer.Argument(help="The packing to write (.h5).", show_default=False)],
    count: Annotated[int | None, typer.Option(help="Number of seeds.", min=1)] = None,
    process: Annotated[Literal["halton", "poisson"], typer.Option(help="How seeds are placed.")] = "halton",
    seeds: Annotated[
        Path | None, typer.Option(help="Your own seeds: .txt, .csv, .npy or .npz, three columns in metres.")
    ] = None,
    shape: Annotated[
        Literal["box", "slab", "cylinder", "hopper"],
        typer.Option(help="What grains grow in; a slab is one grain thick: two-dimensional work."),
    ] = "box",
    lengths: Annotated[
        tuple[float, float, float] | None,
        typer.Option(help="Edge lengths of a box [m], by default 1 1 1, or of a slab, its thickness last."),
    ] = None,
    periodic: Annotated[str, typer.Option(help="Axes that wrap around, such as xy.")] = "",
    radius: Annotated[float | None, typer.Option(help="Radius of a cylinder [m].")] = None,
    height: Annotated[float | None, typer.Option(help="Height of a cylinder or hopper [m].")] = None,
    top: Annotated[tuple[float, float] | None, typer.Option(help="Lengths of a hopper's upper opening [m].")] = None,
    bottom: Annotated[tuple[float, float] | None, typer.Option(help="Lengths of a hopper's lower opening [m].")] = None,
    relax: Annotated[int, typer.Option(help="Lloyd iterations: more make grains rounder and more alike.", min=0)] = 0,
    keep: Annotated[
        Literal["inside", "all"], typer.Option(help="Whether cells that touch a wall are dropped.")
    ] = "inside",
    porosity: Annotated[float | None, typer.Option(help="Void fraction, reached exactly, in [0, 1).")] = None,
    scale: Annotated[float | None, typer.Option(help="Linear factor that grains shrink by, in (0, 1].")] = None,
    median_diameter: Annotated[
        float | None, typer.Option(help="Median diameter by mass [m]: the whole bed is scaled to it.")
    ] = None,
    density: Annotated[float, typer.Option(help="Density [kg/m³].")] = 2650.0,
    rng: Rng = 0,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Grow a bed of grains from seeds and write it as HDF5."""
    from grainsdem import recipe as recipes
    from grainsdem import storage
    from grainsdem.screen import ChainProgress

    storage.check_suffix(output)
    if porosity is None and scale is None:
        scale = 1.0
    wanted = recipes.make(
        name=output.stem,
        rng=rng,
        domain={
            "shape": shape,
            "lengths": lengths,
            "periodic": periodic,
            "radius": radius,
            "height": height,
            "top": top,
            "bottom": bottom,
        },
        seeds={
            "process": "file" if seeds else process,
            "count": count,
            "path": None if seeds is None else str(seeds),
            "relax": relax,
        },
        grains={
            "keep": keep,
            "porosity": porosity,
            "scale": scale,
            "median_diameter": median_diameter,
            "density": density,
        },
    )
    with ChainProgress(err, shown=not (quiet or json_)) as progress:
        packing = recipes.grow(wanted, progress)
    storage.save(packing, output)
    show_summary(packing, json_=json_, quiet=quiet, title=str(output))


@app.command()
@guarded
def survey(
    recipe: Annotated[
        Path, typer.Argument(help="A recipe (.toml), with a table [survey] or with --vary.", show_default=False)
    ],
    output: Annotated[Path, typer.Argument(help="The table to write, or to go on with (.csv).", show_default=False)],
    vary: Annotated[
        list[str] | None, typer.Option(help="A key of the recipe and its values, such as seeds.count=100,200,400.")
    ] = None,
    repeats: Annotated[int | None, typer.Option(help="Beds for each case.", min=1)] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.", min=1)] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Grow a bed for every combination of some parameters, and write what they measure as one table.

    An interrupted survey goes on where it was.
    """
    from grainsdem import survey as surveys
    from grainsdem.recipe import counting_words
    from grainsdem.screen import ChainProgress

    plan = surveys.read(recipe, vary=surveys.parse_vary(vary or []), repeats=repeats)
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Growing beds") as tell:
        table = surveys.run(plan, output, workers=workers, progress=counting_words(tell, "beds"))
    failed = int((table["error"] != "").sum())
    if json_:
        print_json({"rows": len(table), "failed": failed, "files": [str(output)]})
    elif not quiet:
        out.print(f"wrote {output}: {len(table)} beds, {failed} could not be grown", highlight=False)
