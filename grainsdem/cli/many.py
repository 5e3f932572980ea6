"""Commands that make many beds: survey, images."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from grainsdem.cli.guard import Written, err, guarded, out
from grainsdem.cli.options import Json, Quiet, app, keyed, prepare, print_json
from grainsdem.errors import InputError


@app.command()
@guarded
def survey(
    recipe: Annotated[
        Path, typer.Argument(help="A recipe (.toml), with a table [survey] or with --vary.", show_default=False)
    ],
    output: Annotated[
        Path,
        typer.Argument(help="The table to write, or to go on with (.csv).", show_default=False),
        Written("grainsdem.measures.grains.files:check_csv"),
    ],
    vary: Annotated[
        list[str] | None, typer.Option(help="A key of the recipe and its values, such as seeds.count=100,200,400.")
    ] = None,
    repeats: Annotated[int | None, typer.Option(help="Beds for each case.", min=1)] = None,
    means: Annotated[
        Path | None,
        typer.Option(help="Also write each case's means with half their 95 % intervals (.csv, .parquet, .h5)."),
        Written("grainsdem.measures.grains.files:check_table"),
    ] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.", min=1)] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Grow a bed for every combination of some parameters, and write what they measure as one table.

    An interrupted survey goes on where it was.
    """
    import grainsdem
    from grainsdem import survey as surveys
    from grainsdem.recipe import counting_words
    from grainsdem.screen import ChainProgress

    plan = surveys.read(recipe, vary=surveys.parse_vary(vary or []), repeats=repeats)
    prepare("cells", "lloyd", "shapes", "contacts", quiet=quiet)
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Growing beds") as tell:
        table = surveys.run(plan, output, workers=workers, progress=counting_words(tell, "beds"))
    if means is not None:
        grainsdem.write_table(surveys.means(table), means)
    failed = int((table["error"] != "").sum())
    if json_:
        print_json({"rows": len(table), "failed": failed, "files": [str(p) for p in (output, means) if p is not None]})
    elif not quiet:
        out.print(f"wrote {output}: {len(table)} beds, {failed} could not be grown", highlight=False)


@app.command()
@guarded
def images(
    recipe: Annotated[
        Path, typer.Argument(help="A recipe (.toml); its table [images] says what differs.", show_default=False)
    ],
    folder: Annotated[
        Path,
        typer.Argument(help="The folder for images and truth, or one to go on with.", show_default=False),
        Written(is_folder=True),
    ],
    count: Annotated[int, typer.Option(help="Number of photographs.")],
    per_bed: Annotated[int | None, typer.Option(help="Photographs of each bed. [default: 1]")] = None,
    stones: Annotated[
        int | None, typer.Option(help="Points of the grid that stones are counted by on each. [default: 100]")
    ] = None,
    labels: Annotated[
        list[str] | None,
        typer.Option(help="Write which grain each pixel shows: png, npy or tif; may be repeated.", show_default=False),
    ] = None,
    set_: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            help="A key of the recipe's table [images], such as size=[256,256], blur=[0,1.5], wet=0.3 or "
            "lens=[[-0.2,0.1],0]; may be repeated.",
            show_default=False,
        ),
    ] = None,
    rng: Annotated[int | None, typer.Option(help="Seed of the set, instead of the recipe's.", min=0)] = None,
    workers: Annotated[int | None, typer.Option(help="Processes; by default one for each core.", min=1)] = None,
    sheet: Annotated[
        Path | None,
        typer.Option(help="Also draw the first twelve side by side (.png)."),
        Written("grainsdem.figures.frame:check_suffix"),
    ] = None,
    json_: Json = False,
    quiet: Quiet = False,
) -> None:
    """Grow beds, photograph them, and write images with one table of what is true of each: truth.csv.

    An interrupted set goes on where it was, and a larger count adds to it.
    """
    import grainsdem
    from grainsdem import recipe as recipes
    from grainsdem.screen import ChainProgress

    given = {"per_bed": per_bed, "stones": stones, "labels": labels}
    asked = {**keyed(set_ or []), **{name: value for name, value in given.items() if value is not None}}
    wanted = recipes.with_images(recipes.read(recipe), **asked)
    wanted = wanted if rng is None else wanted.model_copy(update={"rng": rng})
    formats = [] if wanted.images is None else wanted.images.formats
    if sheet is not None and "png" not in formats:
        raise InputError(f"a sheet is drawn from png; the set has {', '.join(formats)} only")
    prepare("cells", "lloyd", "shapes", "contacts", quiet=quiet)
    with ChainProgress(err, shown=not (quiet or json_)) as progress, progress.stage("Photographing") as tell:
        told = recipes.counting_words(tell, "images")
        table = grainsdem.images(wanted, folder, count=count, workers=workers, progress=told)
    taken = table[table["error"] == ""]
    if sheet is not None and taken.size:
        pictures = [(folder / name).with_suffix(".png") for name in taken["file"][:12].tolist()]
        grainsdem.figures.contact_sheet(pictures, sheet)
    if json_:
        print_json({"rows": len(table), "failed": len(table) - taken.size, "files": [str(folder / "truth.csv")]})
    elif not quiet:
        failed = len(table) - taken.size
        out.print(f"wrote {folder}: {taken.size} images, {failed} could not be taken", highlight=False)
